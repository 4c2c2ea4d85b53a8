"""Gaussians of targets born at detections, from position, range rate or velocity, and amplitude."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import TINY, FloatArray, IntArray
from ...models.detection_birth import Newborn
from ...sensors.gaussians import PlanePlots
from ...sensors.range_rate import Rates
from ...sensors.view import View
from ..algebra import range_rate
from ..dynamics import Dynamics
from ..mixture import Mixture
from .amplitude import log_amplitude
from .velocity import update_velocities

# Folds of a range rate beyond this many standard deviations of the birth velocity are left out.
BIRTH_SIGMA = 5.0
# Folds of a newborn target's range rate with a smaller probability are left out.
LEAST_FOLD = 1e-3


def newborn_mixture(newborn: Newborn, dynamics: Dynamics, label: int) -> Mixture:
    """Return targets born at detections, one hypothesis each.

    An ambiguous range rate gives one hypothesis for each possible fold, and a detection without an
    elevation one for each of several heights.

    Parameters
    ----------
    newborn : Newborn
        J targets.
    label : int
        Label of the first target; the others follow.
    """
    row, share, plots = newborn.report.sensor.places_of_births(newborn.report.detections)
    if len(row) != len(newborn):
        newborn = _take(newborn, row, share)
    mean, covariance = _gaussians(newborn, plots, dynamics)
    if (rates := newborn.report.range_rates) is not None:
        fold, share, mean, covariance = _split_by_fold(newborn, rates, mean, covariance)
        newborn, row = _take(newborn, fold, share), row[fold]
    elif (
        newborn.report.detections.velocity is not None
        and (velocities := newborn.report.velocities) is not None
    ):
        mean, covariance, _ = update_velocities(mean, covariance, velocities)
    supported = dynamics.supported[:, :, None] * dynamics.supported[:, None, :]
    class_weight = dynamics.birth_weight
    classes, modes = class_weight.shape[:2]
    weight = newborn.mass.dot(class_weight.reshape(classes, -1))
    has_amplitude = newborn.report.detections.amplitude is not None
    return dynamics.nothing.changed(
        row_label=label + row,
        weight=weight.reshape(len(row), modes, classes),
        mean=mean[:, None] * dynamics.supported,
        covariance=covariance[:, None] * supported,
        snr=_snr_given_amplitude(newborn.report, dynamics)
        if has_amplitude
        else dynamics.unknown_snr(len(row)),
    )


def _take(newborn: Newborn, row: IntArray, share: FloatArray) -> Newborn:
    """Return these rows of newborn targets, with a share of the mass of each."""
    taken = newborn.take(row)
    return replace(taken, mass=taken.mass * share[:, None])


def _gaussians(
    newborn: Newborn, plots: PlanePlots, dynamics: Dynamics
) -> tuple[FloatArray, FloatArray]:
    """Return newborn targets at their places, without range rates, (J, D) and (J, D, D)."""
    births, space = dynamics.model.detection_births, dynamics.model.modes.space
    detections = newborn.report.detections
    position, velocity = list(space.place), list(space.motion)
    size = dynamics.supported.shape[1]
    covariance = np.zeros((len(newborn), size, size))
    covariance[:, np.array(position)[:, None], position] = plots.root @ plots.root.swapaxes(1, 2)
    std = [births.velocity_std, births.velocity_std, births.climb_std]
    covariance[:, velocity, velocity] = np.square(std[: len(velocity)])
    covariance[:, space.turn_rate, space.turn_rate] = births.turn_rate_std**2
    if detections.time_s is not None:  # They are moved to their positions at the scan's stamp.
        to_stamp = np.eye(size)[None].repeat(len(newborn), axis=0)
        to_stamp[:, position, velocity] = -detections.time_s[:, None]
        covariance = to_stamp @ covariance @ to_stamp.swapaxes(1, 2)
    mean = np.zeros((len(newborn), size))
    mean[:, position] = plots.position
    return mean, covariance


def _split_by_fold(
    newborn: Newborn,
    rates: Rates,
    mean: FloatArray,
    covariance: FloatArray,
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Return newborn Gaussians updated with each probable fold of their range rates.

    Returns
    -------
    row : int array of shape (K,)
        Index of each Gaussian's newborn target, ascending.
    share : array of shape (K,)
        Probability of the fold.
    mean, covariance : arrays of shape (K, D) and (K, D, D)
    """
    sensor, time_s = newborn.report.sensor, newborn.report.detections.time_s
    in_plane = range_rate.expected_rates(mean, covariance, sensor, time_s)
    expected = range_rate.expected_at(in_plane, rates)
    reach = BIRTH_SIGMA * float(np.sqrt((expected.variance + rates.std**2).max()))
    fold_rates = range_rate.folds_of(rates, expected.rate, reach)
    updated = [
        range_rate.update_expected(mean, covariance, expected, range_rate.unambiguous(rates, rate))
        for rate in fold_rates
    ]
    log_likelihood = np.stack([update.log_likelihood for update in updated], axis=1)
    share = np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True))
    # An unknown range rate has a single fold.
    share[np.isnan(rates.rate), 1:] = 0.0
    share /= share.sum(axis=1, keepdims=True)
    share = np.where(share >= LEAST_FOLD, share, 0.0)
    share /= share.sum(axis=1, keepdims=True)
    row, fold = np.nonzero(share)
    means, covariances = (
        np.stack(columns)
        for columns in ([u.mean for u in updated], [u.covariance for u in updated])
    )
    return row, share[row, fold], means[fold, row], covariances[fold, row]


def _snr_given_amplitude(report: View, dynamics: Dynamics) -> FloatArray:
    """Return the probabilities of the cells of SNR, given each detection's amplitude, (M, C, S)."""
    log_likelihood = log_amplitude(report, dynamics).transpose(2, 0, 1)
    largest = log_likelihood.max(axis=2, keepdims=True)
    likelihood = np.exp(log_likelihood - np.where(largest > -np.inf, largest, 0.0))
    total = likelihood.sum(axis=2, keepdims=True)
    share = likelihood / np.maximum(total, TINY)
    return np.ascontiguousarray(np.where(total > 0.0, share, dynamics.cells.prior))
