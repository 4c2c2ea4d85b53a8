"""Message packages that are not on PyPI, as far as a node needs them to have their topics.

Their types are those of other messages, which the middleware has. What is published is bytes, or
nothing. A ROS installation has the packages themselves, and they have precedence.
"""

import json
import os

PACKAGES = {
    "autoware_perception_msgs": ("ObjectClassification", "TrackedObject", "TrackedObjects"),
    "derived_object_msgs": ("Object", "ObjectArray"),
    "foxglove_msgs": ("GeoJSON",),
    "nav2_dynamic_msgs": ("Obstacle", "ObstacleArray"),
    "radar_msgs": ("RadarTrack", "RadarTracks"),
    "tf2_msgs": ("TFMessage",),
    "vision_msgs": ("Detection3D", "Detection3DArray", "ObjectHypothesisWithPose"),
}
ORIGINAL = "geometry_msgs.msg import PoseArray"


def write(directory):
    """Write the packages; return the environment of a process that finds them."""
    for package, types in PACKAGES.items():
        module, share = directory / package / "msg", directory / "share" / package / "msg"
        for folder in (module, share):
            folder.mkdir(parents=True)
        (directory / package / "__init__.py").touch()
        lines = [f"from {ORIGINAL} as {name}\n" for name in types]
        (module / "__init__.py").write_text("".join(lines))
        # A recording stores this description of each type.
        for name in types:
            described = {
                "type_description_msg": {"referenced_type_descriptions": []},
                "type_hashes": [
                    {"type_name": f"{package}/msg/{name}", "hash_string": f"RIHS01_{0:064d}"}
                ],
            }
            (share / f"{name}.json").write_text(json.dumps(described))
            (share / f"{name}.msg").write_text("geometry_msgs/TransformStamped[] transforms\n")
    paths = [*filter(None, [os.environ.get("PYTHONPATH")]), str(directory)]
    return {"PYTHONPATH": os.pathsep.join(paths)}


def message_class(name):
    """Return the class that stands in for the message of that package, or the message's own."""
    package, _, kind = name.split("/")
    try:
        module = __import__(f"{package}.msg", fromlist=[kind])
    except ImportError:
        source, _, original = ORIGINAL.partition(" import ")
        return getattr(__import__(source, fromlist=[original]), original)
    return getattr(module, kind)
