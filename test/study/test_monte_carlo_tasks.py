import os
import subprocess
import sys
import textwrap
from dataclasses import replace
from functools import partial
from pathlib import Path

import fatal_tasks
import numpy as np
import pytest
from fatal_tasks import alone, die_of_one, die_once
from fatal_tasks import tasks as light_tasks

from phd_jdtc_ros.study import tasks as study_tasks
from phd_jdtc_ros.study.definition import KINDS
from phd_jdtc_ros.study.tasks import Store, perform
from phd_jdtc_ros.tools.monte_carlo import load_study


@pytest.fixture
def sharing(study_file):
    """A study with one more variant, which differs from the first one in its lags alone."""

    def change(document):
        document["variants"]["sooner"] = {"kind": "phd", "lags": [0, 1]}

    return load_study(study_file(change), {})


def test_plan_shares_a_filter_among_variants_of_a_kind_with_equal_parameters(sharing):
    plan = study_tasks.plan(sharing, [4, 5])
    groups = [[variant.name for variant in task.variants] for task in plan.tasks]
    assert groups == [["corrected", "sooner"], ["as printed"], ["fewer"], ["reference"]] * 2
    assert [task.seed for task in plan.tasks] == [4] * 4 + [5] * 4


def test_variants_that_share_a_filter_have_the_scores_that_they_have_alone(sharing):
    shared, *_ = study_tasks.plan(sharing, [4]).tasks
    outcome = perform(shared)
    assert outcome.error == ""
    for variant in shared.variants:
        alone = perform(replace(shared, variants=(variant,))).scores[variant.name]
        found = outcome.scores[variant.name]
        assert found.lags == alone.lags == variant.lags
        np.testing.assert_array_equal(found.values, alone.values)


def test_plan_leaves_out_peers_that_are_not_installed(study_file):
    kinds = {**KINDS, "jpda": replace(KINDS["jpda"], track=len, package="no_such_package")}

    def change(document):
        document["variants"]["JPDA"] = {"kind": "jpda"}
        document["variants"]["GNN"] = {"kind": "gnn"}

    plan = study_tasks.plan(load_study(study_file(change), {}, kinds), [0])

    assert plan.notes == [
        "JPDA: left out, no_such_package is not installed",
        "GNN: left out, it runs with `python -m studies monte_carlo` in the repository",
    ]
    assert {task.kind.name for task in plan.tasks} == {"phd", "phd_as_printed", "reference"}


def test_store_reads_back_what_it_wrote(tasks, tmp_path):
    store = Store(tmp_path / "parts")
    outcome = perform(tasks[0])
    (variant,) = tasks[0].variants
    store.write(tasks[0], variant, outcome.scores[variant.name])
    found = store.read(tasks[0], variant)
    assert outcome.error == ""
    assert found[:2] == outcome.scores[variant.name][:2]
    np.testing.assert_array_equal(found.time_s, 6.0 * np.arange(6))
    np.testing.assert_array_equal(found.values, outcome.scores[variant.name].values)
    np.testing.assert_array_equal(found.taken_for, outcome.scores[variant.name].taken_for)
    assert [path.name for path in store.directory.iterdir()] == [store.path(tasks[0], variant).name]


def test_store_takes_a_damaged_file_for_none(tasks, tmp_path):
    store = Store(tmp_path)
    (variant,) = tasks[0].variants
    store.write(tasks[0], variant, perform(tasks[0]).scores[variant.name])
    path = store.path(tasks[0], variant)
    whole = path.read_bytes()
    for damaged in (b"", b"text", whole[: len(whole) // 2]):
        path.write_bytes(damaged)
        assert store.read(tasks[0], variant) is None


def test_remaining_keeps_the_variants_that_are_not_stored(sharing, tmp_path):
    store = Store(tmp_path)
    task = study_tasks.plan(sharing, [0]).tasks[0]
    first, second = task.variants
    store.write(task, first, perform(replace(task, variants=(first,))).scores[first.name])
    (rest,) = study_tasks.remaining([task], store)
    assert rest.variants == (second,)


@pytest.mark.parametrize(
    "change",
    [
        lambda document: document.update(lags=[0, 1]),
        lambda document: document["cases"]["quiet"]["parameters"].update({"spawn.rate": 0.02}),
        lambda document: document["variants"]["corrected"].update(kind="phd_as_printed"),
        lambda document: document["variants"]["corrected"].update(parameters={"spawn.rate": 0.02}),
    ],
)
def test_digest_follows_the_definition(study, study_file, change):
    one, other = (
        study_tasks.plan(s, [0]).tasks[0].digests["corrected"]
        for s in (study, load_study(study_file(change), {}))
    )
    assert one != other


def test_digest_does_not_depend_on_other_variants(study, study_file):
    alone = load_study(study_file(lambda d: d["variants"].pop("as printed")), {})
    one, other = (study_tasks.plan(s, [0]).tasks[0].digests["corrected"] for s in (study, alone))
    assert one == other


def test_plan_gives_cases_and_variants_their_shares_of_the_runs(study_file):
    def change(document):
        document["cases"]["quiet"]["run_share"] = 0.5
        document["variants"]["fewer"]["run_share"] = 0.2

    study = load_study(study_file(change), {})
    plan = study_tasks.plan(study, range(3, 10))
    seeds = {}
    for task in plan.tasks:
        for variant in task.variants:
            seeds.setdefault(variant.name, []).append(task.seed)
    every = list(range(3, 10))
    assert seeds == {
        "corrected": every[:4],
        "as printed": every[:4],
        "fewer": every[:2],
        "reference": every[:4],
    }
    in_full = study_tasks.plan(study.in_full, every)
    assert [task.seed for task in in_full.tasks] == [seed for seed in every for _ in range(4)]


def on_processes(tasks, report, *work):
    study_tasks.run_on_processes(tasks, 2, report, *work)


def seeds(outcomes):
    assert not any(outcome.error for outcome in outcomes)
    return sorted(outcome.task.seed for outcome in outcomes)


def test_dask_workers_do_what_perform_does(cluster, tasks):
    """Those of a pool do too: see `test_main_gives_the_same_bytes_however_it_is_run`."""
    found = []
    study_tasks.run_on_dask(tasks, cluster, found.append)
    assert seeds(found) == [0, 1]
    for each in found:
        expected = perform(each.task).scores["corrected"].values
        np.testing.assert_array_equal(each.scores["corrected"].values, expected)


def test_dask_runs_a_dead_workers_tasks_again(cluster, tmp_path):
    found = []
    work = partial(die_once, tmp_path / "died", 1)
    study_tasks.run_on_dask(light_tasks(5), cluster, found.append, work)
    assert (tmp_path / "died").exists()
    assert seeds(found) == [0, 1, 2, 3, 4]


def test_run_on_processes_leaves_a_processor_to_what_takes_it(tmp_path):
    found = []
    work = partial(alone, tmp_path / "active")
    study_tasks.run_on_processes(light_tasks(4), 2, found.append, work, busy=lambda: 1)
    assert seeds(found) == [0, 1, 2, 3]
    # However much is taken, one worker goes on.
    study_tasks.run_on_processes(light_tasks(1), 1, found.append, work, busy=lambda: 1)
    assert seeds(found) == [0, 0, 1, 2, 3]


def test_run_on_processes_runs_lost_tasks_again_and_gives_up_on_the_guilty_one_alone(
    monkeypatch, tmp_path
):
    monkeypatch.setattr(study_tasks, "TRIES", 2)
    found = []
    work = partial(die_of_one, 1, tmp_path / "died", 3)
    on_processes(light_tasks(4), found.append, work)
    assert (tmp_path / "died").exists()
    (failed,) = [outcome for outcome in found if outcome.error]
    found.remove(failed)
    assert seeds(found) == [0, 2, 3]
    assert failed.task.seed == 1
    assert "died" in failed.error


def test_run_on_processes_is_interrupted_while_a_worker_sends_an_outcome(tmp_path):
    script = f"""
        from pathlib import Path
        from fatal_tasks import interrupt_a_worker_that_sends
        if __name__ == "__main__":
            interrupt_a_worker_that_sends(Path({str(tmp_path / "marker")!r}))
    """
    (tmp_path / "main.py").write_text(textwrap.dedent(script))
    path = os.pathsep.join([str(Path(fatal_tasks.__file__).parent), str(Path(__file__).parents[2])])
    ended = subprocess.run(
        [sys.executable, tmp_path / "main.py"],
        env={**os.environ, "PYTHONPATH": path},
        stderr=subprocess.PIPE,
        timeout=60,
        check=False,
    )
    assert ended.stderr.decode().strip().endswith("KeyboardInterrupt")
