"""Heights of targets: a filter of its own for each, of the height and the climb rate.

A height is known or not; where it is, it is Gaussian. A garbled height may be any, so that it
neither moves a target nor is excluded as one of its detections.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray, IntArray, sum_by

BoolArray = npt.NDArray[np.bool_]
# Metres: garbled heights, and those of unknown targets, are uniform over so much.
SPAN = 15e3


@dataclass(frozen=True)
class HeightModel:
    """How targets climb, and how their heights are measured.

    Parameters
    ----------
    std : float
        Standard deviation of a measured height, metres.
    noise_density : float
        Spectral density of the white vertical acceleration, m^2/s^3.
    climb_std : float
        Standard deviation of a new target's climb rate about zero, m/s.
    garbled : float
        Probability that a height is any.
    evidence : float
        Exponent of the likelihood ratio by which heights tell whose a detection is: 1 is Bayes'
        rule, 0 leaves them out.
    kept_s : float
        Mean time until a height that is known is lost, seconds: so that a wrong one is given up.
    """

    std: float = 7.6
    noise_density: float = 1.0
    climb_std: float = 10.0
    garbled: float = 0.01
    evidence: float = 1.0
    kept_s: float = 1800.0

    def transition(self, dt: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the matrices of `dt` seconds, (T, 2, 2), and the covariances of the noise.

        The noise of a negative time is that of the same time forward, seen from its end.
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
    """What is known of T targets' heights.

    Parameters
    ----------
    known : array of shape (T,)
        Probability that the Gaussian is right; otherwise the height may be any.
    mean : array of shape (T, 2)
        Height and climb rate, metres and metres per second.
    covariance : array of shape (T, 2, 2)
    """

    known: FloatArray
    mean: FloatArray
    covariance: FloatArray

    @staticmethod
    def fresh(targets: int) -> Heights:
        """Return the heights of targets that nothing is known of."""
        return Heights(np.zeros(targets), np.zeros((targets, 2)), np.zeros((targets, 2, 2)))

    def take(self, rows: IntArray) -> Heights:
        """Return those of these rows."""
        return Heights(self.known[rows], self.mean[rows], self.covariance[rows])

    def moved(self, dt: FloatArray, model: HeightModel) -> Heights:
        """Return the heights `dt` seconds later, (T,)."""
        move, noise = model.transition(dt)
        noise[dt == 0.0] = 0.0
        return Heights(
            self.known * np.exp(-np.abs(dt) / model.kept_s),
            (move @ self.mean[:, :, None])[:, :, 0],
            move @ self.covariance @ move.swapaxes(1, 2) + noise,
        )


class Measured(NamedTuple):
    """Heights of detections, compared with those of targets.

    Parameters
    ----------
    prior : Heights
    part : array of shape (E, 3)
        Probabilities that a pair's detection tells the known height, that it is garbled or tells
        nothing, and that it tells one that was not known.
    told, first : Heights
        Of each pair: after the measurement, and by the measurement alone.
    log_factor : array of shape (E,)
        Log of the likelihood of each pair's detection, over that of an unknown target.
    """

    prior: Heights
    part: FloatArray
    told: Heights
    first: Heights
    log_factor: FloatArray


def compared(
    prior: Heights, target: IntArray, height: FloatArray, since: FloatArray, model: HeightModel
) -> Measured:
    """Return what the heights of pairs' detections tell.

    Parameters
    ----------
    prior : Heights
        Of T targets, at the scan's stamp.
    target : int array of shape (E,)
    height : array of shape (E,)
        Metres; NaN where it is unknown.
    since : array of shape (E,)
        Time of each detection after the scan's stamp, seconds.
    model : HeightModel
    """
    before = prior.take(target)
    given = np.isfinite(height)
    value = np.where(given, height, 0.0)
    row = np.stack([np.ones(len(since)), since], axis=1)
    spread = np.einsum("eij,ej->ei", before.covariance, row)
    variance = (spread * row).sum(axis=1) + model.std**2
    error = value - (before.mean * row).sum(axis=1)
    density = np.exp(-0.5 * error**2 / variance) / np.sqrt(2.0 * np.pi * variance)
    right = before.known * (1.0 - model.garbled) * SPAN * density
    garbled = before.known * model.garbled + (1.0 - before.known) * model.garbled
    new = (1.0 - before.known) * (1.0 - model.garbled)
    part = np.stack([right, garbled, new], axis=1)
    factor = part.sum(axis=1)
    part /= factor[:, None]
    part[~given] = 0.0, 1.0, 0.0
    log_factor = np.where(given, model.evidence * np.log(factor), 0.0)
    gain = spread / variance[:, None]
    told = Heights(
        part[:, 0],
        before.mean + gain * error[:, None],
        before.covariance - gain[:, :, None] * spread[:, None, :],
    )
    return Measured(prior, part, told, _first(value, since, model), log_factor)


def _first(height: FloatArray, since: FloatArray, model: HeightModel) -> Heights:
    """Return heights by one measurement, at the scan's stamp."""
    back, _ = model.transition(-since)
    start = np.diag([model.std**2, model.climb_std**2])
    mean = np.stack([height, np.zeros(len(height))], axis=1)
    return Heights(np.ones(len(height)), mean, back @ start @ back.swapaxes(1, 2))


def learned(
    measured: Measured, target: IntArray, own: FloatArray, none: FloatArray
) -> tuple[Heights, BoolArray]:
    """Return the heights after an association, see `identity.learned`, and which begin again.

    Notes
    -----
    Of each target, the Gaussians of all that may be so are matched by one: of what goes on from the
    height that was known or, if that is more probable, of what begins with a measurement. The other
    part counts as unknown, so that a garbled height does not move a target.
    """
    prior, count = measured.prior, len(measured.prior.known)
    kept = (none + sum_by(target, own * measured.part[:, 1], count)) * prior.known
    right, new = own * measured.part[:, 0], own * measured.part[:, 2]
    begun = sum_by(target, new, count)
    again = begun > kept + sum_by(target, right, count)
    share = np.concatenate([kept, right, new])
    owner = np.concatenate([np.arange(count), target, target])
    of_new = np.arange(len(share)) >= count + len(target)
    share = np.where(again[owner] == of_new, share, 0.0)
    known = sum_by(owner, share, count)
    share = share / np.where(known > 0.0, known, 1.0)[owner]
    parts = [prior, measured.told, measured.first]
    means = np.concatenate([part.mean for part in parts])
    spreads = np.concatenate([part.covariance for part in parts])
    mean = np.stack([sum_by(owner, share * axis, count) for axis in means.T], axis=1)
    apart = means - mean[owner]
    spreads = spreads + apart[:, :, None] * apart[:, None, :]
    covariance = np.zeros((count, 2, 2))
    np.add.at(covariance, owner, share[:, None, None] * spreads)
    return Heights(np.minimum(known, 1.0), mean, covariance), again
