"""Range rates of climbing targets in the plane."""

from dataclasses import replace

import numpy as np
import pytest
from reference import resolve

from phd_jdtc_ros.columns.selection import select
from phd_jdtc_ros.core.association.evidence import Paired
from phd_jdtc_ros.core.factors.transponder.climbs import without_climbs
from phd_jdtc_ros.core.factors.transponder.height import Heights
from phd_jdtc_ros.core.gaussian.algebra.range_rate import update_rates
from phd_jdtc_ros.core.types import Detections

ANTENNA = 20.0
CONFIG = resolve(
    {
        "radar_1.position": [0.0, 0.0, ANTENNA],
        "radar_1.yaw_deg": 0.0,
        "radar_1.fields.range_rate": "rate",
        "radar_1.fields.height": "height",
        "radar_1.range_rate_std": 0.2,
    }
)
INPUT, RADAR = CONFIG.inputs[0], CONFIG.model.radars[0]
PLACE = np.array([[900.0, -400.0, 500.0], [-700.0, 800.0, 60.0], [3e3, 1e3, 1200.0]])
VELOCITY = np.array([[-12.0, 7.0, 6.0], [4.0, -9.0, -3.0], [60.0, 20.0, 10.0]])


def slant_range(time_s):
    place = PLACE + VELOCITY * time_s
    return np.linalg.norm(place - [0.0, 0.0, ANTENNA], axis=1)


def measured():
    """Return range rates as differences of slant ranges, and the detections that have them."""
    step = 1e-3
    rate = (slant_range(step) - slant_range(-step)) / (2.0 * step)
    azimuth = np.arctan2(PLACE[:, 1], PLACE[:, 0])
    columns = {"range": slant_range(0.0), "azimuth": azimuth, "height": PLACE[:, 2]}
    columns |= {"range_rate": rate, "amplitude": np.full(3, 5.0)}
    return rate, select(0, INPUT, columns).detections


def states(spread=0.0):
    """Return the planar states, with errors of the velocity, and their covariances."""
    mean = np.zeros((3, 5))
    mean[:, [0, 2]], mean[:, [1, 3]] = PLACE[:, :2], VELOCITY[:, :2] + spread
    return mean, np.tile(np.diag([1e-6, 25.0, 1e-6, 25.0, 1e-12]), (3, 1, 1))


def test_a_range_rate_is_that_of_the_plane_and_of_the_climb_at_the_elevation():
    rate, found = measured()
    in_plane = RADAR.range_rate_of(states()[0])
    parts = found.level * in_plane + found.rise * VELOCITY[:, 2]
    np.testing.assert_allclose(parts, rate, atol=1e-6)
    assert (np.abs(in_plane - rate) > 0.1).all()


def pairs(found):
    index = np.arange(3)
    return Paired(index, index, np.zeros(3), index, found)


def heights(known, climb_std):
    mean = np.column_stack([PLACE[:, 2], VELOCITY[:, 2]])
    return Heights(np.array(known), mean, np.tile(np.diag([1.0, climb_std**2]), (3, 1, 1)))


def rates_at(found, known, climb_std):
    of_targets = heights(known, climb_std)
    model, projection = RADAR.range_rate, RADAR.height_projection
    projected = without_climbs(pairs(found), np.arange(3), of_targets, projection, model).projected
    return RADAR.motion_of(projected)


def test_the_update_is_that_with_a_known_climb_rate_as_part_of_the_state():
    """The reference has the climb rate as a sixth component of a linear update."""
    rate, found = measured()
    mean, covariance = states(spread=3.0)
    for climb_std in (0.0, 2.0):
        updated = update_rates(mean, covariance, RADAR, rates_at(found, [1.0] * 3, climb_std))
        for row in range(3):
            line = PLACE[row] - [0.0, 0.0, ANTENNA]
            sight = line / np.linalg.norm(line)
            gradient = np.array([0.0, sight[0], 0.0, sight[1], 0.0, sight[2]])
            joint = np.zeros((6, 6))
            joint[:5, :5], joint[5, 5] = covariance[row], climb_std**2
            total = gradient @ joint @ gradient + 0.2**2
            expected = gradient @ np.append(mean[row], VELOCITY[row, 2])
            gain = joint @ gradient / total
            state = mean[row] + gain[:5] * (rate[row] - expected)
            np.testing.assert_allclose(updated.mean[row], state, atol=1e-3)
            left = (joint - np.outer(gain, gain) * total)[:5, :5]
            np.testing.assert_allclose(updated.covariance[row], left, atol=1e-3)


def test_an_unknown_climb_rate_is_part_of_the_noise():
    _, found = measured()
    rates, unknown = rates_at(found, [0.0] * 3, 1.0), RADAR.motion_of(found)
    np.testing.assert_array_equal(rates.std, unknown.std)
    climb_std = RADAR.range_rate.climb_std
    np.testing.assert_allclose(unknown.std, np.hypot(0.2, found.rise * climb_std))


def test_a_detection_without_a_height_has_the_elevation_of_its_target():
    _, found = measured()
    nothing = np.full(3, np.nan)
    blind = replace(found, height=nothing, level=nothing, rise=nothing)
    seen, known = rates_at(blind, [1.0, 0.0, 1.0], 0.5), rates_at(found, [1.0, 0.0, 1.0], 0.5)
    for quantity in ("rate", "std", "level"):
        ours, theirs = getattr(seen, quantity), getattr(known, quantity)
        np.testing.assert_allclose(ours[[0, 2]], theirs[[0, 2]])
    # That of an unknown height is taken as level.
    assert (seen.level[1], seen.std[1]) == (1.0, pytest.approx(0.2))


def test_level_range_rates_are_as_reported():
    plain = Detections(np.ones((2, 2)), None, range_rate=np.array([3.0, -4.0]))
    rates = RADAR.motion_of(plain)
    assert rates.level is None
    np.testing.assert_array_equal(rates.std, [0.2, 0.2])
