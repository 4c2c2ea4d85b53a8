import contextlib
import copy
import csv
import json
import math
import os
import signal
import subprocess
import sys
import textwrap
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml

from phd_jdtc_ros.core.config import ConfigError
from phd_jdtc_ros.core.evaluation import PointSet
from phd_jdtc_ros.core.motion import POSITION
from phd_jdtc_ros.study import monte_carlo
from phd_jdtc_ros.study.monte_carlo import (
    FIGURES,
    HEADER,
    VALUES,
    Mean,
    Outcome,
    Result,
    Scores,
    Store,
    Variant,
)
from phd_jdtc_ros.study.runs import simulated_run
from phd_jdtc_ros.tools.monte_carlo import load_study, main

ROOT = Path(__file__).parents[2]
SCENARIO = """
scans: 6
parameters:
  particles_per_target: 100
  radar_1: {clutter_rate: 3.0}
targets:
  - {class_id: 0, snr_db: 45.0, position: [-10000.0, 10000.0], velocity: [36.0, -44.0],
     first_scan: 0, last_scan: 5}
  - {class_id: 1, snr_db: 25.0, position: [-10000.0, -10000.0], velocity: [36.0, 44.0],
     first_scan: 1, last_scan: 4}
"""
FEW = {"particles_per_birth": 64, "least_particles": 20, "spawn.particles_per_target": 10}
STUDY = {
    "lags": [0, 2],
    "cases": {
        "quiet": {"scenario": "short.yaml", "parameters": {**FEW, "radar_2.clutter_rate": 3.0}}
    },
    "variants": {
        "corrected": {"kind": "ours"},
        "as printed": {"kind": "ours", "death_term": "paper", "extraction": "clusters"},
        "fewer": {"kind": "ours", "parameters": {"particles_per_target": 50}, "lags": [0, 1]},
        "reference": {"kind": "reference"},
    },
    "goals": [
        {
            "name": "localisation",
            "case": "quiet",
            "variant": "corrected",
            "lag": 2,
            "figure": "localization",
            "at_most": 100.0,
            "relative_to": "reference",
        }
    ],
}


@pytest.fixture
def study_file(tmp_path):
    """Return a function that writes a study, changed by a function, and returns its path."""
    (tmp_path / "short.yaml").write_text(SCENARIO)

    def write(change=lambda document: None):
        document = copy.deepcopy(STUDY)
        change(document)
        path = tmp_path / "study.yaml"
        path.write_text(yaml.safe_dump(document, sort_keys=False))
        return path

    return write


@pytest.fixture
def study(study_file):
    return load_study(study_file(), {})


@pytest.fixture
def tasks(study):
    """The tasks of two runs of one variant."""
    return monte_carlo.plan(study.select([], ["corrected"]), range(2)).tasks


@pytest.fixture
def start(study_file, tmp_path):
    """Return a function that runs the tool on the small study into a directory of the test."""

    def run(*arguments, change=lambda document: None, out="out"):
        path = tmp_path / out
        place = [] if "--dask" in arguments else ["--workers", "1"]
        asked = ["--study", str(study_file(change)), "--out", str(path), "--runs", "2", *place]
        return main([*asked, *map(str, arguments)]), path

    return run


def faults(study_file, change, assigned=None):
    with pytest.raises(ConfigError) as caught:
        load_study(study_file(change), assigned or {})
    return list(caught.value.faults)


def parts(out):
    return {path.name: path.stat().st_mtime_ns for path in (out / "parts").iterdir()}


def rows_of(out):
    with (out / "results.csv").open(newline="") as file:
        return list(csv.DictReader(file))


# --- the definition -------------------------------------------------------------------------------


def test_resolve_takes_the_published_study():
    study = load_study(ROOT / "config" / "studies" / "published.yaml", {})

    assert [case.name for case in study.cases] == [
        "clutter 20",
        "clutter 10",
        "clutter 50",
        "one_radar",
        "manoeuvring",
        "three_classes",
    ]
    assert {variant.kind for variant in study.variants} == set(monte_carlo.KINDS)


def test_resolve_lists_every_fault(study_file):
    def spoil(document):
        document["lags"] = [0, -1]
        document["colour"] = "red"
        document["cases"]["quiet"]["parameters"]["radar_1.clutter_rate"] = -3.0
        document["cases"]["nowhere"] = {"scenario": "absent.yaml"}
        document["cases"]["nothing"] = {}
        document["variants"]["wrong"] = {"kind": "theirs", "cases": ["loud"], "size": 1}
        document["variants"]["reference"]["parameters"] = {}
        document["variants"]["corrected"] |= {"death_term": "none", "lags": "all"}
        document["variants"]["as printed"]["parameters"] = {"lag": 3}
        document["goals"][0] |= {"figure": "beauty", "at_least": 1.0}

    found = faults(study_file, spoil)

    assert sorted(fault.split(": ")[0] for fault in found) == [
        "cases.nothing.scenario",
        "cases.nowhere.scenario",
        "cases.quiet.parameters.radar_1.clutter_rate",
        "colour",
        "goals[0].at_most",
        "goals[0].figure",
        "lags",
        "variants.as printed.parameters.lag",
        "variants.corrected.death_term",
        "variants.corrected.lags",
        "variants.reference.parameters",
        "variants.wrong.cases",
        "variants.wrong.kind",
        "variants.wrong.size",
    ]


def test_resolve_lists_faults_of_the_variants_parameters(study_file):
    def spoil(document):
        document["variants"]["fewer"]["parameters"] = {"particles_per_target": 0, "nonsense": 1}

    found = faults(study_file, spoil)

    assert [fault.split(": ")[0] for fault in found] == [
        "variants.fewer.parameters.particles_per_target",
        "variants.fewer.parameters.nonsense",
    ]


def test_resolve_refuses_targets_of_a_class_that_the_tracker_does_not_have(study_file):
    def spoil(document):
        document["cases"]["quiet"]["parameters"] |= {
            "classes": ["only"],
            "spawn.class_transition": [],
            **{f"start_{k}.rates": [0.01] for k in range(1, 5)},
        }

    found = faults(study_file, spoil)

    assert found == ["cases.quiet.scenario: class 1 of a target, must be below 1"]


def test_resolve_names_the_command_line_for_its_faults(study_file):
    found = faults(study_file, lambda _: None, {"nonsense": 1, "seed": 3})

    assert [fault.split(": ")[0] for fault in found] == ["-p seed", "-p nonsense"]


@pytest.mark.parametrize("document", [None, [], "study"])
def test_resolve_refuses_what_is_no_mapping(document):
    with pytest.raises(ConfigError, match="study: must be a mapping"):
        monte_carlo.resolve(document, None, {})


@pytest.mark.parametrize("key", ["lags", "cases", "variants"])
def test_resolve_refuses_a_study_without_a_part(study_file, key):
    found = faults(study_file, lambda document: document.pop(key))

    assert any(fault.startswith(f"{key}: ") for fault in found)


def test_resolve_merges_scenario_case_variant_and_command_line(study_file):
    def change(document):
        document["cases"]["quiet"]["parameters"]["particles_per_target"] = 80

    study = load_study(study_file(change), {"spawn.rate": 0.02})
    (case,) = study.cases
    corrected, _, fewer, _ = (study.parameters(case, variant) for variant in study.variants)

    assert corrected["radar_1.clutter_rate"] == corrected["radar_2.clutter_rate"] == 3.0
    assert (corrected["particles_per_target"], fewer["particles_per_target"]) == (80, 50)
    assert corrected["spawn.rate"] == fewer["spawn.rate"] == 0.02


def test_merged_forgets_the_parts_that_a_later_layer_leaves_out():
    found = monte_carlo.merged(
        {"births": ["east", "west"], "east.rates": [1.0], "west.rates": [2.0], "lag": 3},
        {"births": ["west"]},
    )

    assert found == {"births": ["west"], "west.rates": [2.0], "lag": 3}


def test_merged_forgets_default_parts_too():
    assert monte_carlo.merged({"start_1.rates": [1.0]}, {"births": []}) == {"births": []}


def test_resolve_keeps_the_data_the_cases(study_file):
    def change(document):
        document["variants"]["fewer"]["parameters"] = {"radar_1.clutter_rate": 9.0}

    plan = monte_carlo.plan(load_study(study_file(change), {}), [0])

    assert {task.scenario.radars[0].clutter_rate for task in plan.tasks} == {3.0}


def test_select_lists_every_unknown_name(study):
    with pytest.raises(ConfigError) as caught:
        study.select(["loud"], ["corrected", "best"])

    assert [fault.split(" given")[0] for fault in caught.value.faults] == [
        "--case: 'loud'",
        "--variant: 'best'",
    ]


# --- plan and store -------------------------------------------------------------------------------


def test_plan_shares_a_filter_among_readings(study):
    plan = monte_carlo.plan(study, [4, 5])

    groups = [[variant.name for variant in task.variants] for task in plan.tasks]
    assert groups == [["corrected", "as printed"], ["fewer"], ["reference"]] * 2
    assert [task.seed for task in plan.tasks] == [4, 4, 4, 5, 5, 5]


def test_plan_leaves_out_peers_that_are_not_installed(study_file, monkeypatch):
    monkeypatch.setattr(monte_carlo, "PEERS_PACKAGE", "no_such_package")

    def change(document):
        document["variants"]["JPDA"] = {"kind": "jpda"}

    plan = monte_carlo.plan(load_study(study_file(change), {}), [0])

    assert plan.notes == ["JPDA: left out, no_such_package is not installed"]
    assert all(task.kind != "jpda" for task in plan.tasks)


def test_store_reads_back_what_it_wrote(tasks, tmp_path):
    store = Store(tmp_path / "parts")
    outcome = monte_carlo.perform(tasks[0])
    (variant,) = tasks[0].variants

    store.write(tasks[0], variant, outcome.scores[variant.name])
    found = store.read(tasks[0], variant)

    assert outcome.error == ""
    assert found[:2] == outcome.scores[variant.name][:2]
    np.testing.assert_array_equal(found.time_s, 6.0 * np.arange(6))
    np.testing.assert_array_equal(found.values, outcome.scores[variant.name].values)
    assert [path.name for path in store.directory.iterdir()] == [store.path(tasks[0], variant).name]


def test_store_takes_a_damaged_file_for_none(tasks, tmp_path):
    store = Store(tmp_path)
    (variant,) = tasks[0].variants
    store.write(tasks[0], variant, monte_carlo.perform(tasks[0]).scores[variant.name])
    path = store.path(tasks[0], variant)
    whole = path.read_bytes()

    for damaged in (b"", b"text", whole[: len(whole) // 2]):
        path.write_bytes(damaged)
        assert store.read(tasks[0], variant) is None


def test_remaining_keeps_the_variants_that_are_not_stored(study, tmp_path):
    store = Store(tmp_path)
    task = monte_carlo.plan(study, [0]).tasks[0]
    first, second = task.variants
    store.write(
        task, first, monte_carlo.perform(replace(task, variants=(first,))).scores[first.name]
    )

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


# --- scores ---------------------------------------------------------------------------------------


@pytest.fixture
def run(study):
    return simulated_run(study.cases[0].scenario, 0)


def exact(run):
    return [PointSet(truth.state[:, list(POSITION)], truth.class_id) for truth in run.truth]


def variant_of(kind, lags=(0,)):
    return Variant(kind, kind, None, {}, ("quiet",), lags)


def test_score_of_the_truth_is_perfect(run):
    scores = monte_carlo.score(run, {0: exact(run)}, variant_of("ours"), 2)
    of = {name: scores.values[0, :, 0, VALUES.index(name)] for name in VALUES}

    assert scores.sets == ("all", "class_0", "class_1")
    for name in ("ospa", "localization", "cardinality", "ospa_p1", "ospa_c300"):
        np.testing.assert_array_equal(of[name], 0.0)
    for name in ("n_true", "n_est", "pairs", "right_class"):
        np.testing.assert_array_equal(of[name], [1, 2, 2, 2, 2, 1])


def test_score_counts_wrong_classes_with_the_targets_class(run):
    wrong = [PointSet(points.position, 0 * points.class_id) for points in exact(run)]
    scores = monte_carlo.score(run, {0: wrong}, variant_of("ours"), 2)
    pairs, right = (scores.values[0, 1, :, VALUES.index(n)] for n in ("pairs", "right_class"))

    assert pairs.tolist() == [2, 1, 1]
    assert right.tolist() == [1, 1, 0]


def test_score_of_a_peer_has_no_classes(run):
    scores = monte_carlo.score(run, {0: exact(run)}, variant_of("jpda", (0, 3)), 2)

    assert (scores.lags, scores.sets) == ((0,), ("all",))
    assert np.isnan(scores.values[..., VALUES.index("right_class")]).all()


def test_score_refuses_a_tracker_without_the_wanted_lags(run):
    with pytest.raises(ValueError, match="lags"):
        monte_carlo.score(run, {0: exact(run)}, variant_of("jpda", (3,)), 2)


# --- summaries ------------------------------------------------------------------------------------


def test_mean_has_students_interval():
    mean = Mean.of(np.array([1.0, 2.0, 3.0, np.nan]))

    # t(0.975, 2) = 4.3027
    assert mean.mean == 2.0
    assert mean.half_width == pytest.approx(4.3027 / math.sqrt(3), rel=1e-4)


def test_mean_of_one_run_has_no_interval():
    assert Mean.of(np.array([3.0])).as_json() == {"mean": 3.0, "interval_95": None}
    assert Mean.of(np.array([np.nan])).as_json() is None
    assert Mean.of(None).as_json() is None


def result_of(variant, **values):
    """Two lags, two runs, one scan, all targets; `values` of shape (runs, lags)."""
    array = np.zeros((2, 2, 1, 1, len(VALUES)))
    for name, found in values.items():
        array[:, :, 0, 0, VALUES.index(name)] = found
    return Result("quiet", variant, (0, 1), Scores((0, 2), ("all",), np.zeros(1), array))


def test_result_reduction_is_paired_over_runs():
    result = result_of(variant_of("ours"), ospa=[[100.0, 50.0], [40.0, 30.0]])

    np.testing.assert_allclose(result.figure("reduction", 2), [0.5, 0.25])
    assert result.figure("reduction", 0) is None


def test_result_figures():
    result = result_of(
        variant_of("ours"),
        n_true=[[2, 2], [2, 2]],
        n_est=[[1, 4], [2, 2]],
        pairs=[[1, 2], [2, 0]],
        right_class=[[1, 1], [2, 0]],
    )

    assert result.figure("cardinality_abs_error", 2).tolist() == [2.0, 0.0]
    np.testing.assert_array_equal(result.figure("class_accuracy", 2), [0.5, np.nan])


@pytest.mark.parametrize(("value", "reached"), [(90.0, True), (110.0, False)])
def test_summarise_judges_goals(study, value, reached):
    corrected, *_, reference = study.variants
    results = [
        result_of(corrected, localization=[[0.0, value]] * 2),
        result_of(reference, localization=[[0.0, 1.0]] * 2),
    ]

    (goal,) = monte_carlo.summarise(study, results, [], [])["goals"]

    assert (goal["value"], goal["goal"], goal["reached"]) == (value, 100.0, reached)


def test_summarise_does_not_judge_what_it_does_not_have(study):
    (goal,) = monte_carlo.summarise(study, [], [], [])["goals"]

    assert (goal["value"], goal["goal"], goal["reached"]) == (None, None, None)


# --- many tasks -----------------------------------------------------------------------------------


def die_once(marker, task):
    """Kill the process at the first task of seed 1."""
    if task.seed == 1 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return Outcome(task)


def die_of_one(seed, task):
    if task.seed == seed:
        os.kill(os.getpid(), signal.SIGKILL)
    return Outcome(task)


def many(tasks, count):
    return [replace(tasks[0], seed=seed) for seed in range(count)]


def seeds(outcomes):
    return sorted(outcome.task.seed for outcome in outcomes)


def test_run_on_processes_does_what_perform_does(tasks):
    found = []
    monte_carlo.run_on_processes(tasks, 2, found.append)

    assert [outcome.error for outcome in found] == ["", ""]
    for outcome in found:
        expected = monte_carlo.perform(outcome.task).scores["corrected"].values
        np.testing.assert_array_equal(outcome.scores["corrected"].values, expected)


def test_run_on_processes_runs_a_dead_workers_tasks_again(tasks, tmp_path):
    found = []
    work = partial(die_once, tmp_path / "died")
    monte_carlo.run_on_processes(many(tasks, 5), 2, found.append, work)

    assert (tmp_path / "died").exists()
    assert seeds(found) == [0, 1, 2, 3, 4]
    assert not any(outcome.error for outcome in found)


def test_run_on_processes_gives_up_on_the_guilty_task_alone(tasks, monkeypatch):
    monkeypatch.setattr(monte_carlo, "TRIES", 2)
    found = []
    monte_carlo.run_on_processes(many(tasks, 4), 2, found.append, partial(die_of_one, 1))

    assert seeds(found) == [0, 1, 2, 3]
    (failed,) = [outcome for outcome in found if outcome.error]
    assert failed.task.seed == 1
    assert "died" in failed.error


def test_run_on_processes_restores_the_environment(tasks, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)

    monte_carlo.run_on_processes(tasks[:1], 1, lambda _: None, Outcome)

    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "MKL_NUM_THREADS" not in os.environ


@pytest.fixture(scope="module")
def cluster():
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as running:
        yield running.scheduler_address


def test_run_on_dask_does_what_perform_does(cluster, tasks):
    found = []
    monte_carlo.run_on_dask(tasks, cluster, found.append)

    assert [outcome.error for outcome in found] == ["", ""]
    for outcome in found:
        expected = monte_carlo.perform(outcome.task).scores["corrected"].values
        np.testing.assert_array_equal(outcome.scores["corrected"].values, expected)


def test_run_on_dask_runs_a_dead_workers_tasks_again(cluster, tasks, tmp_path):
    found = []
    work = partial(die_once, tmp_path / "died")
    monte_carlo.run_on_dask(many(tasks, 5), cluster, found.append, work)

    assert (tmp_path / "died").exists()
    assert seeds(found) == [0, 1, 2, 3, 4]
    assert not any(outcome.error for outcome in found)


def test_main_runs_on_dask(cluster, start):
    status, out = start("--dask", cluster, "--variant", "corrected")

    assert status == 0
    assert {row["seed"] for row in rows_of(out)} == {"0", "1"}


def test_main_refuses_a_dask_address_that_does_not_answer(start, monkeypatch, capsys):
    pytest.importorskip("distributed")
    monkeypatch.setattr(monte_carlo, "DASK_TIMEOUT_S", 1)

    assert start("--dask", "tcp://127.0.0.1:9")[0] == 2
    assert "--dask: 'tcp://127.0.0.1:9' given" in capsys.readouterr().err


# --- the tool -------------------------------------------------------------------------------------


def test_main_writes_everything(start):
    status, out = start()

    rows = rows_of(out)
    summary = json.loads((out / "summary.json").read_text())
    assert status == 0
    assert tuple(rows[0]) == HEADER
    # Two runs and two lags of six scans and three sets, four variants.
    assert len(rows) == 2 * 2 * 6 * 3 * 4
    assert {row["variant"] for row in rows} == set(STUDY["variants"])
    corrected = summary["cases"]["quiet"]["corrected"]
    assert (corrected["runs"], corrected["seeds"]) == (2, [0, 1])
    assert corrected["lags"].keys() == {"0", "2"}
    assert corrected["lags"]["2"].keys() == {"all", "class_0", "class_1"}
    assert corrected["lags"]["2"]["all"].keys() == set(FIGURES)
    assert corrected["lags"]["0"]["all"]["reduction"] is None
    assert summary["goals"][0]["reached"] is True
    assert "| corrected | 2 |" in (out / "table.md").read_text()
    assert (out / "figures" / "quiet" / "ospa_against_lag.png").exists()


def test_main_resumes_where_it_was(start, study_file):
    first = start("--variant", "corrected", "--runs", 1)[1]
    before = parts(first)
    status, out = start("--variant", "corrected")

    after = parts(out)
    assert status == 0
    assert len(after) == 2
    assert before.items() <= after.items()


def test_main_gives_the_same_bytes_however_it_is_run(start):
    start("--variant", "as printed", "--runs", 1, out="pieces")
    chosen = ("--variant", "corrected", "--variant", "as printed")
    _, pieces = start(*chosen, out="pieces")
    _, whole = start(*chosen, "--workers", 2, out="whole")

    for name in ("results.csv", "summary.json", "table.md"):
        assert (pieces / name).read_bytes() == (whole / name).read_bytes()


def test_main_reports_failures_and_goes_on(start, monkeypatch, capsys):
    code_of = monte_carlo.code_of
    wrong = lambda kind: "other" if kind == "ours" else code_of(kind)  # noqa: E731
    monkeypatch.setattr(monte_carlo, "code_of", wrong)
    status, out = start("--variant", "corrected", "--variant", "reference")

    summary = json.loads((out / "summary.json").read_text())
    assert status == 1
    assert [(f["variants"], f["seed"]) for f in summary["failed"]] == [
        (["corrected"], 0),
        (["corrected"], 1),
    ]
    assert summary["cases"]["quiet"]["reference"]["runs"] == 2
    assert "seed 1" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (["--runs", "0", "--workers", "0"], "--runs: 0 given"),
        (["--runs", "0", "--workers", "0"], "--workers: 0 given"),
        (["--first-seed", "-1"], "--first-seed: -1 given"),
        (["--case", "loud"], "--case: 'loud' given"),
        (["-p", "nonsense:=1"], "-p nonsense: unknown parameter"),
        (["--study", "absent.yaml"], "absent.yaml: cannot be read"),
    ],
)
def test_main_refuses_wrong_arguments(start, capsys, arguments, fault):
    status, out = start(*arguments)

    assert status == 2
    assert f"monte_carlo: {fault}" in capsys.readouterr().err
    assert not out.exists()


def alive_in_group(group):
    """Return the command lines of a group's processes, without those that have ended."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            # Behind the name in parentheses: state, parent, group.
            state, _, number = (path / "stat").read_text().rpartition(")")[2].split()[:3]
            if int(number) == group and state != "Z":
                found.append((path / "cmdline").read_text())
    return found


def test_main_keeps_what_is_done_when_interrupted(study_file, tmp_path):
    out = tmp_path / "out"
    arguments = ["--study", str(study_file()), "--out", str(out), "--runs", "2000"]
    script = f"""
        import sys
        from phd_jdtc_ros.tools.monte_carlo import main
        sys.exit(main({[*arguments, "--workers", "1"]!r}))
    """
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(script)],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    deadline = time.monotonic() + 60.0
    while not list(out.glob("parts/*.csv.gz")) and time.monotonic() < deadline:
        time.sleep(0.1)
    # As from a keyboard: to the workers too.
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=30)

    assert process.returncode == 130
    assert errors.decode().strip() == "monte_carlo: interrupted"
    assert list(out.glob("parts/*.csv.gz"))
    deadline = time.monotonic() + 10.0
    while alive_in_group(process.pid) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert alive_in_group(process.pid) == []
