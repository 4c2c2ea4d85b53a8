"""The tracker's input and output values: scans in, estimates out.

Every type is frozen and its arrays are read-only, so that a later stage, such as the fixed-lag
window, can keep a value without a copy. Entries of sparse arrays, which scipy requires to be
writable, are never written to either.

Dimension letters: N rows (particles or Gaussians), M detections, T targets, P pairs of a row and a
detection, E pairs of a target and a detection, J components, O modes, C classes, D state,
Z measurement. Other letters are explained where they are used.
"""

from ..arrays import UNKNOWN
from .detections import (
    FULL_TURN,
    LEVEL,
    SENSORS,
    UNKNOWN_COVERAGE,
    Coverage,
    Detections,
    Pose,
    Scan,
    angles_of,
    rotation_of,
)
from .estimates import (
    COASTING,
    CONFIRMED,
    FILTERED,
    SMOOTHED,
    SOURCES,
    TENTATIVE,
    TRACK_STATES,
    Attributes,
    Estimates,
    Truth,
)
from .reports import Reported, SelfReports

__all__ = [
    "COASTING",
    "CONFIRMED",
    "FILTERED",
    "FULL_TURN",
    "LEVEL",
    "SENSORS",
    "SMOOTHED",
    "SOURCES",
    "TENTATIVE",
    "TRACK_STATES",
    "UNKNOWN",
    "UNKNOWN_COVERAGE",
    "Attributes",
    "Coverage",
    "Detections",
    "Estimates",
    "Pose",
    "Reported",
    "Scan",
    "SelfReports",
    "Truth",
    "angles_of",
    "rotation_of",
]
