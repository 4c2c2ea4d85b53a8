"""Transforms as another implementation writes them; and those of the ship of `moving`."""

import math

import moving
import numpy as np
from moving_messages import CLOUDS, sent
from rosbags.typesys import Stores, get_typestore

from msg_adapters.encoding import names
from phd_jdtc_ros.bags.writer import Topic
from phd_jdtc_ros.core.intake.transforms import Placement

STORE = get_typestore(Stores.ROS2_JAZZY)
DEFINITION, HASH = STORE.generate_msgdef(names.TRANSFORMS, ros_version=2)
LIVE, STATIC = "/tf", "/tf_static"
# The radar of `moving`, whose place the parameters do not have.
PARAMETERS = {"mast.pose": "tf", "mast.position": [0.0, 0.0], "mast.yaw_deg": 0.0}


def topics(*given):
    """Return topics of transforms for a bag."""
    return [Topic(name, names.TRANSFORMS, definition=DEFINITION, type_hash=HASH) for name in given]


def upright(x, y, yaw, z=0.0):
    """Return the placement of a frame whose z axis points up."""
    return Placement((x, y, z), (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)))


def message(*transforms, little_endian=True):
    """Return the bytes of a message of (parent, child, stamp, placement)."""
    kinds = STORE.types
    stamped = []
    for parent, child, stamp_ns, (translation, rotation) in transforms:
        stamp = kinds["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
        header = kinds["std_msgs/msg/Header"](stamp, parent)
        transform = kinds["geometry_msgs/msg/Transform"](
            kinds["geometry_msgs/msg/Vector3"](*translation),
            kinds["geometry_msgs/msg/Quaternion"](*rotation),
        )
        kind = kinds["geometry_msgs/msg/TransformStamped"]
        stamped.append(kind(header, child, transform))
    whole = kinds[names.TRANSFORMS](stamped)
    return bytes(STORE.serialize_cdr(whole, names.TRANSFORMS, little_endian=little_endian))


def mounting(parent="base_link", stamp_ns=0):
    """Return the static transform of the radar on the ship."""
    return message((parent, "mast", stamp_ns, upright(*moving.MOUNT[0], moving.MOUNT[1], 12.0)))


def drift(time_s):
    """Return where odometry, which drifts, has its origin in the map."""
    return upright(40.0 - 0.2 * time_s, 25.0 + 0.1 * time_s, 0.6 + 0.002 * time_s)


def carried(clouds=None):
    """Return (topic, bytes, stamp) of the ship's clouds, and of transforms instead of poses.

    The transforms to odometry are as often as the poses, those to the map less often; both are with
    the clouds' stamps too.
    """
    found = [each for each in clouds or sent() if each[0] == CLOUDS]
    end_s = moving.SCANS * moving.INTERVAL_S - 1.5
    for time_s in np.arange(-1.0, end_s, 0.5):
        stamp_ns = moving.stamp(time_s)
        pose = moving.ship(time_s)
        own = drift(time_s).inverse().of(upright(*pose.position, pose.yaw))
        found.append((LIVE, message(("odom", "base_link", stamp_ns, own)), stamp_ns))
    for time_s in np.arange(-1.0, end_s, 1.0):
        stamp_ns = moving.stamp(time_s)
        found.append((LIVE, message(("map", "odom", stamp_ns, drift(time_s))), stamp_ns))
    return sorted(found, key=lambda entry: entry[2])
