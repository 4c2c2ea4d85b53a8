"""The latest positions of every track."""

from __future__ import annotations

from collections import deque

from phd_jdtc_ros.core.types import Estimates

from ..targets.tracks import Waypoint, rows_by_track

# A trail is continued if its track is estimated again within this number of scans.
UNSEEN_SCANS = 10


class Trails:
    """The latest positions of each track that was estimated in the last `UNSEEN_SCANS` scans.

    At most `length` positions are kept per track.
    """

    def __init__(self, length: int) -> None:
        self._length = length
        self._latest: Estimates | None = None
        self._trails: dict[int, deque[Waypoint]] = {}
        self._unseen: dict[int, int] = {}

    def of(self, found: Estimates) -> dict[int, deque[Waypoint]]:
        """Return the trails of a scan's tracks up to the scan, by ascending number.

        Estimates are added only once, because several outputs may request the trails of one scan.
        """
        if found is not self._latest:
            self._latest = found
            self._add(found)
        return {track: self._trails[track] for track, _ in rows_by_track(found)}

    def _add(self, found: Estimates) -> None:
        self._unseen = {track: scans + 1 for track, scans in self._unseen.items()}
        heights = found.known_attributes.height[:, 0].tolist()
        for track, row in rows_by_track(found):
            trail = self._trails.setdefault(track, deque(maxlen=self._length))
            trail.append(Waypoint(found.stamp_ns, found.state[row], heights[row]))
            self._unseen[track] = 0
        for track in [track for track, scans in self._unseen.items() if scans > UNSEEN_SCANS]:
            del self._trails[track], self._unseen[track]

    def clear(self) -> None:
        """Remove all trails."""
        self._latest, self._trails, self._unseen = None, {}, {}
