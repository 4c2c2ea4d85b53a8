# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Names and types of the package's topics."""

from __future__ import annotations

DETECTIONS_SUFFIX = "/detections"
TRUTH = "/ground_truth/targets"
TRACKER = "/tracker"
OSPA = "/evaluator/ospa"
DIAGNOSTICS = "/diagnostics"

CLOUD = "sensor_msgs/msg/PointCloud2"
POSES = "geometry_msgs/msg/PoseArray"
MARKERS = "visualization_msgs/msg/MarkerArray"
FIGURES = "diagnostic_msgs/msg/DiagnosticArray"
PATH = "nav_msgs/msg/Path"
ODOMETRY = "nav_msgs/msg/Odometry"
RADAR_TRACKS = "radar_msgs/msg/RadarTracks"
DETECTIONS_3D = "vision_msgs/msg/Detection3DArray"


def detections(radar: str) -> str:
    """Return the default topic of a radar's detections."""
    return f"/{radar}{DETECTIONS_SUFFIX}"


def estimates(source: str, tracker: str = TRACKER) -> str:
    """Return the topic of the ``filtered`` or ``smoothed`` estimates."""
    return f"{tracker}/{source}/estimates"


def poses(source: str, class_id: int, tracker: str = TRACKER) -> str:
    """Return the topic of one class's poses."""
    return f"{tracker}/{source}/class_{class_id}/poses"


def cardinality(tracker: str = TRACKER) -> str:
    """Return the topic of the tracker's figures, one message per scan."""
    return f"{tracker}/cardinality"


def published(classes: int, tracker: str = TRACKER, scores: str = OSPA) -> dict[str, str]:
    """Return every topic that the tracker and the evaluator always publish, with its type."""
    sources = ("filtered", "smoothed")
    clouds = {estimates(source, tracker): CLOUD for source in sources}
    arrays = {poses(s, k, tracker): POSES for s in sources for k in range(classes)}
    return {
        **clouds,
        **arrays,
        f"{tracker}/markers": MARKERS,
        cardinality(tracker): FIGURES,
        DIAGNOSTICS: FIGURES,
        scores: FIGURES,
    }


def optional(tracker: str = TRACKER) -> dict[str, str]:
    """Return every topic that the tracker publishes if it is asked to, with its type."""
    return {
        f"{tracker}/tracks/path": PATH,
        f"{tracker}/odometry": ODOMETRY,
        f"{tracker}/radar_tracks": RADAR_TRACKS,
        f"{tracker}/detections_3d": DETECTIONS_3D,
    }
