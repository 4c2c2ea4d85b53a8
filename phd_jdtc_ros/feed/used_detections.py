"""How many of a recording's detections the tracker could use, and what the others failed by."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

# Less than this share of the detections is no result that may count as one.
LEAST_USED = 0.5
# Reasons that are named, and what they depend on: parameters of a radar, or of the tracker.
NAMED = 3
PARAMETERS = {
    "amplitude": "amplitude_unit",
    "azimuth": "azimuth_unit",
    "frame": "frame",
    "height": "height, geodetic",
    "late": "reorder_s, late_reports",
    "late_burst": "reorder_s, late_reports",
    "not_finite": "fields",
    "pose_missing": "pose",
    "range": "max_range",
    "schema": "fields",
    "time": "time_unit, time_reference, rotation_s",
}


@dataclass
class UsedDetections:
    """Counts detections, by what became of them.

    Attributes
    ----------
    offered : int
        All; a message that cannot be read counts as one, for nothing says how many it has.
    lost : Counter
        Those that were not used, by reason.
    """

    offered: int = 0
    lost: Counter[str] = field(default_factory=Counter)
    _reports: int = 0

    def unreadable(self, reason: str) -> None:
        """Count a message that cannot be read."""
        self.offered += 1
        self.lost[reason] += 1

    def read(self, kept: int, dropped: Mapping[str, int]) -> None:
        """Count a message's detections that were kept, and those that were not, by reason."""
        self.offered += kept + sum(dropped.values())
        self.lost.update(dropped)
        self._reports += 1

    def refused(self, reason: str, count: int) -> None:
        """Count detections that were kept at first as lost."""
        self.lost[reason] += count

    def reports_lost(self, reports: Mapping[str, int]) -> None:
        """Count reports that were lost later, each with as many detections as the others."""
        each = self.offered / max(self._reports, 1)
        for reason, count in reports.items():
            self.lost[reason] += round(count * each)

    def fault(self) -> str | None:
        """Return what is to be said if too few could be used; None if enough were."""
        lost = min(self.lost.total(), self.offered)
        if self.offered - lost >= LEAST_USED * self.offered:
            return None
        listed = ", ".join(
            f"{reason} {count}" + (f" ({PARAMETERS[reason]})" if reason in PARAMETERS else "")
            for reason, count in self.lost.most_common(NAMED)
        )
        return (
            f"{self.offered - lost} of {self.offered} detections could be used; dropped most by: "
            f"{listed}"
        )
