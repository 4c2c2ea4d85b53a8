"""Measures of a whole run: tracks, classes, and how continuously targets are seen.

What surveillance asks for beside the miss distance of one scan in `metrics`. An estimate belongs
to a target where `metrics.assign` pairs them, closer than the cutoff and each with one at most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .metrics import Ospa, assign, ospa_of_distances
from .types import FloatArray, IntArray

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class TrackSet:
    """Labelled positions of K scans, a row for each of N tracks.

    Parameters
    ----------
    track_id : int array of shape (N,)
    position : array of shape (N, K, 2)
        Metres; 0 where the track does not exist.
    exists : bool array of shape (N, K)
    """

    track_id: IntArray
    position: FloatArray
    exists: BoolArray

    def __len__(self) -> int:
        return len(self.exists)

    def window(self, first: int, last: int) -> TrackSet:
        """Return the tracks that exist in the scans from `first` up to `last`, excluded."""
        exists = self.exists[:, first:last]
        some = exists.any(axis=1)
        return TrackSet(self.track_id[some], self.position[some, first:last], exists[some])


def track_set(ids: Sequence[IntArray], positions: Sequence[FloatArray]) -> TrackSet:
    """Gather labelled positions into tracks.

    Parameters
    ----------
    ids : sequence of K int arrays of shape (T,)
        A scan's labels. Every position with the label 0 (unlabelled) is a track of its own.
    positions : sequence of K arrays of shape (T, 2)
        Metres.

    Raises
    ------
    ValueError
        If a scan has a label twice.
    """
    rows: dict[int | tuple[int, int], int] = {}
    entries = []
    for scan, (labels, points) in enumerate(zip(ids, positions, strict=True)):
        named = labels[labels != 0]
        if len(np.unique(named)) < len(named):
            raise ValueError(f"ids: scan {scan} has {labels.tolist()}, expected no label twice")
        for index, (label, point) in enumerate(zip(labels.tolist(), points, strict=True)):
            row = rows.setdefault(label if label else (scan, index), len(rows))
            entries.append((row, scan, point))
    position = np.zeros((len(rows), len(ids), 2))
    exists = np.zeros((len(rows), len(ids)), dtype=np.bool_)
    for row, scan, point in entries:
        position[row, scan], exists[row, scan] = point, True
    labels = np.array([key if isinstance(key, int) else 0 for key in rows], dtype=np.int64)
    return TrackSet(labels, position, exists)


def track_distances(a: TrackSet, b: TrackSet, cutoff: float, order: float) -> FloatArray:
    """Return the time-averaged distance of every two tracks, metres.

    Parameters
    ----------
    a, b : TrackSet
        N and M tracks over the same scans.
    cutoff : float
        c, metres: the distance where one of the two does not exist, and the greatest.
    order : float
        q, at least 1, of the mean over the scans in which either exists.

    Returns
    -------
    array of shape (N, M)
        0 for two tracks that exist in no scan.
    """
    one, other = a.exists[:, None, :], b.exists[None, :, :]
    apart = np.linalg.norm(a.position[:, None] - b.position[None, :], axis=-1)
    distance = np.where(one & other, np.minimum(apart, cutoff), cutoff)
    either = one | other
    total = (distance**order * either).sum(axis=-1)
    mean: FloatArray = (total / np.maximum(either.sum(axis=-1), 1)) ** (1.0 / order)
    return mean


def ospa2(
    truth: TrackSet, estimate: TrackSet, cutoff: float, order: float, track_order: float = 1.0
) -> Ospa:
    """Return the OSPA(2) distance of two sets of tracks over all their scans.

    Tracks that are short, broken or swapped are far from every target's track, so that labels
    count as well as positions.

    Parameters
    ----------
    truth, estimate : TrackSet
        Over the same scans.
    cutoff : float
        c, metres.
    order : float
        p, of the assignment of tracks.
    track_order : float
        q, of the distance between two tracks.

    References
    ----------
    Beard, Vo and Vo, "OSPA(2): Using the OSPA metric to evaluate multi-target tracking
    performance", International Conference on Control, Automation and Information Sciences, 2017;
    Beard, Vo and Vo, "A solution for large-scale multi-object tracking", IEEE Transactions on
    Signal Processing 68, 2020, with the order q and windows.
    """
    return ospa_of_distances(track_distances(truth, estimate, cutoff, track_order), cutoff, order)


def ospa2_over_time(
    truth: TrackSet,
    estimate: TrackSet,
    window: int,
    cutoff: float,
    order: float,
    track_order: float = 1.0,
) -> list[Ospa]:
    """Return the OSPA(2) distance of every scan's window: that scan and those just before it.

    Parameters
    ----------
    truth, estimate : TrackSet
        Over the same K scans.
    window : int
        Length in scans, at least 1; the windows of the first scans are shorter. With 1 it is
        OSPA.
    cutoff, order, track_order : float
        Of `ospa2`.
    """
    ends = range(1, truth.exists.shape[1] + 1)
    spans = [(max(0, end - window), end) for end in ends]
    return [
        ospa2(truth.window(*span), estimate.window(*span), cutoff, order, track_order)
        for span in spans
    ]


def confusion_matrix(
    truth: FloatArray,
    truth_class: IntArray,
    estimate: FloatArray,
    estimate_class: IntArray,
    cutoff: float,
    classes: int,
) -> IntArray:
    """Return how often a target of each class was taken for each class, in one scan.

    Parameters
    ----------
    truth : array of shape (T, 2)
    truth_class : int array of shape (T,)
    estimate : array of shape (E, 2)
    estimate_class : int array of shape (E,)
    cutoff : float
        Metres.
    classes : int
        C.

    Returns
    -------
    int array of shape (C + 1, C + 1)
        [true class, estimated class], of pairs assigned by position alone. The last column counts
        missed targets, the last row false estimates. Scans add up.
    """
    target, found = assign(truth, estimate, cutoff)
    missed = np.delete(truth_class, target)
    false = np.delete(estimate_class, found)
    matrix = np.zeros((classes + 1, classes + 1), dtype=np.int64)
    np.add.at(matrix, (truth_class[target], estimate_class[found]), 1)
    np.add.at(matrix, (missed, np.full(len(missed), classes)), 1)
    np.add.at(matrix, (np.full(len(false), classes), false), 1)
    return matrix


def position_errors(truth: FloatArray, estimate: FloatArray, cutoff: float) -> FloatArray:
    """Return the distances of a scan's assigned pairs in metres, shape (pairs,).

    Parameters
    ----------
    truth : array of shape (T, 2)
    estimate : array of shape (E, 2)
    cutoff : float
        Metres.
    """
    target, found = assign(truth, estimate, cutoff)
    distance: FloatArray = np.linalg.norm(truth[target] - estimate[found], axis=1)
    return distance


def position_rms(
    truth: Sequence[FloatArray], estimate: Sequence[FloatArray], cutoff: float
) -> float | None:
    """Return the root mean square distance of a run's assigned pairs, metres.

    Parameters
    ----------
    truth, estimate : sequences of arrays of shape (T, 2) and (E, 2), one a scan
    cutoff : float
        Metres.

    Returns
    -------
    float or None
        None without a pair.
    """
    scans = zip(truth, estimate, strict=True)
    errors = np.concatenate([np.zeros(0), *(position_errors(t, e, cutoff) for t, e in scans)])
    return float(np.sqrt(np.mean(errors**2))) if len(errors) else None


def detected(truth: FloatArray, estimate: FloatArray, cutoff: float) -> BoolArray:
    """Return which targets of a scan have an estimate, shape (T,).

    Its mean is the scan's probability of position detection.

    Parameters
    ----------
    truth : array of shape (T, 2)
    estimate : array of shape (E, 2)
    cutoff : float
        Metres.
    """
    found = np.zeros(len(truth), dtype=np.bool_)
    found[assign(truth, estimate, cutoff)[0]] = True
    return found


def detection_history(
    ids: Sequence[IntArray],
    truth: Sequence[FloatArray],
    estimate: Sequence[FloatArray],
    cutoff: float,
) -> dict[int, BoolArray]:
    """Return for every target whether it has an estimate, scan by scan of its life.

    Parameters
    ----------
    ids : sequence of int arrays of shape (T,), one a scan
        Labels of the targets.
    truth, estimate : sequences of arrays of shape (T, 2) and (E, 2), one a scan
    cutoff : float
        Metres.
    """
    history: dict[int, list[bool]] = {}
    for labels, targets, points in zip(ids, truth, estimate, strict=True):
        for label, found in zip(labels.tolist(), detected(targets, points, cutoff), strict=True):
            history.setdefault(label, []).append(bool(found))
    return {label: np.array(found, dtype=np.bool_) for label, found in history.items()}


def gap_lengths(found: BoolArray) -> IntArray:
    """Return the lengths of the runs of False in the order of time, scans.

    Parameters
    ----------
    found : bool array of shape (K,)
        Of `detection_history`. A run at either end counts as well.
    """
    padded = np.concatenate([[True], found, [True]]).astype(np.int8)
    change = np.diff(padded)
    lengths: IntArray = (np.flatnonzero(change == 1) - np.flatnonzero(change == -1)).astype(
        np.int64
    )
    return lengths


@dataclass(frozen=True)
class Gaps:
    """A target's gaps.

    Parameters
    ----------
    longest_s : float
        Seconds; 0 without a gap.
    long_share : float
        Share of its gaps that last longer than the threshold; 0 without a gap.
    """

    longest_s: float
    long_share: float


def gaps(found: BoolArray, interval_s: float, threshold_s: float) -> Gaps:
    """Return a target's longest gap and how many of its gaps are long.

    Parameters
    ----------
    found : bool array of shape (K,)
        Of `detection_history`.
    interval_s : float
        Between scans. A gap of n scans lasts n intervals; between the estimates before and after
        it there is one more.
    threshold_s : float
        Above it a gap is long.

    References
    ----------
    "EUROCONTROL specification for ATM surveillance system performance", EUROCONTROL-SPEC-147,
    counts the positions missed in long gaps in the same spirit.
    """
    duration = gap_lengths(found) * interval_s
    if not len(duration):
        return Gaps(0.0, 0.0)
    return Gaps(float(duration.max()), float(np.mean(duration > threshold_s)))
