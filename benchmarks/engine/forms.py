"""Other forms of the smoother, as baselines and as a reference: dense ones, and a k-d tree.

The naive dense form and the k-d tree take the particles as a resampler returns them, with every
copy in a row of its own (`copies`).

- The naive dense form evaluates K and mu between all particles in float64, as whole arrays, with
  one block per destination mode. As in the paper, Step 4 is carried out at every lag, so all
  kernels are evaluated again each time. There is no gate, so the error of the smoother's gate is
  measured against this form.
- Dense products are the dense form as one would write it for speed: each particle once, the
  distances of a block by one matrix product, and every kernel kept for the other lags. By label,
  only particles of one label are paired, label by label.
- The k-d tree form keeps the pairs within the smoother's gate, found by
  `scipy.spatial.cKDTree.sparse_distance_matrix` over all whitened coordinates.

Where labels are targets (the default corrector), all but the form by label find the same pairs
and then drop those of different labels; births and spawned targets do not enter mu.

None of them shares code with `phd_jdtc_ros.core.smc.kernel.backward_kernel`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.linalg import solve_triangular
from scipy.spatial import cKDTree

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.smc.correction import Corrector
from phd_jdtc_ros.core.smc.kernel.backward_kernel import KERNEL_GATE_SIGMA, Transition
from phd_jdtc_ros.core.smc.particle_set import ParticleSet
from phd_jdtc_ros.core.smc.smoother import DeathTerm, backward_step
from phd_jdtc_ros.core.targets.motion import whitener

Density = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
Link = Callable[[ParticleSet, ParticleSet, TrackerModel, Corrector, float], Transition]


def copies(phd: ParticleSet) -> ParticleSet:
    """Return the set with every copy of a particle in a row of its own."""
    row = np.repeat(np.arange(len(phd)), phd.multiplicity)
    share = 1.0 / phd.multiplicity[row]
    return replace(phd.scale(row, share), multiplicity=np.ones(len(row), dtype=np.int64))


def smooth(
    stored: Sequence[ParticleSet],
    model: TrackerModel,
    corrector: Corrector,
    dt: float,
    death_term: DeathTerm,
    link: Link,
) -> ParticleSet:
    """Return the oldest set smoothed over all later ones; every kernel is evaluated on the way.

    The oldest set comes first; `link` is `dense`, `k_d_tree` or the like.
    """
    smoothed = stored[-1]
    for earlier, later in zip(stored[-2::-1], stored[:0:-1], strict=True):
        own = link(earlier, later, model, corrector, dt)
        backward = own.ratio @ smoothed.weight
        smoothed = backward_step(earlier, own.survival, backward, death_term)
    return smoothed


def dense(
    earlier: ParticleSet,
    later: ParticleSet,
    model: TrackerModel,
    corrector: Corrector,
    dt: float,
    density: Density | None = None,
) -> Transition:
    """Return the transition with K and mu between all particles, as in Sec. IV-C, Step 4.

    `density` returns N(state; mean, covariance) of all pairs, element by element by default. The
    matrix is dense, with 8 bytes per pair of particles of a class.
    """
    density = density or _dense_gaussian
    survival = model.modes.survival(dt)[earlier.mode]
    born = _born(later, model, corrector, dt)
    blocks = []
    for mode, rows in _destinations(later, model):
        sources, share = _survivors(earlier, model, mode, dt)
        kernel = share * density(
            *_pair(earlier, later, model, mode, rows, sources, dt), _motion_noise(model, mode, dt)
        )
        if corrector.labelled:
            kernel *= later.row_label[rows][:, None] == earlier.row_label[sources]
        mu = born[rows] + kernel @ earlier.weight[sources]
        parents, rate = _parents(earlier, model, corrector, mode, dt)
        if len(parents):
            spawned = density(
                *_pair(earlier, later, model, mode, rows, parents, dt), _spawn_noise(model, mode)
            )
            mu += spawned @ (rate * earlier.weight[parents])
        kernel /= np.where(mu > 0.0, mu, 1.0)[:, None]
        blocks.append((sources, rows, kernel))
    return Transition(ratio=_Blocks(len(earlier), blocks), survival=survival, orphans=0)


def dense_products(
    earlier: ParticleSet, later: ParticleSet, model: TrackerModel, corrector: Corrector, dt: float
) -> Transition:
    """Return the transition of `dense`, with distances by matrix products."""
    return dense(earlier, later, model, corrector, dt, _product_gaussian)


def dense_by_label(
    earlier: ParticleSet, later: ParticleSet, model: TrackerModel, corrector: Corrector, dt: float
) -> Transition:
    """Return the transition between particles of one label, label by label, by products.

    Only with a corrector for which labels are targets.
    """
    survival = model.modes.survival(dt)[earlier.mode]
    blocks = []
    for mode, rows in _destinations(later, model):
        sources, share = _survivors(earlier, model, mode, dt)
        states, means = _pair(earlier, later, model, mode, rows, sources, dt)
        noise = _motion_noise(model, mode, dt)
        for own, from_ in _by_label(later.row_label[rows], earlier.row_label[sources]):
            kernel = share[from_] * _product_gaussian(states[own], means[from_], noise)
            mu = kernel @ earlier.weight[sources[from_]]
            kernel /= np.where(mu > 0.0, mu, 1.0)[:, None]
            blocks.append((sources[from_], rows[own], kernel))
    return Transition(ratio=_Blocks(len(earlier), blocks), survival=survival, orphans=0)


def _by_label(later: IntArray, earlier: IntArray) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield the indices of each label that is in both."""
    common = np.intersect1d(later, earlier)
    parts = []
    for label in (later, earlier):
        order = np.argsort(label, kind="stable")
        ends = (np.searchsorted(label[order], common, side=side) for side in ("left", "right"))
        parts.append([order[start:stop] for start, stop in zip(*ends, strict=True)])
    yield from zip(*parts, strict=True)


def k_d_tree(
    earlier: ParticleSet, later: ParticleSet, model: TrackerModel, corrector: Corrector, dt: float
) -> Transition:
    """Return the transition with the pairs within the gate, found by k-d trees."""
    survival = model.modes.survival(dt)[earlier.mode]
    mu = _born(later, model, corrector, dt)
    row, column, value = [], [], []
    for mode, rows in _destinations(later, model):
        sources, share = _survivors(earlier, model, mode, dt)
        near, source, density = _near_gaussian(
            *_pair(earlier, later, model, mode, rows, sources, dt), _motion_noise(model, mode, dt)
        )
        if corrector.labelled:
            own = later.row_label[rows[near]] == earlier.row_label[sources[source]]
            near, source, density = near[own], source[own], density[own]
        kernel = share[source] * density
        np.add.at(mu, rows[near], kernel * earlier.weight[sources[source]])
        row.append(sources[source])
        column.append(rows[near])
        value.append(kernel)
        sources, rate = _parents(earlier, model, corrector, mode, dt)
        if len(sources):
            near, source, density = _near_gaussian(
                *_pair(earlier, later, model, mode, rows, sources, dt), _spawn_noise(model, mode)
            )
            np.add.at(mu, rows[near], rate[source] * density * earlier.weight[sources[source]])
    columns = np.concatenate(column)
    share = np.concatenate(value) / np.where(mu > 0.0, mu, 1.0)[columns]
    ratio = sparse.csr_array(
        (share, (np.concatenate(row), columns)), shape=(len(earlier), len(later))
    )
    return Transition(ratio=ratio, survival=survival, orphans=0)


@dataclass(frozen=True)
class _Blocks:
    """A matrix of dense blocks, each with (rows, columns, transposed values)."""

    size: int
    blocks: list[tuple[IntArray, IntArray, FloatArray]]

    def __matmul__(self, weight: FloatArray) -> FloatArray:
        product = np.zeros(self.size)
        for row, column, value in self.blocks:
            product[row] += weight[column] @ value
        return product


def _destinations(later: ParticleSet, model: TrackerModel) -> Iterator[tuple[int, IntArray]]:
    """Yield every flat mode and the rows of the later set in this mode."""
    for mode in range(len(model.modes)):
        yield mode, np.flatnonzero(later.mode == mode)


def _survivors(
    earlier: ParticleSet, model: TrackerModel, mode: int, dt: float
) -> tuple[IntArray, FloatArray]:
    """Return the rows that can survive into a flat mode, with P_s h of each."""
    share = (model.modes.transition(dt) * model.modes.survival(dt)[:, None])[earlier.mode, mode]
    sources = np.flatnonzero(share > 0.0)
    return sources, share[sources]


def _parents(
    earlier: ParticleSet, model: TrackerModel, corrector: Corrector, mode: int, dt: float
) -> tuple[IntArray, FloatArray]:
    """Return the rows that can spawn into a flat mode within a label, with their rates."""
    if corrector.labelled:
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    rate = model.spawn.rate * dt / model.modes.interval_s
    share = rate * model.spawn.transition[earlier.mode, mode]
    sources = np.flatnonzero(share > 0.0)
    return sources, share[sources]


def _born(later: ParticleSet, model: TrackerModel, corrector: Corrector, dt: float) -> FloatArray:
    """Return the birth intensity at every row, without a gate, shape (N,)."""
    total = np.zeros(len(later))
    if corrector.labelled:  # births have new labels
        return total
    for mode, rows in _destinations(later, model):
        support = list(model.modes.motions[mode].support)
        for term in model.births:
            offset = (later.state[rows] - term.mean)[:, support] / term.std[support]
            scale = np.prod(np.sqrt(2.0 * np.pi) * term.std[support])
            total[rows] += term.rate[mode] / scale * np.exp(-0.5 * (offset**2).sum(axis=1))
    return total * dt / model.modes.interval_s


def _motion_noise(model: TrackerModel, mode: int, dt: float) -> FloatArray:
    return model.modes.motions[mode].noise_covariance(dt)


def _spawn_noise(model: TrackerModel, mode: int) -> FloatArray:
    return np.diag(model.spawn.std[list(model.modes.motions[mode].support)] ** 2)


def _pair(
    earlier: ParticleSet,
    later: ParticleSet,
    model: TrackerModel,
    mode: int,
    rows: IntArray,
    sources: IntArray,
    dt: float,
) -> tuple[FloatArray, FloatArray]:
    """Return later states and predicted means of earlier ones, on a flat mode's support."""
    motion = model.modes.motions[mode]
    support = list(motion.support)
    successor = motion.mean(earlier.state[sources], dt)
    return later.state[rows][:, support], successor[:, support]


def _whitened(
    state: FloatArray, mean: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Return both in coordinates of unit covariance, and the density's normalisation."""
    factor = np.linalg.cholesky(covariance)
    scale = 1.0 / np.prod(np.sqrt(2.0 * np.pi) * np.diag(factor))
    return (
        solve_triangular(factor, state.T, lower=True),
        solve_triangular(factor, mean.T, lower=True),
        float(scale),
    )


def _dense_gaussian(state: FloatArray, mean: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return N(state; mean, covariance) of all pairs, shape (states, means)."""
    state, mean, scale = _whitened(state, mean, covariance)
    square = np.zeros((state.shape[1], mean.shape[1]))
    for of_state, of_mean in zip(state, mean, strict=True):
        square += (of_state[:, None] - of_mean) ** 2
    density: FloatArray = scale * np.exp(-0.5 * square)
    return density


def _product_gaussian(state: FloatArray, mean: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the same as `_dense_gaussian`, with the distances by one matrix product."""
    state, mean, scale = _whitened(state, mean, covariance)
    # Squares of distances are differences of squares; about the centre these are small.
    centre = mean.mean(axis=1, keepdims=True) if mean.shape[1] else 0.0
    state, mean = state - centre, mean - centre
    exponent: FloatArray = state.T @ mean
    exponent -= 0.5 * (state**2).sum(axis=0)[:, None]
    exponent -= 0.5 * (mean**2).sum(axis=0)
    np.exp(exponent, out=exponent)
    exponent *= scale
    return exponent


def _near_gaussian(
    state: FloatArray, mean: FloatArray, covariance: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the pairs within the gate, and their N(state; mean, covariance)."""
    state, mean, scale = _whitened(state, mean, covariance)
    if state.shape[1] == 0 or mean.shape[1] == 0:
        empty = np.zeros(0, dtype=np.int64)
        return empty, empty, np.zeros(0)
    pairs = cKDTree(state.T).sparse_distance_matrix(
        cKDTree(mean.T), KERNEL_GATE_SIGMA, output_type="ndarray"
    )
    return pairs["i"], pairs["j"], scale * np.exp(-0.5 * pairs["v"] ** 2)


def whiten_sort_gather(
    earlier: ParticleSet, later: ParticleSet, model: TrackerModel, dt: float
) -> list[FloatArray]:
    """Whiten, sort and gather for every destination mode: the least work of any search."""
    gathered = []
    transition = model.modes.transition(dt)
    for mode, motion in enumerate(model.modes.motions):
        matrix, _ = whitener(motion.noise_covariance(dt))
        support = list(motion.support)
        sources = np.flatnonzero(transition[earlier.mode, mode] > 0.0)
        successor = motion.mean(earlier.state[sources], dt)[:, support] @ matrix.T
        states = later.state[later.mode == mode][:, support] @ matrix.T
        for points in (successor, states):
            order = np.argsort(points[:, 0], kind="stable")
            gathered.append(points[order])
    return gathered
