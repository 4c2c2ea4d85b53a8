"""Streams over sockets of the loopback interface, with receivers that are slow or not there."""

import socket
import threading
import time
from contextlib import suppress
from dataclasses import replace
from types import SimpleNamespace

import pytest
from refusals import faults_of
from samples import estimates, nothing
from sapient_msg.bsi_flex_335_v2_0.sapient_message_pb2 import SapientMessage

from msg_adapters.outgoing.outputs import View
from msg_adapters.targets.tracks import Trails
from phd_jdtc_ros.core.types import Pose
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.nodes.tracker import senders
from phd_jdtc_ros.nodes.tracker.senders import Senders, destination

VIEW = View(
    "map",
    ("class_0", "class_1"),
    (),
    SystemPlane((54.3, 10.2, 0.0)),
    Trails(1),
    own_pose=lambda stamp_ns: Pose((0.0, 0.0), 0.5, (1.0, 0.0)),
    stale_s=9.0,
)


@pytest.fixture
def made():
    """Return a function that makes senders; they are closed at the end."""
    found = []

    def make(outputs, *destinations):
        found.append(Senders({"outputs": outputs, "destinations": [*destinations]}))
        return found[-1]

    yield make
    for each in found:
        each.close()


def until(fits, timeout_s=10.0):
    end_s = time.monotonic() + timeout_s
    while not fits():
        assert time.monotonic() < end_s
        time.sleep(0.01)


def port_of(sock):
    return f"127.0.0.1:{sock.getsockname()[1]}"


def udp_receiver():
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", 0))
    sock.settimeout(10.0)
    return sock


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as sock:
        return sock.getsockname()[1]


def lines_of(sock, count):
    with sock.makefile("rb") as stream:
        return [stream.readline() for _ in range(count)]


def read_to_the_end(sock):
    """Read until the other side ends the connection; return the number of bytes."""
    count = 0
    with suppress(ConnectionResetError):
        while found := len(sock.recv(2**20)):
            count += found
    return count


@pytest.mark.parametrize(
    "text",
    [
        *(
            "",
            "127.0.0.1:10110",
            "udp://127.0.0.1:1",
            "nmea+udp://127.0.0.1",
            "ais+udp://127.0.0.1:1",
        ),
        *("nmea+udp://localhost:1", "nmea+http://127.0.0.1:80", "cot+tcp://127.0.0.1:0"),
        *("cot+tcp://239.2.3.1:6969", "nmea+listen://127.0.0.1:70000", "cot+udp://::1:5"),
        "sapient+udp://127.0.0.1:5020",
    ],
)
def test_destination_refuses_what_is_none(text):
    with pytest.raises(ValueError, match="must be one of nmea, cot, signalk, sapient, "):
        destination(text)


def test_destination_returns_its_parts():
    for text in (
        "cot+udp://239.2.3.1:6969",
        "signalk+tcp://127.0.0.1:1",
        "nmea+listen://0.0.0.0:1",
    ):
        assert str(destination(text)) == text


def test_udp_has_a_message_in_each_datagram(made):
    with udp_receiver() as nmea, udp_receiver() as other, udp_receiver() as cot:
        to = [f"nmea+udp://{port_of(nmea)}", f"nmea+udp://{port_of(other)}"]
        sender = made(["ttm", "tll", "markers", "cot"], *to, f"cot+udp://{port_of(cot)}")
        until(lambda: all(link.receivers for link in sender.links))
        sender.send(estimates(), VIEW)
        for sock in (nmea, other):
            kinds = [sock.recv(9999)[:6] for _ in range(4)]
            assert kinds == [b"$RATTM", b"$RATTM", b"$RATLL", b"$RATLL"]
        events = [cot.recv(9999) for _ in range(2)]
        assert all(event.endswith(b"</event>\n") for event in events)
        # An address without a receiver is no fault, and the next one gets what is sent later.
        other.close()
        for _ in range(3):
            sender.send(estimates(), VIEW)
        assert nmea.recv(9999)[:6] == b"$RATTM"
        assert not any(link.fault for link in sender.links)


def test_clients_connect_and_get_what_is_sent_from_then_on(made):
    port = free_port()
    sender = made(["tll"], f"nmea+listen://127.0.0.1:{port}")
    (link,) = sender.links
    # Nothing is encoded while nobody listens.
    sender.send(estimates(), SimpleNamespace())
    with socket.create_connection(("127.0.0.1", port), 10.0) as one:
        one.sendall(b"$GPRMC,a client may talk*00\r\n")
        until(lambda: link.receivers == 1)
        sender.send(estimates(), VIEW)
        assert [line[:6] for line in lines_of(one, 2)] == [b"$RATLL"] * 2
        with socket.create_connection(("127.0.0.1", port), 10.0) as two:
            until(lambda: link.receivers == 2)
            sender.send(replace(estimates(), stamp_ns=5), VIEW)
            assert lines_of(one, 2) == lines_of(two, 2)
    until(lambda: link.receivers == 0)
    assert link.fault == ""


def test_a_client_that_does_not_read_is_disconnected_and_others_are_served(made, monkeypatch):
    monkeypatch.setattr(senders, "MOST_BYTES", 2**16)
    port = free_port()
    sender = made(["cot"], f"cot+listen://127.0.0.1:{port}")
    (link,) = sender.links
    crowd, received = estimates(2000), []
    with (
        socket.create_connection(("127.0.0.1", port), 10.0) as stalled,
        socket.create_connection(("127.0.0.1", port), 10.0) as reader,
    ):
        until(lambda: link.receivers == 2)
        scans = 0
        while not link.stalled:
            sender.send(crowd, VIEW)
            scans += 1
            # A receiver that reads gets all before the next scan.
            while sum(received) < scans * 1999:
                received.append(reader.recv(2**20).count(b"</event>"))
        assert (link.stalled, link.receivers) == (1, 1)
        read_to_the_end(stalled)


class SlowPlane(SystemPlane):
    """A plane that is not ready before the scans are sent, as with many tracks."""

    used, sent = threading.Event(), threading.Event()

    def to_geodetic(self, x, y):
        self.used.set()
        assert self.sent.wait(10.0)
        return super().to_geodetic(x, y)


def test_scans_that_cannot_be_encoded_in_time_are_left_out_without_a_wait(made):
    with udp_receiver() as sock:
        sender = made(["cot"], f"cot+udp://{port_of(sock)}")
        (link,) = sender.links
        until(lambda: link.receivers)
        slow = replace(VIEW, plane=SlowPlane(VIEW.plane.origin))
        for number in range(20):
            sender.send(replace(estimates(), stamp_ns=number * 10**9), slow)
            assert slow.plane.used.wait(10.0)
        slow.plane.sent.set()
        stamps = [sock.recv(9999).partition(b'time="')[2][17:19] for _ in range(10)]
        # The one that is being encoded, and the newest that wait.
        assert stamps == [b"00"] * 2 + [b"%02d" % n for n in (16, 17, 18, 19) for _ in range(2)]


def test_tcp_is_connected_again(made, monkeypatch):
    monkeypatch.setattr(senders, "RETRY_S", 0.1)
    port = free_port()
    sender = made(["signalk"], f"signalk+tcp://127.0.0.1:{port}")
    (link,) = sender.links
    until(lambda: link.fault)
    assert link.fault == f"signalk+tcp://127.0.0.1:{port}: Connection refused"
    sender.send(estimates(), VIEW)
    for _ in range(2):
        with socket.create_server(("127.0.0.1", port)) as server:
            client, _ = server.accept()
            until(lambda: link.receivers and not link.fault)
            sender.send(estimates(), VIEW)
            assert [line[:11] for line in lines_of(client, 2)] == [b'{"context":'] * 2
            client.close()
        until(lambda: link.fault)
        assert not link.receivers


def test_a_port_that_is_in_use_is_refused(made):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        text = f"nmea+listen://{port_of(taken)}"
        (fault,) = faults_of(made, ["tll"], text)
    assert fault == f"destinations: {text} given, Address already in use"


def test_too_many_clients_are_turned_away(made, monkeypatch):
    monkeypatch.setattr(senders, "MOST_CLIENTS", 1)
    port = free_port()
    sender = made(["tll"], f"nmea+listen://127.0.0.1:{port}")
    with socket.create_connection(("127.0.0.1", port), 10.0) as one:
        until(lambda: sender.links[0].receivers == 1)
        with socket.create_connection(("127.0.0.1", port), 10.0) as two:
            assert read_to_the_end(two) == 0
        sender.send(estimates(), VIEW)
        assert lines_of(one, 1)[0][:6] == b"$RATLL"


def test_close_ends_all_without_a_word_and_may_come_twice(made, caplog):
    port = free_port()
    sender = made(["tll"], f"nmea+listen://127.0.0.1:{port}", "nmea+udp://127.0.0.1:9")
    with socket.create_connection(("127.0.0.1", port), 10.0) as client:
        until(lambda: sender.links[0].receivers == 1)
        sender.close()
        sender.close()
        assert read_to_the_end(client) == 0
    assert not caplog.messages
    socket.create_server(("127.0.0.1", port)).close()


def test_nothing_is_opened_for_outputs_that_are_off(made):
    sender = made(["markers", "cot"], f"nmea+listen://127.0.0.1:{free_port()}")
    assert not sender.links
    sender.send(nothing(), VIEW)


def test_each_connection_of_sapient_begins_with_a_registration(made):
    port = free_port()
    sender = made(["sapient"], f"sapient+listen://127.0.0.1:{port}")
    (link,) = sender.links

    def kinds_of(sock, count):
        found = []
        with sock.makefile("rb") as stream:
            for _ in range(count):
                size = int.from_bytes(stream.read(4), "little")
                message = SapientMessage.FromString(stream.read(size))
                found.append(message.WhichOneof("content"))
        return found

    expected = ["registration", "status_report", "detection_report", "detection_report"]
    clients = []  # A connection ends with its last reference
    for receivers in (1, 2):
        clients.append(socket.create_connection(("127.0.0.1", port), 10.0))
        until(lambda receivers=receivers: link.receivers == receivers)
        sender.send(estimates(), VIEW)
        assert kinds_of(clients[-1], 4) == expected
