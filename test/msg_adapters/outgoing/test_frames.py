"""The radars' frames, read by an independent decoder."""

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from msg_adapters.encoding import names
from msg_adapters.outgoing import frames
from msg_adapters.outgoing.frames import Mounting

STORE = get_typestore(Stores.ROS2_JAZZY)
STAMP_NS = 1_700_000_000_123_456_789


def decoded(mountings, world="map"):
    data = frames.to_cdr(mountings, STAMP_NS, world)
    return STORE.deserialize_cdr(data, names.TRANSFORMS).transforms


def test_to_cdr_places_every_frame_in_the_world():
    mast = Mounting("mast", (1000.0, -20.5), 2.0)
    first, second = decoded([mast, Mounting("radar_number_two", (0.0, 3.0), 0.0)], "site")
    assert (first.header.frame_id, first.child_frame_id) == ("site", "mast")
    assert (first.header.stamp.sec, first.header.stamp.nanosec) == divmod(STAMP_NS, 10**9)
    where = first.transform.translation
    assert (where.x, where.y, where.z) == (1000.0, -20.5, 0.0)
    assert second.child_frame_id == "radar_number_two"
    assert second.transform.rotation.w == 1.0


@pytest.mark.parametrize("yaw", [0.0, 1.0, np.pi, -3.0])
def test_to_cdr_turns_a_frame_counter_clockwise(yaw):
    ((transform),) = decoded([Mounting("mast", (0.0, 0.0), yaw)])
    q = transform.transform.rotation
    # The x axis of the radar, in the world frame.
    ahead = (q.w**2 - q.z**2, 2.0 * q.w * q.z)
    assert (q.x, q.y) == (0.0, 0.0)
    np.testing.assert_allclose(ahead, (np.cos(yaw), np.sin(yaw)), atol=1e-12)


def test_to_cdr_leaves_out_a_radar_in_the_world_frame_itself():
    assert decoded([Mounting("map", (0.0, 0.0), 0.0)]) == []
