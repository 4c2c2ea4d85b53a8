"""Gates in range and azimuth around Gaussians: compiled loops over hypotheses and detections."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...arrays import TINY, FloatArray, IntArray
from ...compilation import Bool1, Float1, Float2, Float3, Int1, Writeable, compiled, in_place, inner
from ...types import FULL_TURN
from ..polar_geometry import MIN_RANGE
from .angles import wrapped
from .linearised import GATE_SIGMA, Expected


class Radar(NamedTuple):
    """A polar radar."""

    max_range: float  # Metres
    axes: Int1  # Axes of the position and the velocity in a state
    pose: Float1  # Position of the radar, and the cosine and the sine of its yaw, (4,)


class Plots(NamedTuple):
    """M measurements of range and azimuth with their noise; see `linearised.Measured`."""

    measurement: Float2  # (M, 2)
    noise_std: Float2  # (M, 2)
    time_s: Float1  # (M,), or empty if all are made at the stamp


class _Turns(NamedTuple):
    """The plots of two revolutions by azimuth, so that those of a gate are a single run."""

    azimuth: Float1  # (2 M,)
    distance: Float1  # (2 M,)
    order: Int1  # Index of each plot, (2 M,)
    start: Int1  # The place where each of equal parts of the first revolution begins, (M + 1,)
    widest: Float1  # The largest standard deviations of the plots, (2,)
    latest: float  # Their largest distance in time from the stamp, seconds


class _Gated(NamedTuple):
    """The pairs of `gate`, with room for more, and working arrays for one hypothesis."""

    row: Int1
    column: Int1
    log_likelihood: Float2
    in_box: Int1  # The places of detections that are in the box of a hypothesis, (M,)
    anywhere: Bool1  # Whether each Gaussian may be anywhere in azimuth, (R,)
    reach: Float2  # Half widths of each Gaussian's gate, (R, 2)
    box: Float1  # See `_write_box`, (4,)
    inverse: Float2  # Inverse of the innovation's covariance, (R, 3)
    log_scale: Float1  # Log of the density's scale, (R,)
    rate: Float2  # See `_write_rates`, (R, 4)


@inner
def _write_box(
    row: int,
    measured: FloatArray,
    reach: FloatArray,
    weight: FloatArray,
    max_range: float,
    box: FloatArray,
) -> bool:
    """Write the box around a row's gates: both ranges, and the centre and half width in azimuth.

    Return whether any Gaussian has weight and reaches into the radar's range.
    """
    has_gate = False
    for mode in range(len(reach)):
        near, far = measured[row, mode, 0] - reach[mode, 0], measured[row, mode, 0] + reach[mode, 0]
        if not (weight[row, mode] > 0.0 and near <= max_range):
            continue
        if not has_gate:
            box[0], box[1], box[2], box[3] = near, far, measured[row, mode, 1], 0.0
            has_gate = True
        box[0], box[1] = min(box[0], near), max(box[1], far)
        half = abs(wrapped(measured[row, mode, 1] - box[2])) + reach[mode, 1]
        box[3] = max(box[3], half)
    return has_gate


@inner
def _write_rates(row: int, mean: FloatArray, radar: Radar, rate: FloatArray) -> None:
    """Write the time derivatives of a row's measurements, and the bounds of their sizes, (R, 4)."""
    _, axes, pose = radar
    for mode in range(len(rate)):
        east, north = mean[row, mode, axes[0]] - pose[0], mean[row, mode, axes[1]] - pose[1]
        along, across = mean[row, mode, axes[2]], mean[row, mode, axes[3]]
        distance = max(math.sqrt(east * east + north * north), MIN_RANGE)
        rate[mode, 0] = (east * along + north * across) / distance
        rate[mode, 1] = (east * across - north * along) / (distance * distance)
        rate[mode, 2] = abs(along) + abs(across)
        rate[mode, 3] = rate[mode, 2] / distance


@inner
def _write_reach(
    row: int,
    measured: FloatArray,
    covariance: FloatArray,
    turns: _Turns,
    gated: _Gated,
) -> bool:
    """Write the gates' half widths; return whether any Gaussian may be anywhere in azimuth."""
    _, _, _, _, anywhere, reach, _, _, _, rate = gated
    widest, latest, found = turns.widest, turns.latest, False
    for mode in range(len(reach)):
        for axis in range(2):
            std = math.sqrt(covariance[row, mode, axis, axis] + widest[axis] ** 2)
            reach[mode, axis] = GATE_SIGMA * std + latest * rate[mode, 2 + axis]
        # The azimuth's variance grows with the square of the angle that the Gaussian covers.
        wide = covariance[row, mode, 1, 1] >= (0.5 * math.pi / GATE_SIGMA) ** 2
        farthest = reach[mode, 0] - latest * rate[mode, 2]
        anywhere[mode] = wide and measured[row, mode, 0] <= farthest
        found = found or anywhere[mode]
    return found


@inner
def _find_in_box(box: FloatArray, half: float, turns: _Turns, in_box: IntArray) -> int:
    """Write the places of the detections in a box; return their number.

    `half` is the half width of the box in azimuth, pi at most.
    """
    azimuth, distance, _, start, _, _ = turns
    size = len(azimuth) // 2
    low = box[2] - half
    low += FULL_TURN if low < 0.0 else 0.0
    begin, high = start[int(low / FULL_TURN * (len(start) - 1))], low + 2.0 * half
    while begin < size and azimuth[begin] < low:
        begin += 1
    # Without a branch this is faster, because most detections in azimuth are out of range.
    near, far, count = box[0], box[1], 0
    for place in range(begin, begin + size):
        if half < math.pi and azimuth[place] > high:
            break
        in_box[count] = place
        count += near <= distance[place] <= far
    return count


@inner
def _write_inverses(
    row: int,
    covariance: FloatArray,
    noise_range: float,
    noise_azimuth: float,
    inverse: FloatArray,
    log_scale: FloatArray,
) -> None:
    """Write the inverses of a row's innovation covariances, and the logs of their densities."""
    for mode in range(len(inverse)):
        a = covariance[row, mode, 0, 0] + noise_range**2
        b = covariance[row, mode, 0, 1]
        c = covariance[row, mode, 1, 1] + noise_azimuth**2
        determinant = max(a * c - b * b, TINY)
        inverse[mode, 0], inverse[mode, 2] = c / determinant, a / determinant
        inverse[mode, 1] = -2.0 * b / determinant
        log_scale[mode] = 0.5 * math.log(determinant) + math.log(FULL_TURN)


@inner
def _write_densities(
    row: int,
    measured: FloatArray,
    weight: FloatArray,
    measurement: FloatArray,
    time_s: float,
    pair: int,
    gated: _Gated,
) -> bool:
    """Write the log likelihoods of a pair; return whether it is in the gate of any Gaussian."""
    _, _, log_likelihood, _, anywhere, _, _, inverse, log_scale, rate = gated
    found = False
    for mode in range(len(inverse)):
        log_likelihood[pair, mode] = -np.inf
        if not weight[row, mode] > 0.0:
            continue
        range_error = measurement[0] - measured[row, mode, 0] - rate[mode, 0] * time_s
        azimuth_error = measurement[1] - measured[row, mode, 1] - rate[mode, 1] * time_s
        azimuth_error = wrapped(azimuth_error)
        square = inverse[mode, 0] * range_error**2 + inverse[mode, 2] * azimuth_error**2
        square += inverse[mode, 1] * range_error * azimuth_error
        if anywhere[mode] or square <= GATE_SIGMA**2:
            log_likelihood[pair, mode] = -0.5 * square - log_scale[mode]
            found = True
    return found


@in_place
def _gate_pairs(
    radar: Radar,
    weight: Float2,
    mean: Float3,
    expected: Expected,
    plots: Plots,
    turns: Writeable[_Turns],
    gated: Writeable[_Gated],
) -> int:
    """Write the gated pairs; return their number, or -1 if there is no room for them."""
    (measured, covariance, _), (measurement, noise_std, time_s) = expected, plots
    pairs = 0
    for row in range(len(weight)):
        noise_range, noise_azimuth = -1.0, -1.0
        if turns.latest > 0.0:
            _write_rates(row, mean, radar, gated.rate)
        anywhere = _write_reach(row, measured, covariance, turns, gated)
        if not _write_box(row, measured, gated.reach, weight, radar.max_range, gated.box):
            continue
        half = math.pi if anywhere else min(gated.box[3], math.pi)
        count = _find_in_box(gated.box, half, turns, gated.in_box)
        for index in range(count):
            z = turns.order[gated.in_box[index]]
            if pairs == len(gated.row):
                return -1
            if noise_std[z, 0] != noise_range or noise_std[z, 1] != noise_azimuth:
                noise_range, noise_azimuth = noise_std[z, 0], noise_std[z, 1]
                _write_inverses(
                    row, covariance, noise_range, noise_azimuth, gated.inverse, gated.log_scale
                )
            time = time_s[z] if len(time_s) else 0.0
            inside = _write_densities(row, measured, weight, measurement[z], time, pairs, gated)
            gated.row[pairs], gated.column[pairs] = row, z
            pairs += inside
    return pairs


@compiled
def gate(
    radar: Radar,
    weight: Float2,
    mean: Float3,
    expected: Expected,
    plots: Plots,
    ascending: Float1,
    by_azimuth: Int1,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the results of `PolarGaussians.gate_pairs`.

    `ascending` has the azimuths of the detections `by_azimuth`, from 0 to a full turn.
    """
    measurement, noise_std, time_s = plots
    (count, modes), size, begin = weight.shape, len(ascending), 0
    azimuth, distance = np.empty(2 * size), np.empty(2 * size)
    order, start = np.empty(2 * size, np.int64), np.empty(size + 1, np.int64)
    widest, latest = np.zeros(2), 0.0
    for sector in range(size + 1):
        while begin < size and ascending[begin] < sector * (FULL_TURN / size):
            begin += 1
        start[sector] = begin
    for index in range(2 * size):
        order[index] = by_azimuth[index % size]
        azimuth[index] = ascending[index % size] + (FULL_TURN if index >= size else 0.0)
        distance[index] = measurement[order[index], 0]
    for z in range(size):
        widest[0], widest[1] = max(widest[0], noise_std[z, 0]), max(widest[1], noise_std[z, 1])
        latest = max(latest, abs(time_s[z])) if len(time_s) else 0.0
    turns = _Turns(azimuth, distance, order, start, widest, latest)
    pairs, room = -1, 4 * count + 64
    while pairs < 0:
        gated = _Gated(
            np.empty(room, np.int64),
            np.empty(room, np.int64),
            np.empty((room, modes)),
            np.empty(size + 1, np.int64),
            np.empty(modes, np.bool_),
            np.empty((modes, 2)),
            np.empty(4),
            np.empty((modes, 3)),
            np.empty(modes),
            np.zeros((modes, 4)),
        )
        pairs = _gate_pairs(radar, weight, mean, expected, plots, turns, gated)
        room *= 2
    return gated.row[:pairs], gated.column[:pairs], gated.log_likelihood[:pairs]
