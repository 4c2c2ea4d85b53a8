# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measures of a whole run: tracks, classes, and how continuously targets are seen.

What surveillance asks for beside the miss distance of one scan in `metrics`. An estimate belongs
to a target where `metrics.assign` pairs them, closer than the cutoff and each with one at most.
Scans are taken in one by one, and nothing is kept but what later ones need: a window of labelled
positions, and for each living target when it was last seen.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray, IntArray
from .limits import LONG_GAP_S
from .metrics import Ospa, ospa_of_distances

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


class LabelledPoints(NamedTuple):
    """One scan's positions with their labels.

    Parameters
    ----------
    label : int array of shape (T,)
        Of the track that each belongs to; 0 is none.
    position : array of shape (T, 2)
        Metres.
    """

    label: IntArray
    position: FloatArray


class TrackWindow:
    """The labelled positions of the newest scans, for an OSPA(2) distance that goes with time.

    Parameters
    ----------
    scans : int
        Length of the window, at least 1; with 1 its OSPA(2) is OSPA.
    """

    def __init__(self, scans: int) -> None:
        self._scans: deque[tuple[LabelledPoints, LabelledPoints]] = deque(maxlen=scans)

    def add(self, truth: LabelledPoints, estimate: LabelledPoints) -> None:
        """Take in the next scan; the oldest one leaves a full window."""
        self._scans.append((truth, estimate))

    def clear(self) -> None:
        """Forget every scan."""
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
    """Return how often a target of each class was taken for each class, in one scan.

    Parameters
    ----------
    pairs : tuple of two int arrays of shape (P,)
        Of `metrics.assign`, by position alone.
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
        estimates. Scans add up.
    """
    target, found = pairs
    missed, false = np.delete(truth, target), np.delete(estimate, found)
    true = np.concatenate([truth[target], missed, np.full(len(false), classes)])
    taken = np.concatenate([estimate[found], np.full(len(missed), classes), false])
    known = (true <= classes) & (taken <= classes)
    matrix = np.zeros((classes + 1, classes + 1), dtype=np.int64)
    np.add.at(matrix, (true[known], taken[known]), 1)
    return matrix


class Gap(NamedTuple):
    """A time in which a target had no estimate.

    Parameters
    ----------
    class_id : int
        The target's.
    duration_s : float
        From the estimate before to the one after; where there is none, from the target's first
        stamp or to its last.
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
class _Life:
    """What is known of a living target: when it was last seen, and what was missed since."""

    class_id: int
    seen_ns: int
    newest_ns: int
    missed: int = 0

    def gap(self, end_ns: int) -> Gap:
        return Gap(self.class_id, (end_ns - self.seen_ns) * 1e-9, self.missed)


class GapFinder:
    """Finds the gaps of targets, scan by scan; of a target that has gone it keeps nothing.

    References
    ----------
    The detection requirements of the evaluation tool COMPASS (github.com/hpuhr/COMPASS) also go by
    the time between updates, with the ends of the reference in the place of missing ones.
    """

    def __init__(self) -> None:
        self._lives: dict[int, _Life] = {}
        self._newest_ns: int | None = None

    def add(
        self, stamp_ns: int, track_id: IntArray, class_id: IntArray, found: BoolArray
    ) -> list[Gap]:
        """Take in the next scan; return the gaps that ended with it, or before it with a target.

        Parameters
        ----------
        stamp_ns : int
            An earlier one than that of the scan before ends all lives.
        track_id, class_id : int arrays of shape (T,)
            Of the targets that exist; no track_id twice.
        found : bool array of shape (T,)
            Whether each has an estimate.
        """
        back = self._newest_ns is not None and stamp_ns < self._newest_ns
        self._newest_ns = stamp_ns
        there = set() if back else set(track_id.tolist())
        gone = [self._lives.pop(label) for label in list(self._lives) if label not in there]
        ended = [life.gap(life.newest_ns) for life in gone if life.missed]
        targets = zip(track_id.tolist(), class_id.tolist(), found.tolist(), strict=True)
        for label, number, seen in targets:
            life = self._lives.setdefault(label, _Life(number, stamp_ns, stamp_ns))
            life.newest_ns = stamp_ns
            if not seen:
                life.missed += 1
                continue
            if life.missed:
                ended.append(life.gap(stamp_ns))
            life.seen_ns, life.missed = stamp_ns, 0
        return ended

    def under_way(self) -> list[Gap]:
        """Return the gaps that have not ended, as if all targets' lives had."""
        return [life.gap(life.newest_ns) for life in self._lives.values() if life.missed]
