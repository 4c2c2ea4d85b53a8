import numpy as np
import pytest
from numpy.testing import assert_array_equal
from samples import STAMP_NS, truth
from sensor_msgs.msg import PointField

from msg_adapters.encoding import RejectedMessageError, stamps
from msg_adapters.targets import truth as adapter
from phd_jdtc_ros.core.types import Truth

F4, U4 = PointField.FLOAT32, PointField.UINT32


def test_to_msg_keeps_the_contract_of_the_topic():
    message = adapter.to_msg(truth(), "map")
    assert [(f.name, f.datatype) for f in message.fields] == [
        *((name, F4) for name in ("x", "y", "z", "vx", "vy", "vz")),
        *((name, U4) for name in ("track_id", "class_id")),
    ]
    assert message.header == stamps.header(STAMP_NS, "map")


def test_to_msg_takes_the_state_apart_as_x_vx_y_vy():
    given = Truth(0, np.array([[1.0, 2.0, 3.0, 4.0, 0.0]]), np.array([9]), np.array([1]))
    data = bytes(adapter.to_msg(given, "map").data)
    assert_array_equal(np.frombuffer(data[:24], "<f4"), [1.0, 3.0, 0.0, 2.0, 4.0, 0.0])
    assert_array_equal(np.frombuffer(data[24:], "<u4"), [9, 1])


@pytest.mark.parametrize("count", [0, 1, 5])
def test_truth_survives_the_message_exactly(count):
    given = truth(count)
    found = adapter.from_msg(adapter.to_msg(given, "map"))
    assert found.stamp_ns == given.stamp_ns
    for name in ("state", "track_id", "class_id"):
        assert_array_equal(getattr(found, name), getattr(given, name))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_from_msg_refuses_what_is_not_finite(bad):
    message = adapter.to_msg(truth(), "map")
    message.data = np.float32(bad).tobytes() + bytes(message.data)[4:]
    with pytest.raises(RejectedMessageError):
        adapter.from_msg(message)
