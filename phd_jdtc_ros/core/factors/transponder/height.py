"""Height filter: estimates the height and climb rate of each target separately from its state.

A known height has a Gaussian density. A garbled height may have any value: it does not change the
estimate, and its detection can still belong to the target.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...arrays import BoolArray, FloatArray, IntArray, sum_by
from ...sensors.gaussians import SPAN


@dataclass(frozen=True)
class HeightModel:
    """Model of climbing targets and of measured heights."""

    std: float = 7.6  # Standard deviation of a measured height, metres
    noise_density: float = 1.0  # Spectral density of the white vertical acceleration, m^2/s^3
    climb_std: float = 10.0  # Standard deviation of a new target's climb rate about zero, m/s
    garbled: float = 0.01  # Probability that a measured height is garbled
    # Exponent of the heights' likelihood ratio in data association: 1 is Bayes' rule, 0 ignores
    # heights.
    evidence: float = 1.0
    # Mean time until a known height is forgotten, seconds; it bounds the life of a wrong one.
    kept_s: float = 1800.0

    def transition(self, dt: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the transition matrices over `dt` seconds and the process noise, both (T, 2, 2).

        For a negative `dt` the noise is the forward noise, expressed at the end of the interval.
        """
        move = np.zeros((len(dt), 2, 2))
        move[:, 0, 0] = move[:, 1, 1] = 1.0
        move[:, 0, 1] = dt
        noise = np.empty_like(move)
        span = np.abs(dt)
        noise[:, 0, 0] = span**3 / 3.0
        noise[:, 0, 1] = noise[:, 1, 0] = span * dt / 2.0
        noise[:, 1, 1] = span
        return move, self.noise_density * noise


class Heights(NamedTuple):
    """Height densities of T targets."""

    known: FloatArray  # Weight of the Gaussian, (T,); the rest of the density is uniform
    mean: FloatArray  # Height and climb rate, metres and metres per second, (T, 2)
    covariance: FloatArray  # (T, 2, 2)

    @staticmethod
    def fresh(targets: int) -> Heights:
        """Return the prior heights of new targets."""
        return Heights(np.zeros(targets), np.zeros((targets, 2)), np.zeros((targets, 2, 2)))

    def take(self, rows: IntArray) -> Heights:
        """Return the heights of these rows."""
        return Heights(self.known[rows], self.mean[rows], self.covariance[rows])

    def predict(self, dt: FloatArray, model: HeightModel) -> Heights:
        """Return the heights `dt` seconds later, (T,)."""
        move, noise = model.transition(dt)
        noise[dt == 0.0] = 0.0
        return Heights(
            self.known * np.exp(-np.abs(dt) / model.kept_s),
            (move @ self.mean[:, :, None])[:, :, 0],
            move @ self.covariance @ move.swapaxes(1, 2) + noise,
        )


class HeightUpdate(NamedTuple):
    """Likelihood of the detections' heights, and the height filter's update for each pair."""

    prior: Heights  # Predicted heights of the targets
    known: FloatArray  # Probability that each edge's detection measures the known height, (E,)
    garbled: FloatArray  # Probability that its height is garbled or missing, (E,)
    # Probability that it measures a height while the target's is unknown, (E,).
    new: FloatArray
    posterior: Heights  # Known height of each edge's target, updated by the measurement
    first: Heights  # Height of each edge's target from the measurement alone
    # Log likelihood ratio of each edge's detection against an undetected target, (E,).
    log_factor: FloatArray

    @property
    def probably_known(self) -> BoolArray:
        """Mask of the detections that most probably measure the known height, (E,)."""
        return (self.known >= self.garbled) & (self.known >= self.new)

    @property
    def probably_garbled(self) -> BoolArray:
        """Mask of the detections whose height is most probably garbled or missing, (E,)."""
        return (self.garbled > self.known) & (self.garbled >= self.new)


def compare(
    prior: Heights, target: IntArray, height: FloatArray, time_s: FloatArray, model: HeightModel
) -> HeightUpdate:
    """Return the likelihoods of the heights measured in edges, and the updated heights.

    `prior` is at the scan's stamp. Each edge, (E,), has the row of its target in `prior`, the
    height in metres, NaN where it is unknown, and the time relative to the stamp, seconds.
    """
    edge_prior = prior.take(target)
    is_measured = np.isfinite(height)
    value = np.where(is_measured, height, 0.0)
    row = np.stack([np.ones(len(time_s)), time_s], axis=1)
    cross = np.einsum("eij,ej->ei", edge_prior.covariance, row)
    variance = (cross * row).sum(axis=1) + model.std**2
    error = value - (edge_prior.mean * row).sum(axis=1)
    density = np.exp(-0.5 * error**2 / variance) / np.sqrt(2.0 * np.pi * variance)
    known = edge_prior.known * (1.0 - model.garbled) * SPAN * density
    new = (1.0 - edge_prior.known) * (1.0 - model.garbled)
    factor = known + model.garbled + new
    known = np.where(is_measured, known / factor, 0.0)
    log_factor = np.where(is_measured, model.evidence * np.log(factor), 0.0)
    gain = cross / variance[:, None]
    posterior = Heights(
        known,
        edge_prior.mean + gain * error[:, None],
        edge_prior.covariance - gain[:, :, None] * cross[:, None, :],
    )
    return HeightUpdate(
        prior=prior,
        known=known,
        garbled=np.where(is_measured, model.garbled / factor, 1.0),
        new=np.where(is_measured, new / factor, 0.0),
        posterior=posterior,
        first=_initiate(value, time_s, model),
        log_factor=log_factor,
    )


def _initiate(height: FloatArray, time_s: FloatArray, model: HeightModel) -> Heights:
    """Return heights initiated by one measurement, at the scan's stamp."""
    to_stamp, _ = model.transition(-time_s)
    start = np.diag([model.std**2, model.climb_std**2])
    mean = np.stack([height, np.zeros(len(height))], axis=1)
    return Heights(np.ones(len(height)), mean, to_stamp @ start @ to_stamp.swapaxes(1, 2))


def update(
    measured: HeightUpdate, target: IntArray, probability: FloatArray, missed: FloatArray
) -> tuple[Heights, BoolArray]:
    """Return the heights after an association, see `identity.update`, and a mask of restarts.

    Each target's height mixture is moment-matched: the prior continued, or restarted at a
    measurement if that is more probable. The weight of the other part becomes unknown, so that a
    garbled height does not change the estimate.
    """
    prior, count = measured.prior, len(measured.prior.known)
    unmeasured = (missed + sum_by(target, probability * measured.garbled, count)) * prior.known
    known, new = probability * measured.known, probability * measured.new
    restarted = sum_by(target, new, count) > unmeasured + sum_by(target, known, count)
    share = np.concatenate([unmeasured, known, new])
    owner = np.concatenate([np.arange(count), target, target])
    of_new = np.arange(len(share)) >= count + len(target)
    share = np.where(restarted[owner] == of_new, share, 0.0)
    total = sum_by(owner, share, count)
    share = share / np.where(total > 0.0, total, 1.0)[owner]
    parts = [prior, measured.posterior, measured.first]
    means = np.concatenate([part.mean for part in parts])
    spreads = np.concatenate([part.covariance for part in parts])
    mean = np.stack([sum_by(owner, share * axis, count) for axis in means.T], axis=1)
    difference = means - mean[owner]
    spreads = spreads + difference[:, :, None] * difference[:, None, :]
    covariance = np.zeros((count, 2, 2))
    np.add.at(covariance, owner, share[:, None, None] * spreads)
    return Heights(np.minimum(total, 1.0), mean, covariance), restarted
