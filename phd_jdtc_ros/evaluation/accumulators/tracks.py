"""OSPA(2): the distance between estimated and true trajectories over the newest scans."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray

from ..accumulator import TRACKS, LabelAccumulator, Metric, Values, if_any, ratio
from ..comparison import LabelledPoints, PairedScan
from ..metrics import ospa_of_distances

# Scans of an OSPA(2) window: one minute of a radar with a revolution of 6 s.
OSPA2_WINDOW = 10


def tracks_of(scans: Iterable[LabelledPoints]) -> FloatArray:
    """Return the positions of N tracks in K scans, (N, K, 2), NaN where a track does not exist.

    The labels of a scan are distinct.
    """
    labels, positions = zip(*scans, strict=True)
    numbers, row = np.unique(np.concatenate(labels), return_inverse=True)
    tracks = np.full((len(numbers), len(labels), 2), np.nan)
    scan = np.repeat(np.arange(len(labels)), [len(label) for label in labels])
    tracks[row, scan] = np.concatenate(positions)
    return tracks


def track_distances(a: FloatArray, b: FloatArray, cutoff: float) -> FloatArray:
    """Return the time-averaged distance of each of N tracks to each of M others, metres, (N, M).

    Short, broken and swapped tracks are far from every target's track, so that an OSPA distance of
    these base distances, OSPA(2), penalises wrong labels as well as wrong positions.

    Both arrays are results of `tracks_of` over the same scans. The mean is over the scans in which
    at least one track exists; it is 0 for two tracks that exist in no scan. The cutoff c, metres,
    is the upper bound of the distance, and its value where only one track exists.

    References
    ----------
    Beard, Vo and Vo, "OSPA(2): Using the OSPA metric to evaluate multi-target tracking
    performance", International Conference on Control, Automation and Information Sciences, 2017;
    Beard, Vo and Vo, "A solution for large-scale multi-object tracking", IEEE Transactions on
    Signal Processing 68, 2020, with the order q, here 1, and windows.
    """
    distance = np.linalg.norm(a[:, None] - b[None, :], axis=-1)
    distance = np.where(np.isnan(distance), cutoff, np.minimum(distance, cutoff))
    either = ~np.isnan(a[:, None, :, 0]) | ~np.isnan(b[None, :, :, 0])
    mean: FloatArray = (distance * either).sum(axis=-1) / np.maximum(either.sum(axis=-1), 1)
    return mean


class Ospa2Accumulator(LabelAccumulator):
    """The OSPA(2) distance over the window; with one scan it is the OSPA distance."""

    names = ("ospa2",)
    metrics = (
        Metric(
            key="ospa2",
            heading="OSPA(2)",
            unit="m",
            form=".1f",
            of_run=if_any("n_est", lambda run: ratio(run.sum("ospa2"), run.scans)),
            definition=(
                "Mean over the scans of the OSPA distance between estimated and true trajectories "
                f"in the last {OSPA2_WINDOW} scans. The distance of two trajectories is the mean "
                "over the scans in which at least one exists, with c if only one does, so that "
                "short, broken and swapped tracks count. It needs track ids of all targets and "
                "estimates."
            ),
            group=TRACKS,
        ),
    )

    def __init__(self, cutoff: float, order: float, window: int = OSPA2_WINDOW) -> None:
        super().__init__(cutoff, order)
        self._scans: deque[tuple[LabelledPoints, LabelledPoints]] = deque(maxlen=window)

    def clear(self) -> None:
        """Remove all scans."""
        self._scans.clear()

    def add(self, truth: LabelledPoints, estimate: LabelledPoints, scan: PairedScan) -> Values:
        """Return the distance over the newest scans."""
        self._scans.append((truth, estimate))
        true, estimated = map(tracks_of, zip(*self._scans, strict=True))
        distance = track_distances(true, estimated, self.cutoff)
        return (ospa_of_distances(distance, self.cutoff, self.order).distance,)
