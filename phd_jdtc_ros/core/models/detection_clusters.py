"""Merges detections that are close together, for sensors that resolve points of one vehicle.

In the update a target has at most one detection. Further detections of it would look like clutter
or like another target.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..arrays import TINY, FloatArray, IntArray, sum_by, wrap_angle
from ..sensors.gaussians import PlanePlots
from ..sensors.polar_radar import RadarModel
from ..sensors.range_rate import Rates, Velocities
from ..sensors.sensor import Sensor
from ..sensors.spatial_radar import SpatialRadar
from ..types import UNKNOWN, Detections, Pose

# Gate, in standard deviations, on the difference of the range rates of one object.
RATE_SIGMA = 4.0
# Gate, in standard deviations, on the distance between detections of one object.
NOISE_SIGMA = 2.0


def merge_clusters(detections: Detections, sensor: Sensor) -> Detections:
    """Return detections with each group merged to one at its centre.

    The detections of a group are within the sensor's `cluster_distance`, plus noise, of the one
    with the most neighbours, and their range rates or velocities, codes and addresses agree with
    its own. With a distance of 0 the detections are returned unchanged.

    A merged detection has the largest amplitude of the group, the first known identity, and the
    type with the most sensors. It has the standard deviations of one detection, because the
    centre of reflection moves within the target.
    """
    if not sensor.cluster_distance or len(detections) < 2:
        return detections
    own = sensor.at(Pose((0.0, 0.0), 0.0))  # Where it measures in its own frame
    motion = own.motion_of(detections)
    if isinstance(own, SpatialRadar):
        plots = _in_space(detections, own)
    else:
        plots = own.in_plane(detections)
    velocities = motion if isinstance(motion, Velocities) else None
    pairs = _agreeing(_close_pairs(plots, sensor.cluster_distance), velocities)
    known = np.zeros(len(detections), dtype=np.int64)
    for identity in (detections.code, detections.address):
        if identity is not None:
            one, other = identity[pairs].T
            pairs = pairs[(one == other) | (one == UNKNOWN) | (other == UNKNOWN)]
            known += identity != UNKNOWN
    rates = motion if isinstance(motion, Rates) else None
    group = _groups(known, pairs, rates)
    count = int(group.max()) + 1
    if count == len(detections):
        return detections
    x, y, *up = (_mean(group, axis, count) for axis in plots.position.T)
    measured = [x, y]
    if isinstance(sensor, RadarModel):
        measured = [np.hypot(x, y), wrap_angle(np.arctan2(y, x))]
    if up:
        measured = [np.hypot(measured[0], up[0]), measured[1], np.arctan2(up[0], measured[0])]
    measurement = np.stack(measured, axis=1)
    averaged = (
        *("time_s", "noise_std", "noise_correlation", "range_rate_std", "velocity"),
        *("velocity_std", "height", "z", "z_std"),
    )
    means: dict[str, Any] = {
        name: _means(group, getattr(detections, name), count) for name in averaged
    }
    return replace(
        detections,
        measurement=measurement,
        amplitude=_largest(group, detections.amplitude, count),
        range_rate=_mean_rate(group, rates, count),
        **means,
        code=_first_known(group, detections.code, count),
        address=_first_known(group, detections.address, count),
        detection_type=_highest_type(group, detections.detection_type, count),
    )


def _in_space(detections: Detections, sensor: SpatialRadar) -> PlanePlots:
    """Return detections in the sensor's frame with positions in space, metres, (M, 3).

    A detection without an elevation is where it would be at 0, and its unknown elevation is worth
    no distance: only detections with the same one are merged.
    """
    distance, azimuth, elevation = detections.measurement.T
    line = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    level = (distance * np.cos(elevation))[:, None] * line
    std = sensor.noise_std_of(detections)
    return PlanePlots(
        np.column_stack([level, distance * np.sin(elevation)]),
        np.stack([line, line[:, ::-1] * [-1.0, 1.0]], axis=2),
        np.stack([std[:, 0], distance * std[:, 1]], axis=1),
    )


def _close_pairs(plots: PlanePlots, cluster_distance: float) -> IntArray:
    """Return the pairs of detections within the cluster distance and their noise, (P, 2)."""
    position, sides = plots.position, plots.std
    reach = cluster_distance + NOISE_SIGMA * np.sqrt(2.0) * float(sides.max())
    # Few sensors need it, and a tracker starts the sooner without.
    from scipy.spatial import cKDTree

    pairs: IntArray = cKDTree(position).query_pairs(reach, output_type="ndarray")
    first, second = pairs.T
    difference = position[second] - position[first]
    level = distance = np.hypot(difference[:, 0], difference[:, 1])
    if position.shape[1] > 2:
        distance = np.hypot(level, difference[:, 2])
    axis = plots.axes[first, :, 0]
    along = np.abs(axis[:, 0] * difference[:, 0] + axis[:, 1] * difference[:, 1])
    cosine = np.minimum(along / np.maximum(level, TINY), 1.0)
    square = sides[first] ** 2 + sides[second] ** 2
    noise = np.sqrt(cosine**2 * square[:, 0] + (1.0 - cosine**2) * square[:, 1])
    close: IntArray = pairs[distance <= cluster_distance + NOISE_SIGMA * noise]
    return close


def _agreeing(pairs: IntArray, velocities: Velocities | None) -> IntArray:
    """Return the pairs of detections whose velocities agree; an unknown one agrees with all."""
    if velocities is None:
        return pairs
    first, second = pairs.T
    apart = velocities.velocity[first] - velocities.velocity[second]
    noise = velocities.noise[first] + velocities.noise[second]
    square = (apart * np.linalg.solve(noise, apart[..., None])[..., 0]).sum(axis=1)
    agreeing: IntArray = pairs[~(square > RATE_SIGMA**2)]
    return agreeing


def _groups(known: IntArray, pairs: IntArray, rates: Rates | None) -> IntArray:
    """Return the group number of each detection, from 0 in the order of first members.

    A detection that has more of its code and address, `known`, is the centre of a group first, so
    that one without them does not join two of different objects.
    """
    if rates is not None:
        first, second = pairs.T
        rate_difference = np.abs(rates.model.wrap(rates.rate[first] - rates.rate[second]))
        unlike = rate_difference > RATE_SIGMA * np.hypot(rates.std[first], rates.std[second])
        pairs = pairs[~unlike]  # An unknown range rate agrees with all
    size = len(known)
    neighbours: list[list[int]] = [[] for _ in range(size)]
    for detection, neighbour in pairs.tolist():
        neighbours[detection].append(neighbour)
        neighbours[neighbour].append(detection)
    centre = np.full(size, -1)
    for detection in sorted(range(size), key=lambda row: (-known[row], -len(neighbours[row]))):
        if centre[detection] < 0:
            centre[detection] = detection
            for neighbour in neighbours[detection]:
                if centre[neighbour] < 0:
                    centre[neighbour] = detection
    _, first_row, inverse = np.unique(centre, return_index=True, return_inverse=True)
    rank = np.empty(len(first_row), dtype=np.int64)
    rank[np.argsort(first_row)] = np.arange(len(first_row))
    return rank[inverse.ravel()]


def _mean(group: IntArray, value: FloatArray, count: int) -> FloatArray:
    """Return the mean of each group's known values, NaN without any."""
    is_known = np.isfinite(value)
    number = sum_by(group, is_known.astype(np.float64), count)
    total = sum_by(group, np.where(is_known, value, 0.0), count)
    return np.where(number > 0.0, total / np.maximum(number, 1.0), np.nan)


def _means(group: IntArray, value: FloatArray | None, count: int) -> FloatArray | None:
    """Return the means of each group's known values, (M,) or (M, V); None without values."""
    if value is None or value.ndim == 1:
        return None if value is None else _mean(group, value, count)
    return np.stack([_mean(group, column, count) for column in value.T], axis=1)


def _largest(group: IntArray, value: FloatArray | None, count: int) -> FloatArray | None:
    if value is None:
        return None
    largest = np.full(count, np.nan)
    np.fmax.at(largest, group, value)
    return largest


def _first_known(group: IntArray, value: IntArray | None, count: int) -> IntArray | None:
    """Return the first known identity of each group, `UNKNOWN` without one."""
    if value is None:
        return None
    rows = np.flatnonzero(value != UNKNOWN)[::-1]
    first = np.full(count, UNKNOWN)
    first[group[rows]] = value[rows]
    return first


def _highest_type(group: IntArray, detection_type: IntArray | None, count: int) -> IntArray | None:
    """Return the detection type of each group: the highest, which includes most lower ones."""
    if detection_type is None:
        return None
    richest = np.full(count, UNKNOWN)
    np.maximum.at(richest, group, detection_type)
    return richest


def _mean_rate(group: IntArray, rates: Rates | None, count: int) -> FloatArray | None:
    """Return the mean range rates of groups, over the folds nearest to one of their own rates."""
    if rates is None:
        return None
    rows = np.flatnonzero(np.isfinite(rates.rate))[::-1]
    first_rate = np.full(count, np.nan)
    first_rate[group[rows]] = rates.rate[rows]  # The first known rate
    offset = rates.model.wrap(rates.rate - first_rate[group])
    return rates.model.wrap(first_rate + _mean(group, offset, count))
