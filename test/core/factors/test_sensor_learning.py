"""Detection probability and noise that an engine learns of radars that are set wrongly."""

from dataclasses import replace

import numpy as np
import pytest
from runs import learned, reprocessed_from, restored_after, stepped
from scenes import small

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.factors import (
    Bursts,
    ClutterRate,
    CorrelatedMisses,
    Detection,
    Learned,
    Noise,
)
from phd_jdtc_ros.core.snapshot import Snapshot, to_snapshot
from phd_jdtc_ros.core.types import Detections
from phd_jdtc_ros.evaluation.metrics import ospa
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

RADARS = ("radar_1", "radar_2")
SEEDS = range(12)


def of_radars(**values):
    """Return parameters that both radars have."""
    return {f"{radar}.{name}": value for radar in RADARS for name, value in values.items()}


def run_of(seed, scans=60, **truth):
    """Return the truth and the scans of radars that are as `truth` says."""
    radars = small(of_radars(**truth)).model.radars
    return list(simulate(replace(paper_scenario(radars), scans=scans), seed))


def engine_of(**given):
    return new_engine(small({"lag": 0, **of_radars(**given)}))


AUTO = {"learn": ["noise", "detection"], "detection_probability": 0.9}
TRUTH = {"detection_probability": 0.6, "range_std": 600.0, "azimuth_std_deg": 0.6}
LEARNED = (Learned, ClutterRate, Bursts, Detection, Noise, CorrelatedMisses)


def figures(engine, run):
    return [engine.step(scan) for _, scan in run][-1].figures


def tracked(engine, run):
    """Return the last figures, and the mean OSPA distance after twenty scans, metres."""
    steps = [engine.step(scan) for _, scan in run]
    pairs = zip((truth for truth, _ in run), (step.filtered[0] for step in steps), strict=True)
    each = [ospa(truth.position, e.position, 1000.0, 2.0).distance for truth, e in pairs]
    return steps[-1].figures, float(np.mean(each[20:]))


@pytest.fixture(scope="module")
def learned_runs():
    """Return what `tracked` does of every seed, with values that are learned."""
    return [tracked(engine_of(**AUTO), run_of(seed, **TRUTH)) for seed in SEEDS]


@pytest.fixture(scope="module")
def found(learned_runs):
    return [last_figures for last_figures, _ in learned_runs]


@pytest.mark.parametrize("radar", RADARS)
def test_detection_probability_is_found_within_its_deviation(found, radar):
    name = f"{radar}.detection_probability"
    normal = [(each[name] - 0.6) / each[f"{name}_std"] for each in found]
    assert np.sqrt(np.mean(np.square(normal))) < 1.6


@pytest.mark.parametrize("radar", RADARS)
@pytest.mark.parametrize(("component", "ratio"), [("range", 2.0), ("azimuth", 0.6)])
def test_noise_is_found_within_a_tenth(found, radar, component, ratio):
    name = f"{radar}.{component}_noise_ratio"
    assert np.mean([each[name] for each in found]) == pytest.approx(ratio, rel=0.1)


def test_a_tracker_that_learns_comes_near_one_with_the_true_values(learned_runs):
    runs = [run_of(seed, **TRUTH) for seed in SEEDS[:4]]
    right, wrong = (
        np.mean([tracked(engine_of(**given), run)[1] for run in runs])
        for given in (TRUTH, {"detection_probability": 0.9})
    )
    assert np.mean([distance for _, distance in learned_runs[:4]]) < 1.1 * right
    assert wrong > 1.5 * right


def without_targets(scan, rng):
    """Return a scan with false detections of noise alone."""
    threshold, found = small().model.radars[0].threshold, []
    for _ in RADARS:
        place = np.stack([rng.uniform(0.0, 15e3, 20), rng.uniform(-np.pi, np.pi, 20)], axis=1)
        found.append(Detections(place, np.sqrt(threshold**2 + 2.0 * rng.exponential(size=20))))
    return replace(scan, detections=tuple(found))


def test_nothing_is_learned_from_clutter_alone_or_of_given_values():
    rng = np.random.default_rng(2)
    engine = engine_of(**AUTO)
    found = figures(engine, [(t, without_targets(scan, rng)) for t, scan in run_of(1)])
    for radar in RADARS:
        assert found.get(f"{radar}.detection_probability", 0.9) == pytest.approx(0.9, abs=0.02)
        assert found.get(f"{radar}.range_noise_ratio", 1.0) == pytest.approx(1.0, abs=0.05)
    engine = engine_of(learn=["noise"])
    stepped(engine, [scan for _, scan in run_of(1, scans=30, **TRUTH)])
    assert learned(engine, Detection) == {}
    for view in engine.forward.views:
        assert view.sensor.range_std > 330.0
        assert view.detection is None


def test_what_rests_does_not_count_where_a_map_takes_it_for_clutter():
    """Reflectors are detected in half of the scans, targets in nine of ten."""
    rng = np.random.default_rng(3)
    places = np.stack([rng.uniform(3e3, 9e3, 12), rng.uniform(-np.pi, np.pi, 12)], axis=1)
    scans = []
    for _, scan in run_of(2, detection_probability=0.9, range_std=50.0, azimuth_std_deg=0.2):
        with_reflectors = []
        for each in scan.detections:
            seen = places[rng.random(12) < 0.5]
            seen = seen + rng.normal(size=seen.shape) * [50.0, np.radians(0.2)]
            measured = np.concatenate([each.measurement, seen])
            amplitude = np.concatenate([each.amplitude, rng.rayleigh(30.0, len(seen)) + 4.0])
            with_reflectors.append(Detections(measured, amplitude))
        scans.append(replace(scan, detections=tuple(with_reflectors)))
    given = {"range_std": 50.0, "azimuth_std_deg": 0.2, "clutter_map": True}
    anywhere = {"births": [], "detection_births.rates": [0.1, 0.1]}
    radars = of_radars(learn=["detection"], detection_probability=0.9, **given)
    found = {}
    for bound in (8.0, 0.0):
        speed = of_radars(clutter_map_speed=bound)
        engine = new_engine(small({"lag": 0, **anywhere, **radars, **speed}))
        found[bound] = [engine.step(scan) for scan in scans][-1].figures
    for radar in RADARS:
        name = f"{radar}.detection_probability"
        assert found[8.0][name] == pytest.approx(0.9, abs=0.06)
        assert found[0.0][name] < 0.75


def test_detections_own_noise_is_believed():
    run = run_of(1, range_std=600.0)
    own = np.array([300.0, np.radians(1.0)])
    scans = [
        replace(
            scan,
            detections=tuple(
                replace(each, noise_std=np.tile(own, (len(each), 1))) for each in scan.detections
            ),
        )
        for _, scan in run
    ]
    engine = engine_of(learn=["noise"])
    stepped(engine, scans)
    for view in engine.forward.views:
        assert view.sensor.range_std == 300.0


def learning():
    """Return an engine that learns everything that can be learned of the reference radars."""
    words = ["noise", "detection", "correlation", "clutter"]
    every = {"learn": words, "detection_probability": 0.9, "clutter_amplitude": "learned"}
    anywhere = {"births": [], "detection_births.rates": [0.05, 0.05]}
    return new_engine(small({**anywhere, **of_radars(**every)}))


def of_both(kind, one, other):
    """Return the factor of a kind of each radar, in two engines."""
    found = [learned(engine, kind) for engine in (one, other)]
    assert [set(each) for each in found] == [set(RADARS)] * 2
    return [[each[radar] for each in found] for radar in RADARS]


def differs(one, other):
    """Return whether two factors of a kind have learned different values."""
    stored = [Snapshot(None), Snapshot(None)]
    for factor, snapshot in zip((one, other), stored, strict=True):
        to_snapshot(factor, snapshot, "factor")
    one, other = (snapshot.arrays for snapshot in stored)
    return one.keys() != other.keys() or not all(
        np.array_equal(array, other[name]) for name, array in one.items()
    )


def in_revolution(count):
    """Return scans of the radars, of the second one alone every third time."""
    run = run_of(3, scans=count, **TRUTH)
    return [
        replace(scan, detections=(None if number % 3 == 2 else scan.detections[0], second))
        for number, (_, scan) in enumerate(run)
        for second in scan.detections[1:]
    ]


def test_restored_engine_goes_on_with_what_was_learned_until_it_is_reset():
    first, second = restored_after([0, 1, 12], learning, in_revolution(16))
    assert learned(first, Bursts) == learned(second, Bursts)
    assert len(second.forward.factors.looks.stamp_ns) > 16
    nothing = learning()
    for kind in LEARNED:
        assert all(differs(*each) for each in of_both(kind, first, nothing))
    first.flush()
    for kind in LEARNED:
        assert not any(differs(*each) for each in of_both(kind, first, nothing))


def test_reprocessed_scans_teach_what_they_would_have_in_order():
    straight = reprocessed_from(10, learning, in_revolution(16))
    for kind in LEARNED:
        assert all(differs(*each) for each in of_both(kind, straight, learning()))


def test_snapshot_of_another_sensor_is_refused():
    engine = engine_of(**AUTO)
    stepped(engine, [scan for _, scan in run_of(3, scans=12, **TRUTH)])
    snapshot = engine.snapshot()
    for name in [each for each in snapshot.arrays if each.startswith("noise_factor.radar_1.")]:
        snapshot.arrays[name.replace("radar_1", "other")] = snapshot.arrays[name]
    with pytest.raises(ValueError, match="noise_factor: other given, must be a sensor: radar_1"):
        engine_of(**AUTO).restore(snapshot)


def test_looks_at_ended_targets_do_not_pile_up():
    engine = engine_of(**AUTO, clutter_rate=100.0)
    stepped(engine, [scan for _, scan in run_of(3, scans=60, clutter_rate=100.0, **TRUTH)])
    assert sum(len(each.trials) for each in learned(engine, Detection).values()) < 1000
