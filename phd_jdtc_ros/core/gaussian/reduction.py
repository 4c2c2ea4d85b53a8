"""Reduction of each target's hypotheses: improbable ones are dropped, similar ones merged.

Each probable motion mode of a remaining hypothesis then becomes a hypothesis of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray
from ..compilation import SIZE, Bool1, BySize, Float3, Float4, Int1, compiled, inner
from ..snapshot import floats, integers
from .algebra.blocks import (
    add,
    add_mean,
    add_spread,
    divergence,
    factorise,
    square_distance,
    total_of,
)
from .algebra.kalman import floor_eigenvalues, is_positive
from .bounds import Bounds
from .mixture import Hypotheses, Mixture

# Share of `Bounds.most` that single-mode hypotheses may take. The rest is reserved for the next
# scan, in which every detection branches a hypothesis.
ROOM = 0.25
# A mode whose share equals the bound, but for rounding, is a hypothesis of its own: after a missed
# detection the shares often are the probabilities of the modes' changes.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Branched:
    """Hypotheses, and the predicted row from which each descends."""

    mixture: Mixture
    parent: IntArray  # Row of the predicted mixture, (H,); -1 for targets born at detections


@dataclass(frozen=True)
class Ancestry:
    """For each kept hypothesis, the hypotheses merged into it and their predicted rows."""

    # Row of the kept mixture, ascending, (E,).
    child: Annotated[IntArray, integers("E", 0, below="H")]
    # Row of the predicted mixture, (E,); -1 for targets born at detections.
    parent: Annotated[IntArray, integers("E", -1, below="P")]
    # Share of the child's weight, (E, R, C); sums to one over the rows of a child with positive
    # weight.
    share: Annotated[FloatArray, floats("EOC", 0.0, 1.0)]


class _Limits(NamedTuple):
    """Limits of the merging and splitting of hypotheses; see `Bounds`."""

    merge_distance: float
    least_mode: float
    most: float  # Largest number of hypotheses of one mode each


class _Reduced(NamedTuple):
    """The columns of the reduced `Mixture` and of its `Ancestry`."""

    row_label: Int1
    weight: Float3
    mean: Float3
    covariance: Float4
    snr: Float3
    child: Int1
    parent: Int1
    share: Float3


@inner
def _loss(
    distance: float,
    absorbed: tuple[FloatArray, FloatArray, FloatArray],
    centre: FloatArray,
    factor: FloatArray,
    scratch: tuple[FloatArray, FloatArray],
) -> float:
    """Return the mean divergence of an absorbed hypothesis's Gaussians from those of its modes.

    `absorbed` is its weight, means and covariances, and `centre` and `factor` are those of the
    absorbing hypothesis, mode by mode. The sum ends beyond `distance`; that of the means comes
    first, which is enough for most hypotheses.
    """
    (weight, mean, covariance), (own_factor, whitened) = absorbed, scratch
    mass, total = 0.0, 0.0
    for mode in range(len(weight)):
        mass += total_of(weight[mode])
    for mode in range(len(weight)):
        share = total_of(weight[mode])
        if share > 0.0 and total <= distance:
            square = square_distance(factor[mode], mean[mode], centre[mode], whitened)
            total += share / mass * square
    for mode in range(len(weight)):
        share = total_of(weight[mode])
        if share > 0.0 and total <= distance:
            total += share / mass * divergence(covariance[mode], factor[mode], own_factor)
    return total


@inner
def _find_clusters(
    distance: float, is_kept: BoolArray, mixture: Hypotheses
) -> tuple[IntArray, IntArray, IntArray]:
    """Cluster each target's hypotheses around its most probable ones; see `reduce_hypotheses`.

    Return the E hypotheses cluster by cluster, and the cluster of each, (E,), and the first one of
    each cluster. Only the targets with `is_kept`, (T,), have clusters. The rows of a target are
    adjacent, and so are those of a cluster, each by descending probability.
    """
    target, weight = mixture.target, mixture.weight
    mean, covariance = mixture.mean, mixture.covariance
    count, edges, clusters = len(target), 0, 0
    row_of, cluster = np.empty(count, np.int64), np.empty(count, np.int64)
    leader, merged = np.empty(count, np.int64), np.empty(count, np.bool_)
    factor, scratch = np.empty(covariance.shape[1:]), (np.empty((SIZE, SIZE)), np.empty(SIZE))
    begin = end = 0
    while begin < count:
        while end < count and target[end] == target[begin]:
            merged[end] = not is_kept[target[begin]]
            end += 1
        for leader_row in range(begin, end):
            if merged[leader_row]:
                continue
            leader[clusters] = leader_row
            for mode in range(weight.shape[1] if leader_row + 1 < end else 0):
                factorise(covariance[leader_row, mode], factor[mode])
            for row in range(leader_row, end):
                own = weight[row], mean[row], covariance[row]
                if merged[row] or (
                    row > leader_row
                    and _loss(distance, own, mean[leader_row], factor, scratch) > distance
                ):
                    continue
                merged[row], row_of[edges], cluster[edges] = True, row, clusters
                edges += 1
            clusters += 1
        begin = end
    return row_of[:edges], cluster[:edges], leader[:clusters]


@inner
def _write_merged_snr(
    rows: IntArray,
    weight: FloatArray,
    merged_weight: FloatArray,
    snr: FloatArray,
    merged: FloatArray,
) -> None:
    """Write the SNR distribution of a cluster, the mean of its hypotheses' by class.

    Each hypothesis counts in proportion to its weight of the class.
    """
    classes, cells = merged.shape
    for class_id in range(classes):
        class_weight = 0.0
        for mode in range(len(merged_weight)):
            class_weight += merged_weight[mode, class_id]
        for row in rows:
            row_weight = 0.0
            for mode in range(len(merged_weight)):
                row_weight += weight[row, mode, class_id]
            # A class without weight has the cells of all hypotheses, equally weighted.
            share = row_weight / class_weight if class_weight > 0.0 else 1.0 / len(rows)
            for cell in range(cells):
                merged[class_id, cell] += share * snr[row, class_id, cell]


@inner
def _merge_similar(
    distance: float, is_kept: BoolArray, mixture: Hypotheses, parent: IntArray
) -> _Reduced:
    """Merge the hypotheses of each cluster into one, mode by mode."""
    weight, mean, covariance, snr = mixture.weight, mixture.mean, mixture.covariance, mixture.snr
    row_of, child, leader = _find_clusters(distance, is_kept, mixture)
    (modes, classes), edges, count = weight.shape[1:], len(child), len(leader)
    new_weight, new_mean = np.zeros((count, modes, classes)), np.zeros((count, modes, SIZE))
    new_covariance = np.zeros((count, modes, SIZE, SIZE))
    new_snr = np.zeros((count, snr.shape[1], snr.shape[2]))
    share, mode_share = np.zeros((edges, modes, classes)), np.empty(edges)
    begin = end = 0
    for cluster in range(count):
        while end < edges and child[end] == cluster:
            for mode in range(modes):
                add(weight[row_of[end], mode], new_weight[cluster, mode])
            end += 1
        for mode in range(modes):
            centre, spread = new_mean[cluster, mode], new_covariance[cluster, mode]
            mode_weight = total_of(new_weight[cluster, mode])
            for edge in range(begin, end):
                row = row_of[edge]
                # A mode without weight keeps the Gaussians of all hypotheses, equally weighted.
                row_weight = total_of(weight[row, mode])
                mode_share[edge] = (
                    row_weight / mode_weight if mode_weight > 0.0 else 1.0 / (end - begin)
                )
                add_mean(mode_share[edge], mean[row, mode], centre)
                for class_id in range(classes):
                    if new_weight[cluster, mode, class_id] > 0.0:
                        class_share = (
                            weight[row, mode, class_id] / new_weight[cluster, mode, class_id]
                        )
                        share[edge, mode, class_id] = class_share
            for edge in range(begin, end):
                row = row_of[edge]
                add_spread(mode_share[edge], mean[row, mode], covariance[row, mode], centre, spread)
        _write_merged_snr(row_of[begin:end], weight, new_weight[cluster], snr, new_snr[cluster])
        begin = end
    merged = new_weight, new_mean, new_covariance, new_snr
    return _Reduced(mixture.row_label[leader], *merged, child, parent[row_of], share)


@inner
def _separate_modes(least: float, weight: FloatArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return the modes that become hypotheses of their own: the row and the mode of each.

    A mode is separated if its share of a hypothesis is at least `least`, or if it is the most
    probable one. The others stay with the most probable one. The third array, `stays_with`, (H, R),
    is the separated mode to which each mode belongs.
    """
    count, modes = weight.shape[:2]
    row_of, mode_of = np.empty(count * modes, np.int64), np.empty(count * modes, np.int64)
    stays_with, mode_weight, found = np.empty((count, modes), np.int64), np.empty(modes), 0
    bound = least * (1.0 - ROUNDING)
    for row in range(count):
        mass, main = 0.0, 0
        for mode in range(modes):
            mode_weight[mode] = total_of(weight[row, mode])
            mass += mode_weight[mode]
            main = mode if mode_weight[mode] > mode_weight[main] else main
        for mode in range(modes):
            is_separate = mode == main or (
                mode_weight[mode] > 0.0 and mode_weight[mode] >= bound * mass
            )
            stays_with[row, mode] = mode if is_separate else main
            row_of[found], mode_of[found] = row, mode
            found += is_separate
    return row_of[:found], mode_of[:found], stays_with


@inner
def _split(least: float, most: float, merged: _Reduced) -> _Reduced:
    """Split hypotheses into their separated modes; see `_separate_modes`.

    None is split if there would be no or more than `most` new ones.
    """
    row_label, weight, mean, covariance, snr, child, parent, share = merged
    row, mode, stays_with = _separate_modes(least, weight)
    if not len(weight) < len(row) <= most:
        return merged
    modes, classes = weight.shape[1:]
    start = np.zeros(len(weight) + 1, np.int64)
    for hypothesis in child:
        start[hypothesis + 1] += 1
    start = np.cumsum(start)
    edges = 0
    for hypothesis in row:
        edges += start[hypothesis + 1] - start[hypothesis]
    new_weight, new_share = np.zeros((len(row), modes, classes)), np.zeros((edges, modes, classes))
    new_child, new_parent = np.empty(edges, np.int64), np.empty(edges, np.int64)
    edge = 0
    for new_row in range(len(row)):
        old_row, begin = row[new_row], edge
        for edge_before in range(start[old_row], start[old_row + 1]):
            new_child[edge], new_parent[edge] = new_row, parent[edge_before]
            edge += 1
        for other_mode in range(modes):
            if stays_with[old_row, other_mode] != mode[new_row]:
                continue
            for class_id in range(classes):
                new_weight[new_row, other_mode, class_id] = weight[old_row, other_mode, class_id]
                for offset in range(edge - begin):
                    new_share[begin + offset, other_mode, class_id] = share[
                        start[old_row] + offset, other_mode, class_id
                    ]
    split = row_label[row], new_weight, mean[row], covariance[row], snr[row]
    return _Reduced(*split, new_child, new_parent, new_share)


@BySize
@compiled
def _reduce(
    limits: _Limits, is_kept: Bool1, mixture: Hypotheses, parent: Int1
) -> tuple[_Reduced, int]:
    """Return the columns of reduced hypotheses, and how many merged covariances are not sound."""
    merged = _merge_similar(limits.merge_distance, is_kept, mixture, parent)
    unsound, factor = 0, np.empty((SIZE, SIZE))
    for modes in merged.covariance:
        for spread in modes:
            unsound += not is_positive(spread, factor)
    return _split(limits.least_mode, limits.most, merged), unsound


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
    does, and so on. Each motion mode's Gaussian is moment-matched to the Gaussians it absorbs. The
    distance is therefore twice the Kullback-Leibler divergence of the absorbed from the absorbing
    one, mode by mode, so that a narrow Gaussian, as that of a target which has flown straight on
    unseen, does not become one with a wide one of the same mean. Hypotheses that differ only in the
    shares of their modes and classes are merged without loss: their moments over all modes, which
    differ most where a class is at rest, would keep them apart.

    A merge of hypotheses of different motion modes only after the update is the second-order
    generalised pseudo-Bayesian filter; hypotheses that are kept apart make this more exact.

    References
    ----------
    Chang and Athans, "State estimation for discrete systems with switching parameters", IEEE
    Transactions on Aerospace and Electronic Systems 14(3), 1978.
    Salmond, "Mixture reduction algorithms for target tracking in clutter", Proceedings of SPIE
    1305, 1990, the clustering algorithm.
    Runnalls, "Kullback-Leibler approach to Gaussian mixture reduction", IEEE Transactions on
    Aerospace and Electronic Systems 43(3), 2007, the divergence as a measure of what merging loses.
    """
    mixture = branched.mixture
    # If the number of hypotheses would leave too little room for the next scan, none is split:
    # modes are mixed, as with a `least_mode` of 1.
    limits = _Limits(bounds.merge_distance, bounds.least_mode, ROOM * bounds.most)
    is_kept = _keep_targets(mixture, bounds)
    reduce = _reduce[mixture.mean.shape[2]]
    columns, floored = reduce(limits, is_kept, mixture.hypotheses, branched.parent)
    row_label, weight, mean, covariance, snr, child, parent, share = columns
    if floored:
        covariance, _ = floor_eigenvalues(covariance)
    reduced = mixture.changed(
        row_label=row_label, weight=weight, mean=mean, covariance=covariance, snr=snr
    )
    return reduced, Ancestry(child, parent, share), floored


def _keep_targets(mixture: Mixture, bounds: Bounds) -> BoolArray:
    """Return whether each target's existence probability is sufficient, (T,)."""
    existence = mixture.sums.existence
    is_kept: BoolArray = existence >= bounds.least_existence
    if len(mixture) > bounds.most:
        size = np.bincount(mixture.sums.target, minlength=len(existence))
        order = np.argsort(-existence, kind="stable")
        is_kept[order] &= (np.cumsum(size[order]) <= bounds.most) | (
            size[is_kept].sum() <= bounds.most
        )
    return is_kept
