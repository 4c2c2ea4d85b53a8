"""Holds back the reports of moving radars until their poses are known.

A report waits for a pose at or after its stamp, so that its own pose is interpolated, whichever of
the two arrives first. The stamps of later reports show when the pose is overdue: it is then
extrapolated, or the report is dropped. Reports behind a waiting one wait too, which keeps the order
of arrival.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ..types import Detections, Pose
from .poses import Platform, PoseFault


class _Held(NamedTuple):
    """A waiting part of a report.

    Parameters
    ----------
    radar : int
    stamp_ns : int
    detections : Detections
    latest_ns : int
        Latest stamp of the report's parts.
    """

    radar: int
    stamp_ns: int
    detections: Detections
    latest_ns: int


@dataclass(frozen=True)
class PosedReport:
    """A report with its pose.

    Parameters
    ----------
    radar : int
        Index in the configured order.
    stamp_ns : int
    detections : Detections or None
        They have the radar's pose if it moves; None if the pose is unknown.
    extrapolated : bool
        Whether the pose was extrapolated.
    """

    radar: int
    stamp_ns: int
    detections: Detections | None
    extrapolated: bool = False


class PosedReports:
    """Queue of the reports that wait for poses, in their order of arrival.

    Parameters
    ----------
    platforms : sequence of (Platform or None)
        The platform of each radar, in the configured order; None for a fixed radar.
    """

    def __init__(self, platforms: Sequence[Platform | None]) -> None:
        self._platforms = tuple(platforms)
        self._held: deque[_Held] = deque()

    @property
    def moving(self) -> bool:
        """Whether any radar moves."""
        return any(platform is not None for platform in self._platforms)

    @property
    def waiting(self) -> bool:
        """Whether a report is held back."""
        return bool(self._held)

    @property
    def awaited(self) -> int | None:
        """The radar of the first report that is held back; None if none is."""
        return self._held[0].radar if self._held else None

    def add(self, radar: int, parts: Sequence[tuple[int, Detections]]) -> None:
        """Take in the parts of a report, each with its stamp; they have come together."""
        latest_ns = max(stamp_ns for stamp_ns, _ in parts)
        self._held += [_Held(radar, *part, latest_ns) for part in parts]

    def add_pose(self, radar: int, stamp_ns: int, pose: Pose) -> PoseFault | None:
        """Take in a pose of what carries a radar; return why it is not used, or None if it is."""
        platform = self._platforms[radar]
        if platform is None:
            raise ValueError(f"radar: {radar} given, must be one that moves")
        return platform.track.add(stamp_ns, pose)

    def released(self, everything: bool = False) -> Iterator[PosedReport]:
        """Yield the reports that need not wait any longer, or all of them."""
        while self._held and (everything or self._ready()):
            part = self._held.popleft()
            platform = self._platforms[part.radar]
            if platform is None:
                yield PosedReport(part.radar, part.stamp_ns, part.detections)
            else:
                found = platform.with_pose(part.stamp_ns, part.detections)
                yield PosedReport(part.radar, part.stamp_ns, *found)

    def forget(self) -> None:
        """Discard all reports; the poses stay."""
        self._held.clear()

    def _ready(self) -> bool:
        first = self._held[0]
        platform = self._platforms[first.radar]
        if platform is None or platform.reaches(first.stamp_ns, first.detections):
            return True
        late_ns = first.latest_ns + platform.track.max_age_s * 1e9
        back_ns = first.latest_ns - platform.track.reset_threshold_s * 1e9
        return any(part.latest_ns > late_ns or part.latest_ns < back_ns for part in self._held)
