# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Plots of unknown height: pairs by each target's, and tracks that they leave alone."""

import numpy as np
import pytest
from hard_turns import GIVEN, PERIOD_S, measured
from lone import lone, scan_at

from phd_jdtc_ros.core.attributes import readings
from phd_jdtc_ros.core.attributes.height import Heights
from phd_jdtc_ros.core.engines import new_engine
from phd_jdtc_ros.core.models.radar import GATE_SIGMA
from phd_jdtc_ros.core.types import Detections

RADAR = lone({"radar.fields.height": "height", "radar.range_std": 40.0}).model.radars[0]
# Four targets of five rows each; the height of the last one is not known.
TARGETS, ROWS = 4, 5
HEIGHTS = Heights(
    np.array([0.99, 0.9, 0.6, 0.4]),
    np.array([[9e3, 0.0], [3e3, 0.0], [5e3, 0.0], [4e3, 0.0]]),
    np.array([100.0, 400.0, 2500.0, 100.0])[:, None, None] * np.eye(2),
)


def crowd(rng):
    """Return rows near each other as the radar would measure them, their targets, and plots."""
    target = np.arange(TARGETS).repeat(ROWS)
    expected = np.stack([15e3 + rng.normal(0.0, 400.0, 20), rng.normal(0.0, 0.03, 20)], axis=1)
    # Half of the plots are read at the antenna's height, of targets that are higher.
    seen = np.concatenate([expected[::2], expected[1::2]])
    seen[:10, 0] = np.hypot(seen[:10, 0], HEIGHTS.mean[target[::2], 0])
    height = np.concatenate([np.full(10, np.nan), HEIGHTS.mean[target[1::2], 0]])
    return expected, target, Detections(seen, None, height=height)


def by_hand(expected, target, detections):
    """Return the log likelihood of each pair, of a plot read at its row's target's height."""
    found = np.full((len(expected), len(detections)), -np.inf)
    for row, column in np.ndindex(found.shape):
        distance, azimuth = detections.measurement[column]
        std = RADAR.noise_std.copy()
        own = target[row]
        if np.isnan(detections.height[column]) and HEIGHTS.known[own] > 0.5:
            height, off = HEIGHTS.mean[own, 0], np.sqrt(HEIGHTS.covariance[own, 0, 0])
            ground = np.sqrt(max(distance**2 - height**2, 0.0))
            std[0] = np.hypot(std[0], ground - np.sqrt(max(distance**2 - (height + off) ** 2, 0.0)))
            distance = ground
        error = (np.array([distance, azimuth]) - expected[row]) / std
        if (error**2).sum() <= GATE_SIGMA**2:
            found[row, column] = -0.5 * (error**2).sum() - np.log(2.0 * np.pi * std.prod())
    return found


def test_a_plot_without_a_height_is_read_at_the_height_of_each_target():
    expected, target, detections = crowd(np.random.default_rng(1))
    pairs = readings.paired(
        lambda seen: RADAR.gated_pairs(expected, seen),
        *(target, HEIGHTS, detections, RADAR.deviations(detections), RADAR.height_reading),
    )
    found = np.full((len(expected), len(detections)), -np.inf)
    found[pairs.row, pairs.column] = pairs.log_likelihood
    wanted = by_hand(expected, target, detections)
    assert np.isfinite(wanted[:, :10]).sum() > 10
    assert np.isfinite(wanted[:, 10:]).sum() > 10
    assert len(pairs.row) == np.isfinite(wanted).sum()
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


@pytest.mark.parametrize("engine", ["gaussian", "particles"])
def test_a_track_stays_where_its_target_is_when_that_does_not_answer_once(engine):
    # At 30 km and a height of 9 km the plot without it is 1381 m farther away.
    one = new_engine(lone({**GIVEN, "engine": engine, "radar.fields.height": "height"}))
    rng, numbers = np.random.default_rng(2), set()
    noise = np.array([5.0, np.radians(0.01)])
    for index in range(24):
        position = np.array([[3e4 - 100.0 * index, 150.0 * PERIOD_S * index - 6e3]])
        plot, height = measured(position, noise, rng), 9e3
        if index in (12, 18):
            plot[:, 0], height = np.hypot(plot[:, 0], height), np.nan
        step = one.step(scan_at((index + 1) * PERIOD_S, plot, height=np.array([height])))
        for found in step.filtered:
            numbers.update(found.track_id.tolist())
            if index > 4:
                apart = np.hypot(*(found.position - position).T)
                assert apart.shape == (1,), index
                assert apart[0] < 100.0, index
    assert len(numbers) == 1
