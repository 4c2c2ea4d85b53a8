"""Estimates as markers that read well over a map."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from phd_jdtc_ros.core.motion import POSITION, VX, VY, X, Y
from phd_jdtc_ros.core.types import Estimates, FloatArray

from . import stamps
from .ellipse import outline
from .palette import COLOURS, class_rgb

PALETTE = tuple(class_rgb(k) for k in range(len(COLOURS)))
ELLIPSE_SIGMA = 3.0
# For a map that shows 30 km on a thousand pixels: lines are between one and two pixels wide,
# letters 13 pixels high, and an arrow of 60 m/s reaches 60 pixels, out of its ellipse.
VELOCITY_SECONDS = 30.0
LABEL_HEIGHT = 400.0
LINE_WIDTH = 40.0
ELLIPSE_POINTS = 33


def to_msg(estimates: Estimates, frame: str, class_names: tuple[str, ...]) -> MarkerArray:
    """Return a clearing marker, then an ellipse, a velocity and a label for every estimate.

    Namespaces are ``NAME/ellipse``, ``NAME/velocity`` and ``NAME/label`` with the class's name.
    """
    clear = Marker(header=stamps.header(estimates.stamp_ns, frame), action=Marker.DELETEALL)
    array = MarkerArray(markers=[clear])
    for index, state in enumerate(estimates.state):
        class_id = int(estimates.class_id[index])
        colour = ColorRGBA(**dict(zip("rgb", PALETTE[class_id % len(PALETTE)], strict=True)), a=1.0)
        name = class_names[class_id]
        share = estimates.class_probability[index, class_id]
        here, ahead = (
            _point(state[X], state[Y]),
            _point(
                state[X] + VELOCITY_SECONDS * state[VX], state[Y] + VELOCITY_SECONDS * state[VY]
            ),
        )
        base = (estimates.stamp_ns, frame, index, colour)
        ellipse = _marker(*base, f"{name}/ellipse", Marker.LINE_STRIP)
        ellipse.scale = Vector3(x=LINE_WIDTH, y=0.0, z=0.0)
        ellipse.points = _ellipse(state, estimates.covariance[index])
        velocity = _marker(*base, f"{name}/velocity", Marker.ARROW)
        velocity.scale = Vector3(x=LINE_WIDTH, y=3.0 * LINE_WIDTH, z=3.0 * LINE_WIDTH)
        velocity.points = [here, ahead]
        label = _marker(*base, f"{name}/label", Marker.TEXT_VIEW_FACING)
        label.scale = Vector3(x=0.0, y=0.0, z=LABEL_HEIGHT)
        label.pose.position = _point(state[X], state[Y] + 2.0 * LABEL_HEIGHT)
        label.text = label_text(int(estimates.track_id[index]), name, share)
        array.markers += [ellipse, velocity, label]
    return array


def label_text(track_id: int, class_name: str, share: float) -> str:
    """Return what stands beside a target: its track, its class, and how sure that is."""
    return f"{track_id} {class_name} {share:.0%}" if track_id else f"{class_name} {share:.0%}"


def _marker(
    stamp_ns: int, frame: str, index: int, colour: ColorRGBA, namespace: str, kind: int
) -> Marker:
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


def _point(x: float, y: float) -> Point:
    return Point(x=float(x), y=float(y), z=0.0)


def _ellipse(state: FloatArray, covariance: FloatArray) -> list[Point]:
    """Return a closed outline of the position covariance at `ELLIPSE_SIGMA`."""
    around = outline(covariance[np.ix_(POSITION, POSITION)], ELLIPSE_SIGMA, ELLIPSE_POINTS)
    return [_point(state[X] + dx, state[Y] + dy) for dx, dy in around.T]
