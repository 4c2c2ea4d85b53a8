"""Receiving from streams: servers that end and come back, and serial lines."""

import os
import pty
import socket
import time
from contextlib import closing

import pytest

from phd_jdtc_ros.transport import sockets
from phd_jdtc_ros.transport.sockets import Address, Receiver, Serial, Tcp, input_of

LOOPBACK = "127.0.0.1"


@pytest.fixture(autouse=True)
def soon(monkeypatch):
    monkeypatch.setattr(sockets, "RETRY_S", 0.05)


def server(port=0):
    return socket.create_server((LOOPBACK, port))


def taken(found, count, timeout_s=20.0):
    """Return the next pieces of data of a receiver."""
    pieces, until_s = [], time.monotonic() + timeout_s
    while len(pieces) < count and time.monotonic() < until_s:
        piece = found.take()
        if piece is None:
            time.sleep(0.01)
        else:
            pieces.append(piece)
    return pieces


def wait(what, timeout_s=20.0):
    until_s = time.monotonic() + timeout_s
    while not what() and time.monotonic() < until_s:
        time.sleep(0.01)
    assert what()


@pytest.mark.parametrize(
    ("text", "made"),
    [
        ("127.0.0.1:8600", Address("127.0.0.1", 8600)),
        ("udp://239.1.1.1:8600", Address("239.1.1.1", 8600)),
        ("tcp://localhost:30003", Tcp("localhost", 30003)),
        ("serial:/dev/ttyUSB0:4800", Serial("/dev/ttyUSB0", 4800)),
        ("serial:/dev/ttyUSB0", Serial("/dev/ttyUSB0", 38400)),
    ],
)
def test_inputs_are_told_by_their_form(text, made):
    assert input_of(text) == made


@pytest.mark.parametrize(
    "text",
    [
        "",
        "tcp://host",
        "tcp://:1",
        "tcp://h:99999",
        "serial:",
        "serial:/dev/x:17",
        "host:1",
        "1:2:3",
    ],
)
def test_other_inputs_are_refused_with_the_forms(text):
    with pytest.raises(ValueError, match="must be an IPv4 address"):
        input_of(text)


def test_a_server_is_read_in_order_with_times_of_receipt():
    with server() as here:
        before_ns = time.time_ns()
        with closing(Receiver([Tcp(LOOPBACK, here.getsockname()[1])], "", lambda: None)) as found:
            there, _ = here.accept()
            with there:
                there.sendall(b"one ")
                first = taken(found, 1)
                there.sendall(b"two")
                (second,) = taken(found, 1)
    assert b"".join(piece.data for piece in [*first, second]) == b"one two"
    assert before_ns <= first[0].received_ns <= second.received_ns <= time.time_ns()
    assert first[0].source == second.source


def test_a_server_that_ends_and_comes_back_is_a_new_source():
    with server() as here:
        port = here.getsockname()[1]
        found = Receiver([Tcp(LOOPBACK, port)], "", lambda: None)
        there, _ = here.accept()
        there.sendall(b"half a li")
        (first,) = taken(found, 1)
        there.close()
    with closing(found):
        wait(lambda: found.disconnected)
        assert found.ended.total() >= 1
        with server(port) as here:
            there, _ = here.accept()
            with there:
                there.sendall(b"a line")
                (second,) = taken(found, 1)
                assert not found.disconnected
    assert second.source != first.source


def test_a_server_that_is_not_there_is_named_and_does_not_delay_others():
    with server() as here:
        port = here.getsockname()[1]
    inputs = [Tcp(LOOPBACK, port), Tcp("no.such.host.invalid", 1), Address(LOOPBACK, free_port())]
    with closing(Receiver(inputs, "", lambda: None)) as found:
        wait(lambda: len(found.disconnected) == 2)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.sendto(b"here", inputs[2])
        assert [piece.data for piece in taken(found, 1)] == [b"here"]


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((LOOPBACK, 0))
        return sock.getsockname()[1]


def test_a_serial_line_is_read_as_it_is():
    ours, theirs = pty.openpty()
    path = os.ttyname(theirs)
    with closing(Receiver([Serial(path, 38400)], "", lambda: None)) as found:
        # A terminal would turn the carriage return into a line feed.
        wait(lambda: found._streams[0].opened)
        os.write(ours, b"!AIVDM\r\n\x1a\x03")
        pieces = taken(found, 1)
        assert b"".join(piece.data for piece in pieces) == b"!AIVDM\r\n\x1a\x03"
        os.close(theirs)
        os.close(ours)
        wait(lambda: found.disconnected)


def test_what_is_no_serial_line_is_named(tmp_path):
    (tmp_path / "file").write_bytes(b"x")
    inputs = [Serial(str(tmp_path / "file"), 4800), Serial(str(tmp_path / "none"), 4800)]
    with closing(Receiver(inputs, "", lambda: None)) as found:
        wait(lambda: len(found.disconnected) == 2)
        reasons = sorted(found.disconnected.values())
    assert reasons == ["No such file or directory", "is no serial line"]


def test_streams_share_the_bound_of_what_waits():
    with server() as here:
        found = Receiver([Tcp(LOOPBACK, here.getsockname()[1])], "", lambda: None)
        there, _ = here.accept()
    with closing(found), there:
        for _ in range(40):
            there.sendall(bytes(65_535))
        wait(lambda: found.lost)
        kept = sum(len(piece.data) for piece in taken(found, found.waiting))
    assert 0 < kept <= sockets.MAX_BYTES
