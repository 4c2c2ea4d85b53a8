"""Studies of radars whose antennas turn."""

import math

import numpy as np
import pytest
import yaml
from reference import resolve

from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.metrics import ospa
from phd_jdtc_ros.simulation.antenna import Antenna
from phd_jdtc_ros.simulation.scenario import Scenario, truth_after
from phd_jdtc_ros.simulation.targets import Flight, Leg
from phd_jdtc_ros.simulation.turning_antenna import simulate_reports
from phd_jdtc_ros.study import tasks as study_tasks
from phd_jdtc_ros.study.tasks import perform
from phd_jdtc_ros.study.tracker import revolution_ends, track_turning, turning_run, without_ignored
from phd_jdtc_ros.tools.monte_carlo import load_study
from studies import peers
from studies.peers.plot_kalman import Settings, follow, plot_kalman

PARAMETERS = {
    "sensors": ["approach"],
    "approach.position": [0.0, 0.0],
    "approach.rotation_s": 4.0,
    "approach.range_std": 40.0,
    "approach.azimuth_std_deg": 0.1,
    "approach.max_range": 6e4,
    "approach.detection_probability": 0.95,
    "approach.clutter_rate": 3.0,
    "approach.clutter_max_range": 6e4,
    "approach.fields.time": "time",
    "approach.fields.amplitude": "",
    "interval_s": 4.0,
    "classes": ["aircraft"],
    "aircraft.survival_probability": 0.999,
    "births": [],
    "detection_births.rates": [0.1],
    "detection_births.std": [150.0],
    "spawn.rate": 0.0,
}
EAST = Flight(0, 1e3, 0.0, (-10e3, 20e3), (200.0, 0.0), (Leg(100.0),))
TURNING = Flight(0, 1e3, 0.0, (15e3, -10e3), (0.0, 150.0), (Leg(40.0), Leg(30.0, 0.03), Leg(30.0)))
TAXIING = Flight(0, 1e3, 0.0, (3e3, 2e3), (8.0, 0.0), (Leg(100.0),))


def scene(*flights, bearing=0.0, seconds=100, **changes):
    config = resolve({**PARAMETERS, **changes})
    antennas = tuple(Antenna(bearing) for _ in config.model.radars)
    radars = config.model.radars
    return Scenario(10**12, 1.0, seconds + 1, flights, radars, antennas), config.inputs


def far_off(run, points):
    """Return each scored target's distance to the nearest estimate, after six revolutions."""
    found = []
    for truth, estimate in list(zip(run.truth, points, strict=True))[6:]:
        assert len(estimate) >= len(truth.state)
        apart = np.linalg.norm(truth.position[:, None] - estimate.position[None], axis=2)
        found.append(apart.min(axis=1))
    return np.array(found)


def test_runs_are_scored_at_revolution_ends_with_targets_in_the_air():
    assert revolution_ends(scene(EAST, seconds=12)[0]) == [4.0, 8.0, 12.0]
    begun = scene(EAST, seconds=12, bearing=math.pi / 2.0)[0]
    assert revolution_ends(begun) == [7.0, 11.0]
    run = turning_run(begun, 3)
    assert [truth.stamp_ns for truth in run.truth] == [10**12 + 7 * 10**9, 10**12 + 11 * 10**9]
    found, _ = scene(TAXIING, EAST)
    run = turning_run(found, 0)
    assert {tuple(truth.track_id.tolist()) for truth in run.truth} == {(2,)}


def test_estimates_of_slow_targets_are_left_out_and_false_ones_stay():
    found, _ = scene(TAXIING, EAST, seconds=8)
    run = turning_run(found, 0)
    exact = [truth_after(found, end).position for end in revolution_ends(found)]
    false = np.array([[-4e4, 0.0]])
    points = [
        PointSet(np.concatenate([place, false]), np.zeros(3, dtype=int), np.array([7, 8, 9]))
        for place in exact
    ]
    assert [left.track_id.tolist() for left in without_ignored(run, points)] == [[8, 9], [8, 9]]


@pytest.mark.parametrize("sectors", [0, 6])
def test_the_tracker_follows_targets_by_revolution_and_by_sector(sectors):
    found, _ = scene(EAST, TURNING, seconds=72)
    run = turning_run(found, 1)
    tracked = track_turning(run, {**PARAMETERS, "approach.sectors": sectors}, [0, 3])
    assert sorted(tracked.tracks) == [0, 3]
    assert tracked.cpu_ms > 0.0
    for lag in (0, 3):
        values = [
            ospa(truth.position, points.position, 1000.0, 2.0).distance
            for truth, points in list(zip(run.truth, tracked.tracks[lag], strict=True))[6:]
        ]
        # One stamp for a whole revolution would be wrong by up to 800 m.
        assert np.median(values) < 150.0


# --- the nearest-neighbour Kalman tracker ---------------------------------------------------------


USUAL = Settings()


def followed(found, inputs, seed=1, settings=USUAL):
    run = turning_run(found, seed)
    reports = simulate_reports(found, inputs, seed)
    stamps = [truth.stamp_ns for truth in run.truth]
    return run, follow(reports, found.radars, stamps, settings)


def test_the_peer_follows_targets_through_turns_misses_and_clutter():
    found, inputs = scene(EAST, TURNING)
    run, points = followed(found, inputs)
    assert np.sqrt((far_off(run, points) ** 2).mean()) < 120.0
    for row in (0, 1):
        nearest = [
            int(p.track_id[np.linalg.norm(p.position - t.position[row], axis=1).argmin()])
            for t, p in list(zip(run.truth, points, strict=True))[6:]
        ]
        assert len(set(nearest)) == 1


def test_the_peer_confirms_a_track_with_its_third_plot_and_ends_it_after_missed_revolutions():
    short = Flight(0, 1e3, 8.0, (-10e3, 20e3), (200.0, 0.0), (Leg(40.0),))
    quiet = {"approach.clutter_rate": 0.0, "approach.detection_probability": 0.999}
    _, points = followed(*scene(short, **quiet))
    numbers = [len(p) for p in points]
    # Passed in the third to the twelfth revolution, and reported for three more.
    assert numbers == [0] * 4 + [1] * 11 + [0] * 10


def test_the_peer_reports_nothing_of_clutter_or_without_plots():
    _, points = followed(*scene(seconds=200))
    assert sum(len(p) for p in points) <= 5
    found, _ = scene(seconds=12, **{"approach.clutter_rate": 0.0})
    run = turning_run(found, 0)
    tracked = plot_kalman(run, {**PARAMETERS, "approach.clutter_rate": 0.0}, [0, 5])
    assert [len(points) for points in tracked.tracks[5]] == [0, 0, 0]
    assert tracked.tracks[0] is tracked.tracks[5]


def test_the_peer_takes_plots_of_several_radars():
    of_first = {k.partition(".")[2]: v for k, v in PARAMETERS.items() if "approach." in k}
    changes = {f"second.{name}": value for name, value in of_first.items()}
    changes |= {"second.rotation_s": 4.8, "second.position": [5e3, 5e3]}
    found, inputs = scene(EAST, TURNING, sensors=["approach", "second"], **changes)
    one = far_off(*followed(*scene(EAST, TURNING)))
    two = far_off(*followed(found, inputs))
    assert np.sqrt((two**2).mean()) < np.sqrt((one**2).mean())


# --- in a Monte Carlo study -----------------------------------------------------------------------

SCENARIO = {
    "interval_s": 1.0,
    "scans": 45,
    "parameters": PARAMETERS,
    "traffic": {"aircraft": 4, "taxiing": 1, "radius": 4e4},
}
STUDY = {
    "lags": [0, 2],
    "cases": {"busy": {"scenario": "busy.yaml"}, "still": {"scenario": "paper_scenario"}},
    "variants": {
        "turns": {"kind": "turning"},
        "sectors": {"kind": "turning", "parameters": {"approach.sectors": 8}},
        "peer": {"kind": "plot_kalman"},
        "reference": {"kind": "reference"},
    },
    "goals": [],
}


def study_of(directory, **changes):
    (directory / "busy.yaml").write_text(yaml.safe_dump(SCENARIO))
    (directory / "study.yaml").write_text(yaml.safe_dump({**STUDY, **changes}, sort_keys=False))
    return load_study(directory / "study.yaml", {}, peers.KINDS)


def test_variants_have_the_cases_that_their_kinds_suit(tmp_path):
    study = study_of(tmp_path)
    assert [variant.cases for variant in study.variants] == [("busy",)] * 3 + [("still",)]


def test_faults_of_variants_are_named(tmp_path):
    variants = {"peer": {"kind": "plot_kalman", "cases": ["still"]}}
    with pytest.raises(ConfigError, match=r"variants\.peer\.cases: \['still'\] given, must be a "):
        study_of(tmp_path, variants=variants)
    variants = {"peer": {"kind": "plot_kalman", "parameters": {"lag": 3}}}
    kinds = "gaussian or phd or phd_as_printed or phd_gaussian or turning or gm_phd"
    with pytest.raises(ConfigError, match=rf"peer\.parameters: only for kind {kinds} or "):
        study_of(tmp_path, variants=variants)


def test_perform_scores_turning_radars_and_their_cpu_time(tmp_path):
    study = study_of(tmp_path).select(["busy"], [])
    for task in study_tasks.plan(study, [4]).tasks:
        outcome = perform(task)
        assert outcome.error == ""
        (scores,) = outcome.scores.values()
        assert len(scores.time_s) == 11
        columns = dict(zip(study_tasks.VALUES, scores.values[0, :, 0].T, strict=True))
        assert (columns["cpu_ms"] > 0.0).all()
        assert np.isfinite(columns["identity_switches"]).all()
        assert columns["near"][6:].sum() >= 0.7 * columns["n_true"][6:].sum()
