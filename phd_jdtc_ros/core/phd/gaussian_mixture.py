"""The intensity in closed form: a mixture of Gaussians over the general mode, and its recursion.

The paper's last sentence leaves it for further study. With linear motion and Gaussian noise the
recursion of Sec. III-A maps a mixture to a mixture; a turn is linearised at the mean, a polar
measurement iteratively at the posterior. The steps have the names of those of particles:
`predict` is Step 1, `correct` Step 2, and `reduce` takes the place of Step 3.

References
----------
Vo and Ma, "The Gaussian mixture probability hypothesis density filter", IEEE Transactions on Signal
Processing 54(11), 2006, with the truncation and merging of its Table II; Pasha, Vo, Tuan and Ma,
"A Gaussian mixture PHD filter for jump Markov system models", IEEE Transactions on Aerospace and
Electronic Systems 45(3), 2009, for motion modes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, ReadOnly, factorize, run_starts
from ..factors.limit import limit_detections
from ..gaussian.algebra import kalman
from ..models.tracker_model import TrackerModel
from ..sensors.of_gaussians.linearised import Measured, WeightedGaussians
from ..sensors.view import View
from ..targets.modes import ModeSpace
from .correction import detection_probability, explained_shares, log_amplitude_likelihood

# Gaussians of less weight are left out.
LEAST_WEIGHT = 1e-4


@dataclass(frozen=True)
class Mixture(ReadOnly):
    """A mixture of J Gaussians over (state, class, motion mode).

    Each Gaussian is of one Bernoulli component or of the Poisson part; see the package.
    """

    weight: FloatArray  # Expected number of targets, (J,)
    # World frame; metres, metres per second, radians per second, (J, D).
    mean: FloatArray
    covariance: FloatArray  # Zero on axes on which the motion mode is not defined, (J, D, D)
    mode: IntArray  # Flat index into the mode space, (J,)
    # Number of the birth from which the Gaussian descends, by birth term and scan, (J,).
    origin: IntArray
    # Number of the detection that explains it, of any radar, (J,); -1 for the Poisson part.
    component: IntArray

    def __len__(self) -> int:
        return len(self.weight)

    def take(self, rows: IntArray) -> Mixture:
        """Return the Gaussians of these rows."""
        return self.changed(**{name: getattr(self, name)[rows] for name in COLUMNS})

    @staticmethod
    def concatenate(*parts: Mixture) -> Mixture:
        """Return the Gaussians of all parts."""
        return Mixture(*(np.concatenate([getattr(p, name) for p in parts]) for name in COLUMNS))

    @staticmethod
    def empty(size: int) -> Mixture:
        """Return an intensity of no targets, given the size of a state."""
        none = np.zeros(0, dtype=np.int64)
        return Mixture(np.zeros(0), np.zeros((0, size)), np.zeros((0, size, size)), *[none] * 3)


COLUMNS = tuple(Mixture.__dataclass_fields__)


class Predicted(NamedTuple):
    """A predicted mixture, all in the Poisson part."""

    mixture: Mixture  # Survivors first, then spawned targets and births
    parent: IntArray  # Row of each survivor in the earlier mixture, (S,)
    cross: FloatArray  # Covariance of each survivor's parent with it, (S, D, D)


class Updated(NamedTuple):
    """A mixture, and the row of each Gaussian in the predicted mixture, (J,)."""

    mixture: Mixture
    source: IntArray


def predict(mixture: Mixture, model: TrackerModel, dt: float, scan_index: int) -> Predicted:
    """Return the intensity after `dt` seconds (Step 1): survivors, spawned targets, births.

    `scan_index` numbers the origins of births.
    """
    modes, spawn = model.modes, model.spawn
    survived = modes.survival(dt)[:, None] * modes.transition(dt)
    survivors, parent, cross = _moved(mixture, survived, modes.noise(dt), modes, dt)
    # Spawned targets and births have no spread on the axes that their motion mode lacks.
    supported = np.zeros((len(modes), len(modes.space)))
    for index, motion in enumerate(modes.motions):
        supported[index, list(motion.support)] = 1.0
    rate = spawn.rate * dt / modes.interval_s
    spawn_noise = np.eye(len(modes.space)) * (supported * spawn.std**2)[:, None]
    spawned = _moved(mixture, rate * spawn.transition, spawn_noise, modes, dt)[0]
    parts = [survivors, spawned]
    for index, term in enumerate(model.births):
        (mode,) = term.rate.nonzero()
        count, origin = len(mode), scan_index * len(model.births) + index
        parts.append(
            Mixture(
                weight=term.rate[mode] * dt / modes.interval_s,
                mean=term.mean * supported[mode],
                covariance=np.eye(len(term.mean)) * (supported[mode] * term.std**2)[:, None],
                mode=mode,
                origin=np.full(count, origin),
                component=np.full(count, -1),
            )
        )
    return Predicted(Mixture.concatenate(*parts), parent, cross)


def _moved(
    mixture: Mixture, rate: FloatArray, noise: FloatArray, modes: ModeSpace, dt: float
) -> tuple[Mixture, IntArray, FloatArray]:
    """Return the Gaussians after the motions of their new modes, with noise by mode, (O, D, D).

    `rate`, (O, O), is the factor on the weight, by [from, to]. Return also the row of
    each one's source, and the covariance of the source with it.
    """
    by_mode = mixture.weight[:, None] * rate[mixture.mode]
    source, mode = np.nonzero(by_mode > LEAST_WEIGHT)
    mean, jacobian = mixture.mean[source], np.empty((len(source), *mixture.covariance.shape[1:]))
    for motion in dict.fromkeys(modes.motions):
        with_motion = np.array([other == motion for other in modes.motions])
        (rows,) = with_motion[mode].nonzero()
        before = mean[rows]
        mean[rows], jacobian[rows] = motion.mean(before, dt), motion.jacobian(before, dt)
    cross = mixture.covariance[source] @ jacobian.swapaxes(1, 2)
    covariance = jacobian @ cross + noise[mode]
    weight, unexplained = by_mode[source, mode], np.full(len(source), -1)
    moved = Mixture(weight, mean, covariance, mode, mixture.origin[source], unexplained)
    return moved, source, cross


def correct(updated: Updated, report: View, modes: ModeSpace) -> Updated:
    """Return the mixture after a report (Step 2): each of its detections becomes a component."""
    mixture, source = updated
    class_id, place = modes.class_of[mixture.mode], list(modes.space.position)
    measured, jacobian = report.sensor.linearise(mixture.mean[:, place])
    spread = jacobian @ mixture.covariance[:, place][:, :, place] @ jacobian.swapaxes(1, 2)
    variance = np.diagonal(spread, axis1=1, axis2=2)
    report = limit_detections(report, measured, mixture.weight)
    sensor, detected = report.sensor, report.detections.measurement
    error = sensor.wrap(detected - measured[:, None])
    # Gate on each component of a measurement, in standard deviations of the innovation.
    gate = 6.0**2 * (variance[:, None] + report.detection_std**2)
    row, column = (error**2 <= gate).all(axis=2).nonzero()

    gaussians = WeightedGaussians.of(mixture.mean, mixture.covariance)
    readings = Measured(detected, report.detection_std)
    innovation = kalman.innovations(gaussians, sensor, readings, (row, column))
    log_likelihood = innovation.log_likelihood
    log_likelihood = log_likelihood + log_amplitude_likelihood(report, class_id[row], column, modes)
    share = explained_shares(column, log_likelihood, mixture.weight[row], report)
    (pair,) = (share > LEAST_WEIGHT).nonzero()
    row, column = row[pair], column[pair]
    mean, covariance = kalman.update(
        mixture.mean, mixture.covariance, sensor, innovation, pairs=(row, pair)
    )
    first = int(mixture.component.max(initial=-1)) + 1
    found = Mixture(
        share[pair], mean, covariance, mixture.mode[row], mixture.origin[row], first + column
    )
    std = np.sqrt(variance)
    missed = 1.0 - detection_probability(report, measured, class_id, modes, std)
    weight = mixture.weight * missed
    (kept,) = (weight > LEAST_WEIGHT).nonzero()
    unseen = mixture.changed(weight=weight).take(kept)
    return Updated(Mixture.concatenate(unseen, found), np.concatenate([source[kept], source[row]]))


def reduce(mixture: Mixture, modes: ModeSpace) -> tuple[Mixture, IntArray]:
    """Merge near Gaussians of one mode and component; in the Poisson part also of one origin.

    Return also the row of each Gaussian in the result, (J,).
    """
    origin = factorize(mixture.origin)[1] + int(mixture.component.max(initial=-1)) + 1
    part = np.where(mixture.component < 0, origin, mixture.component)
    group = part * len(modes) + mixture.mode
    precision = inverses(mixture.covariance)
    cluster, leaders = np.full(len(mixture), -1), [np.zeros(0, dtype=np.int64)]
    rest, clusters = np.lexsort((-mixture.weight, group)), 0
    while len(rest):
        # The heaviest of each group is joined by all that are near it.
        first = run_starts(group[rest])
        leader = first.repeat(np.diff(np.append(first, len(rest))))
        offset = mixture.mean[rest] - mixture.mean[rest[leader]]
        square = (offset[:, None] @ precision[rest] @ offset[..., None])[:, 0, 0]
        # Square Mahalanobis distance within which Gaussians are merged.
        near = square <= 4.0
        rank = np.cumsum(np.bincount(first, minlength=len(rest))) - 1
        cluster[rest[near]] = clusters + rank[near]
        leaders.append(rest[first])
        clusters += len(first)
        rest = rest[~near]
    leading = mixture.take(np.concatenate(leaders))
    merged = moments(mixture.weight, mixture.mean, mixture.covariance, cluster, leading.mean)
    return leading.changed(**merged._asdict()), cluster


class Moments(NamedTuple):
    """Moments of groups of Gaussians."""

    weight: FloatArray  # (G,)
    mean: FloatArray  # (G, D)
    covariance: FloatArray  # (G, D, D)


def moments(
    weight: FloatArray, mean: FloatArray, covariance: FloatArray, group: IntArray, near: FloatArray
) -> Moments:
    """Return the moments of groups of Gaussians, given a point near the means of each, (G, D).

    A group without weight has that point for its mean, and the covariance zero.
    """
    count, size = near.shape
    order = np.argsort(group, kind="stable")
    row, weight, offset = group[order], weight[order], mean[order] - near[group[order]]
    square = covariance[order] + offset[..., None] * offset[:, None]
    parts = np.ones((len(row), 1)), offset, square.reshape(-1, size**2)
    first, sums = run_starts(row), np.zeros((count, 1 + size + size**2))
    if len(first):
        sums[row[first]] = np.add.reduceat(weight[:, None] * np.concatenate(parts, axis=1), first)
    total = sums[:, 0].copy()
    sums /= np.where(total > 0.0, total, 1.0)[:, None]
    moved = sums[:, 1 : 1 + size]
    spread = sums[:, 1 + size :].reshape(-1, size, size) - moved[..., None] * moved[:, None]
    return Moments(total, near + moved, spread)


def inverses(covariance: FloatArray) -> FloatArray:
    """Return the inverses of covariances, zero on the axes on which these are zero."""
    axes = np.arange(covariance.shape[1])
    unused = covariance[:, axes, axes] == 0.0
    regular = covariance.copy()
    regular[:, axes, axes] += unused
    inverse = np.linalg.inv(regular)
    inverse[:, axes, axes] -= unused
    return inverse
