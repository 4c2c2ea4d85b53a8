import socket
import time

import pytest

from phd_jdtc_ros.asterix.transport.udp import MAX_BYTES, Address, Receiver

LARGE = bytes(60_000)


@pytest.fixture
def receiver():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        where = Address(*free.getsockname())
    made = Receiver([where], "", lambda: None)
    yield made, where
    made.close()


def sent(receiver, where, datagrams):
    """Send datagrams one after the other, each once the one before is received."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        for data in datagrams:
            before, until_s = receiver.received, time.monotonic() + 10.0
            sock.sendto(data, where)
            while receiver.received == before and time.monotonic() < until_s:
                time.sleep(1e-3)


def test_receiver_bounds_the_bytes_that_wait_and_counts_the_rest(receiver):
    made, where = receiver
    room = MAX_BYTES // len(LARGE)
    sent(made, where, [LARGE] * (room + 5))
    assert (made.waiting, made.lost) == (room, 5)


def test_receiver_has_room_again_for_what_was_taken(receiver):
    made, where = receiver
    room = MAX_BYTES // len(LARGE)
    sent(made, where, [LARGE] * (room + 1))
    assert made.take().data == LARGE
    sent(made, where, [b"abc" + LARGE[3:]])
    found = [made.take().data[:3] for _ in range(room)]
    assert found == [bytes(3)] * (room - 1) + [b"abc"]
    assert made.take() is None
    assert made.lost == 1
