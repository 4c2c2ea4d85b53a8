"""The messages of a ship's radar and of its odometry; see `moving`."""

import moving
import numpy as np

from msg_adapters.encoding import interfaces
from msg_adapters.incoming import detections, moving_radars

CLOUDS = "/mast/detections"


def sent(kind="odometry", frame="map", count=moving.SCANS, radar="mast"):
    """Return (topic, bytes, stamp) of all messages, poses between scans and not with them.

    Those of another radar are on the topics of `mast`, too.
    """
    settings, found = moving.config(), []
    for index, scan in enumerate(moving.scans(count)):
        stamp_ns = moving.stamp(index * moving.INTERVAL_S)
        cloud = detections.to_msg(scan, stamp_ns, radar, settings.inputs[0])
        found.append((CLOUDS, interfaces.encode(cloud), stamp_ns))
    for time_s in np.arange(-0.3, count * moving.INTERVAL_S - 2.5, 0.4):
        stamp_ns = moving.stamp(time_s)
        pose = moving.ship(time_s)
        data = moving_radars.pose_to_cdr(pose, stamp_ns, frame, kind, "own_ship")
        found.append((moving.ODOMETRY, data, stamp_ns))
    return sorted(found, key=lambda message: message[2])
