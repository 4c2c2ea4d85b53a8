"""Surveillance measures of a whole run: OSPA(2) of tracks, confusion of classes, and gaps.

An estimate belongs to a target if `metrics.assign` pairs them: closer than the cutoff, and each
with at most one other. Scans are added in order. Only a window of labelled positions and the last
paired stamp of each existing target are kept.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.core.arrays import FloatArray, IntArray

from .limits import LONG_GAP_S
from .metrics import Ospa, ospa_of_distances

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class TrackSet:
    """Labelled positions of N tracks in K scans.

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


def track_set(ids: Sequence[IntArray], positions: Sequence[FloatArray]) -> TrackSet:
    """Return labelled positions as tracks.

    Parameters
    ----------
    ids : sequence of K int arrays of shape (T,)
        Labels per scan. Every unlabelled position (label 0) is a track of its own.
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
    """Return the time-averaged distance of each track of `a` to each track of `b`, metres.

    Parameters
    ----------
    a, b : TrackSet
        N and M tracks over the same scans.
    cutoff : float
        c, metres: the upper bound of the distance, and its value where only one track exists.
    order : float
        q, at least 1, of the mean over the scans in which at least one track exists.

    Returns
    -------
    array of shape (N, M)
        0 for two tracks that exist in no scan.
    """
    a_exists, b_exists = a.exists[:, None, :], b.exists[None, :, :]
    distance = np.linalg.norm(a.position[:, None] - b.position[None, :], axis=-1)
    distance = np.where(a_exists & b_exists, np.minimum(distance, cutoff), cutoff)
    either = a_exists | b_exists
    total = (distance**order * either).sum(axis=-1)
    mean: FloatArray = (total / np.maximum(either.sum(axis=-1), 1)) ** (1.0 / order)
    return mean


def ospa2(
    truth: TrackSet, estimate: TrackSet, cutoff: float, order: float, track_order: float = 1.0
) -> Ospa:
    """Return the OSPA(2) distance of two sets of tracks over all their scans.

    Short, broken and swapped tracks are far from every target's track, so that labels count as
    well as positions.

    Parameters
    ----------
    truth, estimate : TrackSet
        Over the same scans.
    cutoff : float
        c, metres.
    order : float
        p: order of the assignment of tracks.
    track_order : float
        q: order of the distance between two tracks.

    References
    ----------
    Beard, Vo and Vo, "OSPA(2): Using the OSPA metric to evaluate multi-target tracking
    performance", International Conference on Control, Automation and Information Sciences, 2017;
    Beard, Vo and Vo, "A solution for large-scale multi-object tracking", IEEE Transactions on
    Signal Processing 68, 2020, with the order q and windows.
    """
    return ospa_of_distances(track_distances(truth, estimate, cutoff, track_order), cutoff, order)


class LabelledPoints(NamedTuple):
    """The positions of one scan with their labels.

    Parameters
    ----------
    label : int array of shape (T,)
        Label of each position's track; 0 for none.
    position : array of shape (T, 2)
        Metres.
    """

    label: IntArray
    position: FloatArray


class TrackWindow:
    """The labelled positions of the newest scans, for an OSPA(2) distance over a sliding window.

    Parameters
    ----------
    scans : int
        Length of the window, at least 1. With 1 the OSPA(2) distance is the OSPA distance.
    """

    def __init__(self, scans: int) -> None:
        self._scans: deque[tuple[LabelledPoints, LabelledPoints]] = deque(maxlen=scans)

    def add(self, truth: LabelledPoints, estimate: LabelledPoints) -> None:
        """Add the next scan; if the window is full, the oldest one is removed."""
        self._scans.append((truth, estimate))

    def clear(self) -> None:
        """Remove all scans."""
        self._scans.clear()

    def ospa2(self, cutoff: float, order: float, track_order: float = 1.0) -> Ospa:
        """Return the distance over the window, see `ospa2`.

        Raises
        ------
        ValueError
            If a scan has a label twice.
        """
        truth, estimate = (
            track_set([points.label for points in side], [points.position for points in side])
            for side in zip(*self._scans, strict=True)
        )
        return ospa2(truth, estimate, cutoff, order, track_order)


def confusion_matrix(
    pairs: tuple[IntArray, IntArray], truth: IntArray, estimate: IntArray, classes: int
) -> IntArray:
    """Return the number of targets of one scan by true and by estimated class.

    Parameters
    ----------
    pairs : tuple of two int arrays of shape (P,)
        As of `metrics.assign`, by position alone.
    truth : int array of shape (T,)
        Classes of the targets.
    estimate : int array of shape (E,)
        Classes of the estimates.
    classes : int
        C; targets and estimates of other classes than 0 to C - 1 are left out.

    Returns
    -------
    int array of shape (C + 1, C + 1)
        [true class, estimated class]. The last column counts missed targets, the last row false
        estimates. The matrix of a run is the sum over its scans.
    """
    row, column = pairs
    missed, false = np.delete(truth, row), np.delete(estimate, column)
    true = np.concatenate([truth[row], missed, np.full(len(false), classes)])
    estimated = np.concatenate([estimate[column], np.full(len(missed), classes), false])
    counted = (true <= classes) & (estimated <= classes)
    matrix = np.zeros((classes + 1, classes + 1), dtype=np.int64)
    np.add.at(matrix, (true[counted], estimated[counted]), 1)
    return matrix


class Gap(NamedTuple):
    """A time in which a target had no estimate.

    Parameters
    ----------
    class_id : int
        Class of the target.
    duration_s : float
        From the previous estimate, or else the target's first stamp, to the next estimate, or else
        its last stamp.
    missed : int
        Scans without an estimate.
    """

    class_id: int
    duration_s: float
    missed: int

    @property
    def is_long(self) -> bool:
        """Whether it lasts longer than `LONG_GAP_S`."""
        return self.duration_s > LONG_GAP_S


@dataclass
class _Continuity:
    """When an existing target was last paired with an estimate, and the missed scans since."""

    class_id: int
    paired_ns: int
    newest_ns: int
    missed: int = 0

    def gap(self, end_ns: int) -> Gap:
        return Gap(self.class_id, (end_ns - self.paired_ns) * 1e-9, self.missed)


class GapFinder:
    """Finds the gaps of targets, scan by scan; nothing is kept of targets that no longer exist.

    References
    ----------
    The detection requirements of the evaluation tool COMPASS (github.com/hpuhr/COMPASS) are also
    based on the time between updates, with the ends of the reference in place of missing updates.
    """

    def __init__(self) -> None:
        self._targets: dict[int, _Continuity] = {}
        self._newest_ns: int | None = None

    def add(
        self, stamp_ns: int, track_id: IntArray, class_id: IntArray, found: BoolArray
    ) -> list[Gap]:
        """Add the next scan; return the gaps that ended with an estimate or with their target.

        Parameters
        ----------
        stamp_ns : int
            If it is earlier than that of the previous scan, all targets end.
        track_id, class_id : int arrays of shape (T,)
            Of the targets that exist; every track_id is distinct.
        found : bool array of shape (T,)
            Whether each target is paired with an estimate.
        """
        back = self._newest_ns is not None and stamp_ns < self._newest_ns
        self._newest_ns = stamp_ns
        existing = set() if back else set(track_id.tolist())
        gone = [self._targets.pop(label) for label in list(self._targets) if label not in existing]
        ended = [target.gap(target.newest_ns) for target in gone if target.missed]
        rows = zip(track_id.tolist(), class_id.tolist(), found.tolist(), strict=True)
        for label, number, paired in rows:
            target = self._targets.setdefault(label, _Continuity(number, stamp_ns, stamp_ns))
            target.newest_ns = stamp_ns
            if not paired:
                target.missed += 1
                continue
            if target.missed:
                ended.append(target.gap(stamp_ns))
            target.paired_ns, target.missed = stamp_ns, 0
        return ended

    def under_way(self) -> list[Gap]:
        """Return the open gaps, as if all targets ended with the newest scan."""
        return [target.gap(target.newest_ns) for target in self._targets.values() if target.missed]
