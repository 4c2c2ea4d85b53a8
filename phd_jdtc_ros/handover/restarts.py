"""Detects that a tracker restarted its track numbers, and keeps the series of numbers apart.

After a cold start, a reset or a flush a tracker numbers its tracks from 1 again, while its stamps
continue. Earlier tracks with these numbers were other targets. The estimates do not announce a
restart, but the tracks do not continue, and numbers reappear that were used before. The same
happens when all tracks are lost for a while and return; they then count as new tracks.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from phd_jdtc_ros.core.types import Estimates

from .ownership import REACH

# Track numbers of messages are less than this.
SERIES = 2**32
# Time for which the beginning of a series is remembered, seconds.
KEPT_S = 600.0
# After this silence the tracks of a tracker cannot be matched with the earlier ones, seconds.
SILENT_S = 60.0


class TrackSeries:
    """The series of one tracker's track numbers."""

    def __init__(self) -> None:
        self._count = 0
        # Stamp after which each recent series began, ascending, and the series' number.
        self._series: list[tuple[int, int]] = []
        self._highest = 0
        self._newest: Estimates | None = None
        self._last_ns = 0

    def take(self, stamp_ns: int, found: Estimates | None) -> None:
        """Add the filtered estimates of a stamp, None if the tracker has none; stamps increase."""
        before = self._newest
        if found is None:
            if before is not None and stamp_ns - before.stamp_ns > SILENT_S * 1e9:
                self._newest = None
            return
        self._newest = found
        if not len(found):
            return
        continues = before is not None and _continues(before, found)
        if not continues and int(found.track_id.min()) <= self._highest:
            self._count += 1
            # Everything after the last track of the earlier series belongs to this one, because
            # the smoother reports a target before the filter does.
            self._series.append((self._last_ns, self._count))
            self._highest = 0
        self._highest = max(self._highest, int(found.track_id.max()))
        self._last_ns = stamp_ns
        oldest_ns = stamp_ns - round(KEPT_S * 1e9)
        self._series = [entry for entry in self._series if entry[0] >= oldest_ns]

    def renumber(self, found: Estimates) -> Estimates:
        """Return estimates with track numbers that are unique over all series."""
        if not self._count:
            return found
        series = self._series[0][1] - 1 if self._series else self._count
        for after_ns, number in self._series:
            series = number if found.stamp_ns > after_ns else series
        return replace(found, track_id=found.track_id + SERIES * series)


def _continues(before: Estimates, found: Estimates) -> bool:
    """Return whether most tracks are near the earlier track with the same number."""
    _, old, new = np.intersect1d(before.track_id, found.track_id, return_indices=True)
    moved = np.hypot(*(found.position[new] - before.position[old]).T)
    speed = np.maximum(np.hypot(*before.velocity[old].T), np.hypot(*found.velocity[new].T))
    flown = speed * (found.stamp_ns - before.stamp_ns) * 1e-9
    near = np.count_nonzero(moved <= REACH + flown)
    # After a restart, a target may get its earlier number by chance.
    return bool(2 * near > len(moved))
