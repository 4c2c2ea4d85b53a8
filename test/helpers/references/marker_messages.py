"""Markers and poses made of message objects: the reference of the published bytes."""

import itertools

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from msg_adapters.encoding import stamps
from msg_adapters.targets import vertical
from msg_adapters.targets.markers import (
    ELLIPSE_SIDES,
    ELLIPSE_SIGMA,
    HEAD_LENGTH,
    HEAD_WIDTH,
    LABEL_COLOUR,
    LABEL_HEIGHT,
    LINE_WIDTH,
    VELOCITY_SECONDS,
    class_rgb,
)
from msg_adapters.targets.tracks import pose_of
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
        poses=[pose_of(row, float(height)) for row, (height, _) in zip(rows, up, strict=True)],
    )


def marker_array(estimates, frame, class_names):
    """Return a clearing marker, then each class's ellipses, velocities and labels.

    Namespaces are ``NAME/ellipse``, ``NAME/velocity`` and ``NAME/label`` with the class's name.
    """
    stamp_ns = estimates.stamp_ns
    clear = Marker(header=stamps.header(stamp_ns, frame), action=Marker.DELETEALL)
    array = MarkerArray(markers=[clear])
    for class_id in sorted(set(estimates.class_id.tolist())):
        rows = [row for row, k in enumerate(estimates.class_id) if k == class_id]
        name, colour = class_names[class_id], _colour(class_rgb(class_id))
        for kind, lines in (("ellipse", _ellipse), ("velocity", _arrow)):
            marker = _marker(stamp_ns, frame, 0, colour, f"{name}/{kind}", Marker.LINE_LIST)
            marker.scale = Vector3(x=LINE_WIDTH, y=0.0, z=0.0)
            marker.points = [point for row in rows for point in lines(estimates, row)]
            array.markers.append(marker)
        array.markers += [_label(estimates, row, frame, name) for row in rows]
    return array


def _label(estimates, row, frame, name):
    kind = f"{name}/label", Marker.TEXT_VIEW_FACING
    label = _marker(estimates.stamp_ns, frame, row, _colour(LABEL_COLOUR), *kind)
    state, share = estimates.state[row], estimates.class_probability[row]
    label.scale = Vector3(x=0.0, y=0.0, z=LABEL_HEIGHT)
    label.pose.position = _point(
        state[X], state[Y] + 2.0 * LABEL_HEIGHT, heights(estimates)[row, 0]
    )
    track, more = int(estimates.track_id[row]), vertical.words(estimates)[row]
    label.text = " ".join(
        filter(None, [str(track or ""), name, f"{share[estimates.class_id[row]]:.0%}", more])
    )
    return label


def _colour(rgb):
    return ColorRGBA(**dict(zip("rgb", rgb, strict=True)), a=1.0)


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


def _ellipse(estimates, row):
    """Return the sides of the outline of the position covariance at `ELLIPSE_SIGMA`."""
    state, covariance = estimates.state[row], estimates.covariance[row]
    variance, axes = np.linalg.eigh(covariance[np.ix_((X, Y), (X, Y))])
    height = heights(estimates)[row, 0]
    corners = []
    for angle in np.linspace(0.0, 2.0 * np.pi, ELLIPSE_SIDES + 1):
        circle = np.array([np.cos(angle), np.sin(angle)])
        # The ends are those of the covariance's symmetric square root.
        dx, dy = axes @ (ELLIPSE_SIGMA * np.sqrt(variance) * (axes.T @ circle))
        corners.append(_point(state[X] + dx, state[Y] + dy, height))
    return [corner for side in itertools.pairwise(corners) for corner in side]


def _arrow(estimates, row):
    """Return the segments of an arrow to where the target will be: its shaft and its head."""
    state, (height, climb) = estimates.state[row], heights(estimates)[row]
    here = np.array([state[X], state[Y], height])
    tip = here + VELOCITY_SECONDS * np.array([state[VX], state[VY], climb])
    way = VELOCITY_SECONDS * np.hypot(state[VX], state[VY])
    direction = np.arctan2(state[VY], state[VX])
    length = min(HEAD_LENGTH, way)
    width = length * HEAD_WIDTH / HEAD_LENGTH
    along = length * np.array([np.cos(direction), np.sin(direction), 0.0])
    across = width * np.array([-np.sin(direction), np.cos(direction), 0.0])
    ends = [here, tip, tip, tip - along + across, tip, tip - along - across]
    return [_point(*end) for end in ends]
