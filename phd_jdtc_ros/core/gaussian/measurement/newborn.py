"""Targets born at detections: their Gaussians, by range and azimuth, range rate and amplitude."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import FloatArray, IntArray
from ...models.detection_birth import Newborn
from ...sensors.range_rate import Rates
from ..algebra import range_rate
from ..dynamics import Dynamics
from ..mixture import Mixture
from .amplitude import log_amplitude

# Of the newborn velocity's prior; folds of a range rate farther out are left out.
BIRTH_SIGMA = 5.0
# Probability of a fold of a newborn target's range rate below which it is left out.
LEAST_FOLD = 1e-3


def newborn_mixture(newborn: Newborn, dynamics: Dynamics, label: int) -> Mixture:
    """Return targets born at detections, one hypothesis each.

    With ambiguous range rates there is one for each possible fold.

    Parameters
    ----------
    newborn : Newborn
        J of them.
    dynamics : Dynamics
    label : int
        Of the first one; the others follow.

    Returns
    -------
    mixture : Mixture
    """
    row = np.arange(len(newborn))
    mean, covariance = _gaussians(newborn, dynamics)
    if (rates := newborn.report.range_rates) is not None:
        row, share, mean, covariance = _by_fold(newborn, rates, mean, covariance)
        newborn = newborn.take(row)
        newborn = replace(newborn, mass=newborn.mass * share[:, None])
    supported = dynamics.supported[:, :, None] * dynamics.supported[:, None, :]
    added = Mixture(
        label + row,
        np.tensordot(newborn.mass, dynamics.born, axes=1),
        mean[:, None] * dynamics.supported,
        covariance[:, None] * supported,
    )
    if newborn.report.detections.amplitude is not None:
        added = _weighed_by_amplitude(added, newborn, dynamics)
    return added


def _gaussians(newborn: Newborn, dynamics: Dynamics) -> tuple[FloatArray, FloatArray]:
    """Return newborn targets at their detections, without range rates, (J, D) and (J, D, D)."""
    births, space = dynamics.model.detection_births, dynamics.model.modes.space
    detections = newborn.report.detections
    plots = newborn.report.in_plane
    place, speed = list(space.position), list(space.velocity)
    size = dynamics.supported.shape[1]
    covariance = np.zeros((len(newborn), size, size))
    covariance[np.ix_(range(len(newborn)), place, place)] = plots.root @ plots.root.swapaxes(1, 2)
    covariance[:, speed, speed] = births.velocity_std**2
    covariance[:, space.turn_rate, space.turn_rate] = births.turn_rate_std**2
    if detections.time_s is not None:  # back to where it was at the scan's stamp
        back = np.broadcast_to(np.eye(size), covariance.shape).copy()
        back[:, place, speed] = -detections.time_s[:, None]
        covariance = back @ covariance @ back.swapaxes(1, 2)
    mean = np.zeros((len(newborn), size))
    mean[:, place] = plots.position
    return mean, covariance


def _by_fold(
    newborn: Newborn,
    rates: Rates,
    mean: FloatArray,
    covariance: FloatArray,
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Return newborn Gaussians updated with each probable fold of their range rates.

    Returns
    -------
    row : int array of shape (K,)
        The newborn target of each, ascending.
    share : array of shape (K,)
        Probability of the fold.
    mean, covariance : arrays of shape (K, D) and (K, D, D)
    """
    sensor, time_s = newborn.report.sensor, newborn.report.detections.time_s
    before = range_rate.expected(mean, covariance, sensor, time_s)
    reach = BIRTH_SIGMA * float(np.sqrt((before.variance + rates.std**2).max()))
    each = range_rate.folds_of(rates, before.rate, reach)
    updated = [
        range_rate.updated(mean, covariance, before, range_rate.unfolded(rates, rate))
        for rate in each
    ]
    log_likelihood = np.stack([one.log_likelihood for one in updated], axis=1)
    share = np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True))
    # One that is unknown is the same in all folds.
    share[np.isnan(rates.rate), 1:] = 0.0
    share /= share.sum(axis=1, keepdims=True)
    share = np.where(share >= LEAST_FOLD, share, 0.0)
    share /= share.sum(axis=1, keepdims=True)
    row, fold = np.nonzero(share)
    means, covariances = (
        np.stack(part) for part in ([u.mean for u in updated], [u.covariance for u in updated])
    )
    return row, share[row, fold], means[fold, row], covariances[fold, row]


def _weighed_by_amplitude(added: Mixture, newborn: Newborn, dynamics: Dynamics) -> Mixture:
    """Return newborn targets, each class's weight spread over its cells by the amplitudes."""
    cells = dynamics.cells
    if len(cells) == len(dynamics.model.modes.classes):
        return added
    log_likelihood = log_amplitude(newborn.report, dynamics).T
    likelihood = np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True))
    of_class = (cells.class_of[:, None] == cells.class_of).astype(float)
    mean = likelihood @ of_class / of_class.sum(axis=1)
    factor = likelihood / np.where(mean > 0.0, mean, 1.0)
    return replace(added, weight=added.weight * factor[:, None, :])
