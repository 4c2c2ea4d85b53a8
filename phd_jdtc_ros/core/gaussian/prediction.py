"""Prediction: survivors move and switch modes, targets are spawned, targets are born."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, sum_by
from ..snapshot import MAX_STATE, floats
from ..tracks import labels
from .algebra.kalman import MOST_GAIN, Backward, backward, predicted_covariance
from .algebra.moments import match_moments
from .dynamics import Dynamics
from .mixture import Mixture

# Bound, in a snapshot, on the magnitude of a log determinant.
MOST_LOG = 1e4


class Aged(NamedTuple):
    """A stored mixture and its age.

    Parameters
    ----------
    dt : float
        Time since its scan, seconds.
    """

    mixture: Mixture
    dt: float


@dataclass(frozen=True)
class Moves:
    """The prediction from the hypotheses of earlier scans, row by row, for the smoother.

    Each of the K pairs is a motion mode before the prediction and a possible one after it.

    Parameters
    ----------
    pairs : tuple of two int arrays of shape (K,)
        Modes of each pair before and after the prediction.
    change : array of shape (H, K)
        Probability of survival with a change from the first mode to the second.
    survival : array of shape (H, R)
        Probability of survival until the later scan.
    cells : array of shape (H, S, S) or None
        Transition matrix of the cells, [from, to]; None if cells do not change.
    mean : array of shape (H, K, D)
        Predicted mean of each pair.
    precision : array of shape (H, K, D, D)
        Inverse of each pair's predicted covariance.
    log_determinant : array of shape (H, K)
        Log determinant of the precision.
    backward : Backward
        Backward step from each pair's later Gaussian to the earlier one, leading shape (H, K).
    """

    pairs: tuple[IntArray, IntArray]
    change: Annotated[FloatArray, floats("PK", 0.0, 1.0)]
    survival: Annotated[FloatArray, floats("PO", 0.0, 1.0)]
    cells: Annotated[FloatArray | None, floats("PSS", 0.0, 1.0)]
    mean: Annotated[FloatArray, floats("PKD", -MAX_STATE, MAX_STATE)]
    precision: Annotated[FloatArray, floats("PKDD", -MOST_GAIN, MOST_GAIN)]
    log_determinant: Annotated[FloatArray, floats("PK", -MOST_LOG, MOST_LOG)]
    backward: Backward

    def take(self, rows: IntArray) -> Moves:
        """Return the predictions of these rows."""
        return Moves(
            self.pairs,
            self.change[rows],
            self.survival[rows],
            None if self.cells is None else self.cells[rows],
            self.mean[rows],
            self.precision[rows],
            self.log_determinant[rows],
            Backward(*(part[rows] for part in self.backward)),
        )

    @staticmethod
    def concatenate(parts: Sequence[Moves]) -> Moves:
        """Return the predictions of several scans concatenated."""
        cells = [part.cells for part in parts if part.cells is not None]
        return Moves(
            parts[0].pairs,
            np.concatenate([part.change for part in parts]),
            np.concatenate([part.survival for part in parts]),
            np.concatenate(cells) if cells else None,
            np.concatenate([part.mean for part in parts]),
            np.concatenate([part.precision for part in parts]),
            np.concatenate([part.log_determinant for part in parts]),
            Backward(*map(np.concatenate, zip(*(part.backward for part in parts), strict=True))),
        )


def survivors(earlier: Sequence[Aged], dynamics: Dynamics) -> tuple[Mixture, Moves]:
    """Return the hypotheses of earlier scans predicted to the time of a later one.

    Notes
    -----
    Interacting multiple models: all Gaussians whose mode may change to a given mode are predicted
    with that mode's motion, weighted by their transition probabilities and moment-matched by one.

    References
    ----------
    Blom and Bar-Shalom, "The interacting multiple model algorithm for systems with Markovian
    switching coefficients", IEEE Transactions on Automatic Control 33(8), 1988.
    """
    before = Mixture.concatenate([part.mixture for part in earlier])
    source = np.arange(len(earlier)).repeat([len(part.mixture) for part in earlier])
    survival = np.stack([dynamics.survival(dt) for _, dt in earlier])[source]
    of, to = dynamics.pairs
    change = np.stack([dynamics.transition(dt)[of, to] for _, dt in earlier])[source]
    change = change * survival[:, of]
    noise = np.stack([dynamics.noise(dt) for _, dt in earlier])[source]
    cells = None
    weight = dynamics.to_mode @ (change[..., None] * before.weight.take(of, axis=1))
    if (first := dynamics.cells.transition(earlier[0].dt)) is not None:
        others = [dynamics.cells.transition(dt) for _, dt in earlier[1:]]
        cells = np.stack([first, *(other for other in others if other is not None)])[source]
        weight = weight @ cells
    dt_of = np.array([dt for _, dt in earlier])[source]
    mean, covariance = before.mean.take(of, axis=1), before.covariance.take(of, axis=1)
    later_mean, jacobian = _move(mean, to, dt_of, dynamics)
    later, cross = predicted_covariance(covariance, jacobian, noise.take(to, axis=1))
    back, precision = backward(
        mean, covariance, later_mean, later, cross, 1.0 - dynamics.supported[to]
    )
    share = _shares(change * before.mode_weight[:, of], dynamics)
    return (
        Mixture(before.row_label, weight, *match_moments(share, later_mean, later)),
        Moves(
            pairs=(of, to),
            change=change,
            survival=survival,
            cells=cells,
            mean=later_mean,
            precision=precision,
            log_determinant=np.linalg.slogdet(precision)[1],
            backward=back,
        ),
    )


def _shares(joint: FloatArray, dynamics: Dynamics) -> FloatArray:
    """Return the share of each pair in each later mode, (H, R, K), given the weights (H, K)."""
    weight = dynamics.to_mode * joint[:, None]
    total = weight.sum(axis=2, keepdims=True)
    reached = total > 0.0
    # An unreachable mode has no weight; it keeps its own Gaussian.
    same = dynamics.to_mode * (dynamics.pairs[0] == dynamics.pairs[1])
    share: FloatArray = np.where(reached, weight / np.where(reached, total, 1.0), same)
    return share


def _move(
    mean: FloatArray, to: IntArray, dt: FloatArray, dynamics: Dynamics
) -> tuple[FloatArray, FloatArray]:
    """Return the means (H, K, D) after `dt` seconds in each mode `to`, and the Jacobians."""
    later = np.empty_like(mean)
    jacobian = np.empty((*mean.shape, mean.shape[2]))
    for mode, motion in enumerate(dynamics.motions):
        own = np.flatnonzero(to == mode)
        flat, since = mean[:, own].reshape(-1, mean.shape[2]), dt.repeat(len(own))
        later[:, own] = motion.mean(flat, since).reshape(len(mean), len(own), mean.shape[2])
        jacobian[:, own] = motion.jacobian(flat, since).reshape(
            len(mean), len(own), *jacobian.shape[2:]
        )
    return later, jacobian


def births(births: Sequence[tuple[int, float]], dynamics: Dynamics, scan_index: int) -> Mixture:
    """Return the birth components at the configured places, each with a new label.

    Parameters
    ----------
    births : sequence of (int, float)
        Index of each birth term, and the time since its last births, seconds.
    """
    model, supported = dynamics.model, dynamics.supported
    first = labels.first_predicted(scan_index)
    terms = [model.births[index] for index, _ in births]
    count, (modes, size) = len(terms), supported.shape
    if not terms:
        return Mixture.empty(modes, len(dynamics.cells), size)
    expected = np.array([dt / model.modes.interval_s for _, dt in births])
    rate = np.stack([term.rate for term in terms])
    covariance = np.zeros((count, modes, size, size))
    axes = np.arange(size)
    covariance[..., axes, axes] = np.stack([term.std**2 for term in terms])[:, None] * supported
    return Mixture(
        np.array([first + index for index, _ in births]),
        expected[:, None, None] * np.tensordot(rate, dynamics.spread, axes=1),
        np.stack([term.mean for term in terms])[:, None] * supported,
        covariance,
    )


def spawn(earlier: Sequence[Aged], dynamics: Dynamics, scan_index: int, least: float) -> Mixture:
    """Return the spawned targets, one for each parent, each with a new label.

    Parameters
    ----------
    least : float
        Existence probability below which a spawned target is left out.

    Notes
    -----
    The parent's hypotheses are moment-matched by one Gaussian, which each motion mode predicts.
    """
    model = dynamics.model
    label = labels.first_predicted(scan_index) + len(model.births)
    parts = [Mixture.empty(len(dynamics.motions), len(dynamics.cells), len(model.modes.space))]
    for mixture, dt in earlier:
        rate = min(model.spawn.rate * dt / model.modes.interval_s, 1.0)
        if rate * mixture.existence.max(initial=0.0) < least:
            continue
        parents = np.flatnonzero(rate * mixture.existence >= least)
        part = _spawned_by(mixture, parents, rate, dt, dynamics, label)
        label += len(part)
        parts.append(part)
    return Mixture.concatenate(parts)


def _spawned_by(
    mixture: Mixture, parents: IntArray, rate: float, dt: float, dynamics: Dynamics, label: int
) -> Mixture:
    spawn, supported = dynamics.model.spawn, dynamics.supported
    mean, covariance = mixture.overall
    mean, covariance = mean[parents], covariance[parents]
    modes, size = supported.shape
    moved = np.repeat(mean[:, None], modes, axis=1)
    later, jacobian = _move(moved, np.arange(modes), np.full(len(parents), dt), dynamics)
    noise = np.zeros((modes, size, size))
    noise[:, np.arange(size), np.arange(size)] = spawn.std**2 * supported
    spread = predicted_covariance(covariance[:, None], jacobian, noise)[0]
    to = np.tensordot(spawn.transition, dynamics.spread, axes=1)
    of_mode = (dynamics.spread > 0.0).astype(np.float64)
    flat = mixture.weight.reshape(len(mixture), -1) @ of_mode.reshape(len(of_mode), -1).T
    flat = np.stack([sum_by(mixture.target, column, len(mixture.label)) for column in flat.T], 1)
    return Mixture(
        label + np.arange(len(parents)),
        rate * np.tensordot(flat[parents], to, axes=1),
        later,
        spread,
    )
