"""Tells the tracks of a tracker apart that began again with number 1.

A tracker numbers its tracks from 1 after a cold start, a reset or a flush, while its stamps go on.
Its earlier tracks with these numbers were other targets. Nothing in the estimates says that it
began again, but its tracks do not go on then, and numbers come that were used before. That is also
what it looks like where all tracks are lost for a while and come back, which are then taken for
others, as the joint picture does anyway.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from phd_jdtc_ros.core.types import Estimates

from .ownership import REACH
from .synchroniser import Gathered

# Track numbers of messages are less than this.
SERIES = 2**32
# For so long the beginnings of series are kept, seconds.
KEPT_S = 600.0
# After so long without a word of it, a tracker's tracks may be anywhere, seconds.
SILENT_S = 60.0


@dataclass
class TrackSeries:
    """The series of one tracker's track numbers."""

    _count: int = field(init=False, default=0)
    # Stamps after which series began, and their numbers, ascending.
    _begun: list[tuple[int, int]] = field(init=False, default_factory=list)
    _highest: int = field(init=False, default=0)
    _there: Estimates | None = field(init=False, default=None)
    _last_ns: int = field(init=False, default=0)

    def take(self, stamp_ns: int, found: Estimates | None) -> None:
        """Take in the filtered estimates of a stamp, None where there are none of it.

        Stamps must increase.
        """
        before = self._there
        if found is None:
            if before is not None and stamp_ns - before.stamp_ns > SILENT_S * 1e9:
                self._there = None
            return
        self._there = found
        if not len(found):
            return
        goes_on = before is not None and _goes_on(before, found)
        if not goes_on and int(found.track_id.min()) <= self._highest:
            self._count += 1
            # All that comes after the last track of the earlier series is of this one: the smoother
            # knows a target before the filter does.
            self._begun.append((self._last_ns, self._count))
            self._highest = 0
        self._highest = max(self._highest, int(found.track_id.max()))
        self._last_ns = stamp_ns
        oldest_ns = stamp_ns - round(KEPT_S * 1e9)
        self._begun = [entry for entry in self._begun if entry[0] >= oldest_ns]

    def apart(self, found: Estimates) -> Estimates:
        """Return estimates with track numbers that no track of another series has."""
        if not self._count:
            return found
        series = self._begun[0][1] - 1 if self._begun else self._count
        for after_ns, number in self._begun:
            series = number if found.stamp_ns > after_ns else series
        return replace(found, track_id=found.track_id + SERIES * series)


class SeriesOfAll:
    """The series of several trackers.

    Parameters
    ----------
    trackers : int
        How many there are.
    """

    def __init__(self, trackers: int) -> None:
        self._each = [TrackSeries() for _ in range(trackers)]

    def take(self, stamp_ns: int, gathered: Gathered) -> Gathered:
        """Take in the filtered estimates of a stamp, and return them with numbers told apart."""
        for tracker, series in enumerate(self._each):
            series.take(stamp_ns, gathered.get(tracker))
        return self.apart(gathered)

    def apart(self, gathered: Gathered) -> Gathered:
        """Return estimates of a stamp with numbers told apart."""
        return {tracker: self._each[tracker].apart(own) for tracker, own in gathered.items()}


def _goes_on(before: Estimates, found: Estimates) -> bool:
    """Return whether most tracks that have a number of the stamp before are near where it was."""
    _, old, new = np.intersect1d(before.track_id, found.track_id, return_indices=True)
    moved = np.hypot(*(found.position[new] - before.position[old]).T)
    speed = np.maximum(np.hypot(*before.velocity[old].T), np.hypot(*found.velocity[new].T))
    flown = speed * (found.stamp_ns - before.stamp_ns) * 1e-9
    near = np.count_nonzero(moved <= REACH + flown)
    # Where the same targets get numbers again, one of them may get its earlier one by chance.
    return bool(2 * near > len(moved))
