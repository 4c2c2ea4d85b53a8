"""Markers and poses made of message objects: what the bytes that are published must say."""

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from msg_adapters import stamps, vertical
from msg_adapters.ellipse import outline
from msg_adapters.estimates import heading
from msg_adapters.markers import (
    ELLIPSE_POINTS,
    ELLIPSE_SIGMA,
    LABEL_COLOUR,
    LABEL_HEIGHT,
    LINE_WIDTH,
    VELOCITY_SECONDS,
    label_text,
)
from msg_adapters.palette import class_rgb
from phd_jdtc_ros.core.state_space import VX, VY, X, Y


def heights(estimates):
    """Return heights and climb rates, 0 where they are unknown."""
    known = estimates.attributes
    return np.zeros((len(estimates), 2)) if known is None else np.nan_to_num(known.height)


def pose_array(estimates, class_id, frame):
    """Return the poses of the estimates of one class, facing where they move."""
    mine = estimates.class_id == class_id
    rows, up = estimates.state[mine], heights(estimates)[mine]
    return PoseArray(
        header=stamps.header(estimates.stamp_ns, frame),
        poses=[
            Pose(
                position=_point(row[X], row[Y], height),
                orientation=heading(row[VX], row[VY]),
            )
            for row, (height, _) in zip(rows, up, strict=True)
        ],
    )


def marker_array(estimates, frame, class_names):
    """Return a clearing marker, then an ellipse, a velocity and a label for every estimate.

    Namespaces are ``NAME/ellipse``, ``NAME/velocity`` and ``NAME/label`` with the class's name.
    """
    clear = Marker(header=stamps.header(estimates.stamp_ns, frame), action=Marker.DELETEALL)
    array = MarkerArray(markers=[clear])
    for index, state in enumerate(estimates.state):
        class_id = int(estimates.class_id[index])
        height, climb = heights(estimates)[index]
        colour = ColorRGBA(**dict(zip("rgb", class_rgb(class_id), strict=True)), a=1.0)
        name = class_names[class_id]
        share = estimates.class_probability[index, class_id]
        ahead = state + VELOCITY_SECONDS * np.array([state[VX], 0.0, state[VY], 0.0, 0.0])
        base = (estimates.stamp_ns, frame, index, colour)
        ellipse = _marker(*base, f"{name}/ellipse", Marker.LINE_STRIP)
        ellipse.scale = Vector3(x=LINE_WIDTH, y=0.0, z=0.0)
        ellipse.points = _ellipse(state, estimates.covariance[index], height)
        velocity = _marker(*base, f"{name}/velocity", Marker.ARROW)
        velocity.scale = Vector3(x=LINE_WIDTH, y=3.0 * LINE_WIDTH, z=3.0 * LINE_WIDTH)
        velocity.points = [
            _point(state[X], state[Y], height),
            _point(ahead[X], ahead[Y], height + VELOCITY_SECONDS * climb),
        ]
        dark = ColorRGBA(**dict(zip("rgb", LABEL_COLOUR, strict=True)), a=1.0)
        label = _marker(*base[:3], dark, f"{name}/label", Marker.TEXT_VIEW_FACING)
        label.scale = Vector3(x=0.0, y=0.0, z=LABEL_HEIGHT)
        label.pose.position = _point(state[X], state[Y] + 2.0 * LABEL_HEIGHT, height)
        label.text = label_text(
            int(estimates.track_id[index]), name, share, vertical.words(estimates)[index]
        )
        array.markers += [ellipse, velocity, label]
    return array


def _marker(stamp_ns, frame, index, colour, namespace, kind):
    return Marker(
        header=stamps.header(stamp_ns, frame),
        ns=namespace,
        id=index,
        type=kind,
        action=Marker.ADD,
        pose=Pose(orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)),
        color=colour,
        lifetime=Duration(sec=0, nanosec=0),
    )


def _point(x, y, z):
    return Point(x=float(x), y=float(y), z=float(z))


def _ellipse(state, covariance, height):
    """Return a closed outline of the position covariance at `ELLIPSE_SIGMA`."""
    around = outline(covariance[np.ix_((X, Y), (X, Y))], ELLIPSE_SIGMA, ELLIPSE_POINTS)
    return [_point(state[X] + dx, state[Y] + dy, height) for dx, dy in around.T]
