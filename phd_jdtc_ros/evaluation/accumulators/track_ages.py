"""Ages of tracks: the number of scans since each was first reported."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phd_jdtc_ros.core.arrays import IntArray

# Marks an unknown age.
NO_AGE = -1
# A track number that is not reported for this many scans is removed.
FORGOTTEN = 10


class TrackAges:
    """Counts the scans since each track number was first reported, scan by scan.

    A number that is not reported for `FORGOTTEN` scans is removed, and counts as new if it returns.
    """

    def __init__(self) -> None:
        self._scan = 0
        self._newest_ns: int | None = None
        self._first: dict[int, int] = {}
        self._last: dict[int, int] = {}

    def add(self, stamp_ns: int, track_id: IntArray | None, size: int) -> IntArray:
        """Add the next scan; return the age of each of its estimates.

        A new run begins if the stamp is earlier than the previous scan's. The age is `NO_AGE` for
        unlabelled estimates, of track_id 0; `track_id` is None if all are unlabelled.
        """
        if self._newest_ns is not None and stamp_ns < self._newest_ns:
            self._first, self._last = {}, {}
        self._newest_ns = stamp_ns
        self._scan += 1
        labels: Sequence[int] = [0] * size if track_id is None else track_id.tolist()
        known = [label for label in labels if label]
        for label in known:
            self._first.setdefault(label, self._scan)
            self._last[label] = self._scan
        for label in [n for n, last in self._last.items() if self._scan - last > FORGOTTEN]:
            del self._first[label], self._last[label]
        ages = [self._scan - self._first[label] if label else NO_AGE for label in labels]
        return np.array(ages, dtype=np.int64)
