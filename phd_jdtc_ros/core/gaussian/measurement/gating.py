"""Gating: which detections may be those of a hypothesis, and about how likely each is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ... import backend
from ...arrays import FloatArray, IntArray
from ...pair_search.bands import in_boxes
from ...sensors.polar_radar import LEAST_RANGE, RadarModel, wrap_angle
from ...types import Detections
from ...window.entries import BoolArray
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
    own = radar.detection_noise(detections)
    noise = radar.noise_std if own is None else own.max(axis=0, initial=0.0)
    row, column = _near(mixture, expected, noise, detections, radar)
    alive, surrounded = mixture.mode_weight > 0.0, _surrounded(expected, noise)
    rate, times = None, detections.time_s
    if times is not None:
        rate = radar.measurement_rate(mixture.mean.reshape(-1, mixture.mean.shape[2]))
        rate = rate.reshape(expected.measured.shape)
    if loops := backend.compiled("gaussian.algebra"):
        size, measured = len(detections), np.ascontiguousarray(expected.measured)
        found: tuple[IntArray, IntArray, FloatArray] = loops.gated(
            *(row, column, measured, np.zeros_like(measured) if rate is None else rate),
            *(np.ascontiguousarray(expected.covariance), detections.measurement),
            np.ascontiguousarray(
                np.broadcast_to(radar.noise_std if own is None else own, (size, 2))
            ),
            *(np.zeros(size) if times is None else times, alive, surrounded, GATE_SIGMA),
        )
        return found
    error = detections.measurement[column][:, None] - expected.measured[row]
    if rate is not None and times is not None:
        error -= rate[row] * times[column][:, None, None]
    along, across = error[..., 0], wrap_angle(error[..., 1])
    spread = expected.covariance[row]
    std = radar.noise_std if own is None else own[column][:, None]
    a, b = spread[..., 0, 0] + std[..., 0] ** 2, spread[..., 0, 1]
    c = spread[..., 1, 1] + std[..., 1] ** 2
    determinant = np.maximum(a * c - b * b, np.finfo(float).tiny)
    square = (c * along**2 - 2.0 * b * along * across + a * across**2) / determinant
    near = ((square <= GATE_SIGMA**2) & alive[row]) | surrounded[row]
    log_likelihood = -0.5 * (square + np.log(determinant)) - np.log(2.0 * np.pi)
    pairs = np.flatnonzero(near.any(axis=1))
    rough = np.where(near[pairs], log_likelihood[pairs], -np.inf)
    return row[pairs], column[pairs], rough


def _near(
    mixture: Mixture,
    expected: Expected,
    noise: FloatArray,
    detections: Detections,
    radar: RadarModel,
) -> tuple[IntArray, IntArray]:
    """Return the pairs of a hypothesis and a detection in the box around its gates."""
    measured = expected.measured
    reach = GATE_SIGMA * np.sqrt(expected.covariance[..., [0, 1], [0, 1]] + noise**2)
    if detections.time_s is not None and len(detections):
        speed = np.abs(mixture.mean[..., list(radar.space.velocity)]).sum(axis=-1)
        moved = speed * np.abs(detections.time_s).max()
        reach[..., 0] += moved
        reach[..., 1] += moved / np.maximum(measured[..., 0], LEAST_RANGE)
    alive = (mixture.mode_weight > 0.0) & (measured[..., 0] - reach[..., 0] <= radar.max_range)
    # One box around the gates of all motion modes; the first that has weight is its centre.
    centre = np.take_along_axis(measured[..., 1], alive.argmax(axis=1)[:, None], axis=1)
    half = np.abs(wrap_angle(measured[..., 1] - centre)) + reach[..., 1]
    half = np.where(alive, half, 0.0).max(axis=1)
    near = np.where(alive, measured[..., 0] - reach[..., 0], np.inf).min(axis=1)
    far = np.where(alive, measured[..., 0] + reach[..., 0], -np.inf).max(axis=1)
    half = np.where(_surrounded(expected, noise).any(axis=1), np.pi, half)
    return in_boxes(np.stack([near, far], axis=1), centre[:, 0], half, detections.measurement)


def _surrounded(expected: Expected, noise: FloatArray) -> BoolArray:
    """Return which Gaussians surround the radar, which then may see them anywhere, (H, R)."""
    spread = np.sqrt(expected.covariance[..., 0, 0] + noise[0] ** 2)
    around = expected.measured[..., 0] <= GATE_SIGMA * spread
    # The azimuth's variance grows with the square of the angle that the Gaussian covers.
    wide = GATE_SIGMA * np.sqrt(expected.covariance[..., 1, 1]) >= 0.5 * np.pi
    surrounded: BoolArray = around & wide
    return surrounded
