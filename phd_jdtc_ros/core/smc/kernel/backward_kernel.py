"""The backward kernel between two stored particle sets, built once per scan.

The kernel K and its normaliser mu (Sec. IV-C, Step 4) do not depend on later scans. They are
cached, so that every lag costs one sparse product. Only pairs within 7.5 standard deviations of the
process noise are kept: with a gate of 6, single weights are off by 5 %, with 7 by up to 2e-3, and
with 7.5 by less than 1e-4. Rows with many pairs are thinned (`kernel_thinning`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from ...arrays import FloatArray, IntArray, SparseArray, add_by_row, factorize
from ...models import newborn_sampling
from ...models.detection_birth import Newborn
from ...models.tracker_model import TrackerModel
from ...snapshot import floats, integers, sparse_columns
from ...targets import birth
from ...window.entries import Entry, UnsweptRows
from ..correction import Corrector
from ..particle_set import AgedParticles, ParticleSet
from . import kernel_thinning, strata
from .spawn_intensity import spawn_intensity
from .transition_density import TransitionDensity

KERNEL_GATE_SIGMA = 7.5


@dataclass(frozen=True)
class Transition:
    """The cached backward kernel between two consecutive stored sets."""

    # K[q, s] / mu_q, transposed, so that ``B = ratio @ w_{t+1|k}``, (N_t, N_{t+1}).
    ratio: Annotated[SparseArray, sparse_columns("EN")]
    survival: Annotated[FloatArray, floats("E", 0.0, 1.0)]  # P_s over the true interval, (N_t,)
    # Number of rows of the later set for which mu is zero, since no survivor, spawned target or
    # birth is within the gate. Each is linked to its parent instead.
    orphans: Annotated[int, integers("", 0)]


ParticleEntry = Entry[ParticleSet, Transition]
UnsweptParticles = UnsweptRows[ParticleSet, Transition]


class _Sums(NamedTuple):
    """A kernel's pairs by later row, and their contribution to mu."""

    value: FloatArray  # (pairs,)
    column: npt.NDArray[np.int32]  # The earlier rows, (pairs,)
    start: npt.NDArray[np.int32]  # Index at which the pairs of each later row begin, (N_{t+1} + 1,)
    # Sum of kernel times weight over all pairs of each later row, before thinning, (N_{t+1},).
    mu: FloatArray


def build(
    earlier: ParticleSet,
    later: ParticleSet,
    model: TrackerModel,
    corrector: Corrector,
    dt: float,
    newborns: tuple[Newborn, ...] = (),
) -> Transition:
    """Return the cached transition between two stored sets, `dt` seconds apart.

    `newborns` has the targets born at the detections of the later scan, by radar.

    Sec. IV-C, Step 4: K[q, s] = P_s h[r_s, r_q] f_{r_q}(x_q | x_s) within a class, and
    mu_q = gamma(x_q, o_q) + sum_s w_{t|t}(s) K[q, s] + sum_s w_{t|t}(s) beta(q | s), the last sum
    over all classes. As in the paper, the spawn intensity is part of mu and not of the numerator.

    Deviation: with a labelled corrector, sums are over rows of the same label. Births and spawned
    targets have new labels and do not contribute to the mu of any other label.
    """
    modes = model.modes
    survival = modes.survival(dt)[earlier.mode]
    successor = {motion: motion.mean(earlier.state, dt) for motion in dict.fromkeys(modes.motions)}
    noise = {motion: motion.noise_covariance(dt) for motion in successor}
    kernel = TransitionDensity.of_noise(
        noise, modes, modes.transition(dt), successor, earlier.mode, survival
    )
    if corrector.labelled:
        ratio, column, start, mu = _sum_within_labels(kernel, earlier, later)
    else:
        pairs = kernel.gated_pairs(later, np.arange(len(later)), KERNEL_GATE_SIGMA)
        ratio, column, start, mu = _sum_pairs(pairs, earlier, later)
        mu += _birth_intensity(later, model, dt, newborns)
        if model.spawn.rate > 0.0 and len(earlier):
            mu += spawn_intensity(mu, earlier, later, model, dt, successor, KERNEL_GATE_SIGMA)
    ratio /= np.where(mu > 0.0, mu, 1.0).repeat(np.diff(start))
    # An orphan is paired with its parent alone, which is the limit of K / mu for a wide gate.
    orphan = np.flatnonzero((mu <= 0.0) & (later.parent >= 0))
    if corrector.labelled:  # a spawned target has no past under its parent's label
        orphan = orphan[later.row_label[orphan] == earlier.row_label[later.parent[orphan]]]
    if len(orphan):
        parent = later.parent[orphan]
        ratio = np.insert(ratio, start[orphan], 1.0 / earlier.weight[parent])
        column = np.insert(column, start[orphan], parent.astype(np.int32))
        start[1:] += np.cumsum(np.bincount(orphan, minlength=len(later))).astype(np.int32)
    return Transition(
        ratio=sparse.csc_array((ratio, column, start), shape=(len(earlier), len(later))),
        survival=survival,
        orphans=len(orphan),
    )


def build_joint(
    earlier: Sequence[AgedParticles],
    later: ParticleSet,
    model: TrackerModel,
    corrector: Corrector,
    newborns: tuple[Newborn, ...] = (),
) -> Transition:
    """Return the transition from the concatenated rows of stored sets to a later set; see `build`.

    There is more than one earlier set only with a labelled corrector. The parents of `later` are
    rows of the concatenated sets.
    """
    if len(earlier) == 1:
        return build(earlier[0].particles, later, model, corrector, earlier[0].dt, newborns)
    parts, first = [], 0
    for particles, dt in earlier:
        # Each label is in one earlier set, which therefore explains all later rows of the label.
        columns = np.flatnonzero(np.isin(later.row_label, factorize(particles.row_label)[0]))
        continued = later.take(columns)
        child = replace(continued, parent=np.maximum(continued.parent - first, -1))
        parts.append((columns, build(particles, child, model, corrector, dt)))
        first += len(particles)
    return _concatenate(parts, len(later))


def _concatenate(parts: Sequence[tuple[IntArray, Transition]], size: int) -> Transition:
    """Return one transition, given those to the parts of a later set of `size` rows."""
    placed, first = [], 0
    rows = sum(part.ratio.shape[0] for _, part in parts)
    for columns, part in parts:
        block = part.ratio.tocoo()
        placed.append((block.data, block.row + first, columns[block.col]))
        first += part.ratio.shape[0]
    data, row, column = (np.concatenate(values) for values in zip(*placed, strict=True))
    return Transition(
        ratio=sparse.csc_array((data, (row, column)), shape=(rows, size)),
        survival=np.concatenate([part.survival for _, part in parts]),
        orphans=sum(part.orphans for _, part in parts),
    )


def _birth_intensity(
    later: ParticleSet, model: TrackerModel, dt: float, newborns: tuple[Newborn, ...]
) -> FloatArray:
    """Return the intensity of births at every later row, shape (N_{t+1},)."""
    modes, state, mode = model.modes, later.state, later.mode
    total = birth.intensity(model.births, modes, state, mode) * dt / modes.interval_s
    for newborn in newborns:
        total += newborn_sampling.intensity(newborn, model, state, mode)
    return total


def _sum_within_labels(
    kernel: TransitionDensity, earlier: ParticleSet, later: ParticleSet
) -> _Sums:
    """Return the kernel between rows of one label, and its sums."""
    # A target's class never changes, so groups by (label, class) are smaller and faster to search.
    modes = kernel.modes
    key = [
        modes.class_of[particles.mode] + len(modes.classes) * particles.row_label
        for particles in (later, earlier)
    ]
    group = factorize(np.concatenate(key))[1]
    groups = group[: len(later)], group[len(later) :]
    groups = strata.split_into_strata(kernel, earlier, later, groups, KERNEL_GATE_SIGMA)
    pairs = kernel.gated_pairs(later, np.arange(len(later)), KERNEL_GATE_SIGMA, groups)
    return _sum_pairs(pairs, earlier, later)


def _sum_pairs(
    pairs: Iterable[tuple[IntArray, IntArray, FloatArray]], earlier: ParticleSet, later: ParticleSet
) -> _Sums:
    """Return the pairs of all chunks, thinned, and the sums of kernel times weight by later row."""
    values, columns = [np.zeros(0)], [np.zeros(0, dtype=np.int32)]
    count = np.zeros(len(later), dtype=np.int64)
    mu = np.zeros(len(later))
    for row, earlier_row, density in kernel_thinning.complete_rows(pairs):
        weight = earlier.weight.take(earlier_row)
        add_by_row(mu, row, density * weight)
        kept_row, column, value = kernel_thinning.thin(row, earlier_row, density, weight)
        add_by_row(count, kept_row, None)
        values.append(value)
        columns.append(column.astype(np.int32))
    start = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
    return _Sums(np.concatenate(values), np.concatenate(columns), start, mu)
