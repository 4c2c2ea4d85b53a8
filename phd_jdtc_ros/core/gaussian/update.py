# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The update: every detection in a hypothesis's gate makes a new hypothesis of the same target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .. import origins
from ..arrays import FloatArray, IntArray, sum_by
from ..association.bernoulli import Claims, bernoulli
from ..association.marginals import LEAST_CLUTTER
from ..models import rest
from ..models.clutter_memory import ClutterMemory
from ..models.detection_birth import Newborn
from ..models.other_sources import OtherSources, other_sources
from ..models.overload import thinned
from ..models.radar import LEAST_RANGE, RadarModel, Rates
from ..models.tracker_model import TrackerModel
from ..types import Detections, Scan
from . import kalman, range_rate
from .dynamics import Dynamics
from .gating import Expected, gated
from .mixture import Mixture
from .reduction import Bounds, Branched, probable

# Of the sources of a detection, and of the hypotheses of a target; pairs below it are left out
# before they are located.
LEAST_SHARE = 1e-4
# Of the newborn velocity's prior; folds of a range rate farther out are left out.
BIRTH_SIGMA = 5.0
# Probability of a fold of a newborn target's range rate below which it is left out.
LEAST_FOLD = 1e-3


def update(
    predicted: Branched,
    detections: Detections,
    radar: RadarModel,
    dynamics: Dynamics,
    bounds: Bounds,
    dt: float,
    clutter: ClutterMemory | None = None,
    earlier: Sequence[Newborn] = (),
) -> tuple[Branched, Newborn | None, int]:
    """Update the hypotheses with one radar's detections.

    Parameters
    ----------
    predicted : Branched
    detections : Detections
        M of them; a report without detections is valid.
    radar : RadarModel
    dynamics : Dynamics
    bounds : Bounds
    dt : float
        True interval since the previous scan, seconds.
    clutter : ClutterMemory or None
        What is known of the radar's clutter, to learn from these detections; None to go by the
        radar model alone.
    earlier : sequence of Newborn
        Targets born at the detections of the scan's earlier radars.

    Returns
    -------
    branched : Branched
        Hypotheses once without a detection, and once with each in their gates; the most probable of
        each target.
    newborn : Newborn or None
        Targets born at these detections; None if births at detections are disabled.
    approximate : int
        Number of clusters of targets too large for exact association probabilities.

    Notes
    -----
    Let psi(z) be the weight of all Gaussians of a target times their likelihood of detection z,
    and p(z) and p(0) the marginal probabilities that the target has detection z or none. A
    hypothesis with z has its weight times its likelihood, times p(z) / psi(z).
    """
    model, mixture = dynamics.model, predicted.mixture
    detections = model.amplitudes.used(detections)
    radar = radar if clutter is None else clutter.informed(radar)
    expected = Expected.of(mixture, radar)
    flat = expected.measured.reshape(-1, 2)
    detections, radar, share = thinned(flat, float(mixture.mass.sum()), detections, radar)
    detectable = share * _detection_probability(expected, detections, radar, dynamics)
    missed = mixture.weight * (1.0 - detectable)
    log_amplitude = _log_amplitude(detections, radar, dynamics).T
    row, column, rough = gated(mixture, expected, detections, radar)
    rates = radar.rates_of(detections)
    if rates is not None:
        rough = rough + _rough_rates(mixture, row, column, rates, radar)
    log_mass = rough[..., None] + log_amplitude[column][:, None, :]
    others = _others(log_mass, column, detections, radar, model, dt, earlier)
    weight = _weight(mixture, row, column, log_mass, others)
    likely = _likely(mixture, row, column, weight, missed, others)
    row, column = row[likely], column[likely]

    found = _located(mixture, row, column, detections, radar)
    modes = mixture.mean.shape[1]
    log_likelihood, rated = found.log_likelihood, None
    if rates is not None:
        rated = _rated(mixture, row, column, found, rates, detections, radar)
        log_likelihood = log_likelihood + rated.log_likelihood
    log_mass = log_likelihood.reshape(-1, modes, 1) + log_amplitude[column][:, None, :]
    others = _others(log_mass, column, detections, radar, model, dt, earlier)
    weight = _weight(mixture, row, column, log_mass, others)
    prior = np.where(mixture.mass > 0.0, mixture.mass, 1.0)
    claims = Claims(
        row=row,
        column=column,
        mass=_summed(weight),
        other=others.total,
        detection_probability=_summed(mixture.weight * detectable) / prior,
    )
    shares = bernoulli(mixture.target, len(mixture.label), mixture.mass, claims)
    if clutter is not None and clutter.learns(radar):
        slow = claims.part(_slow(mixture, radar))
        still = model.detection_births.at_rest(slow, radar.clutter_map_speed)
        clutter.learn(radar, detections, shares.claimed, still)
    factor = shares.missed[mixture.target] * shares.prior / prior
    weight = np.concatenate([missed * factor[:, None, None], weight * shares.pair[:, None, None]])
    source = np.concatenate([np.arange(len(mixture)), row])
    located = _Located(found, rated, column, detections, radar)
    branched = _branched(predicted, source, weight, located, bounds)
    newborn = others.newborn(shares.claimed, radar, detections, model, share)
    return branched, newborn, shares.approximate


def _slow(mixture: Mixture, radar: RadarModel) -> FloatArray:
    """Return how probable it is that each hypothesis is slower than `clutter_map_speed`, (H,)."""
    axes = list(radar.space.velocity)
    covariance = mixture.covariance[..., axes, :][..., axes]
    slower = rest.slower(mixture.mean[..., axes], covariance, radar.clutter_map_speed)
    weight = np.einsum("hrs->hr", mixture.weight)
    total = np.maximum(weight.sum(axis=1), np.finfo(float).tiny)
    slow: FloatArray = (weight * slower).sum(axis=1) / total
    return slow


def _others(
    log_mass: FloatArray,
    column: IntArray,
    detections: Detections,
    radar: RadarModel,
    model: TrackerModel,
    dt: float,
    earlier: Sequence[Newborn],
) -> OtherSources:
    """Return the other sources of the detections, given log p_D L_z of the pairs, (P, R, S)."""
    largest = log_mass.max(axis=(1, 2), initial=-np.inf)
    return other_sources(detections, radar, model, dt, column, largest, earlier)


def _weight(
    mixture: Mixture,
    row: IntArray,
    column: IntArray,
    log_mass: FloatArray,
    others: OtherSources,
) -> FloatArray:
    """Return p_D L_z w of pairs, divided by the scale of their detections, shape (P, R, S)."""
    weight: FloatArray = mixture.weight[row] * np.exp(
        log_mass - others.log_scale[column, None, None]
    )
    return weight


def _likely(
    mixture: Mixture,
    row: IntArray,
    column: IntArray,
    weight: FloatArray,
    missed: FloatArray,
    others: OtherSources,
) -> IntArray:
    """Return the pairs that may be more than `LEAST_SHARE` of their target and their detection.

    Another target may claim a detection, however sure this target is of it. Of every detection only
    that part counts which others would leave even if all that want it did get it.
    """
    mass, total = _summed(weight), others.total
    target, count = mixture.target[row], len(mixture.label)
    odds = mass / np.maximum(total, LEAST_CLUTTER)[column]
    edge, place = np.unique(target * len(total) + column, return_inverse=True)
    own = sum_by(place.ravel(), odds, len(edge))
    wanted = sum_by(column, odds, len(total))[edge % max(len(total), 1)]
    left = own / (1.0 + np.maximum(wanted - own, 0.0))
    alone = 1.0 - mixture.existence + sum_by(mixture.target, _summed(missed), count)
    alone += sum_by(edge // max(len(total), 1), left, count)
    rows: IntArray = np.flatnonzero(odds > LEAST_SHARE * np.maximum(alone, 1.0)[target])
    return rows


def _located(
    mixture: Mixture, row: IntArray, column: IntArray, detections: Detections, radar: RadarModel
) -> kalman.Located:
    """Return where the detections put the Gaussians of pairs, leading shape (P R,)."""
    modes, size = mixture.mean.shape[1:]
    own = radar.detection_noise(detections)
    column = column.repeat(modes)
    return kalman.located(
        mixture.mean[row].reshape(-1, size),
        mixture.covariance[row].reshape(-1, size, size),
        radar,
        detections.measurement[column],
        np.broadcast_to(radar.noise_std, (len(column), 2)) if own is None else own[column],
        None if detections.time_s is None else detections.time_s[column],
    )


def _rough_rates(
    mixture: Mixture,
    row: IntArray,
    column: IntArray,
    rates: Rates,
    radar: RadarModel,
) -> FloatArray:
    """Return about the log likelihood of the range rates of pairs, (P, R): at the predicted means.

    The times of detections are left aside.
    """
    modes, size = mixture.mean.shape[1:]
    before = range_rate.expected(
        mixture.mean.reshape(-1, size), mixture.covariance.reshape(-1, size, size), radar
    )
    rate, variance = (part.reshape(-1, modes) for part in (before.rate, before.variance))
    error = rates.rate[column][:, None] - rate[row]
    return rates.model.log_density(error, variance[row] + rates.std[column][:, None] ** 2)


def _rated(
    mixture: Mixture,
    row: IntArray,
    column: IntArray,
    found: kalman.Located,
    rates: Rates,
    detections: Detections,
    radar: RadarModel,
) -> range_rate.Rated:
    """Return the Gaussians of pairs after range, azimuth and range rate, leading shape (P R,)."""
    modes, size = mixture.mean.shape[1:]
    column = column.repeat(modes)
    time_s = None if detections.time_s is None else detections.time_s[column]
    mean, covariance = kalman.updated(
        mixture.mean[row].reshape(-1, size),
        mixture.covariance[row].reshape(-1, size, size),
        *(radar, found, time_s),
    )
    return range_rate.rated(mean, covariance, radar, rates.take(column), time_s)


class _Located(NamedTuple):
    """What the detections of pairs make of their Gaussians, leading shape (P R,).

    Parameters
    ----------
    found : kalman.Located
        By range and azimuth.
    rated : range_rate.Rated or None
        With range rates too; None without them.
    column : int array of shape (P,)
        The detection of each pair.
    detections : Detections
    radar : RadarModel
    """

    found: kalman.Located
    rated: range_rate.Rated | None
    column: IntArray
    detections: Detections
    radar: RadarModel

    def updated(
        self, mean: FloatArray, covariance: FloatArray, pair: IntArray, gaussian: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return Gaussians after their detections; of some pairs, by row of these Gaussians."""
        if self.rated is not None:
            return self.rated.mean[gaussian], self.rated.covariance[gaussian]
        times = self.detections.time_s
        modes = len(gaussian) // max(len(pair), 1)
        return kalman.updated(
            *(mean, covariance, self.radar, self.found.take(gaussian)),
            None if times is None else times[self.column[pair]].repeat(modes),
        )


def _branched(
    predicted: Branched, source: IntArray, weight: FloatArray, located: _Located, bounds: Bounds
) -> Branched:
    """Return those hypotheses that are kept: first without a detection, then the pairs.

    Only their Gaussians are updated.
    """
    mixture = predicted.mixture
    kept, factor = probable(mixture.target[source], _summed(weight), bounds)
    source, weight = source[kept], weight[kept] * factor[:, None, None]
    modes, size = mixture.mean.shape[1:]
    mean, covariance = mixture.mean[source], mixture.covariance[source]
    paired = np.flatnonzero(kept >= len(mixture))
    pair = kept[paired] - len(mixture)
    gaussian = (pair[:, None] * modes + np.arange(modes)).ravel()
    later = located.updated(
        mean[paired].reshape(-1, size),
        covariance[paired].reshape(-1, size, size),
        pair,
        gaussian,
    )
    mean[paired] = later[0].reshape(-1, modes, size)
    covariance[paired] = later[1].reshape(-1, modes, size, size)
    return Branched(
        Mixture(mixture.origin[source], weight, mean, covariance), predicted.parent[source]
    )


def _summed(weight: FloatArray) -> FloatArray:
    """Return the sums over modes and cells, (N,); three times as fast as those of short axes."""
    total: FloatArray = np.einsum("hrs->h", weight)
    return total


def _detection_probability(
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


def _log_amplitude(detections: Detections, radar: RadarModel, dynamics: Dynamics) -> FloatArray:
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


def update_scan(
    predicted: Mixture,
    survivors: int,
    scan: Scan,
    dynamics: Dynamics,
    bounds: Bounds,
    dt: float,
    scan_index: int,
    clutter: ClutterMemory | None = None,
) -> tuple[Branched, int]:
    """Update with every radar that reported, in the configured order.

    Targets born at one radar's detections join the mixture before the next radar's update, so that
    two radars that detect a new target do not give birth to it twice.

    Parameters
    ----------
    predicted : Mixture
    survivors : int
        Number of its first rows that come from earlier scans.
    scan : Scan
    dynamics : Dynamics
    bounds : Bounds
    dt : float
        True interval since the previous scan, seconds.
    scan_index : int
        Determines the origins of births.
    clutter : ClutterMemory or None
        See `update`.

    Returns
    -------
    branched : Branched
    approximate : int
        Number of clusters of targets too large for exact association probabilities.
    """
    origin, approximate = origins.first_detected(scan_index), 0
    row = np.arange(len(predicted))
    branched = Branched(predicted, np.where(row < survivors, row, -1))
    newborns: list[Newborn] = []
    for radar, detections in dynamics.model.reports(scan):
        branched, newborn, clusters = update(
            branched, detections, radar, dynamics, bounds, dt, clutter, newborns
        )
        approximate += clusters
        if newborn is not None:
            newborns.append(newborn)
            branched = _with_newborn(branched, newborn, dynamics, origin)
            origin += len(newborn)
    return branched, approximate


def _with_newborn(
    branched: Branched, newborn: Newborn, dynamics: Dynamics, origin: int
) -> Branched:
    """Return the hypotheses with newborn targets added, one hypothesis each.

    With ambiguous range rates there is one for each possible fold.
    """
    if not len(newborn):
        return branched
    row = np.arange(len(newborn))
    mean, covariance = _newborn_gaussians(newborn, dynamics)
    if (rates := newborn.radar.rates_of(newborn.detections)) is not None:
        row, share, mean, covariance = _by_fold(newborn, rates, mean, covariance, dynamics)
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
    return Branched(
        Mixture.joined([branched.mixture, added]),
        np.concatenate([branched.parent, np.full(len(added), -1)]),
    )


def _by_fold(
    newborn: Newborn,
    rates: Rates,
    mean: FloatArray,
    covariance: FloatArray,
    dynamics: Dynamics,
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
        range_rate.rated(mean, covariance, radar, range_rate.unfolded(rates, rate), time_s)
        for rate in each
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


def _newborn_gaussians(newborn: Newborn, dynamics: Dynamics) -> tuple[FloatArray, FloatArray]:
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


def _told_by_amplitude(added: Mixture, newborn: Newborn, dynamics: Dynamics) -> Mixture:
    """Return newborn targets with each class's weight over its cells as their amplitudes tell."""
    cells = dynamics.cells
    if len(cells) == len(dynamics.model.modes.classes):
        return added
    log_likelihood = _log_amplitude(newborn.detections, newborn.radar, dynamics).T
    likelihood = np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True))
    of_class = (cells.class_of[:, None] == cells.class_of).astype(float)
    mean = likelihood @ of_class / of_class.sum(axis=1)
    factor = likelihood / np.where(mean > 0.0, mean, 1.0)
    return replace(added, weight=added.weight * factor[:, None, :])
