"""The backward step over the window: smoothed Gaussians, weights and hypotheses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from .. import backend
from ..arrays import FloatArray, IntArray, run_starts, sum_by
from ..window.entries import Entry
from .algebra import moments
from .mixture import Mixture
from .prediction import Moves
from .window_graph import Link, generations, is_chain

# Smallest log fit of a pair of modes relative to the best pair: no pair is excluded for good.
LEAST_LOG_FIT = -50.0


@dataclass(frozen=True)
class Later:
    """Predicted hypotheses conditioned on later scans.

    Parameters
    ----------
    moves : Moves
        The predictions that led to these hypotheses.
    weight : array of shape (H, R, S)
    mean, covariance : arrays of shape (H, R, D) and (H, R, D, D)
    """

    moves: Moves
    weight: FloatArray
    mean: FloatArray
    covariance: FloatArray


def backward_pass(entries: Sequence[Entry[Mixture, Link]]) -> list[Mixture]:
    """Return the smoothed mixtures of a window, newest first: lag 0, lag 1 and so on.

    Parameters
    ----------
    entries : sequence of Entry
        Oldest first. A source outside these entries has left the window.
    """
    if is_chain(entries):
        return list(_smooth_chain([(entry.stored, entry.link) for entry in reversed(entries)]))
    parts = generations(entries)
    weight, mean, covariance = (
        np.concatenate([getattr(entry.stored, column) for entry in entries])
        for column in ("weight", "mean", "covariance")
    )
    smoothed = _smooth_chain([(part.stored, part.link) for part in parts])
    for part, mixture in zip(parts, smoothed, strict=True):
        weight[part.rows] = mixture.weight
        mean[part.rows], covariance[part.rows] = mixture.mean, mixture.covariance
    ends = np.cumsum([len(entry.stored) for entry in entries])[:-1]
    columns = (np.split(column, ends) for column in (weight, mean, covariance))
    whole = zip(entries, *columns, strict=True)
    return [entry.stored.with_gaussians(*parts) for entry, *parts in whole][::-1]


def _smooth_chain(chain: Sequence[tuple[Mixture, Link | None]]) -> Iterator[Mixture]:
    """Yield the smoothed mixtures of a chain, newest first, each with its link to the next."""
    later: Mixture | None = None
    link: Link | None = None
    for filtered, before in chain:
        if later is None or link is None:
            later = filtered
        else:
            later = _with_hindsight(filtered, _before_update(later, link))
        yield later
        link = before


def _before_update(smoothed: Mixture, link: Link) -> Later:
    """Return the predicted hypotheses, given their smoothed children.

    A predicted hypothesis has the summed weight of its smoothed children, and its Gaussians match
    their moments. The weight of a merged child is divided by the filtered weights of its parents.
    """
    ancestry, moves = link.ancestry, link.moves
    edges = np.flatnonzero(ancestry.parent >= 0)
    edges = edges[np.argsort(ancestry.parent[edges], kind="stable")]
    child, parent = ancestry.child[edges], ancestry.parent[edges]
    weight = smoothed.weight[child] * ancestry.share[edges]
    mean, covariance = smoothed.mean[child], smoothed.covariance[child]
    first = run_starts(parent)
    if len(first) < len(parent):
        size = np.diff(np.append(first, len(parent)))
        mode_weight = weight.sum(axis=2)
        weight = np.add.reduceat(weight, first)
        total = weight.sum(axis=2).repeat(size, axis=0)
        share = np.where(
            total > 0.0,
            mode_weight / np.where(total > 0.0, total, 1.0),
            1.0 / size.repeat(size)[:, None],
        )
        mean, covariance = moments.merge_moments(share, mean, covariance, first)
    rows, count = parent[first], len(moves.change)
    if len(rows) == count:
        return Later(moves, weight, mean, covariance)
    # Hypotheses without children have no weight.
    every = Later(
        moves,
        np.zeros((count, *weight.shape[1:])),
        np.zeros((count, *mean.shape[1:])),
        np.zeros((count, *covariance.shape[1:])),
    )
    every.weight[rows], every.mean[rows], every.covariance[rows] = weight, mean, covariance
    return every


def _with_hindsight(own: Mixture, later: Later) -> Mixture:
    """Return the smoothed mixture of one scan, given the later predicted hypotheses.

    Notes
    -----
    A later mode j divides its smoothed weight among the pairs (i, j) of earlier modes i in
    proportion to w_i P_s pi_ij N(m_j; m_ij, P_ij), where m_j is the smoothed mean and m_ij, P_ij
    are the pair's predicted mean and covariance. The state of a pair follows by a backward step
    from the smoothed later state: the expectation correction. Without the normal density this is
    Kim's smoother, whose error grows with the lag; in a turn the growth cancels its gain. The
    weight of targets that die has the factor of a Bernoulli target's death,
    (1 - smoothed survivors) / (1 - filtered survivors).

    References
    ----------
    Barber, "Expectation correction for smoothed inference in switching linear dynamical systems",
    Journal of Machine Learning Research 7, 2006.
    Kim, "Dynamic linear models with Markov-switching", Journal of Econometrics 60, 1994.
    """
    moves, modes = later.moves, own.mean.shape[1]
    of, to = moves.pairs
    weight = moves.change[..., None] * own.weight.take(of, axis=1) * _fit(later)[..., None]
    predicted = _by_mode(weight, to, modes)
    if moves.cells is not None:
        predicted = predicted @ moves.cells
    back = np.where(predicted > 0.0, later.weight / np.where(predicted > 0.0, predicted, 1.0), 0.0)
    if moves.cells is not None:
        back = back @ moves.cells.swapaxes(1, 2)
    weight *= back.take(to, axis=1)
    survived = _by_mode(weight, of, modes)
    died = own.weight * (1.0 - moves.survival)[..., None]
    died *= _death_factor(own, survived, died)[:, None, None]
    mean, covariance = _blend(own, weight.sum(axis=2), died.sum(axis=2), later)
    return own.with_gaussians(survived + died, mean, covariance)


def _death_factor(own: Mixture, survived: FloatArray, dying: FloatArray) -> FloatArray:
    """Return phi of each row's target: the factor on the weight that does not survive."""

    def by_target(weight: FloatArray) -> FloatArray:
        return sum_by(own.target, weight.sum(axis=(1, 2)), len(own.label))

    alive = np.minimum(by_target(survived), 1.0)
    dead = 1.0 - own.existence + by_target(dying)
    factor: FloatArray = (1.0 - alive) / np.where(dead > 0.0, dead, np.inf)
    return factor[own.target]


def _fit(later: Later) -> FloatArray:
    """Return the relative likelihood of each later mode's mean under its pairs, shape (H, K).

    This is a normal density, divided by the largest density among the pairs of that later mode.
    """
    moves = later.moves
    of, to = moves.pairs
    if len(of) == later.mean.shape[1]:
        return np.ones_like(moves.change)
    if loops := backend.compiled("gaussian.algebra"):
        log_density = loops.log_densities(
            *map(np.ascontiguousarray, (later.mean, moves.mean, moves.precision)),
            *map(np.ascontiguousarray, (moves.log_determinant, to)),
        )
    else:
        apart = (later.mean[:, to] - moves.mean)[..., None]
        square = (apart.swapaxes(-1, -2) @ moves.precision @ apart)[..., 0, 0]
        log_density = 0.5 * (moves.log_determinant - square)
    log_density = np.where(np.isfinite(log_density), log_density, np.finfo(float).min)
    largest = np.stack(
        [log_density[:, to == mode].max(axis=1) for mode in range(later.mean.shape[1])], axis=1
    )
    fit: FloatArray = np.exp(np.maximum(log_density - largest[:, to], LEAST_LOG_FIT))
    return fit


def _by_mode(weight: FloatArray, mode: IntArray, modes: int) -> FloatArray:
    """Return the weights of pairs, (H, K, S), summed by mode, (H, R, S)."""
    select = (np.arange(modes)[:, None] == mode).astype(np.float64)
    total: FloatArray = select @ weight
    return total


def _blend(
    own: Mixture, joint: FloatArray, died: FloatArray, later: Later
) -> tuple[FloatArray, FloatArray]:
    """Return the Gaussian of each earlier mode, moment-matched over the later modes and death.

    `joint` has the weights of the pairs, (H, K), and `died` the weights of death, (H, R).
    """
    of, to = later.moves.pairs
    if loops := backend.compiled("gaussian.algebra"):
        every: tuple[FloatArray, FloatArray] = loops.blend(
            *map(np.ascontiguousarray, (own.mean, own.covariance, joint, died, of, to)),
            *map(np.ascontiguousarray, (*later.moves.backward, later.mean, later.covariance)),
        )
        return every
    mean, covariance = later.moves.backward.earlier(
        later.mean.take(to, axis=1), later.covariance.take(to, axis=1)
    )
    weight = (np.arange(own.mean.shape[1])[:, None] == of) * joint[:, None]
    total = weight.sum(axis=2)
    reached = total > 0.0
    share = weight / np.where(reached, total, 1.0)[..., None]
    mean, covariance = moments.match_moments(share, mean, covariance)
    share = np.where(reached, died / np.where(reached, total + died, 1.0), 1.0)[..., None]
    apart = own.mean - mean
    mean = mean + share * apart
    share = share[..., None]
    covariance = (1.0 - share) * covariance + share * own.covariance
    covariance += share * (1.0 - share) * apart[..., None] * apart[..., None, :]
    # Axes that a mode lacks stay zero, even where other modes have them.
    axes = np.arange(mean.shape[2])
    defined = (own.covariance[..., axes, axes] > 0.0).astype(np.float64)
    return mean * defined, covariance * defined[..., None] * defined[..., None, :]
