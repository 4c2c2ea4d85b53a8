import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msg_adapters.encoding import stamps

SECONDS = 1_000_000_000


@settings(deadline=None)
@given(st.integers(-(2**31) * SECONDS, 2**31 * SECONDS - 1))
def test_stamps_survive_the_message_to_the_nanosecond(stamp_ns):
    message = stamps.from_ns(stamp_ns)
    assert 0 <= message.nanosec < SECONDS
    assert stamps.to_ns(message) == stamp_ns


@pytest.mark.parametrize(("kind", "order"), [(b"\0\0", ">"), (b"\0\1", "<")])
@settings(deadline=None)
@given(st.integers(-(2**31), 2**31 - 1), st.integers(0, SECONDS - 1))
def test_of_cdr_reads_either_byte_order(kind, order, sec, nanosec):
    data = kind + b"\0\0" + struct.pack(order + "iI", sec, nanosec) + b"\0\0\0\0"
    assert stamps.of_cdr(data) == sec * SECONDS + nanosec
