"""OSPA(2): the distance between estimated and true trajectories over the newest scans."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray

from ..accumulator import TRACKS, LabelAccumulator, Metric, Values, if_any
from ..comparison import LabelledPoints, PairedScan
from ..metrics import Ospa, ospa_of_distances
from ..totals import ratio

# Scans of an OSPA(2) window: one minute of a radar with a turn of 6 s.
OSPA2_WINDOW = 10


@dataclass(frozen=True)
class TrackSet:
    """Labelled positions of N tracks in K scans."""

    track_id: IntArray  # (N,)
    position: FloatArray  # (N, K, 2). Metres; 0 where the track does not exist.
    exists: BoolArray  # (N, K)

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

    Short, broken and swapped tracks are far from every target's track, so that the distance
    penalises wrong labels as well as wrong positions.

    Parameters
    ----------
    truth, estimate : TrackSet
        Tracks over the same scans.
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


class Ospa2Accumulator(LabelAccumulator):
    """The OSPA(2) distance over the window."""

    names = ("ospa2",)
    metrics = (
        Metric(
            "ospa2",
            "OSPA(2)",
            "m",
            ".1f",
            if_any("n_est", lambda run: ratio(run.sum("ospa2"), run.scans)),
            "Mean over the scans of the OSPA distance between estimated and true trajectories in "
            f"the last {OSPA2_WINDOW} scans. The distance of two trajectories is the mean over the "
            "scans in which at least one exists, with c if only one does, so that short, broken "
            "and swapped tracks count. It needs track ids of all targets and estimates.",
            TRACKS,
        ),
    )

    def __init__(self, cutoff: float, order: float) -> None:
        super().__init__(cutoff, order)
        self._window = TrackWindow(OSPA2_WINDOW)

    def clear(self) -> None:
        """Remove all scans."""
        self._window.clear()

    def add(self, truth: LabelledPoints, estimate: LabelledPoints, scan: PairedScan) -> Values:
        """Return the distance over the newest scans."""
        self._window.add(truth, estimate)
        return (self._window.ospa2(self.cutoff, self.order).distance,)
