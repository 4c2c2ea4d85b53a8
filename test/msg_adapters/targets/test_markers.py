from dataclasses import replace

import numpy as np
import pytest
from marker_messages import marker_array
from numpy.testing import assert_allclose
from rclpy.serialization import deserialize_message
from samples import as_sent, estimates, of_every_kind
from visualization_msgs.msg import Marker, MarkerArray

from msg_adapters.targets import markers
from msg_adapters.targets.markers import (
    COLOURS,
    ELLIPSE_SIGMA,
    VELOCITY_SECONDS,
    class_colour,
    class_rgb,
)
from phd_jdtc_ros.core.state_space import SPATIAL
from phd_jdtc_ros.report import style

NAMES = ("jet", "drone")


def made(given=None, names=NAMES):
    data = markers.to_cdr(estimates() if given is None else given, "map", names)
    return deserialize_message(data, MarkerArray).markers


def lines(kind, given=None):
    """Return the ends of each target's lines of a kind, in the order of the classes."""
    given = estimates() if given is None else given
    found = [marker for marker in made(given) if marker.ns.endswith(f"/{kind}")]
    points = [(p.x, p.y, p.z) for marker in found for p in marker.points]
    return np.reshape(points, (len(given), -1, 3))


def by_class(given=None):
    """Return the rows of estimates in the order of their classes."""
    given = estimates() if given is None else given
    return np.argsort(given.class_id, kind="stable")


def floats(marker):
    points = [(p.x, p.y, p.z) for p in [*marker.points, marker.pose.position, marker.scale]]
    q, c = marker.pose.orientation, marker.color
    return [*np.ravel(points).tolist(), q.x, q.y, q.z, q.w, c.r, c.g, c.b, c.a]


def test_arrows_and_markers_are_distinct_and_finite():
    names = [(marker.ns, marker.id) for marker in made()[1:]]
    assert len(set(names)) == len(names)
    given = estimates()
    bad = given.covariance.copy()
    bad[:, 0, 0] = -1.0
    broken = type(given)(**{**vars(given), "covariance": bad})
    for marker in made(broken)[1:]:
        assert np.isfinite(floats(marker)).all()
    still = replace(estimates(count=1), state=np.array([[7.0, 0.0, 9.0, 0.0, 0.0]]))
    assert_allclose(lines("velocity", still)[0, :, :2], [[7.0, 9.0]] * 6)


def test_ellipses_are_the_closed_outlines_of_the_covariances():
    given = estimates()
    for ends, row in zip(lines("ellipse"), by_class(), strict=True):
        assert_allclose(ends[1:-1:2], ends[2::2])
        assert_allclose(ends[0], ends[-1])
        offset = ends[:, :2] - given.state[row, [0, 2]]
        inverse = np.linalg.inv(given.covariance[row][np.ix_([0, 2], [0, 2])])
        distance = np.sqrt(np.einsum("ni,ij,nj->n", offset, inverse, offset))
        assert_allclose(distance, ELLIPSE_SIGMA, rtol=1e-6)


def test_ellipsoids_in_space_are_three_outlines_of_the_covariances():
    rng, planar = np.random.default_rng(0), estimates(count=4)
    root = rng.normal(size=(4, 7, 7)) * 20.0
    covariance = root @ root.swapaxes(1, 2)
    covariance[1, 5, 5] = 1e6
    state = np.concatenate([planar.state, rng.normal(0.0, 50.0, (4, 2))], axis=1)
    given = planar.changed(state=state, covariance=covariance, space=SPATIAL, attributes=None)
    given = given.with_heights(500.0)
    for ends, row in zip(lines("ellipse", given), by_class(given), strict=True):
        offset = ends - [*given.state[row, [0, 2]], 0.0 if row == 1 else given.state[row, 5]]
        if row == 1:
            # A target without a height is flat.
            assert not offset[:, 2].any()
            continue
        inverse = np.linalg.inv(given.covariance[row][np.ix_([0, 2, 5], [0, 2, 5])])
        distance = np.sqrt(np.einsum("ni,ij,nj->n", offset, inverse, offset))
        assert_allclose(distance, ELLIPSE_SIGMA, rtol=1e-5)
        assert len(ends) == 3 * 48


def test_negative_variances_from_rounding_give_ellipses_without_extent():
    given = estimates()
    rounded = replace(given, covariance=np.broadcast_to(-1e-18 * np.eye(5), given.covariance.shape))
    for ends, row in zip(lines("ellipse", rounded), by_class(), strict=True):
        assert_allclose(ends[:, :2] - given.state[row, [0, 2]], 0.0, atol=1e-6)


def test_velocities_point_where_the_targets_will_be():
    for ends, row in zip(lines("velocity"), by_class(), strict=True):
        state = estimates().state[row]
        here, ahead = ends[:2, :2]
        assert_allclose(here, state[[0, 2]])
        assert_allclose(ahead - here, VELOCITY_SECONDS * state[[1, 3]])
        # The head goes back from the tip to both sides.
        back = ends[[3, 5], :2] - ahead
        assert_allclose(ends[[2, 4], :2], [ahead, ahead])
        assert (back @ (ahead - here) < 0.0).all()
        assert_allclose(back.sum(axis=0) @ [-state[3], state[1]], 0.0, atol=1e-6)


@pytest.mark.parametrize(
    ("tracks", "numbers"), [([0, 0, 0], ["", "", ""]), ([7, 0, 12], ["7 ", "", "12 "])]
)
def test_labels_name_the_track_the_class_and_its_probability(tracks, numbers):
    given = replace(estimates(count=3), track_id=np.array(tracks))
    classes, shares = given.class_id, given.class_probability
    expected = [
        f"{numbers[row]}{NAMES[classes[row]]} {shares[row, classes[row]]:.0%}"
        for row in by_class(given)
    ]
    found = [m.text for m in made(given, NAMES) if m.type == Marker.TEXT_VIEW_FACING]
    assert found == expected


@pytest.mark.parametrize("classes", [2, 7])
def test_to_cdr_colours_by_class(classes):
    names = tuple(f"class_{index}" for index in range(classes))
    given = estimates(count=classes, classes=classes)
    colours = [(m.color.r, m.color.g, m.color.b) for m in made(given, names)[1::3]]
    hexadecimal = ["#" + "".join(f"{round(255 * part):02X}" for part in rgb) for rgb in colours]
    assert hexadecimal == [COLOURS[index % len(COLOURS)] for index in range(classes)]


def coordinates(array):
    return np.array([[p.x, p.y, p.z] for marker in array.markers for p in marker.points])


def without_points(array):
    # Empty arrays of bytes are not equal to each other; in words they are.
    return [str(type(m)(**{**fields(m), "points": []})) for m in array.markers]


def fields(message):
    return {name: getattr(message, name) for name in message.get_fields_and_field_types()}


@of_every_kind
# Frames of several lengths, so that markers begin at every alignment.
@pytest.mark.parametrize("frame", ["map", "world", "enu/origin"])
def test_to_cdr_equals_the_serialised_objects(found, frame):
    names = NAMES if found.class_probability.shape[1] == 2 else (*NAMES, "other")
    read = deserialize_message(markers.to_cdr(found, frame, names), MarkerArray)
    expected = as_sent(marker_array(found, frame, names))
    assert without_points(read) == without_points(expected)
    np.testing.assert_allclose(coordinates(read), coordinates(expected), rtol=0.0, atol=1e-9)


def test_class_colours_are_those_of_pictures_and_repeat():
    assert len(set(COLOURS)) == len(COLOURS)
    assert class_colour(len(COLOURS)) == class_colour(0)
    assert class_rgb(0) == (0.0, 0x72 / 255, 0xB2 / 255)
    assert [style.class_colour(k) for k in range(7)] == [class_colour(k) for k in range(7)]
