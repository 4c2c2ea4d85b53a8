"""Gating: which detections may be those of a hypothesis, and about how likely each is."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray
from ...compilation import Float1, Float2, Float3, Float4, Int1, compiled, contiguous, inner
from ...sensors.polar_radar import LEAST_RANGE, RadarModel
from ...types import FULL_TURN, Detections
from ..algebra.blocks import wrapped
from ..algebra.kalman import TINY
from ..mixture import Mixture

# Radius of the gate in standard deviations of the innovation; 4e-6 of the detections are outside.
GATE_SIGMA = 5.0


class Expected(NamedTuple):
    """What a radar would measure of each Gaussian.

    Parameters
    ----------
    measured : array of shape (H, R, 2)
        Range in metres and azimuth in radians.
    covariance : array of shape (H, R, 2, 2)
        Without the radar's noise.
    """

    measured: FloatArray
    covariance: FloatArray

    @staticmethod
    def of(mixture: Mixture, radar: RadarModel) -> Expected:
        """Return what a radar would measure of a mixture's Gaussians."""
        place = list(radar.space.position)
        measured, jacobian = radar.linearised(mixture.mean[..., place])
        position = mixture.covariance[..., place, :][..., place]
        return Expected(measured, jacobian @ position @ jacobian.swapaxes(-1, -2))


@inner
def _longer(array: Any, size: int) -> Any:
    """Return a table with room for more rows."""
    longer = np.empty((size, array.shape[1]), array.dtype)
    longer[: len(array)] = array
    return longer


@inner
def _box(
    measured: FloatArray,
    reach: FloatArray,
    weight: FloatArray,
    max_range: float,
    box: FloatArray,
) -> bool:
    """Write least and largest range, centre and half width in azimuth around a row's gates.

    Return whether there are any: of Gaussians that have weight and reach into the radar's range.
    """
    found = False
    for mode in range(len(weight)):
        near, far = measured[mode, 0] - reach[mode, 0], measured[mode, 0] + reach[mode, 0]
        if not (weight[mode] > 0.0 and near <= max_range):
            continue
        if not found:
            box[0], box[1], box[2], box[3] = near, far, measured[mode, 1], 0.0
            found = True
        box[0], box[1] = min(box[0], near), max(box[1], far)
        half = abs(wrapped(measured[mode, 1] - box[2])) + reach[mode, 1]
        box[3] = max(box[3], half)
    return found


@compiled
def _gated(
    max_range: float,
    measured: Float3,
    covariance: Float4,
    rate: Float3,
    moved: Float3,
    weight: Float2,
    detection: Float2,
    order: Int1,
    azimuth: Float1,
    noise_std: Float2,
    time_s: Float1,
    widest: Float1,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the results of `gated`.

    `azimuth` is that of the detections in ascending `order`, within a full turn from 0; `widest`
    is the largest noise of any, and `moved` how far the measurement moves by their times.
    """
    count, modes = weight.shape
    room, found = 4 * count + 64, 0
    pairs, log_likelihood = np.empty((room, 2), np.int64), np.empty((room, modes))
    around, reach, box = np.empty(modes, np.bool_), np.empty((modes, 2)), np.empty(4)
    for row in range(count):
        anywhere = False
        for mode in range(modes):
            spread = covariance[row, mode]
            for axis in range(2):
                std = math.sqrt(spread[axis, axis] + widest[axis] ** 2)
                reach[mode, axis] = GATE_SIGMA * std + moved[row, mode, axis]
            # The azimuth's variance grows with the square of the angle that the Gaussian covers.
            wide = GATE_SIGMA * math.sqrt(spread[1, 1]) >= 0.5 * math.pi
            inside = GATE_SIGMA * math.sqrt(spread[0, 0] + widest[0] ** 2)
            around[mode] = measured[row, mode, 0] <= inside and wide
            anywhere = anywhere or around[mode]
        if not _box(measured[row], reach, weight[row], max_range, box):
            continue
        half = math.pi if anywhere else min(box[3], math.pi)
        low = (box[2] - half) % FULL_TURN
        begin = np.searchsorted(azimuth, low)
        for step in range(len(order)):
            place = (begin + step) % len(order)
            if half < math.pi and (azimuth[place] - low) % FULL_TURN > 2.0 * half:
                break
            one = order[place]
            if not box[0] <= detection[one, 0] <= box[1]:
                continue
            if found == room:
                room *= 2
                pairs, log_likelihood = _longer(pairs, room), _longer(log_likelihood, room)
            near = False
            for mode in range(modes):
                time = time_s[one]
                along = detection[one, 0] - measured[row, mode, 0] - rate[row, mode, 0] * time
                across = detection[one, 1] - measured[row, mode, 1] - rate[row, mode, 1] * time
                across = wrapped(across)
                spread = covariance[row, mode]
                a, b = spread[0, 0] + noise_std[one, 0] ** 2, spread[0, 1]
                c = spread[1, 1] + noise_std[one, 1] ** 2
                determinant = max(a * c - b * b, TINY)
                square = (c * along**2 - 2.0 * b * along * across + a * across**2) / determinant
                log_likelihood[found, mode] = -np.inf
                if around[mode] or (square <= GATE_SIGMA**2 and weight[row, mode] > 0.0):
                    log_density = -0.5 * (square + math.log(determinant))
                    log_likelihood[found, mode] = log_density - math.log(FULL_TURN)
                    near = True
            pairs[found, 0], pairs[found, 1] = row, one
            found += near
    return pairs[:found, 0].copy(), pairs[:found, 1].copy(), log_likelihood[:found]


def gated(
    mixture: Mixture, expected: Expected, detections: Detections, radar: RadarModel
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the pairs of a hypothesis and a detection in the gate of one of its Gaussians.

    Returns
    -------
    row, column : int arrays of shape (P,)
    log_likelihood : array of shape (P, R)
        Of the measurement linearised at the mean; -inf outside the gate of a Gaussian.
    """
    size, shape = len(detections), expected.measured.shape
    own, times = radar.detection_noise(detections), detections.time_s
    rate, moved = np.zeros(shape), np.zeros(shape)
    if times is not None and size:
        rate = radar.measurement_rate(mixture.mean.reshape(-1, mixture.mean.shape[2]))
        rate = rate.reshape(shape)
        speed = np.abs(mixture.mean[..., list(radar.space.velocity)]).sum(axis=-1)
        moved[..., 0] = speed * np.abs(times).max()
        moved[..., 1] = moved[..., 0] / np.maximum(expected.measured[..., 0], LEAST_RANGE)
    std = np.broadcast_to(radar.noise_std, (size, 2)) if own is None else own
    widest = radar.noise_std if own is None else own.max(axis=0, initial=0.0)
    azimuth = np.mod(detections.measurement[:, 1], FULL_TURN)
    order = np.argsort(azimuth, kind="stable")
    return _gated(
        radar.max_range,
        *contiguous(expected.measured, expected.covariance, rate, moved, mixture.mode_weight),
        *contiguous(detections.measurement, order, azimuth[order], std),
        *contiguous(np.zeros(size) if times is None else times, widest),
    )
