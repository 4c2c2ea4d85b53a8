"""Births at detections of sensors that look at different times."""

from dataclasses import replace

import numpy as np
import pytest
from runs import ENGINES, restored_after, step_and_reprocess, stepped
from scenes import small

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.models.recent_looks import MOST, RecentLooks
from phd_jdtc_ros.core.sensors.report import Report
from phd_jdtc_ros.core.types import Coverage, Detections, Scan
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

START_NS = 10**12
LENGTH_S = 6.0
NOTHING = Detections(np.zeros((0, 2)), None)
BORN = {"births": [], "detection_births.rates": [0.05, 0.05]}
DETECTED = 0.7


def config_of(engine="gaussian", accuracy="normal", **given):
    radars = {f"radar_1.{name}": value for name, value in given.items()}
    probability = {"radar_1.detection_probability": DETECTED, "radar_2.detection_probability": 0.6}
    given = {"engine": engine, "accuracy": accuracy, "amplitude": "none", **BORN}
    return small({**given, **probability, **radars})


def odds_of_birth(config, looks=(), coverage=None):
    """Return the odds that the second radar's detection is a new target.

    The radar has seen nothing before, `LENGTH_S` earlier; the first one sees nothing in between, at
    the times of `looks`.
    """
    engine = new_engine(config)
    engine.step(Scan(START_NS, (NOTHING, NOTHING)))
    for time_s in looks:
        seen = Detections(np.zeros((0, 2)), None, coverage=coverage)
        engine.step(Scan(START_NS + round(1e9 * time_s), (seen, None)))
    found = Detections(np.array([[6e3, 0.5]]), None)
    step = engine.step(Scan(START_NS + round(1e9 * LENGTH_S), (None, found)))
    mass = step.class_mass.sum()
    return mass / (1.0 - mass)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("coverage", "given"),
    [
        pytest.param(None, {"min_range": 3e4, "max_range": 5e4}, id="out of range"),
        pytest.param(Coverage(2.0, 1.0), {}, id="in another sector"),
    ],
)
def test_looks_elsewhere_leave_births_as_they_are(engine, coverage, given):
    config = config_of(engine, **given)
    hidden = odds_of_birth(config, [1.0, 2.0, 4.5], coverage)
    assert hidden == pytest.approx(odds_of_birth(config), rel=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("looks", [[5.0], [1.0, 2.0, 4.5]])
def test_looks_at_the_place_leave_the_unknown_targets_that_they_missed(engine, looks):
    rng, config = np.random.default_rng(1), config_of(engine)
    appeared = rng.uniform(0.0, LENGTH_S, 200_000)
    missed = rng.random((len(looks), len(appeared))) >= DETECTED
    unknown = (missed | (np.array(looks)[:, None] < appeared)).all(axis=0).mean()
    found = odds_of_birth(config, looks) / odds_of_birth(config)
    assert found == pytest.approx(unknown, rel=0.02)


@pytest.mark.parametrize("accuracy", ["fast", "normal"])
def test_a_sensor_that_can_see_no_target_changes_no_estimate(accuracy):
    blind = {"min_range": 20.0, "max_range": 60.0, "clutter_max_range": 60.0}
    config = config_of(accuracy=accuracy, **blind)
    alone, beside = new_engine(config), new_engine(config)
    known = 0
    for _, scan in simulate(paper_scenario(config_of().model.radars), 4)[:25]:
        seen = replace(scan, detections=(None, scan.detections[1]))
        for before_s in (2.0, 1.1, 0.3):
            stamp_ns = scan.stamp_ns - round(1e9 * before_s)
            beside.step(Scan(stamp_ns, (NOTHING, None)))
        (ours,), (theirs,) = alone.step(seen).filtered, beside.step(seen).filtered
        # Improbable targets of unknown position may be in its field.
        np.testing.assert_allclose(theirs.weight, ours.weight, rtol=2e-4)
        np.testing.assert_allclose(theirs.state, ours.state, rtol=1e-3, atol=1.0)
        known += len(ours)
    assert known > 40


def alternating(count=12):
    """Return scans in which the radars look in turn, twice the first and once the second."""
    run = simulate(paper_scenario(config_of().model.radars), 4)[:count]
    return [
        Scan(scan.stamp_ns, (None, seen[1]) if number % 3 == 2 else (seen[0], None))
        for number, (_, scan) in enumerate(run)
        for seen in [scan.detections]
    ]


@pytest.mark.parametrize("engine", ENGINES)
def test_restored_engine_knows_the_looks(engine):
    first, second = restored_after(7, lambda: new_engine(config_of(engine)), alternating())
    assert len(second.forward.sensors.looks.stamp_ns) == 12
    for ours, theirs in zip(first.forward.sensors.looks, second.forward.sensors.looks, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_reprocessed_scans_have_the_looks_in_order():
    straight, late = new_engine(config_of()), new_engine(config_of())
    stepped(straight, alternating())
    step_and_reprocess(late, alternating(), 7)
    looks = straight.forward.sensors.looks
    np.testing.assert_array_equal(late.forward.sensors.looks.stamp_ns, looks.stamp_ns)


def test_snapshot_with_a_look_of_no_sensor_is_refused():
    engine = new_engine(config_of())
    stepped(engine, alternating(4))
    snapshot = engine.snapshot()
    snapshot.arrays["recent_looks.sensor"] = np.full(4, 2)
    with pytest.raises(ValueError, match=r"recent_looks.sensor: must be below .* sensors, 2"):
        new_engine(config_of()).restore(snapshot)


def test_looks_are_bounded_and_none_of_a_lone_sensor():
    (first, second), looks = config_of().model.radars, RecentLooks.of_none()
    looks = looks.after(Report(second, NOTHING, START_NS), 1)
    for number in range(1, MOST + 1):
        assert looks.since_last(Report(second, NOTHING, START_NS + number), 1) is not None
        looks = looks.after(Report(first, NOTHING, START_NS + number), 0)
    assert len(looks.stamp_ns) == MOST
    assert looks.since_last(Report(second, NOTHING, START_NS + MOST + 1), 1) is None
    config = small({"engine": "gaussian", "sensors": ["radar_1"], **BORN})
    engine = new_engine(config)
    for number in range(3):
        engine.step(Scan(START_NS + number * 10**9, (NOTHING,)))
    assert not len(engine.forward.sensors.looks.stamp_ns)
