"""Names and types of the package's topics."""

from __future__ import annotations

DETECTIONS_SUFFIX, REPORTS_SUFFIX = "/detections", "/reports"
TRUTH = "/ground_truth/targets"
TRACKER = "/tracker"
EVALUATOR = "/evaluator"
OSPA = f"{EVALUATOR}/ospa"
DIAGNOSTICS = "/diagnostics"
STATIC_FRAMES = "/tf_static"

CLOUD = "sensor_msgs/msg/PointCloud2"
POSES = "geometry_msgs/msg/PoseArray"
MARKERS = "visualization_msgs/msg/MarkerArray"
FIGURES = "diagnostic_msgs/msg/DiagnosticArray"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
NUMBER = "std_msgs/msg/Float64"
PATH = "nav_msgs/msg/Path"
ODOMETRY = "nav_msgs/msg/Odometry"
FIX = "sensor_msgs/msg/NavSatFix"
GEOJSON = "foxglove_msgs/msg/GeoJSON"
GRID = "nav_msgs/msg/OccupancyGrid"
POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
RADAR_TRACKS = "radar_msgs/msg/RadarTracks"
DETECTIONS_3D = "vision_msgs/msg/Detection3DArray"
DETECTION_3D = "vision_msgs/msg/Detection3D"
TRACKED_OBJECTS = "autoware_perception_msgs/msg/TrackedObjects"
OBSTACLES = "nav2_dynamic_msgs/msg/ObstacleArray"
DERIVED_OBJECTS = "derived_object_msgs/msg/ObjectArray"


def detections(radar: str) -> str:
    """Return the default topic of a radar's detections."""
    return f"/{radar}{DETECTIONS_SUFFIX}"


def reports(receiver: str) -> str:
    """Return the default topic of what transmitters report of themselves to a receiver."""
    return f"/{receiver}{REPORTS_SUFFIX}"


def estimates(source: str, tracker: str = TRACKER) -> str:
    """Return the topic of the ``filtered`` or ``smoothed`` estimates."""
    return f"{tracker}/{source}/estimates"


def tracker_of(estimates_topic: str) -> str:
    """Return the full name of the tracker's node, given its topic of `estimates`."""
    return estimates_topic.rsplit("/", 2)[0]


def poses(source: str, class_id: int, tracker: str = TRACKER) -> str:
    """Return the topic of the poses of one class."""
    return f"{tracker}/{source}/class_{class_id}/poses"


def detections_in_map(tracker: str = TRACKER) -> str:
    """Return the topic of all radars' detections in the world frame."""
    return f"{tracker}{DETECTIONS_SUFFIX}"


def cardinality(tracker: str = TRACKER) -> str:
    """Return the topic of the tracker's figures, published once per scan."""
    return f"{tracker}/cardinality"


def clutter_map(tracker: str = TRACKER) -> str:
    """Return the topic of a tracker's clutter map."""
    return f"{tracker}/clutter_map"


def manual(tracker: str = TRACKER) -> str:
    """Return the topic of the manual work on a tracker's tracks."""
    return f"{tracker}/manual"


def conflicts(tracker: str = TRACKER) -> str:
    """Return the topic of a tracker's conflicts."""
    return f"{tracker}/conflicts"


def fixes(tracker: str = TRACKER) -> str:
    """Return the topic of the tracks by latitude and longitude."""
    return f"{tracker}/navsat"


def curve(quantity: str, node: str = TRACKER) -> str:
    """Return the topic of a number that a node publishes for plots, see `plots`."""
    return f"{node}/plot/{quantity}"


def health(line: str, tracker: str = TRACKER) -> str:
    """Return the name of a status of the tracker's health: a radar's name, or ``step time``.

    It begins with the node's full name, because ``/diagnostics`` is shared by all namespaces.
    """
    return f"{tracker}: {line}"


def hardware(radar: str, tracker: str = TRACKER) -> str:
    """Return the hardware id of a tracker's radar."""
    return f"{tracker}/{radar}"
