from dataclasses import replace

import numpy as np
import pytest

from phd_jdtc_ros.study import monte_carlo
from phd_jdtc_ros.study.monte_carlo import Store
from phd_jdtc_ros.study.monte_carlo.kinds import KINDS
from phd_jdtc_ros.study.monte_carlo.tasks import perform
from phd_jdtc_ros.tools.monte_carlo import load_study


def test_plan_shares_a_filter_among_readings(study):
    plan = monte_carlo.plan(study, [4, 5])

    groups = [[variant.name for variant in task.variants] for task in plan.tasks]
    assert groups == [["corrected", "as printed"], ["fewer"], ["reference"]] * 2
    assert [task.seed for task in plan.tasks] == [4, 4, 4, 5, 5, 5]


def test_plan_leaves_out_peers_that_are_not_installed(study_file):
    kinds = {**KINDS, "jpda": replace(KINDS["jpda"], track=len, package="no_such_package")}

    def change(document):
        document["variants"]["JPDA"] = {"kind": "jpda"}
        document["variants"]["GNN"] = {"kind": "gnn"}

    plan = monte_carlo.plan(load_study(study_file(change), {}, kinds), [0])

    assert plan.notes == [
        "JPDA: left out, no_such_package is not installed",
        "GNN: left out, it runs with `python -m studies monte_carlo` in the repository",
    ]
    assert {task.kind.name for task in plan.tasks} == {"particles", "reference"}


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


def test_remaining_keeps_the_variants_that_are_not_stored(study, tmp_path):
    store = Store(tmp_path)
    task = monte_carlo.plan(study, [0]).tasks[0]
    first, second = task.variants
    store.write(task, first, perform(replace(task, variants=(first,))).scores[first.name])

    (rest,) = monte_carlo.remaining([task], store)

    assert rest.variants == (second,)


@pytest.mark.parametrize(
    "change",
    [
        lambda document: document.update(lags=[0, 1]),
        lambda document: document["cases"]["quiet"]["parameters"].update({"spawn.rate": 0.02}),
        lambda document: document["variants"]["corrected"].update(death_term="paper"),
        lambda document: document["variants"]["corrected"].update(parameters={"spawn.rate": 0.02}),
    ],
)
def test_digest_follows_the_definition(study, study_file, change):
    one, other = (
        monte_carlo.plan(s, [0]).tasks[0].digests["corrected"]
        for s in (study, load_study(study_file(change), {}))
    )
    assert one != other


def test_digest_does_not_depend_on_other_variants(study, study_file):
    alone = load_study(study_file(lambda d: d["variants"].pop("as printed")), {})
    one, other = (monte_carlo.plan(s, [0]).tasks[0].digests["corrected"] for s in (study, alone))

    assert one == other


def test_plan_gives_cases_and_variants_their_shares_of_the_runs(study_file):
    def change(document):
        document["cases"]["quiet"]["run_share"] = 0.5
        document["variants"]["fewer"]["run_share"] = 0.2

    study = load_study(study_file(change), {})
    plan = monte_carlo.plan(study, range(3, 10))
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
    in_full = monte_carlo.plan(study.in_full, every)
    assert [task.seed for task in in_full.tasks] == [seed for seed in every for _ in range(3)]
