"""The unit of a run's maps, metres or kilometres, and short texts of lengths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray

from .record import Record, concatenate_rows

# Maps with a smaller extent than this are in metres.
SHORT_M = 2000.0


@dataclass(frozen=True)
class MapScale:
    """The unit of maps and of the lengths on them."""

    unit: str
    metres: float  # Length of the unit

    @staticmethod
    def of(record: Record) -> MapScale:
        """Return the scale that suits the positions of a record."""
        places = places_of(record)
        return MapScale.of_extent(float(np.ptp(places, axis=0).max()) if len(places) else SHORT_M)

    @staticmethod
    def of_extent(extent: float) -> MapScale:
        """Return the scale that suits an extent, metres."""
        return MapScale("m", 1.0) if extent < SHORT_M else MapScale("km", 1e3)

    def of_metres(self, metres: FloatArray) -> FloatArray:
        """Return lengths or positions in the unit."""
        return metres / self.metres


def places_of(record: Record) -> FloatArray:
    """Return the positions of targets and estimates, or else of detections, (N, 2), metres."""
    parts = (record.truth, record.filtered, record.smoothed)
    targets = concatenate_rows((entry.position for part in parts for entry in part), 2)
    return targets if len(targets) else record.all_plots.position


def metres_text(metres: float) -> str:
    """Return a length with its unit and at least two significant digits."""
    rounded = abs(metres)
    decimals = 0 if rounded >= 9.95 or rounded < 5e-3 else 1 if rounded >= 0.995 else 2
    return f"{metres:.{decimals}f} m"
