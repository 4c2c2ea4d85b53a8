from dataclasses import replace

import numpy as np
import pytest
from reference import resolve
from scenes import small

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.gaussian.reduction import Branched
from phd_jdtc_ros.core.gaussian.update import GaussianSteps
from phd_jdtc_ros.core.models import detection_birth
from phd_jdtc_ros.core.models.detection_birth import Newborn
from phd_jdtc_ros.core.models.zones import EXCLUSION, Zone
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.targets.amplitude_density import of_classes
from phd_jdtc_ros.core.types import Coverage, Detections, Scan
from phd_jdtc_ros.core.window.forward_filter import ForwardFilter
from phd_jdtc_ros.core.window.update import Updated, update, update_scan
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

MODEL = small().model
MODES, RADAR = MODEL.modes, MODEL.radars[1]


def unknown():
    """Return a model whose targets appear anywhere and nowhere else."""
    return small({"births": [], "detection_births.rates": [0.05, 0.05]}).model


def nothing_and_steps(model):
    """Return no targets and what nothing was learned of, and the steps that update them."""
    forward = ForwardFilter(model, small().bounds)
    nothing = Branched(forward.dynamics.nothing, np.zeros(0, dtype=int))
    return Updated(nothing, forward.factors), GaussianSteps(forward.dynamics, forward.bounds)


def newborns_of(model, report, dt=6.0):
    nothing, steps = nothing_and_steps(model)
    return update(nothing, View.of(RADAR, report), steps, dt, 0).newborns


def scan_update(model, scan, index=0):
    nothing, steps = nothing_and_steps(model)
    return update_scan(nothing.rows, steps.model.reports(scan), steps, 6.0, index, nothing.factors)


def test_newborn_mass_follows_the_interval():
    report = Detections(np.array([[6000.0, 0.5]]), np.array([4.5]))
    masses = [newborns_of(unknown(), report, dt)[0].mass.sum() for dt in (3.0, 6.0)]
    assert masses[1] == pytest.approx(2.0 * masses[0], rel=0.02)


def test_no_target_is_born_in_an_exclusion_zone_and_others_are():
    report = Detections(np.array([[6000.0, 0.5], [9000.0, 2.0]]), np.array([200.0, 200.0]))
    place = View.of(RADAR, report).position[0]
    corners = place + 500.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    sides = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    model = unknown()
    births = replace(model.detection_births, excluded=(Zone("buoys", EXCLUSION, sides),))
    (usual,) = newborns_of(model, report)
    (found,) = newborns_of(model.changed(detection_births=births), report)
    assert len(usual) == 2
    assert np.array_equal(found.mass, usual.mass[1:])


def test_update_leaves_unclaimed_detections_as_newborn_if_there_are_such_births():
    # 45 dB: no clutter is that strong; 4: any clutter is.
    report = Detections(np.array([[6000.0, 0.5], [9000.0, 2.0]]), np.array([200.0, 4.0]))
    (found,) = newborns_of(unknown(), report)
    assert found.mass[0].sum() == pytest.approx(1.0, abs=1e-6)
    assert found.mass[0, 0] > 0.99  # The stronger class
    assert found.mass[1:].sum() < 0.05
    report = Detections(np.array([[6000.0, 0.5]]), np.array([200.0]))
    assert newborns_of(MODEL, report) == ()


def reports_of_one_target(amplitude=200.0):
    """Return both radars' reports of a target, and a model of them without birth places."""
    model = unknown()
    state = np.array([[5e3, 0.0, 4e3, 0.0, 0.0]])
    reports = [Detections(r.measure(state), np.array([amplitude])) for r in model.radars]
    return model, Scan(1, tuple(reports))


def test_update_scan_finds_a_target_of_two_radars_once():
    updated = scan_update(*reports_of_one_target())
    assert [one.mass.sum() for one in updated.newborns] == pytest.approx([1.0, 0.0], abs=0.05)
    assert updated.rows.mixture.sums.mass.sum() == pytest.approx(1.0, abs=0.05)


def test_update_scan_gives_every_detection_an_origin_of_its_own():
    model, scan = reports_of_one_target()
    far = Detections(np.array([[6000.0, 0.5], [9000.0, 2.0]]), np.array([200.0, 200.0]))
    scan = replace(scan, detections=(far, scan.detections[1]))
    first, second = (set(scan_update(model, scan, k).rows.mixture.sums.label) for k in (2, 3))
    assert [len(first), len(second)] == [3, 3]
    assert not first & second


def test_tracker_finds_targets_without_known_birth_places():
    config = resolve({"births": [], "detection_births.rates": [0.05, 0.05]})
    engine = new_engine(config)
    run = simulate(paper_scenario(config.model.radars), 5)[:15]
    for _, scan in run:
        step = engine.step(scan)
    truth = run[-1][0]
    (found,) = step.filtered
    offset = found.position[:, None] - truth.position[None]
    distance = np.hypot(*offset.transpose(2, 0, 1))
    assert len(step.filtered[0]) == 3
    assert distance.min(axis=0).max() < 600.0


HIDDEN = {"min_range": 3e4, "max_range": 5e4}


def odds_of_birth(first, given=None):
    """Return the odds that the second radar's only detection is a new target.

    `first` is the first radar's report.
    """
    config = small(
        {
            "amplitude": "none",
            "births": [],
            "detection_births.rates": [0.05, 0.05],
            "radar_1.detection_probability": 0.7,
            "radar_2.detection_probability": 0.6,
            **(given or {}),
        }
    )
    second = Detections(np.array([[6e3, 0.5]]), None)
    step = new_engine(config).step(Scan(1, (first, second)))
    mass = step.class_mass.sum()
    return mass / (1.0 - mass)


def test_unknown_targets_that_an_earlier_radar_would_have_seen_are_the_fewer():
    nothing = Detections(np.zeros((0, 2)), None)
    alone = odds_of_birth(None)
    assert 0.001 < alone < 1.0
    assert odds_of_birth(nothing) == pytest.approx(0.3 * alone, rel=1e-9)


@pytest.mark.parametrize(
    ("first", "given"),
    [
        (Detections(np.zeros((0, 2)), None), {f"radar_1.{k}": v for k, v in HIDDEN.items()}),
        (Detections(np.zeros((0, 2)), None, coverage=Coverage(2.0, 1.0)), {}),
    ],
    ids=["out of range", "in another sector"],
)
def test_unknown_targets_that_no_earlier_radar_could_see_are_as_many(first, given):
    hidden = odds_of_birth(first, given)
    assert hidden == pytest.approx(odds_of_birth(None, given), rel=1e-9)


def test_missed_by_is_the_product_of_the_radars_that_looked_of_what_they_took_in():
    model = small({"radar_1.detection_probability": 0.7}).model
    place = np.array([[6e3, 0.0], [0.0, 5e3]])
    nothing = Detections(np.zeros((0, 2)), None)
    none = np.zeros((0, 2)), np.zeros(0, dtype=int)
    ahead = replace(nothing, coverage=Coverage(-1.0, 2.0))
    first = Newborn(View.of(model.radars[0], nothing, share=0.5), *none)
    second = Newborn(View.of(model.radars[1], ahead), *none)
    p_d = of_classes(model.radars[1].threshold, MODES.classes)
    missed = detection_birth.missed_by((first.report, second.report), place, MODES)
    np.testing.assert_allclose(missed[:, 0], 0.65 * (1.0 - p_d), rtol=1e-12)
    np.testing.assert_allclose(missed[:, 1], 0.65, rtol=1e-12)
    np.testing.assert_array_equal(detection_birth.missed_by((), place, MODES), 1.0)
