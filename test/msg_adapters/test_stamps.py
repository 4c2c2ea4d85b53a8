import struct

import pytest
from builtin_interfaces.msg import Time
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from samples import STAMP_NS, cloud

from msg_adapters import stamps

SECONDS = 1_000_000_000


@settings(deadline=None)
@given(st.integers(-(2**31) * SECONDS, 2**31 * SECONDS - 1))
def test_stamps_survive_the_message_to_the_nanosecond(stamp_ns):
    message = stamps.from_ns(stamp_ns)
    assert 0 <= message.nanosec < SECONDS
    assert stamps.to_ns(message) == stamp_ns


def test_to_ns_adds_seconds_and_nanoseconds():
    assert stamps.to_ns(Time(sec=3, nanosec=7)) == 3_000_000_007


def test_from_ns_counts_nanoseconds_upward_before_the_epoch():
    assert stamps.from_ns(-1) == Time(sec=-1, nanosec=999_999_999)


def test_header_carries_stamp_and_frame():
    header = stamps.header(STAMP_NS, "map")
    assert (header.stamp.sec, header.stamp.nanosec) == divmod(STAMP_NS, SECONDS)
    assert header.frame_id == "map"


def test_of_cdr_reads_what_the_middleware_wrote():
    assert stamps.of_cdr(serialize_message(cloud([], []))) == STAMP_NS


@pytest.mark.parametrize(("kind", "order"), [(b"\0\0", ">"), (b"\0\1", "<")])
@settings(deadline=None)
@given(st.integers(-(2**31), 2**31 - 1), st.integers(0, SECONDS - 1))
def test_of_cdr_reads_either_byte_order(kind, order, sec, nanosec):
    data = kind + b"\0\0" + struct.pack(order + "iI", sec, nanosec) + b"\0\0\0\0"
    assert stamps.of_cdr(data) == sec * SECONDS + nanosec
