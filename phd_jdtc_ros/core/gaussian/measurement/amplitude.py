"""Detections by class and signal-to-noise ratio: how probable they are, and their amplitudes."""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray
from ...models import stationary
from ...sensors.polar_radar import RadarModel
from ...types import Detections
from ..dynamics import Dynamics
from ..mixture import Mixture
from .gating import Expected


def detection_probability(
    expected: Expected,
    detections: Detections,
    radar: RadarModel,
    dynamics: Dynamics,
) -> FloatArray:
    """Return the probability that each Gaussian is detected if it is the target, (H, R, S)."""
    model, cells = dynamics.model, dynamics.cells
    flat = expected.measured.reshape(-1, 2)
    azimuth_std = np.sqrt(expected.covariance[..., 1, 1].ravel() + radar.azimuth_std**2)
    seen = radar.missable(flat, detections.coverage, azimuth_std)
    probability = model.amplitudes.detection_probability(
        np.tile(dynamics.mode_of_cell, len(flat)),
        np.tile(cells.log_snr, len(flat)),
        flat[:, 0].repeat(len(cells)),
        radar,
        model.modes,
    )
    seen_and_detected: FloatArray = seen[:, None] * probability.reshape(-1, len(cells))
    return seen_and_detected.reshape(*expected.measured.shape[:2], len(cells))


def log_amplitude(detections: Detections, radar: RadarModel, dynamics: Dynamics) -> FloatArray:
    """Return log p_D g(a) of every cell and detection, shape (S, M)."""
    cells, count = len(dynamics.cells), len(detections)
    likelihood = dynamics.model.amplitudes.log_likelihood(
        dynamics.mode_of_cell,
        dynamics.cells.log_snr,
        detections,
        (np.arange(cells).repeat(count), np.tile(np.arange(count), cells)),
        radar,
        dynamics.model.modes,
    )
    return likelihood.reshape(cells, count)


def slow(mixture: Mixture, radar: RadarModel) -> FloatArray:
    """Return how probable it is that each hypothesis is slower than `clutter_map_speed`, (H,)."""
    axes = list(radar.space.velocity)
    covariance = mixture.covariance[..., axes, :][..., axes]
    slower = stationary.slower(mixture.mean[..., axes], covariance, radar.clutter_map_speed)
    weight = np.einsum("hrs->hr", mixture.weight)
    total = np.maximum(weight.sum(axis=1), np.finfo(float).tiny)
    probability: FloatArray = (weight * slower).sum(axis=1) / total
    return probability
