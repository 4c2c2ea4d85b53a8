"""The loops over Gaussians, compiled by numba; see `core.numba_loops`.

Each function equals the one of its name in `kalman`, `moments`, `gating` or `reduction` up to
rounding. Arrays have one leading axis, N, and matrices are symmetric unless stated otherwise.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...arrays import FloatArray, IntArray
from ...numba_loops import compiled, read, types
from ...state_space import PLANAR

SIZE = len(PLANAR)
_FLOAT, _INT, _BOOL = types.float64, types.int64, types.boolean
_1, _2, _3, _4 = (read(_FLOAT, axes) for axes in (1, 2, 3, 4))
_INTS, _BOOLS, _FLAGS = read(_INT, 1), read(_BOOL, 1), read(_BOOL, 2)
_NEW = {axes: types.Array(_FLOAT, axes, "C") for axes in (1, 2, 3, 4)}
_NEW_INTS = types.Array(_INT, 1, "C")
_AXES = types.UniTuple(_INT, 4)
_POSE = types.UniTuple(_FLOAT, 4)


@compiled(_FLOAT(_FLOAT))
def _wrapped(angle: float) -> float:
    """Return an angle wrapped to (-pi, pi]."""
    wrapped = math.pi - (math.pi - angle) % (2.0 * math.pi)
    return wrapped if wrapped > -math.pi else math.pi


@compiled(
    types.Tuple((_NEW[3], _NEW[2], _NEW[3], _NEW[1]))(
        *(_2, _3, _AXES, _POSE, _2, _2, _1, _INT, _FLOAT, _FLOAT)
    )
)
def iterated_update(
    mean: FloatArray,
    covariance: FloatArray,
    axes: tuple[int, int, int, int],
    pose: tuple[float, float, float, float],
    measurement: FloatArray,
    noise_std: FloatArray,
    time_s: FloatArray,
    iterations: int,
    converged: float,
    least_range: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the columns of `kalman.Located`.

    `axes` are the axes of position and velocity; `pose` is the radar's position and the cosine and
    sine of its yaw.
    """
    count = len(mean)
    jacobian, inverse = np.empty((count, 2, 2)), np.empty((count, 2, 2))
    weighted, log_likelihood = np.empty((count, 2)), np.empty(count)
    x, y, vx, vy = axes
    at_x, at_y, cos, sin = pose
    for row in range(count):
        time, state, spread = time_s[row], mean[row], covariance[row]
        prior_x, prior_y = state[x] + time * state[vx], state[y] + time * state[vy]
        p = spread[x, x] + time * (2.0 * spread[x, vx] + time * spread[vx, vx])
        q = spread[x, y] + time * (spread[x, vy] + spread[vx, y] + time * spread[vx, vy])
        r = spread[y, y] + time * (2.0 * spread[y, vy] + time * spread[vy, vy])
        noise_range, noise_azimuth = noise_std[row, 0] ** 2, noise_std[row, 1] ** 2
        limit = converged * noise_std[row, 0]
        east, north = prior_x, prior_y
        j, k, a, b, d, determinant = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        along, across, weight_along, weight_across = 0.0, 0.0, 0.0, 0.0
        n, m = 0.0, 0.0
        for _ in range(iterations):
            line_x, line_y = east - at_x, north - at_y
            ahead, left = cos * line_x + sin * line_y, cos * line_y - sin * line_x
            distance = max(math.sqrt(ahead * ahead + left * left), least_range)
            j, k = line_x / distance, line_y / distance
            n, m = -k / distance, j / distance
            seen_x, seen_y = p * j + q * k, q * j + r * k
            turned_x, turned_y = p * n + q * m, q * n + r * m
            a = j * seen_x + k * seen_y + noise_range
            b = j * turned_x + k * turned_y
            d = n * turned_x + m * turned_y + noise_azimuth
            moved_x, moved_y = east - prior_x, north - prior_y
            along = measurement[row, 0] - distance + (j * moved_x + k * moved_y)
            across = _wrapped(measurement[row, 1] - math.atan2(left, ahead))
            across += n * moved_x + m * moved_y
            determinant = max(a * d - b * b, np.finfo(np.float64).tiny)
            weight_along = (d * along - b * across) / determinant
            weight_across = (a * across - b * along) / determinant
            before_x, before_y = east, north
            east = prior_x + seen_x * weight_along + turned_x * weight_across
            north = prior_y + seen_y * weight_along + turned_y * weight_across
            if max(abs(east - before_x), abs(north - before_y)) < limit:
                break
        jacobian[row, 0, 0], jacobian[row, 0, 1] = j, k
        jacobian[row, 1, 0], jacobian[row, 1, 1] = n, m
        inverse[row, 0, 0], inverse[row, 1, 1] = d / determinant, a / determinant
        inverse[row, 0, 1] = inverse[row, 1, 0] = -b / determinant
        weighted[row, 0], weighted[row, 1] = weight_along, weight_across
        square = along * weight_along + across * weight_across
        log_likelihood[row] = -0.5 * (square + math.log(determinant)) - math.log(2.0 * math.pi)
    return jacobian, weighted, inverse, log_likelihood


@compiled(types.Tuple((_NEW[2], _NEW[3]))(_2, _3, _AXES, _3, _2, _3, _1))
def updated(
    mean: FloatArray,
    covariance: FloatArray,
    axes: tuple[int, int, int, int],
    jacobian: FloatArray,
    weighted: FloatArray,
    inverse: FloatArray,
    time_s: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the means and covariances after their innovations; `axes` as in `iterated_update`."""
    later_mean, later = np.empty_like(mean), np.empty_like(covariance)
    x, y, vx, vy = axes
    size = mean.shape[1]
    cross = np.empty((2, size))
    gain = np.empty((2, size))
    for row in range(len(mean)):
        spread, time = covariance[row], time_s[row]
        a, b, d = inverse[row, 0, 0], inverse[row, 0, 1], inverse[row, 1, 1]
        for i in range(size):
            with_x = spread[i, x] + time * spread[i, vx]
            with_y = spread[i, y] + time * spread[i, vy]
            cross[0, i] = with_x * jacobian[row, 0, 0] + with_y * jacobian[row, 0, 1]
            cross[1, i] = with_x * jacobian[row, 1, 0] + with_y * jacobian[row, 1, 1]
            gain[0, i] = a * cross[0, i] + b * cross[1, i]
            gain[1, i] = b * cross[0, i] + d * cross[1, i]
            moved = cross[0, i] * weighted[row, 0] + cross[1, i] * weighted[row, 1]
            later_mean[row, i] = mean[row, i] + moved
        for i in range(size):
            for k in range(i + 1):
                taken = gain[0, i] * cross[0, k] + gain[1, i] * cross[1, k]
                later[row, i, k] = later[row, k, i] = spread[i, k] - taken
    return later_mean, later


@compiled(types.Tuple((_BOOL, *(_NEW[axes] for axes in (3, 3, 2, 3))))(_2, _3, _2, _3, _3, _2))
def backward(
    mean: FloatArray,
    covariance: FloatArray,
    later_mean: FloatArray,
    later: FloatArray,
    cross: FloatArray,
    unsupported: FloatArray,
) -> tuple[bool, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return success, the inverses of the later covariances, and the backward steps.

    The call fails if a later covariance is not positive definite.
    """
    count, size = mean.shape
    precision = np.zeros((count, size, size))
    gain, base = np.empty((count, size, size)), np.empty((count, size, size))
    offset = np.empty((count, size))
    # The factor L of L D L', unit triangular, its inverse, and D.
    factor, inverse = np.zeros((size, size)), np.zeros((size, size))
    pivot = np.empty(size)
    for row in range(count):
        for i in range(size):
            for k in range(i):
                total = later[row, i, k]
                for n in range(k):
                    total -= factor[i, n] * factor[k, n] * pivot[n]
                factor[i, k] = total / pivot[k]
            total = later[row, i, i] + unsupported[row, i]
            for n in range(i):
                total -= factor[i, n] * factor[i, n] * pivot[n]
            if not total > 0.0:
                return False, precision, gain, offset, base
            pivot[i] = total
            inverse[i, i] = 1.0
            for k in range(i):
                total = -factor[i, k]
                for n in range(k + 1, i):
                    total -= factor[i, n] * inverse[n, k]
                inverse[i, k] = total
        for n in range(size):
            for i in range(n + 1):
                scaled = inverse[n, i] / pivot[n]
                for k in range(n + 1):
                    precision[row, i, k] += scaled * inverse[n, k]
        for i in range(size):
            gain[row, i] = 0.0
            for n in range(size):
                one = cross[row, i, n]
                for k in range(size):
                    gain[row, i, k] += one * precision[row, n, k]
            total = mean[row, i]
            for k in range(size):
                total -= gain[row, i, k] * later_mean[row, k]
            offset[row, i] = total
        for i in range(size):
            for k in range(i + 1):
                taken = 0.0
                for n in range(size):
                    taken += gain[row, i, n] * cross[row, k, n] + gain[row, k, n] * cross[row, i, n]
                base[row, i, k] = base[row, k, i] = covariance[row, i, k] - 0.5 * taken
    return True, precision, gain, offset, base


@compiled(types.Tuple((_NEW[3], _NEW[4]))(_3, _3, _4))
def match_moments(
    share: FloatArray, mean: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the moments of mixtures with the same number of Gaussians."""
    count, mixtures, parts = share.shape
    size = mean.shape[2]
    centre = np.zeros((count, mixtures, size))
    spread = np.zeros((count, mixtures, size, size))
    for row in range(count):
        for j in range(mixtures):
            for k in range(parts):
                for i in range(size):
                    centre[row, j, i] += share[row, j, k] * mean[row, k, i]
            for k in range(parts):
                one = share[row, j, k]
                for i in range(size):
                    apart = one * (mean[row, k, i] - centre[row, j, i])
                    for n in range(size):
                        spread[row, j, i, n] += one * covariance[row, k, i, n] + apart * (
                            mean[row, k, n] - centre[row, j, n]
                        )
    return centre, spread


@compiled(types.Tuple((_NEW[3], _NEW[4]))(_2, _3, _4, _INTS))
def merge_moments(
    share: FloatArray, mean: FloatArray, covariance: FloatArray, first: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return the moments of mixtures of consecutive rows."""
    count, modes, size = mean.shape
    centre = np.zeros((len(first), modes, size))
    spread = np.zeros((len(first), modes, size, size))
    for mixture in range(len(first)):
        end = first[mixture + 1] if mixture + 1 < len(first) else count
        for mode in range(modes):
            for row in range(first[mixture], end):
                for i in range(size):
                    centre[mixture, mode, i] += share[row, mode] * mean[row, mode, i]
            for row in range(first[mixture], end):
                one = share[row, mode]
                for i in range(size):
                    apart = mean[row, mode, i] - centre[mixture, mode, i]
                    for k in range(size):
                        spread[mixture, mode, i, k] += one * (
                            covariance[row, mode, i, k]
                            + apart * (mean[row, mode, k] - centre[mixture, mode, k])
                        )
    return centre, spread


@compiled(_NEW[2](_3, _3, _4, _2, _INTS))
def log_densities(
    mean: FloatArray,
    pair_mean: FloatArray,
    precision: FloatArray,
    log_determinant: FloatArray,
    to: IntArray,
) -> FloatArray:
    """Return the log density of each pair at its later mode's mean, up to a constant, (H, K)."""
    count, pairs, size = pair_mean.shape
    found = np.empty((count, pairs))
    apart = np.empty(size)
    for row in range(count):
        for pair in range(pairs):
            square = 0.0
            for i in range(size):
                apart[i] = mean[row, to[pair], i] - pair_mean[row, pair, i]
                total = 0.5 * precision[row, pair, i, i] * apart[i]
                for k in range(i):
                    total += precision[row, pair, i, k] * apart[k]
                square += 2.0 * total * apart[i]
            found[row, pair] = 0.5 * (log_determinant[row, pair] - square)
    return found


@compiled(types.Tuple((_NEW[3], _NEW[4]))(*(_3, _4, _2, _2, _INTS, _INTS), *(_4, _3, _4, _3, _4)))
def blend(
    own_mean: FloatArray,
    own_covariance: FloatArray,
    joint: FloatArray,
    died: FloatArray,
    of: IntArray,
    to: IntArray,
    gain: FloatArray,
    offset: FloatArray,
    base: FloatArray,
    later_mean: FloatArray,
    later_covariance: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the Gaussians of each earlier mode, given later ones; see `smoother`."""
    count, modes = own_mean.shape[:2]
    size = SIZE  # a constant for the compiler, which halves the time
    if own_mean.shape[2] != size:
        raise ValueError("states are not planar")
    mean, covariance = np.zeros((count, modes, size)), np.zeros((count, modes, size, size))
    pairs = len(of)
    moved, spread = np.empty((pairs, size)), np.empty((pairs, size, size))
    half, total = np.empty(size), np.empty(modes)
    for row in range(count):
        for mode in range(modes):
            total[mode] = 0.0
        for pair in range(pairs):
            total[of[pair]] += joint[row, pair]
        for pair in range(pairs):
            after, mode = to[pair], of[pair]
            if not joint[row, pair] > 0.0:
                continue
            share = joint[row, pair] / total[mode]
            for i in range(size):
                place = offset[row, pair, i]
                for k in range(size):
                    place += gain[row, pair, i, k] * later_mean[row, after, k]
                moved[pair, i] = place
                mean[row, mode, i] += share * place
                for n in range(size):
                    half[n] = 0.0
                for k in range(size):
                    for n in range(size):
                        half[n] += gain[row, pair, i, k] * later_covariance[row, after, k, n]
                for k in range(i + 1):
                    value = base[row, pair, i, k]
                    for n in range(size):
                        value += half[n] * gain[row, pair, k, n]
                    spread[pair, i, k] = value
        for pair in range(pairs):
            mode = of[pair]
            if not joint[row, pair] > 0.0:
                continue
            share = joint[row, pair] / total[mode]
            for i in range(size):
                apart = moved[pair, i] - mean[row, mode, i]
                for k in range(i + 1):
                    covariance[row, mode, i, k] += share * (
                        spread[pair, i, k] + apart * (moved[pair, k] - mean[row, mode, k])
                    )
        for mode in range(modes):
            share = 1.0
            if total[mode] > 0.0:
                share = died[row, mode] / (total[mode] + died[row, mode])
            for i in range(size):
                apart = own_mean[row, mode, i] - mean[row, mode, i]
                for k in range(i + 1):
                    value = (1.0 - share) * covariance[row, mode, i, k]
                    value += share * own_covariance[row, mode, i, k]
                    value += (share * (1.0 - share)) * (
                        apart * (own_mean[row, mode, k] - mean[row, mode, k])
                    )
                    # Axes that a mode lacks stay zero, even where other modes have them.
                    if not own_covariance[row, mode, i, i] > 0.0:
                        value = 0.0
                    if not own_covariance[row, mode, k, k] > 0.0:
                        value = 0.0
                    covariance[row, mode, i, k] = covariance[row, mode, k, i] = value
            for i in range(size):
                apart = own_mean[row, mode, i] - mean[row, mode, i]
                mean[row, mode, i] += share * apart
                if not own_covariance[row, mode, i, i] > 0.0:
                    mean[row, mode, i] = 0.0
    return mean, covariance


@compiled(
    types.Tuple((_NEW_INTS, _NEW_INTS, _NEW[2]))(
        *(_INTS, _INTS, _3, _3, _4, _2, _2, _1, _FLAGS, _FLAGS, _FLOAT)
    )
)
def gate_pairs(
    row: IntArray,
    column: IntArray,
    expected: FloatArray,
    rate: FloatArray,
    covariance: FloatArray,
    measurement: FloatArray,
    noise_std: FloatArray,
    time_s: FloatArray,
    alive: Any,
    surrounded: Any,
    sigmas: float,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the pairs in the gate of any of their Gaussians, and their log likelihoods."""
    modes = expected.shape[1]
    near_row, near_column = np.empty(len(row), np.int64), np.empty(len(row), np.int64)
    log_likelihood = np.empty((len(row), modes))
    found = 0
    for pair in range(len(row)):
        one, detection = row[pair], column[pair]
        range_variance = noise_std[detection, 0] * noise_std[detection, 0]
        azimuth_variance = noise_std[detection, 1] * noise_std[detection, 1]
        time, any_near = time_s[detection], False
        for mode in range(modes):
            along = measurement[detection, 0] - expected[one, mode, 0] - rate[one, mode, 0] * time
            across = measurement[detection, 1] - expected[one, mode, 1] - rate[one, mode, 1] * time
            across = _wrapped(across)
            spread = covariance[one, mode]
            a, b = spread[0, 0] + range_variance, spread[0, 1]
            c = spread[1, 1] + azimuth_variance
            determinant = max(a * c - b * b, np.finfo(np.float64).tiny)
            square = (c * along**2 - 2.0 * b * along * across + a * across**2) / determinant
            near = surrounded[one, mode] or (square <= sigmas**2 and alive[one, mode])
            log_likelihood[found, mode] = -np.inf
            if near:
                log_likelihood[found, mode] = -0.5 * (square + math.log(determinant)) - math.log(
                    2.0 * math.pi
                )
                any_near = True
        near_row[found], near_column[found] = one, detection
        found += any_near
    return near_row[:found], near_column[:found], log_likelihood[:found]


@compiled(types.Tuple((_BOOL, _NEW_INTS))(_INTS, _2, _3, _FLOAT))
def clusters(
    target: IntArray, mean: FloatArray, covariance: FloatArray, distance: float
) -> tuple[bool, IntArray]:
    """Return success, and the row into which each hypothesis is merged.

    The call fails if a covariance is not positive definite. `target` ascends.
    """
    count, size = mean.shape
    into = np.full(count, -1)
    factor, apart = np.empty((size, size)), np.empty(size)
    for centre in range(count):
        if into[centre] >= 0:
            continue
        into[centre] = centre
        if centre + 1 == count or target[centre + 1] != target[centre]:
            continue
        for i in range(size):
            for k in range(i + 1):
                total = covariance[centre, i, k]
                for n in range(k):
                    total -= factor[i, n] * factor[k, n]
                if i != k:
                    factor[i, k] = total / factor[k, k]
                elif total > 0.0:
                    factor[i, i] = math.sqrt(total)
                else:
                    return False, into
        for row in range(centre + 1, count):
            if target[row] != target[centre]:
                break
            if into[row] >= 0:
                continue
            square = 0.0
            for i in range(size):
                total = mean[row, i] - mean[centre, i]
                for n in range(i):
                    total -= factor[i, n] * apart[n]
                apart[i] = total / factor[i, i]
                square += apart[i] * apart[i]
            if square <= distance:
                into[row] = centre
    return True, into
