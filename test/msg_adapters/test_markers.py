from dataclasses import replace

import numpy as np
import pytest
from marker_messages import marker_array
from numpy.testing import assert_allclose
from rclpy.serialization import deserialize_message, serialize_message
from samples import STAMP_NS, as_sent, estimates, many_estimates, nothing, with_heights
from visualization_msgs.msg import Marker, MarkerArray

from msg_adapters import markers, stamps
from msg_adapters.markers import ELLIPSE_SIGMA, LABEL_HEIGHT, LINE_WIDTH, VELOCITY_SECONDS
from msg_adapters.palette import COLOURS

NAMES = ("jet", "drone")
KINDS = {
    "ellipse": Marker.LINE_STRIP,
    "velocity": Marker.ARROW,
    "label": Marker.TEXT_VIEW_FACING,
}


def made(given=None, names=NAMES):
    data = markers.to_cdr(estimates() if given is None else given, "map", names)
    return deserialize_message(data, MarkerArray).markers


def of_kind(kind):
    return [marker for marker in made() if marker.ns.endswith(f"/{kind}")]


def floats(marker):
    points = [(p.x, p.y, p.z) for p in [*marker.points, marker.pose.position, marker.scale]]
    q, c = marker.pose.orientation, marker.color
    return [*np.ravel(points).tolist(), q.x, q.y, q.z, q.w, c.r, c.g, c.b, c.a]


def test_to_cdr_clears_first_and_only_once():
    first, *rest = made()
    assert first.action == Marker.DELETEALL
    assert {marker.action for marker in rest} == {Marker.ADD}


def test_to_cdr_of_no_estimates_only_clears():
    assert [marker.action for marker in made(nothing())] == [Marker.DELETEALL]


def test_to_cdr_gives_every_estimate_an_ellipse_a_velocity_and_a_label():
    found = [(marker.ns, marker.type) for marker in made()[1:]]
    expected = [
        (f"{NAMES[class_id]}/{kind}", shape)
        for class_id in estimates().class_id
        for kind, shape in KINDS.items()
    ]
    assert found == expected


def test_to_cdr_names_no_marker_twice():
    names = [(marker.ns, marker.id) for marker in made()[1:]]
    assert len(set(names)) == len(names)


def test_to_cdr_stamps_every_marker_alike():
    assert {(stamps.to_ns(m.header.stamp), m.header.frame_id) for m in made()} == {
        (STAMP_NS, "map")
    }


def test_to_cdr_holds_nothing_but_finite_floats():
    for marker in made()[1:]:
        values = floats(marker)
        assert {type(value) for value in values} == {float}
        assert np.isfinite(values).all()
        assert all(0.0 <= part <= 1.0 for part in values[-4:])


def test_to_cdr_stays_finite_for_a_covariance_that_is_not_definite():
    given = estimates()
    bad = given.covariance.copy()
    bad[:, 0, 0] = -1.0
    broken = type(given)(**{**vars(given), "covariance": bad})
    for marker in made(broken)[1:]:
        assert np.isfinite(floats(marker)).all()


def test_ellipses_are_the_closed_outline_of_the_covariance():
    given = estimates()
    for marker, state, covariance in zip(
        of_kind("ellipse"), given.state, given.covariance, strict=True
    ):
        outline = np.array([(point.x, point.y) for point in marker.points])
        assert_allclose(outline[0], outline[-1])
        offset = outline - state[[0, 2]]
        inverse = np.linalg.inv(covariance[np.ix_([0, 2], [0, 2])])
        distance = np.sqrt(np.einsum("ni,ij,nj->n", offset, inverse, offset))
        assert_allclose(distance, ELLIPSE_SIGMA, rtol=1e-6)
        assert marker.scale.x > 0.0


def test_velocities_point_where_the_targets_will_be():
    for marker, state in zip(of_kind("velocity"), estimates().state, strict=True):
        here, ahead = [(point.x, point.y) for point in marker.points]
        assert here == (state[0], state[2])
        assert_allclose(np.subtract(ahead, here), VELOCITY_SECONDS * state[[1, 3]])


@pytest.mark.parametrize(
    ("tracks", "numbers"), [([0, 0, 0], ["", "", ""]), ([7, 0, 12], ["7 ", "", "12 "])]
)
def test_labels_name_the_track_the_class_and_its_probability(tracks, numbers):
    given = replace(estimates(count=3), track_id=np.array(tracks))
    expected = [
        f"{number}{NAMES[k]} {share[k]:.0%}"
        for number, k, share in zip(numbers, given.class_id, given.class_probability, strict=True)
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


def test_sizes_are_legible_on_a_map_of_30_km():
    pixel = 30e3 / 1000.0
    assert 1.0 <= LINE_WIDTH / pixel <= 2.0
    assert 10.0 <= LABEL_HEIGHT / pixel <= 20.0
    # Slow targets have an arrow that is seen, fast ones none that crosses the map.
    assert 10.0 * VELOCITY_SECONDS / pixel >= 5.0
    assert 300.0 * VELOCITY_SECONDS / pixel <= 400.0


def coordinates(array):
    return np.array([[p.x, p.y, p.z] for marker in array.markers for p in marker.points])


def without_points(array):
    # Empty arrays of bytes are not equal to each other; in words they are.
    return [str(type(m)(**{**fields(m), "points": []})) for m in array.markers]


def fields(message):
    return {name: getattr(message, name) for name in message.get_fields_and_field_types()}


CASES = pytest.mark.parametrize(
    "found",
    [nothing(), estimates(), many_estimates(1), many_estimates(40)],
    ids=["none", "samples", "one", "many"],
)


@CASES
# Frames of several lengths, so that records begin at every alignment.
@pytest.mark.parametrize("frame", ["map", "world", "enu/origin"])
def test_to_cdr_says_what_the_objects_say(found, frame):
    names = NAMES if found.class_probability.shape[1] == 2 else (*NAMES, "other")
    read = deserialize_message(markers.to_cdr(found, frame, names), MarkerArray)
    expected = as_sent(marker_array(found, frame, names))

    assert without_points(read) == without_points(expected)
    np.testing.assert_allclose(coordinates(read), coordinates(expected), rtol=0.0, atol=1e-9)


def test_to_cdr_is_as_long_as_the_objects():
    # Nothing is missing at the end, where a reader would not notice.
    written = markers.to_cdr(many_estimates(7), "map", NAMES)
    assert len(written) == len(serialize_message(marker_array(many_estimates(7), "map", NAMES)))


def test_to_cdr_takes_each_stamp():
    # Layouts are kept from call to call; stamps must not be.
    for stamp_ns in (5_000_000_001, 2**31 * 10**9 - 1, -(2**31) * 10**9 + 1):
        found = replace(many_estimates(3), stamp_ns=stamp_ns)
        read = deserialize_message(markers.to_cdr(found, "map", NAMES), MarkerArray)
        assert {(m.header.stamp.sec, m.header.stamp.nanosec) for m in read.markers} == {
            divmod(stamp_ns, 10**9)
        }


def test_everything_is_at_the_height_of_its_target_and_in_the_plane_without_one():
    up = with_heights(estimates(count=3), [[3048.0, -5.0], [np.nan, np.nan], [900.0, 0.0]])
    found = made(up)
    assert found == as_sent(marker_array(up, "map", NAMES)).markers
    high, unknown, _ = (found[1 + 3 * k : 4 + 3 * k] for k in range(3))
    ellipse, velocity, label = high
    assert {point.z for point in ellipse.points} == {3048.0}
    assert [point.z for point in velocity.points] == [3048.0, 3048.0 - 5.0 * VELOCITY_SECONDS]
    assert label.pose.position.z == 3048.0
    assert all(point.z == 0.0 for marker in unknown for point in marker.points)
    assert unknown[2].pose.position.z == 0.0
