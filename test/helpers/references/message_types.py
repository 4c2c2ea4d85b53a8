"""Message classes built after their public definitions, for packages that are not installed.

Fields are checked as a ROS installation with `ROS_PYTHON_CHECK_FIELDS` does: an unknown name or a
value of another type raises.
"""

import numpy as np
from geometry_msgs.msg import (
    Accel,
    AccelWithCovariance,
    Point,
    Polygon,
    Pose,
    PoseWithCovariance,
    Twist,
    TwistWithCovariance,
    Vector3,
)
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import Header
from unique_identifier_msgs.msg import UUID

NUMBERS = {
    **{"float32": float, "float64": float},
    **{"uint8": int, "uint16": int, "uint32": int, "bool": bool},
}


class _Field:
    """Of a message: its type and how a new one begins."""

    def __init__(self, kind, known):
        self.name, _, length = kind.partition("[")
        self.array = bool(length)
        self.length = int(length.rstrip("]") or 0)
        self.type = known.get(self.name) or NUMBERS.get(self.name) or str

    def new(self):
        if not self.array:
            return self.type()
        return np.zeros(self.length, dtype=self.name) if self.length else []

    def accepts(self, value):
        if self.array and self.length:
            shape = (self.length,)
            return (
                isinstance(value, np.ndarray)
                and value.shape == shape
                and (value.dtype == self.name)
            )
        if self.array:
            return isinstance(value, list) and all(type(entry) is self.type for entry in value)
        return type(value) is self.type


def _make(name, definition, **known):
    kinds = dict(reversed(line.split()) for line in definition.strip().splitlines())
    fields = {field: _Field(kind, known) for field, kind in kinds.items()}

    def setattr_checked(self, field, value):
        if field not in fields:
            raise AttributeError(f"{name} has no field {field!r}")
        if not fields[field].accepts(value):
            raise TypeError(f"{name}.{field}: {value!r} is no {kinds[field]}")
        object.__setattr__(self, field, value)

    def init(self, **given):
        for field, of_field in fields.items():
            setattr(self, field, given.pop(field) if field in given else of_field.new())
        if given:
            raise AttributeError(f"{name} has no field {sorted(given)}")

    return type(name, (), {"__init__": init, "__setattr__": setattr_checked})


RadarReturn = _make(
    "RadarReturn",
    """
    float32 range
    float32 azimuth
    float32 elevation
    float32 doppler_velocity
    float32 amplitude
    """,
)
RadarScan = _make(
    "RadarScan",
    """
    Header header
    RadarReturn[] returns
    """,
    Header=Header,
    RadarReturn=RadarReturn,
)
RadarTrack = _make(
    "RadarTrack",
    """
    UUID uuid
    Point position
    Vector3 velocity
    Vector3 acceleration
    Vector3 size
    uint16 classification
    float32[6] position_covariance
    float32[6] velocity_covariance
    float32[6] acceleration_covariance
    float32[6] size_covariance
    """,
    UUID=UUID,
    Point=Point,
    Vector3=Vector3,
)
RadarTracks = _make(
    "RadarTracks",
    """
    Header header
    RadarTrack[] tracks
    """,
    Header=Header,
    RadarTrack=RadarTrack,
)
BoundingBox3D = _make(
    "BoundingBox3D",
    """
    Pose center
    Vector3 size
    """,
    Pose=Pose,
    Vector3=Vector3,
)
ObjectHypothesis = _make(
    "ObjectHypothesis",
    """
    string class_id
    float64 score
    """,
)
ObjectHypothesisWithPose = _make(
    "ObjectHypothesisWithPose",
    """
    ObjectHypothesis hypothesis
    PoseWithCovariance pose
    """,
    ObjectHypothesis=ObjectHypothesis,
    PoseWithCovariance=PoseWithCovariance,
)
Detection3D = _make(
    "Detection3D",
    """
    Header header
    ObjectHypothesisWithPose[] results
    BoundingBox3D bbox
    string id
    """,
    Header=Header,
    ObjectHypothesisWithPose=ObjectHypothesisWithPose,
    BoundingBox3D=BoundingBox3D,
)
Detection3DArray = _make(
    "Detection3DArray",
    """
    Header header
    Detection3D[] detections
    """,
    Header=Header,
    Detection3D=Detection3D,
)
ObjectClassification = _make(
    "ObjectClassification",
    """
    uint8 label
    float32 probability
    """,
)
TrackedObjectKinematics = _make(
    "TrackedObjectKinematics",
    """
    PoseWithCovariance pose_with_covariance
    TwistWithCovariance twist_with_covariance
    AccelWithCovariance acceleration_with_covariance
    uint8 orientation_availability
    bool is_stationary
    """,
    PoseWithCovariance=PoseWithCovariance,
    TwistWithCovariance=TwistWithCovariance,
    AccelWithCovariance=AccelWithCovariance,
)
Shape = _make(
    "Shape",
    """
    uint8 type
    Polygon footprint
    Vector3 dimensions
    """,
    Polygon=Polygon,
    Vector3=Vector3,
)
TrackedObject = _make(
    "TrackedObject",
    """
    UUID object_id
    float32 existence_probability
    ObjectClassification[] classification
    TrackedObjectKinematics kinematics
    Shape shape
    """,
    UUID=UUID,
    ObjectClassification=ObjectClassification,
    TrackedObjectKinematics=TrackedObjectKinematics,
    Shape=Shape,
)
TrackedObjects = _make(
    "TrackedObjects",
    """
    Header header
    TrackedObject[] objects
    """,
    Header=Header,
    TrackedObject=TrackedObject,
)
_OBSTACLE = """
    UUID uuid
    float32 score
    Point position
    Vector3 velocity
    Vector3 size
    """
_COVARIANCES = """
    float64[9] position_covariance
    float64[9] velocity_covariance
    """
_PARTS = {"UUID": UUID, "Point": Point, "Vector3": Vector3}
# The definition up to 2023, and the present one.
EarlyObstacle = _make("Obstacle", _OBSTACLE, **_PARTS)
Obstacle = _make("Obstacle", _OBSTACLE.rstrip() + _COVARIANCES, **_PARTS)
ObstacleArray = _make(
    "ObstacleArray",
    """
    Header header
    Obstacle[] obstacles
    """,
    Header=Header,
    Obstacle=Obstacle,
)
DerivedObject = _make(
    "DerivedObject",
    """
    Header header
    uint32 id
    uint8 detection_level
    bool object_classified
    Pose pose
    Twist twist
    Accel accel
    Polygon polygon
    SolidPrimitive shape
    uint8 classification
    uint8 classification_certainty
    uint32 classification_age
    """,
    Header=Header,
    Pose=Pose,
    Twist=Twist,
    Accel=Accel,
    Polygon=Polygon,
    SolidPrimitive=SolidPrimitive,
)
DerivedObjectArray = _make(
    "DerivedObjectArray",
    """
    Header header
    DerivedObject[] objects
    """,
    Header=Header,
    DerivedObject=DerivedObject,
)
