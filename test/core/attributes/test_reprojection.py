"""Plots of missing and false heights: pairs by each target's, and tracks that they leave alone."""

import numpy as np
import pytest
from hard_turns import GIVEN, PERIOD_S, measured
from lone import lone, scan_at

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.attributes import reprojection
from phd_jdtc_ros.core.attributes.height import HeightModel, Heights
from phd_jdtc_ros.core.sensors.polar_gate import DETECTION_GATE_SIGMA
from phd_jdtc_ros.core.sensors.report import Report
from phd_jdtc_ros.core.types import Detections

RADAR = lone({"radar.fields.height": "height", "radar.range_std": 40.0}).model.radars[0]
# Four targets of five rows each; the height of the last one is not known, the second's not well.
TARGETS, ROWS = 4, 5
HEIGHTS = Heights(
    np.array([0.999, 0.9, 0.995, 0.4]),
    np.array([[9e3, 0.0], [3e3, 0.0], [5e3, 0.0], [4e3, 0.0]]),
    np.array([100.0, 400.0, 2500.0, 100.0])[:, None, None] * np.eye(2),
)


# Heights of plots: none, their targets' heights, and garbled ones.
MISSING, TRUE, GARBLED = range(0, 10), range(10, 16), range(16, 20)


def crowd(rng):
    """Return rows near each other as the radar would measure them, their targets, and plots."""
    target = np.arange(TARGETS).repeat(ROWS)
    expected = np.stack([15e3 + rng.normal(0.0, 400.0, 20), rng.normal(0.0, 0.03, 20)], axis=1)
    of = np.concatenate([np.arange(0, 20, 2), np.arange(1, 20, 2)])
    seen, height = expected[of], HEIGHTS.mean[target[of], 0]
    height[MISSING], height[GARBLED] = np.nan, 6900.0
    slant = np.hypot(seen[:, 0], HEIGHTS.mean[target[of], 0])
    seen[:, 0] = np.sqrt(slant**2 - np.nan_to_num(height) ** 2)
    return expected, target, Detections(seen, None, height=height)


def explained(expected, target, detections, column):
    """Return whether a plot has the known height of a target that it is near to."""
    error = (detections.measurement[column] - expected) / RADAR.noise_std
    near = (error**2).sum(axis=1) <= DETECTION_GATE_SIGMA**2
    same = np.abs(detections.height[column] - HEIGHTS.mean[target, 0]) < 1000.0
    return (near & same & (HEIGHTS.known[target] > 0.5)).any()


def by_hand(expected, target, detections):
    """Return the log likelihood of each pair, of a plot read at its row's target's height."""
    found = np.full((len(expected), len(detections)), -np.inf)
    for row, column in np.ndindex(found.shape):
        distance, azimuth = detections.measurement[column]
        std, own, told = RADAR.noise_std.copy(), target[row], detections.height[column]
        height, off = HEIGHTS.mean[own, 0], np.sqrt(HEIGHTS.covariance[own, 0, 0])
        false = not (abs(told - height) < 1000.0 or explained(expected, target, detections, column))
        # Another height contradicts an uncertain one.
        if HEIGHTS.known[own] > (0.5 if np.isnan(told) else 0.99) and false:
            square = distance**2 + np.nan_to_num(told) ** 2
            ground, lower = (np.sqrt(square - above**2) for above in (height, height + off))
            std[0] = np.hypot(std[0], ground - lower)
            distance = ground
        error = (np.array([distance, azimuth]) - expected[row]) / std
        if (error**2).sum() <= DETECTION_GATE_SIGMA**2:
            found[row, column] = -0.5 * (error**2).sum() - np.log(2.0 * np.pi * std.prod())
    return found


def test_a_plot_of_a_false_height_is_read_at_the_height_of_each_target():
    expected, target, detections = crowd(np.random.default_rng(1))
    pairs = reprojection.pair(
        lambda seen: RADAR.gated_pairs(expected, seen),
        *(target, HEIGHTS, Report(RADAR, detections), RADAR.height_projection, HeightModel()),
    )
    found = np.full((len(expected), len(detections)), -np.inf)
    found[pairs.row, pairs.column] = pairs.log_likelihood
    wanted = by_hand(expected, target, detections)
    assert all(np.isfinite(wanted[:, of]).sum() >= 6 for of in (MISSING, TRUE, GARBLED))
    assert len(pairs.row) == np.isfinite(wanted).sum()
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


@pytest.mark.parametrize("engine", ["gaussian", "particles"])
def test_a_track_stays_where_its_target_is_without_its_height_and_with_a_false_one(engine):
    # At 30 km and a height of 9 km the plots without it, and with 2 km, are 1.3 km farther away.
    told = {**dict.fromkeys(range(12, 17), np.nan), 20: 2e3}
    one = new_engine(lone({**GIVEN, "engine": engine, "radar.fields.height": "height"}))
    rng, numbers = np.random.default_rng(2), set()
    noise = np.array([5.0, np.radians(0.01)])
    for index in range(24):
        position = np.array([[3e4 - 100.0 * index, 150.0 * PERIOD_S * index - 6e3]])
        plot, height = measured(position, noise, rng), told.get(index, 9e3)
        plot[:, 0] = np.sqrt(plot[:, 0] ** 2 + 9e3**2 - np.nan_to_num(height) ** 2)
        step = one.step(scan_at((index + 1) * PERIOD_S, plot, height=np.array([height])))
        for found in step.filtered:
            numbers.update(found.track_id.tolist())
            if index > 4:
                apart = np.hypot(*(found.position - position).T)
                assert apart.shape == (1,), index
                assert apart[0] < 100.0, index
    assert len(numbers) == 1
