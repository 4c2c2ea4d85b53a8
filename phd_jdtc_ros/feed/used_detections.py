"""The share of a recording's detections that the tracker used, and the reasons for the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

# Least share of used detections for a result that counts as a success.
LEAST_USED = 0.5
# Largest number of reasons in a message, and the parameters to check for each reason.
MAX_LISTED = 3
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
    """Counts the detections of a recording, and the unused ones."""

    # All detections; an unreadable message counts as one, because its number is unknown.
    offered: int = 0
    lost: Counter[str] = field(default_factory=Counter)  # Unused detections by reason
    _reports: int = 0

    def unreadable(self, reason: str) -> None:
        """Count a message that cannot be read."""
        self.offered += 1
        self.lost[reason] += 1

    def read(self, kept: int, dropped: Mapping[str, int]) -> None:
        """Count a message's detections: the kept ones, and the dropped ones by reason."""
        self.offered += kept + sum(dropped.values())
        self.lost.update(dropped)
        self._reports += 1

    def refuse(self, reason: str, count: int) -> None:
        """Count detections of a refused report as lost."""
        self.lost[reason] += count

    def lose_reports(self, reports: Mapping[str, int]) -> None:
        """Count reports that were lost later, each with the mean number of detections."""
        each = self.offered / max(self._reports, 1)
        for reason, count in reports.items():
            self.lost[reason] += round(count * each)

    def fault(self) -> str | None:
        """Return an error message if too few detections were used, else None."""
        lost = min(self.lost.total(), self.offered)
        if self.offered - lost >= LEAST_USED * self.offered:
            return None
        listed = ", ".join(
            f"{reason} {count}" + (f" ({PARAMETERS[reason]})" if reason in PARAMETERS else "")
            for reason, count in self.lost.most_common(MAX_LISTED)
        )
        return (
            f"{self.offered - lost} of {self.offered} detections could be used; dropped most by: "
            f"{listed}"
        )
