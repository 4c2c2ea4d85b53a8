import numpy as np
import pytest
from geometry_msgs.msg import PoseArray
from marker_messages import pose_array
from numpy.testing import assert_allclose, assert_array_equal
from rclpy.serialization import deserialize_message, serialize_message
from samples import STAMP_NS, as_sent, estimates, of_every_kind

from msg_adapters.encoding import stamps
from msg_adapters.targets import poses


def made(given, class_id, frame="map"):
    return deserialize_message(poses.to_cdr(given, class_id, frame), PoseArray)


@of_every_kind
# Frames of several lengths, so that the poses begin at every alignment.
@pytest.mark.parametrize("frame", ["map", "world", "enu/origin"])
def test_to_cdr_equals_the_serialised_objects(found, frame):
    for class_id in range(2):
        expected = pose_array(found, class_id, frame)
        assert made(found, class_id, frame) == as_sent(expected)
        # Nothing is missing at the end, where a reader would not notice.
        written = poses.to_cdr(found, class_id, frame)
        assert len(written) == len(serialize_message(expected))


def test_to_cdr_takes_one_class_and_faces_where_it_moves():
    given = estimates()
    message = made(given, 0)
    rows = given.state[[0, 2]]
    assert message.header == stamps.header(STAMP_NS, "map")
    found = np.array([[p.position.x, p.position.y, p.position.z] for p in message.poses])
    assert_array_equal(found, np.column_stack([rows[:, 0], rows[:, 2], np.zeros(2)]))
    for pose, row in zip(message.poses, rows, strict=True):
        q = pose.orientation
        speed = np.hypot(row[1], row[3])
        # The x axis turned by the quaternion.
        facing = [1.0 - 2.0 * q.z**2, 2.0 * q.z * q.w]
        assert_allclose(facing, [row[1] / speed, row[3] / speed], atol=1e-12)
        assert_allclose(q.x**2 + q.y**2 + q.z**2 + q.w**2, 1.0)
