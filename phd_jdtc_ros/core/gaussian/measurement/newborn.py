"""Targets born at detections: their Gaussians, by range and azimuth, range rate and amplitude."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import FloatArray, IntArray
from ...models.detection_birth import Newborn
from ...sensors.polar_radar import LEAST_RANGE, Rates
from ..algebra import range_rate
from ..dynamics import Dynamics
from ..mixture import Mixture
from .amplitude import log_amplitude

# Of the newborn velocity's prior; folds of a range rate farther out are left out.
BIRTH_SIGMA = 5.0
# Probability of a fold of a newborn target's range rate below which it is left out.
LEAST_FOLD = 1e-3


def newborn_mixture(newborn: Newborn, dynamics: Dynamics, origin: int) -> Mixture:
    """Return targets born at detections, one hypothesis each.

    With ambiguous range rates there is one for each possible fold.

    Parameters
    ----------
    newborn : Newborn
        J of them.
    dynamics : Dynamics
    origin : int
        Of the first one; the others follow.

    Returns
    -------
    mixture : Mixture
    """
    row = np.arange(len(newborn))
    mean, covariance = _gaussians(newborn, dynamics)
    if (rates := newborn.radar.rates_of(newborn.detections)) is not None:
        row, share, mean, covariance = _by_fold(newborn, rates, mean, covariance)
        newborn = newborn.take(row)
        newborn = replace(newborn, mass=newborn.mass * share[:, None])
    supported = dynamics.supported[:, :, None] * dynamics.supported[:, None, :]
    added = Mixture(
        origin + row,
        np.tensordot(newborn.mass, dynamics.born, axes=1),
        mean[:, None] * dynamics.supported,
        covariance[:, None] * supported,
    )
    if newborn.detections.amplitude is not None:
        added = _told_by_amplitude(added, newborn, dynamics)
    return added


def _gaussians(newborn: Newborn, dynamics: Dynamics) -> tuple[FloatArray, FloatArray]:
    """Return where newborn targets are by range and azimuth, (J, D) and (J, D, D)."""
    births, space = dynamics.model.detection_births, dynamics.model.modes.space
    radar, detections = newborn.radar, newborn.detections
    place, speed = list(space.position), list(space.velocity)
    size = dynamics.supported.shape[1]
    position = radar.to_world(detections.measurement)
    own = radar.detection_noise(detections)
    std = np.broadcast_to(radar.noise_std, position.shape) if own is None else own
    # Along the line of sight and across it; at the radar itself there is no azimuth.
    bearing = detections.measurement[:, 1] + radar.yaw
    along = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    distance = np.maximum(detections.measurement[:, 0], LEAST_RANGE)
    to_world = np.stack([along * std[:, :1], across * (distance * std[:, 1])[:, None]], axis=2)
    covariance = np.zeros((len(newborn), size, size))
    covariance[np.ix_(range(len(newborn)), place, place)] = to_world @ to_world.swapaxes(1, 2)
    covariance[:, speed, speed] = births.velocity_std**2
    covariance[:, space.turn_rate, space.turn_rate] = births.turn_rate_std**2
    if detections.time_s is not None:  # back to where it was at the scan's stamp
        back = np.broadcast_to(np.eye(size), covariance.shape).copy()
        back[:, place, speed] = -detections.time_s[:, None]
        covariance = back @ covariance @ back.swapaxes(1, 2)
    mean = np.zeros((len(newborn), size))
    mean[:, place] = position
    return mean, covariance


def _by_fold(
    newborn: Newborn,
    rates: Rates,
    mean: FloatArray,
    covariance: FloatArray,
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Return newborn Gaussians told by each probable fold of their range rates.

    Returns
    -------
    row : int array of shape (K,)
        The newborn target of each, ascending.
    share : array of shape (K,)
        Probability of the fold.
    mean, covariance : arrays of shape (K, D) and (K, D, D)
    """
    radar, time_s = newborn.radar, newborn.detections.time_s
    before = range_rate.expected(mean, covariance, radar, time_s)
    reach = BIRTH_SIGMA * float(np.sqrt((before.variance + rates.std**2).max()))
    each = range_rate.folds_of(rates, before.rate, reach)
    told = [
        range_rate.told(mean, covariance, before, range_rate.unfolded(rates, rate)) for rate in each
    ]
    log_likelihood = np.stack([one.log_likelihood for one in told], axis=1)
    share = np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True))
    # One that is unknown is the same in all folds.
    share[np.isnan(rates.rate), 1:] = 0.0
    share /= share.sum(axis=1, keepdims=True)
    share = np.where(share >= LEAST_FOLD, share, 0.0)
    share /= share.sum(axis=1, keepdims=True)
    row, fold = np.nonzero(share)
    means, covariances = (
        np.stack(part) for part in ([t.mean for t in told], [t.covariance for t in told])
    )
    return row, share[row, fold], means[fold, row], covariances[fold, row]


def _told_by_amplitude(added: Mixture, newborn: Newborn, dynamics: Dynamics) -> Mixture:
    """Return newborn targets with each class's weight over its cells as their amplitudes tell."""
    cells = dynamics.cells
    if len(cells) == len(dynamics.model.modes.classes):
        return added
    log_likelihood = log_amplitude(newborn.detections, newborn.radar, dynamics).T
    likelihood = np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True))
    of_class = (cells.class_of[:, None] == cells.class_of).astype(float)
    mean = likelihood @ of_class / of_class.sum(axis=1)
    factor = likelihood / np.where(mean > 0.0, mean, 1.0)
    return replace(added, weight=added.weight * factor[:, None, :])
