"""Range rates: of targets that pass each other, and at births."""

from dataclasses import replace

import numpy as np
import pytest
from lone import STD, lone, mixture_of, scan_at, start_from
from scipy.stats import norm

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.gaussian.bounds import Bounds
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.measurement.newborn import newborn_mixture
from phd_jdtc_ros.core.gaussian.reduction import Branched
from phd_jdtc_ros.core.gaussian.update import GaussianSteps
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import Detections
from phd_jdtc_ros.core.window.forward_filter import ForwardFilter
from phd_jdtc_ros.core.window.update import Updated, update

ROAD = {
    "interval_s": 0.1,
    "births": [],
    "detection_births.rates": [0.02],
    "detection_births.std": [12.0, 2e-3],
    "cv.noise_density": 4.0,
    "lag": 4,
    "radar.position": [0.0, 0.0],
    "radar.yaw_deg": 0.0,
    "radar.range_std": 0.3,
    "radar.azimuth_std_deg": 0.6,
    "radar.max_range": 200.0,
    "radar.clutter_max_range": 200.0,
    "radar.clutter_rate": 5.0,
    "radar.detection_probability": 0.9,
    "radar.fields.range_rate": "range_rate",
    "radar.range_rate_std": 0.15,
    "radar.range_rate_ambiguity": 24.0,
}
# Two that pass each other, one of them faster than half the ambiguity.
START = np.array([[60.0, -15.0, 3.0, 0.0, 0.0], [40.0, 6.0, -3.0, 2.0, 0.0]])


def scans(radar, seed, count=8):
    rng = np.random.default_rng(seed)
    found = []
    for number in range(1, count + 1):
        state = START.copy()
        state[:, [0, 2]] += 0.1 * number * START[:, [1, 3]]
        seen = radar.measure(state) + rng.standard_normal((2, 2)) * radar.noise_std
        rate = radar.range_rate_of(state) + 0.15 * rng.standard_normal(2)
        false = np.column_stack([rng.uniform(0.0, 200.0, 4), rng.uniform(-np.pi, np.pi, 4)])
        found.append(
            scan_at(
                0.1 * number,
                np.concatenate([seen, false]),
                range_rate=np.append(radar.range_rate.wrap(rate), rng.uniform(-12.0, 12.0, 4)),
            )
        )
    return found


def test_newborn_gaussians_are_one_hypothesis_for_each_fold():
    config = lone(ROAD)
    (radar,), births = config.model.radars, config.model.detection_births
    dynamics = Dynamics(config.model)
    nothing = Branched(dynamics.nothing, np.zeros(0, dtype=int))
    report = Detections(
        np.array([[60.0, 0.4], [50.0, 0.0], [80.0, -1.0]]),
        None,
        range_rate=np.array([9.0, 0.0, np.nan]),
    )
    bounds = Bounds(100, 0.0, 0.0, 0.0, 1000, 1.0)
    steps = GaussianSteps(dynamics, bounds)
    before = Updated(nothing, ForwardFilter(config.model, bounds).factors)
    (newborn,) = update(before, View.of(radar, report), steps, 0.1, 1000).newborns
    found = newborn_mixture(newborn, dynamics, 1000)

    mass = found.sums.mass
    for row in range(3):
        own = found.row_label == 1000 + row
        assert mass[own].sum() == pytest.approx(newborn.mass[row].sum(), rel=1e-9)
    own = np.flatnonzero(found.row_label == 1000)
    toward = np.array([np.cos(0.4), np.sin(0.4)])
    radial = found.mean[own, 0][:, [1, 3]] @ toward
    gain = births.velocity_std**2 / (births.velocity_std**2 + 0.15**2)
    folds = radial / gain
    density = norm.pdf(folds, 0.0, 12.0)
    assert {-15, 9} <= set(np.round(folds).astype(int).tolist()) <= {-39, -15, 9, 33}
    share = mass[own] / mass[own].sum()
    np.testing.assert_allclose(share, density / density.sum(), atol=0.01)
    spread = found.covariance[own, 0][:, [1, 3]][:, :, [1, 3]]
    # The noise, and that of the direction times the velocity across.
    expected = np.hypot(0.15, np.radians(0.6) * 12.0)
    np.testing.assert_allclose(np.sqrt(toward @ spread @ toward), expected, rtol=0.02)
    across = np.array([-toward[1], toward[0]])
    np.testing.assert_allclose(np.sqrt(across @ spread @ across), 12.0, rtol=0.01)
    assert np.count_nonzero(found.row_label == 1002) == 1


def test_targets_with_ambiguous_range_rates_are_tracked():
    config = lone(ROAD)
    tracker = new_engine(config)
    for scan in scans(config.model.radars[0], 3):
        (found,) = tracker.step(scan).filtered
    assert len(found) == 2
    order = np.argsort(found.position[:, 0])
    truth = START[::-1].copy()
    truth[:, [0, 2]] += 0.8 * truth[:, [1, 3]]
    np.testing.assert_allclose(found.position[order], truth[:, [0, 2]], atol=1.0)
    np.testing.assert_allclose(found.velocity[order], truth[:, [1, 3]], atol=4.0)


def test_range_rates_that_are_not_configured_change_nothing():
    config = lone({**ROAD, "radar.fields.range_rate": ""})
    found = []
    for rated in (True, False):
        tracker = new_engine(config)
        for scan in scans(lone(ROAD).model.radars[0], 4, 4):
            seen = scan.detections[0]
            step = tracker.step(
                replace(scan, detections=(seen if rated else replace(seen, range_rate=None),))
            )
        found.append(step.filtered[0].state)
    np.testing.assert_array_equal(*found)


def test_a_range_rate_separates_two_targets_at_one_place():
    config = lone({**ROAD, "detection_births.rates": []})
    (radar,) = config.model.radars
    state = np.array([60.0, -8.0, 3.0, 0.0, 0.0])
    other = np.array([60.0, 8.0, 3.0, 0.0, 0.0])
    tracker = new_engine(config)
    std = 1e-2 * STD
    std[:4] = [1.0, 1.0, 1.0, 1.0]
    targets = [(0.9, state, std), (0.9, other, std)]
    stored = mixture_of(tracker.forward.dynamics, targets)
    start_from(tracker, 10**12, stored)
    moved = state.copy()
    moved[0] -= 0.8
    step = tracker.step(
        scan_at(0.1, radar.measure(moved[None]), range_rate=radar.range_rate_of(moved[None]))
    )
    (found,) = step.filtered
    by_speed = dict(zip(np.sign(found.state[:, 1]), found.weight, strict=True))
    assert by_speed[-1.0] > 0.99
    assert by_speed.get(1.0, 0.0) < 0.6
