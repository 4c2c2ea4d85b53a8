"""Messages written as bytes against the same messages made of objects."""

from dataclasses import replace

import numpy as np
import pytest
from geometry_msgs.msg import PoseArray
from rclpy.serialization import deserialize_message, serialize_message
from samples import estimates, nothing
from visualization_msgs.msg import MarkerArray

from msg_adapters import estimates as estimate_adapter
from msg_adapters import markers, serialised
from phd_jdtc_ros.core.types import Estimates

NAMES = ("jet", "aéronef")


def many(count):
    rng = np.random.default_rng(count)
    root = rng.standard_normal((count, 5, 5))
    probability = rng.dirichlet([0.3, 0.3], count)
    return Estimates(
        stamp_ns=1_500_000_007,
        lag=0,
        state=100.0 * rng.standard_normal((count, 5)),
        covariance=100.0 * root @ root.transpose(0, 2, 1),
        weight=np.ones(count),
        class_probability=probability,
        class_id=probability.argmax(axis=1),
        track_id=np.zeros(count, dtype=int),
    )


def as_sent(message):
    """Return a message as its receiver has it: colours are of single precision."""
    return deserialize_message(serialize_message(message), type(message))


def coordinates(array):
    return np.array([[p.x, p.y, p.z] for marker in array.markers for p in marker.points])


def without_points(array):
    # Empty arrays of bytes are not equal to each other; in words they are.
    return [str(type(m)(**{**fields(m), "points": []})) for m in array.markers]


def fields(message):
    return {name: getattr(message, name) for name in message.get_fields_and_field_types()}


CASES = pytest.mark.parametrize(
    "found", [nothing(), estimates(), many(1), many(40)], ids=["none", "samples", "one", "many"]
)


@CASES
# Frames of several lengths, so that records begin at every alignment.
@pytest.mark.parametrize("frame", ["map", "world", "enu/origin"])
def test_marker_array_is_that_of_the_objects(found, frame):
    names = NAMES if found.class_probability.shape[1] == 2 else (*NAMES, "other")
    read = deserialize_message(serialised.marker_array(found, frame, names), MarkerArray)
    expected = as_sent(markers.to_msg(found, frame, names))

    assert without_points(read) == without_points(expected)
    np.testing.assert_allclose(coordinates(read), coordinates(expected), rtol=0.0, atol=1e-9)


@CASES
@pytest.mark.parametrize("frame", ["map", "world"])
def test_pose_array_is_that_of_the_objects(found, frame):
    for class_id in range(2):
        read = deserialize_message(serialised.pose_array(found, class_id, frame), PoseArray)
        assert read == as_sent(estimate_adapter.to_pose_array(found, class_id, frame))


def test_marker_array_is_as_long_as_that_of_the_objects():
    # Nothing is missing at the end, where a reader would not notice.
    written = serialised.marker_array(many(7), "map", NAMES)
    assert len(written) == len(serialize_message(markers.to_msg(many(7), "map", NAMES)))


def test_marker_array_takes_each_stamp():
    # Layouts are kept from call to call; stamps must not be.
    for stamp_ns in (5_000_000_001, 2**31 * 10**9 - 1, -(2**31) * 10**9 + 1):
        found = replace(many(3), stamp_ns=stamp_ns)
        read = deserialize_message(serialised.marker_array(found, "map", NAMES), MarkerArray)
        assert {(m.header.stamp.sec, m.header.stamp.nanosec) for m in read.markers} == {
            divmod(stamp_ns, 10**9)
        }
