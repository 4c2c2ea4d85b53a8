"""Reduction of each target's hypotheses: improbable ones are dropped, similar ones merged.

Each probable motion mode of a remaining hypothesis then becomes a hypothesis of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from ..arrays import FloatArray, IntArray, contiguous
from ..compilation import Float3, Float4, Int1, Int2, compiled, inner
from ..snapshot import floats, integers
from .algebra import kalman
from .algebra.blocks import SIZE, add_mean, add_spread, factorise, square_distance
from .algebra.vectors import add, total_of
from .bounds import Bounds
from .mixture import Mixture

# Share of `Bounds.most` that single-mode hypotheses may take. The rest is reserved for the next
# scan, in which every detection branches a hypothesis.
ROOM = 0.25


@dataclass(frozen=True)
class Branched:
    """Hypotheses, and the predicted row from which each descends."""

    mixture: Mixture
    parent: IntArray  # (H,). Row of the predicted mixture; -1 for targets born at detections.

    def take(self, rows: IntArray) -> Branched:
        """Return the hypotheses of these rows."""
        return Branched(self.mixture.take(rows), self.parent[rows])


@dataclass(frozen=True)
class Ancestry:
    """For each kept hypothesis, the hypotheses merged into it and their predicted rows."""

    # Row of the kept mixture, ascending, (E,).
    child: Annotated[IntArray, integers("E", 0, below="H")]
    # (E,). Row of the predicted mixture; -1 for targets born at detections.
    parent: Annotated[IntArray, integers("E", -1, below="P")]
    # (E, R, C). Share of the child's weight; sums to one over the rows of a child with positive
    # weight.
    share: Annotated[FloatArray, floats("EOC", 0.0, 1.0)]


@inner
def _across_modes(
    weight: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
    centre: FloatArray,
    spread: FloatArray,
) -> None:
    """Write a hypothesis's moments over its motion modes; unused axes have variance 1."""
    mass = 0.0
    for mode in range(len(weight)):
        mass += total_of(weight[mode])
    for mode in range(len(weight)):
        add_mean(total_of(weight[mode]) / mass if mass > 0.0 else 0.0, mean[mode], centre)
    for mode in range(len(weight)):
        share = total_of(weight[mode]) / mass if mass > 0.0 else 0.0
        add_spread(share, mean[mode], covariance[mode], centre, spread)
    for i in range(SIZE):
        if spread[i, i] == 0.0:
            spread[i, i] = 1.0


@compiled
def _clusters(
    target: Int1, weight: Float3, mean: Float3, covariance: Float4, distance: float
) -> IntArray:
    """Return for each hypothesis the row that absorbs it; its own row if it is not merged.

    The rows of a target come one after the other, the most probable first.
    """
    count = len(target)
    into, centre = np.full(count, -1), np.zeros((count, SIZE))
    spread, factor = np.zeros((count, SIZE, SIZE)), np.empty((SIZE, SIZE))
    apart = np.empty(SIZE)
    begin = 0
    while begin < count:
        end = begin + 1
        while end < count and target[end] == target[begin]:
            end += 1
        for row in range(begin, end if end > begin + 1 else begin):
            _across_modes(weight[row], mean[row], covariance[row], centre[row], spread[row])
        for first in range(begin, end):
            if into[first] >= 0:
                continue
            into[first] = first
            if first + 1 < end:
                factorise(spread[first], factor)
            for row in range(first + 1, end):
                if into[row] < 0:
                    square = square_distance(factor, centre[row], centre[first], apart)
                    into[row] = first if square <= distance else -1
        begin = end
    return into


@inner
def _merged_snr(
    row_of: IntArray,
    child: IntArray,
    size: IntArray,
    weight: FloatArray,
    found: FloatArray,
    snr: FloatArray,
) -> FloatArray:
    """Return the cells of SNR of each cluster: those of its hypotheses, by the class's weight."""
    classes, cells = snr.shape[1:]
    merged = np.zeros((len(found), classes, cells))
    for edge in range(len(row_of)):
        row, one = row_of[edge], child[edge]
        for class_id in range(classes):
            own, whole = 0.0, 0.0
            for mode in range(weight.shape[1]):
                own += weight[row, mode, class_id]
                whole += found[one, mode, class_id]
            # A class without weight has the cells of all hypotheses, equally weighted.
            part = own / whole if whole > 0.0 else 1.0 / size[one + 1]
            for cell in range(cells):
                merged[one, class_id, cell] += part * snr[row, class_id, cell]
    return merged


@compiled
def _merged(
    into: Int1, parent: Int1, weight: Float3, mean: Float3, covariance: Float4, snr: Float3
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray, IntArray, FloatArray]:
    """Return the columns of each cluster's hypothesis, and the columns of `Ancestry`.

    For `into` see `_clusters`.
    """
    count, modes, classes = weight.shape
    cluster, size = np.cumsum(into == np.arange(count)) - 1, np.zeros(count + 1, np.int64)
    clusters = cluster[-1] + 1 if count else 0
    for row in range(count):
        size[cluster[into[row]] + 1] += 1
    start = np.cumsum(size)
    row_of, child = np.empty(count, np.int64), np.empty(count, np.int64)
    for row in range(count):
        child[start[cluster[into[row]]]] = cluster[into[row]]
        row_of[start[cluster[into[row]]]] = row
        start[cluster[into[row]]] += 1
    found, share = np.zeros((clusters, modes, classes)), np.zeros((count, modes, classes))
    centre, spread = np.zeros((clusters, modes, SIZE)), np.zeros((clusters, modes, SIZE, SIZE))
    for row in range(count):
        for mode in range(modes):
            add(weight[row, mode], found[cluster[into[row]], mode])
    part = np.empty((count, modes))
    for edge in range(count):
        row, one = row_of[edge], child[edge]
        for mode in range(modes):
            whole = total_of(found[one, mode])
            # A mode without weight keeps the Gaussians of all hypotheses, equally weighted.
            some = whole > 0.0
            part[edge, mode] = total_of(weight[row, mode]) / whole if some else 1.0 / size[one + 1]
            add_mean(part[edge, mode], mean[row, mode], centre[one, mode])
            for class_id in range(classes):
                if found[one, mode, class_id] > 0.0:
                    part_of = weight[row, mode, class_id] / found[one, mode, class_id]
                    share[edge, mode, class_id] = part_of
    for edge in range(count):
        row, one = row_of[edge], child[edge]
        for mode in range(modes):
            at, around = centre[one, mode], spread[one, mode]
            add_spread(part[edge, mode], mean[row, mode], covariance[row, mode], at, around)
    cells = _merged_snr(row_of, child, size, weight, found, snr)
    return found, centre, spread, cells, child, parent[row_of], share


@compiled
def _split(
    row: Int1,
    mode: Int1,
    stays_with: Int2,
    weight: Float3,
    child: Int1,
    parent: Int1,
    share: Float3,
) -> tuple[FloatArray, IntArray, IntArray, FloatArray]:
    """Return the weights of hypotheses of one mode each, and the columns of their `Ancestry`.

    `row` and `mode` are the hypothesis and its mode, ascending, of each result. `stays_with` is the
    mode with which each mode of a hypothesis stays.
    """
    modes, classes = weight.shape[1:]
    size = np.zeros(len(weight) + 1, np.int64)
    for edge in range(len(child)):
        size[child[edge] + 1] += 1
    start = np.cumsum(size)
    edges = 0
    for one in row:
        edges += size[one + 1]
    found, part = np.zeros((len(row), modes, classes)), np.zeros((edges, modes, classes))
    to, of = np.empty(edges, np.int64), np.empty(edges, np.int64)
    edge = 0
    for new in range(len(row)):
        old, begin = row[new], edge
        for at in range(start[old], start[old + 1]):
            to[edge], of[edge] = new, parent[at]
            edge += 1
        for other in range(modes):
            if stays_with[old, other] != mode[new]:
                continue
            for class_id in range(classes):
                found[new, other, class_id] = weight[old, other, class_id]
                for at in range(edge - begin):
                    part[begin + at, other, class_id] = share[start[old] + at, other, class_id]
    return found, to, of, part


def reduce_hypotheses(branched: Branched, bounds: Bounds) -> tuple[Mixture, Ancestry, int]:
    """Return the reduced hypotheses, from which the next prediction starts.

    Parameters
    ----------
    branched : Branched
        Sorted by target, and then by descending probability.

    Returns
    -------
    mixture : Mixture
    ancestry : Ancestry
    floored : int
        Number of covariances in which rounding had caused negative eigenvalues.

    Notes
    -----
    Targets of small existence probability are dropped. The most probable hypothesis of each other
    target absorbs all hypotheses within the merge distance, then the most probable remaining one
    does, and so on. Each motion mode's Gaussian is moment-matched to the Gaussians it absorbs.

    A merge of hypotheses of different motion modes only after the update is the second-order
    generalised pseudo-Bayesian filter; hypotheses that are kept apart make this more exact.

    References
    ----------
    Chang and Athans, "State estimation for discrete systems with switching parameters", IEEE
    Transactions on Aerospace and Electronic Systems 14(3), 1978.
    Salmond, "Mixture reduction algorithms for target tracking in clutter", Proceedings of SPIE
    1305, 1990, the clustering algorithm.
    """
    branched = branched.take(_existing(branched.mixture, bounds))
    mixture = branched.mixture
    columns = mixture.weight, mixture.mean, mixture.covariance
    into = _clusters(mixture.target, *columns, bounds.merge_distance)
    weight, mean, covariance, snr, child, parent, share = _merged(
        *contiguous(into, branched.parent, *columns, mixture.snr)
    )
    covariance, floored = kalman.floor_eigenvalues(covariance)
    origin = mixture.row_label[np.flatnonzero(into == np.arange(len(into)))]
    merged = Mixture(origin, weight, mean, covariance, snr)
    return *_by_mode(merged, Ancestry(child, parent, share), bounds), floored


def _by_mode(mixture: Mixture, ancestry: Ancestry, bounds: Bounds) -> tuple[Mixture, Ancestry]:
    """Return a hypothesis for each motion mode whose share is at least `least_mode`.

    Less probable modes stay with the most probable one. If the number of hypotheses would leave
    too little room for the next scan, none is split: modes are mixed, as with a `least_mode` of 1.
    """
    least = bounds.least_mode
    mass = np.where(mixture.mass > 0.0, mixture.mass, 1.0)
    own = (mixture.mode_weight >= least * mass[:, None]) & (mixture.mode_weight > 0.0)
    main = mixture.mode_weight.argmax(axis=1)
    own[np.arange(len(mixture)), main] = True
    count = np.count_nonzero(own)
    if count == len(mixture) or count > ROOM * bounds.most:
        return mixture, ancestry
    row, mode = np.nonzero(own)
    # The mode of its own that each mode stays with.
    stays_with = np.where(own, np.arange(own.shape[1]), main[:, None])
    weight, child, parent, share = _split(
        *contiguous(row, mode, stays_with, mixture.weight),
        *contiguous(ancestry.child, ancestry.parent, ancestry.share),
    )
    split = replace(mixture.take(row), weight=weight)
    return split, Ancestry(child, parent, share)


def _existing(mixture: Mixture, bounds: Bounds) -> IntArray:
    """Return the rows of the targets of sufficient existence probability."""
    existence = mixture.existence
    kept = existence >= bounds.least_existence
    size = np.bincount(mixture.target, minlength=len(existence))
    if size[kept].sum() > bounds.most:
        order = np.argsort(-existence, kind="stable")
        most = order[np.cumsum(size[order]) <= bounds.most]
        affordable = np.zeros(len(existence), dtype=bool)
        affordable[most] = True
        kept &= affordable
    rows: IntArray = np.flatnonzero(kept[mixture.target])
    return rows
