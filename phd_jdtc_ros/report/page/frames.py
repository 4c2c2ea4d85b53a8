"""The positions of the page's slider."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import IntArray
from phd_jdtc_ros.core.types import SOURCES

from ..record import Record

# Largest number of frames of a page, which shows every second or third set of a longer run.
MOST = 3600


@dataclass(frozen=True)
class Frames:
    """The stamps that the page can show, ascending."""

    stamp_ns: IntArray  # (F,)

    @staticmethod
    def of(record: Record) -> Frames:
        """Return the stamps of the estimates; without any, of detections and truth."""
        estimates = [entry.stamp_ns for source in SOURCES for entry in record.of_source(source)]
        others = [entry.stamp_ns for part in (record.plots, record.truth) for entry in part]
        stamps = np.unique(np.array(estimates or others, dtype=np.int64))
        return Frames(stamps[:: -(-len(stamps) // MOST) or 1])

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def at(self, stamp_ns: Sequence[int]) -> IntArray:
        """Return the frame of each stamp: the first frame not before it, or else the last."""
        found = np.searchsorted(self.stamp_ns, np.array(stamp_ns, dtype=np.int64))
        within: IntArray = np.minimum(found, max(len(self) - 1, 0)).astype(np.int64)
        return within

    def first_shown(self, record: Record) -> int:
        """Return the last of the frames with the most targets, counting true ones if known."""
        estimates = max((record.of_source(source) for source in SOURCES), key=len)
        counted = record.truth or estimates
        most = np.zeros(len(self), dtype=np.int64)
        np.maximum.at(
            most, self.at([e.stamp_ns for e in counted]), [len(e.class_id) for e in counted]
        )
        return int(np.flatnonzero(most == most.max())[-1]) if len(most) else 0
