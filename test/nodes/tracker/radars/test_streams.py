"""What a live tracker on a ship sends to other programs, read by their own libraries."""

import math
import socket
from contextlib import suppress

import moving
import numpy as np
import pytest
from live_and_offline import started
from moving_messages import CLOUDS, sent
from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import stamps
from phd_jdtc_ros.configuration.schema import flatten
from phd_jdtc_ros.earth import SystemPlane

pynmea2 = pytest.importorskip("pynmea2")
takproto = pytest.importorskip("takproto")
ORIGIN = [54.3, 10.2, 0.0]
MILE = 1852.0


def receiver():
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2**20)
    sock.bind(("127.0.0.1", 0))
    sock.setblocking(False)
    return sock, f"udp://127.0.0.1:{sock.getsockname()[1]}"


def received(sock, found):
    """Add all datagrams that have come."""
    with suppress(BlockingIOError):
        while True:
            found.append(sock.recv(65535))
    return found


def test_a_ships_targets_are_sent_as_nmea_and_as_cursor_on_target(processes, peer, tmp_path):
    (nmea, nmea_to), (cot, cot_to) = receiver(), receiver()
    given = {
        **dict(flatten(moving.PARAMETERS)),
        "world_origin": ORIGIN,
        "outputs": ["ttm", "ttm_relative", "tll", "cot"],
        "destinations": [f"nmea+{nmea_to}", f"cot+{cot_to}"],
        "cot_types": ["a-u-S"],
    }
    types = {CLOUDS: PointCloud2, moving.ODOMETRY: Odometry}
    outputs, found, _ = started(processes, peer, tmp_path, given, types)
    messages = sent()
    for topic, data, stamp_ns in messages:
        outputs[topic].publish(data)
        if topic == moving.ODOMETRY:
            due = sum(other == CLOUDS and ns <= stamp_ns for other, _, ns in messages)
            assert peer.spin_until(lambda due=due: len(found) >= due)
    # The last scan but one: the last waits for a pose that never comes.
    time_s = (moving.SCANS - 2) * moving.INTERVAL_S
    stamp_ns = moving.stamp(time_s)
    clock = stamp_ns // 10**9 % 86400
    of_scan = f' time="{stamps.to_iso(stamp_ns)}"'.encode()
    lines, texts = [], []

    def sentences_of_scan():
        found = [pynmea2.parse(each.decode(), check=True) for each in received(nmea, lines)]
        return [
            each
            for each in found
            if each.sentence_type != "OSD"
            and each.timestamp.hour * 3600 + each.timestamp.minute * 60 + each.timestamp.second
            == clock
        ]

    def are_complete():
        # Each of the three outputs in sentences has the targets of the events, sent in any order.
        events = sum(of_scan in each for each in received(cot, texts))
        return events > 1 and len(sentences_of_scan()) >= 3 * events

    with nmea, cot:
        assert peer.spin_until(are_complete)
        now = sentences_of_scan()
    events = [takproto.parse_proto(bytearray(each)).cotEvent for each in texts]

    own, heading = moving.antenna(time_s)[0], moving.ship(time_s).yaw
    boats = moving.boats(time_s)
    expected = np.array([[math.dist(own, boat) / MILE] for boat in boats]).ravel()
    bearings = [math.degrees(math.atan2(*(boat - own))) % 360.0 for boat in boats]
    bow = 90.0 - math.degrees(heading)
    for reference, zero in (("T", 0.0), ("R", bow)):
        own_targets = [
            each for each in now if each.sentence_type == "TTM" and each.brg_ref == reference
        ]
        for distance, bearing, velocity in zip(
            expected, bearings, moving.BOATS[:, 2:], strict=True
        ):
            found_one = min(own_targets, key=lambda e, d=distance: abs(float(e.distance) - d))
            assert float(found_one.distance) == pytest.approx(distance, abs=30.0 / MILE)
            apart = float(found_one.bearing) - (bearing - zero)
            assert abs((apart + 180.0) % 360.0 - 180.0) < 3.0
            assert float(found_one.speed) == pytest.approx(
                math.hypot(*velocity) * 3600.0 / MILE, abs=2.0
            )
    # The numbers stay with the targets, and are those of both sentences.
    numbers = {each.sentence_type: set() for each in now}
    for each in now:
        numbers[each.sentence_type].add(each.target_number)
    assert numbers["TTM"] == numbers["TLL"]
    plane = SystemPlane(ORIGIN)
    last = [event for event in events if event.sendTime == stamp_ns // 10**6]
    places = [plane.to_plane(each.latitude, each.longitude) for each in now if hasattr(each, "lat")]
    assert len(places) == len(last) >= 2
    for event in last:
        x, y = plane.to_plane(event.lat, event.lon)
        assert np.hypot(*(np.transpose(places) - [[x], [y]])).min() < 1.0
        assert event.type == "a-u-S"
        assert 0.0 < event.ce < 30.0
        assert event.staleTime - event.sendTime == 3 * 2000
    every = [pynmea2.parse(each.decode(), check=True) for each in lines]
    headings = [float(each.data[0]) for each in every if each.sentence_type == "OSD"]
    assert headings[-1] == pytest.approx(bow % 360.0, abs=0.2)
