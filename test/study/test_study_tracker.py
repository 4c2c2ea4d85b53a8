from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from inner import resolve

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.types import Detections, Pose
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.study import tasks as study_tasks
from phd_jdtc_ros.study.metrics import VALUES
from phd_jdtc_ros.study.tasks import perform
from phd_jdtc_ros.study.tracker import simulated_run, track
from phd_jdtc_ros.tools.monte_carlo import load_study

SCANS = 9
SEED = 3
GIVEN = {
    "engine": "phd",
    "particles": [150, 128],
    "budget.least": 30,
    "spawning.particles_per_target": 20,
    "seed": SEED,
}
ROOT = Path(__file__).parents[2]
# The aircraft that join are apart again after 190 s.
SWITCHING_SEED, LONGEST_S = 0, {"terminal radar, clean codes": 100}
STUDY = load_study(ROOT / "config" / "studies" / "published.yaml", {})
GOALS = [goal for goal in STUDY.goals if goal.name.endswith("against none")]


@pytest.fixture(scope="module")
def config():
    return resolve(GIVEN)


@pytest.fixture(scope="module")
def run(config):
    scenario = replace(paper_scenario(config.model.radars), scans=SCANS)
    return simulated_run(scenario, SEED)


@pytest.fixture(scope="module")
def tracks(run, config):
    return track(run, config, [0, 3])


def engine_positions(run, lag, given):
    """Return what the engine's own smoother finds, filtered and smoothed, a scan each."""
    engine = new_engine(resolve({**given, "lag": lag}))
    steps = [engine.step(scan) for scan in run.scans]
    smoothed = [found for step in steps for found in step.smoothed] + list(engine.flush())
    return [
        [(found.position, found.class_id) for found in estimates]
        for estimates in ([found for step in steps for found in step.filtered], smoothed)
    ]


def assert_equal(points, expected):
    assert len(points) == len(expected) == SCANS
    for point, (position, class_id) in zip(points, expected, strict=True):
        np.testing.assert_array_equal(point.position, position)
        np.testing.assert_array_equal(point.class_id, class_id)


def same(one, other):
    return all(
        np.array_equal(a.position, b.position) and np.array_equal(a.class_id, b.class_id)
        for a, b in zip(one, other, strict=True)
    )


def test_track_follows_the_runs_seed_and_needs_lag_0_without_smoothing(run, config, tracks):
    alone = track(run, config, [0])
    assert same(alone[0], tracks[0])
    other = track(replace(run, seed=SEED + 1), config, [0])
    assert not same(other[0], tracks[0])


# A lag beyond the run's length has all of the run.
@pytest.mark.parametrize("lag", [0, 1, 3, 20])
@pytest.mark.parametrize("engine", ["phd", "gaussian", "phd_as_printed", "phd_gaussian"])
def test_track_gives_what_the_engine_gives_with_its_flush(run, lag, engine):
    given = {**GIVEN, "engine": engine}
    found = track(run, resolve(given), [0, lag])
    filtered, smoothed = engine_positions(run, lag, given)
    assert_equal(found[0], filtered)
    assert_equal(found[lag], smoothed if lag else filtered)
    assert sum(len(points) for points in found[lag]) > SCANS


def switches(scores, goal):
    """Return the switches of a run's filtered estimates."""
    assert scores.lags[0] == 0
    return scores.values[0, :, 0, VALUES.index(goal.figure)].sum()


def test_every_kind_of_identity_is_compared_with_none():
    assert {goal.case for goal in GOALS} == {"joining aircraft", "terminal radar, clean codes"}


@pytest.mark.parametrize("goal", GOALS, ids=lambda goal: goal.case)
def test_identities_make_no_more_switches_than_none(goal):
    of_goal = STUDY.select([goal.case], [goal.variant, goal.relative_to])
    (case,) = of_goal.cases
    scans = min(case.scenario.scans, LONGEST_S.get(goal.case, case.scenario.scans))
    begun = [flight for flight in case.scenario.targets if flight.start_s < scans - 1]
    shorter = replace(case.scenario, scans=scans, targets=tuple(begun))
    case = replace(case, scenario=shorter, lags=(0,))
    found = {}
    for task in study_tasks.plan(replace(of_goal, cases=(case,)), [SWITCHING_SEED]).tasks:
        outcome = perform(task)
        assert outcome.error == ""
        found.update(outcome.scores)
    own, none = (switches(found[name], goal) for name in (goal.variant, goal.relative_to))
    assert own <= none


def test_targets_out_of_sight_have_their_most_probable_motion_as_the_trackers():
    """Straight flight and turns of both signs are several humps once no radar is near."""
    motions = {"motions": ["cv", "ct"], "ct.turn_noise_density": 1e-3, "accuracy": "high"}
    config = resolve(motions)
    run = simulated_run(replace(paper_scenario(config.model.radars), scans=SCANS), SEED)
    away = Detections(np.zeros((0, 2)), np.zeros(0), pose=Pose((1e6, 1e6), 0.0))
    blind = [replace(scan, detections=(away,) * len(scan.detections)) for scan in run.scans[4:]]
    run = replace(run, scans=(*run.scans[:4], *blind))
    found = track(run, config, [0])[0]
    expected, _ = engine_positions(run, 0, motions)
    assert any(len(points.position) for points in found[7:])
    assert_equal(found, expected)
