"""Holds back the reports of moving radars until their poses are known.

A report waits for a pose at or after its stamp, so that its own pose is interpolated, whichever of
the two arrives first. The stamps of later reports show when the pose is overdue: it is then
extrapolated, or the report is dropped. Reports behind a waiting one wait too, which keeps the order
of arrival.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from ..types import Detections, Pose
from .poses import Platform, PoseFault


class _Waiting(NamedTuple):
    """A slice of a report that waits for a pose."""

    radar: int
    stamp_ns: int
    detections: Detections
    latest_ns: int  # Latest stamp of the report's slices


class RadarPose(NamedTuple):
    """A pose of the platform that carries a radar, or of the radar itself if that is known."""

    radar: int  # Index in the configured order
    stamp_ns: int | None  # None for a pose that holds at all times
    pose: Pose


class PosedReport(NamedTuple):
    """A report with its pose."""

    radar: int  # Index in the configured order
    stamp_ns: int
    size: int  # Number of detections
    # With the radar's pose if it moves; None if the pose is unknown.
    detections: Detections | None
    extrapolated: bool = False  # Whether the pose was extrapolated


class PosedReports:
    """Queue of the reports that wait for poses, in their order of arrival.

    Platforms are in the configured order of the radars; None for a fixed radar.
    """

    def __init__(self, platforms: Sequence[Platform | None]) -> None:
        self._platforms = tuple(platforms)
        self.moving = any(platform is not None for platform in platforms)  # Whether any radar moves
        self._queue: deque[_Waiting] = deque()

    @property
    def waiting(self) -> bool:
        """Whether a report is held back."""
        return bool(self._queue)

    @property
    def awaited(self) -> int | None:
        """The radar of the first report that is held back; None without one."""
        return self._queue[0].radar if self._queue else None

    def add(self, radar: int, slices: Sequence[tuple[int, Detections]]) -> None:
        """Add the slices of a report, each with its stamp."""
        latest_ns = max(stamp_ns for stamp_ns, _ in slices)
        self._queue += [_Waiting(radar, *each, latest_ns) for each in slices]

    def add_pose(self, radar: int, stamp_ns: int | None, pose: Pose) -> PoseFault | None:
        """Add a pose of a radar's platform, see `PoseTrack.add`."""
        platform = self._platforms[radar]
        if platform is None:
            raise ValueError(f"radar: {radar} given, must be one that moves")
        return platform.track.add(stamp_ns, pose)

    def release(self, everything: bool = False) -> Iterator[PosedReport]:
        """Yield the reports that need not wait any longer, or all of them."""
        while self._queue and (everything or self._is_ready()):
            radar, stamp_ns, detections, _ = self._queue.popleft()
            platform = self._platforms[radar]
            posed = (detections,) if platform is None else platform.with_pose(stamp_ns, detections)
            yield PosedReport(radar, stamp_ns, len(detections), *posed)

    def forget(self) -> None:
        """Discard all reports; the poses stay."""
        self._queue.clear()

    def _is_ready(self) -> bool:
        first = self._queue[0]
        platform = self._platforms[first.radar]
        if platform is None or platform.reaches(first.stamp_ns, first.detections):
            return True
        overdue_ns = first.latest_ns + platform.track.max_age_s * 1e9
        # A report from before this stamp begins a new run: the old one gets no more poses.
        back_ns = first.latest_ns - platform.track.reset_threshold_s * 1e9
        return any(each.latest_ns > overdue_ns or each.latest_ns < back_ns for each in self._queue)
