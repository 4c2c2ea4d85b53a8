"""Holds back the reports of radars that move until their poses are known.

A report waits for a pose at its stamp or after it, so that its own is interpolated, whichever of
the two came first. By the stamps of later reports it is known when that has taken too long: the
pose is then extrapolated, or the report is given up. Reports that come behind one that waits wait
too, so that the order in which they came stays.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ..types import Detections, Pose
from .poses import Platform, PoseFault


class _Held(NamedTuple):
    """A part of a report that waits.

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
    """A report that no longer waits.

    Parameters
    ----------
    radar : int
        Index in the configured order.
    stamp_ns : int
    detections : Detections or None
        With the radar's pose if it moves; None if that is not known.
    extrapolated : bool
        Whether the pose is.
    """

    radar: int
    stamp_ns: int
    detections: Detections | None
    extrapolated: bool = False


class PosedReports:
    """The reports that wait for poses, in the order in which they came.

    Parameters
    ----------
    platforms : sequence of (Platform or None)
        What carries each radar, in the configured order; None for one that stands.
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
                found = platform.posed(part.stamp_ns, part.detections)
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
