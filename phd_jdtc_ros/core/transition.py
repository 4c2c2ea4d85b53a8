"""The backward kernel between two stored particle sets, built once a scan.

The kernel K and its normaliser mu do not depend on later scans, so they are cached and every lag
costs one sparse product. Only pairs within 7 standard deviations of the process noise are kept:
at 6, single weights are off by 5 %; at 7, by 1e-4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from . import birth, detection_birth
from .detection_birth import Newborn
from .filter import TrackerModel
from .motion import whitener
from .neighbours import pairs_within
from .types import FloatArray, IntArray, ParticlePHD, SparseArray, sum_by

GATE_SIGMA = 7.0


@dataclass(frozen=True)
class Transition:
    """What the backward step needs to know of two consecutive stored sets.

    Parameters
    ----------
    ratio : sparse array of shape (N_t, N_{t+1})
        K[q, s] / mu_q, transposed, so that ``B = ratio @ w_{t+1|k}``.
    survival : array of shape (N_t,)
        P_s over the true interval.
    orphans : int
        Rows of the later set that neither a parent, a spawn nor a birth explains within the gate;
        each is given to its ancestor.
    """

    ratio: SparseArray
    survival: FloatArray
    orphans: int


def build(
    earlier: ParticlePHD,
    later: ParticlePHD,
    model: TrackerModel,
    dt: float,
    found: tuple[Newborn, ...] = (),
) -> Transition:
    """Return the cached transition between two stored sets.

    Parameters
    ----------
    earlier, later : ParticlePHD
        Stored sets at t and t + 1, of N_t and N_{t+1} rows.
    model : TrackerModel
    dt : float
        True interval between them, seconds.
    found : tuple of Newborn
        What the later set's prediction was given.

    Returns
    -------
    Transition

    Notes
    -----
    Sec. IV-C, Step 4: K[q, s] = P_s h[r_s, r_q] f_{r_q}(x_q | x_s) within a class, and
    mu_q = gamma(x_q, o_q) + sum_s w_{t|t}(s) K[q, s] + sum_s w_{t|t}(s) beta(q | s), the last sum
    over all classes. As in the paper the spawn intensity stands in mu and not in the numerator.
    """
    survival = model.modes.survival(dt)[earlier.mode]
    row, column, value = _survival_pairs(earlier, later, model, dt)
    value = value * survival[column]
    mu = sum_by(row, value * earlier.weight[column], len(later))
    mu += _spawn_intensity(earlier, later, model, dt)
    gamma = birth.intensity(model.births, model.modes, later.state, later.mode)
    mu += gamma * dt / model.modes.interval_s
    for one in found:
        mu += detection_birth.intensity(
            one, model.detection_births, model.modes, dt, later.state, later.mode
        )

    # A row without any explanation inside the gate goes to the row it was drawn from, which is
    # the limit of the quotient as the gate widens.
    orphan = np.flatnonzero((mu <= 0.0) & (later.parent >= 0))
    heir = later.parent[orphan]
    share = value / np.where(mu > 0.0, mu, 1.0)[row]
    ratio = sparse.csr_array(
        (
            np.concatenate([share, 1.0 / earlier.weight[heir]]),
            (np.concatenate([column, heir]), np.concatenate([row, orphan])),
        ),
        shape=(len(earlier), len(later)),
    )
    return Transition(ratio=ratio, survival=survival, orphans=len(orphan))


def _survival_pairs(
    earlier: ParticlePHD, later: ParticlePHD, model: TrackerModel, dt: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return (later row, earlier row, h f) of every pair within the gate."""
    transition = model.modes.transition(dt)
    whitening = [whitener(motion.noise_covariance(dt)) for motion in model.modes.motions]
    return _gated_density(earlier, later, model, dt, transition, whitening)


def _spawn_intensity(
    earlier: ParticlePHD, later: ParticlePHD, model: TrackerModel, dt: float
) -> FloatArray:
    """Return sum_s w(s) beta(q | s) for every later row, shape (N_{t+1},)."""
    spawn = model.spawn
    if spawn.rate == 0.0:
        return np.zeros(len(later))
    whitening = [
        whitener(np.diag(spawn.std[list(motion.support)] ** 2)) for motion in model.modes.motions
    ]
    row, column, value = _gated_density(earlier, later, model, dt, spawn.transition, whitening)
    rate = spawn.rate * dt / model.modes.interval_s
    return rate * sum_by(row, value * earlier.weight[column], len(later))


def _gated_density(
    earlier: ParticlePHD,
    later: ParticlePHD,
    model: TrackerModel,
    dt: float,
    transition: FloatArray,
    whitening: list[tuple[FloatArray, float]],
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the gated Gaussian transition density times the mode transition.

    Both kernels have one form: the later state is Gaussian about the noise-free successor under
    its own mode. All destination modes are searched at once, each a block of its own; modes with
    a smaller support are padded with equal coordinates.
    """
    size = earlier.state.shape[1]
    query = np.zeros((len(later), size))
    points, blocks, sources = [], [], []
    log_norm = np.empty(len(model.modes))
    for index, motion in enumerate(model.modes.motions):
        matrix, log_determinant = whitening[index]
        support = list(motion.support)
        log_norm[index] = log_determinant - 0.5 * len(support) * np.log(2.0 * np.pi)
        chosen = later.mode == index
        query[chosen, : len(support)] = later.state[chosen][:, support] @ matrix.T
        source = np.flatnonzero(transition[earlier.mode, index] > 0.0)
        point = np.zeros((len(source), size))
        mean = motion.mean(earlier.state[source], dt)
        point[:, : len(support)] = mean[:, support] @ matrix.T
        points.append(point)
        blocks.append(np.full(len(source), index))
        sources.append(source)
    row, found, square = pairs_within(
        query, later.mode, np.concatenate(points), np.concatenate(blocks), GATE_SIGMA
    )
    column = np.concatenate(sources)[found]
    log_density = log_norm[later.mode[row]] - 0.5 * square
    probability = transition[earlier.mode[column], later.mode[row]]
    return row, column, probability * np.exp(log_density)
