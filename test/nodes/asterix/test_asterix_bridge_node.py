"""The live bridge between UDP on the loopback interface, DDS and a tracker."""

import socket
import time
from contextlib import closing
from functools import partial

import asterix_records as made
import estimate_sets
import forked
import numpy as np
import pytest
from asterix_reference import decoded, value
from live_radars import Health, change
from sensor_msgs.msg import PointCloud2

from msg_adapters.incoming import detections
from msg_adapters.outgoing import diagnostics
from msg_adapters.targets import estimates
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.transport import sockets

pytestmark = pytest.mark.live
# The specifications, which take a second.
forked.preload("asterix.generated")

LOOPBACK = "127.0.0.1"
GROUP = "239.255.86.1"
TOPIC = "/radar_1_2/detections"
SEEN = [(10.0, 20.0), (100.0, 30.0), (190.0, 40.0), (350.0, 50.0)]
NAMED = ("-p", "radars:=[radar_1_2]", "-p", "radar_1_2.source:=[1, 2]")
# A recording is sent faster than it was made, so that its times are not those of its receipt.
ANY_TIME = ("-p", "max_clock_offset_s:=86400.0")
LAYOUT = {
    "sensors": ["radar_1_2"],
    "radar_1_2.max_range": 200e3,
    "radar_1_2.clutter_max_range": 200e3,
    "radar_1_2.fields.amplitude": "",
    "radar_1_2.fields.time": "time",
    "radar_1_2.fields.sector": "sector",
    "radar_1_2.rotation_s": 4.0,
    "radar_1_2.sectors": 32,
}


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((LOOPBACK, 0))
        return sock.getsockname()[1]


def today_s(before_s=0.0):
    """Return a time of day some seconds ago, far enough from midnight for a few revolutions."""
    now = time.time() % 86_400
    return (now - before_s) % 86_400


class Site:
    """A bridge, and sockets of a radar and of a display beside it."""

    def __init__(self, processes, peer, host):
        self.peer = peer
        self.host = host
        self.port, self.display = free_port(), sockets.Address(LOOPBACK, free_port())
        self.processes = processes
        self._sockets = []
        self.clouds = peer.collect(PointCloud2, TOPIC, 1000)
        self.health = Health(peer, "/asterix_bridge")
        self._tracks = sockets.receiving_socket(self.display, "")

    def start(self, *arguments, named=NAMED):
        """Start the bridge and wait until it receives."""
        given = ["-p", f"inputs:=['{self.host}:{self.port}']", "-p", f"interface:={LOOPBACK}"]
        given += ["-p", f"output:='{self.display}'", *named, *ANY_TIME, *arguments]
        process = self.processes.start("asterix_bridge", "--ros-args", *given)
        self.peer.said(process, "receiving")
        self.peer.meet("/asterix_bridge")
        return process

    def radar(self, host=LOOPBACK):
        """Return a socket that sends to the bridge from an address of this machine."""
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(LOOPBACK))
        sock.bind((host, 0))
        sock.connect((self.host, self.port))
        self._sockets.append(sock)
        return sock

    def send(self, blocks, sock=None):
        """Send datagrams, and wait now and then until the bridge has taken them."""
        radar = sock or self.radar()
        for block in blocks:
            radar.send(block)

    def tracks(self):
        """Return the records that the display has received since the last time."""
        found = []
        while True:
            try:
                found += decoded(self._tracks.recv(65_535))
            except BlockingIOError:
                return found

    def close(self):
        for sock in (*self._sockets, self._tracks):
            sock.close()


@pytest.fixture(params=[LOOPBACK, GROUP], ids=["unicast", "multicast"])
def site(request, processes, peer):
    with closing(Site(processes, peer, request.param)) as found:
        yield found


@pytest.fixture
def unicast(processes, peer):
    with closing(Site(processes, peer, LOOPBACK)) as found:
        yield found


def test_datagrams_become_clouds(site):
    site.start()
    site.send(made.revolutions(2, start_s=today_s(), seen=SEEN, rotation_s=4.0))
    assert site.peer.spin_until(lambda: len(site.clouds) >= 64)
    radar = resolve(LAYOUT).inputs[0]
    reports = [detections.from_msg(cloud, radar) for cloud in site.clouds]
    assert sum(len(report.detections) for report in reports) == 8
    stamps = np.array([report.stamp_ns for report in reports])
    assert abs(stamps[0] * 1e-9 - time.time()) < 60.0
    np.testing.assert_allclose(np.diff(stamps), 125e6, atol=1)
    numbers = {report.sector for report in reports if len(report.detections)}
    assert numbers == {7, 31, 23, 8}


def test_tracks_are_of_one_radar_until_another_reports(unicast, peer):
    unicast.start("-p", "output_period_s:=0.0", named=())
    topic = "/tracker/filtered/estimates"
    publisher = peer.node.create_publisher(PointCloud2, topic, 10)
    assert peer.spin_until(lambda: publisher.get_subscription_count() > 0)
    found = estimate_sets.of_tracks({1: (0.0, 0.0)}, variance=np.ones(5), stamp_ns=10**9)
    said = []
    for sic in (2, 3):
        unicast.send(made.revolutions(1, start_s=today_s(), sic=sic))
        unicast.health.until(f"radar_1_{sic}", lambda status, values: int(values["clouds"]) > 0)
        publisher.publish(estimates.to_msg(found, "map"))
        records = []

        def come(records=records):
            records += [each for each in unicast.tracks() if each["category"] == 62]
            return records

        assert peer.spin_until(come)
        said.append(value(records[0], "I080", "MON"))
    assert said == [1, 0]


def test_accuracy_of_predicted_tracks_has_the_live_trackers_process_noise(unicast, peer):
    # In three seconds a white acceleration of this density moves a target by 30 m.
    loud = [f"{motion}.noise_density:=100.0" for motion in ("calm", "cv", "ct")]
    given = [word for each in loud for word in ("-p", each)]
    tracker = unicast.processes.start("tracker", "--ros-args", *given)
    peer.said(tracker, "tracking ")
    unicast.start("-p", "output_period_s:=0.2")
    publisher = peer.node.create_publisher(PointCloud2, "/tracker/filtered/estimates", 10)
    assert peer.spin_until(lambda: publisher.get_subscription_count() > 0)

    def accuracy():
        ago_ns = time.time_ns() - 3 * 10**9
        parts = {"stamp_ns": ago_ns, "class_probability": np.array([[0.5, 0.5]])}
        found = estimate_sets.of_tracks({1: (0.0, 0.0)}, variance=np.full(5, 1e-6), **parts)
        publisher.publish(estimates.to_msg(found, "map"))
        peer.spin(0.3)
        records = [each for each in unicast.tracks() if each["category"] == 62]
        return max((value(each, "I500", "APC", "APC_X") for each in records), default=0.0)

    assert peer.spin_until(lambda: 25.0 < accuracy() < 60.0)


def test_hostile_datagrams_are_counted_and_change_nothing(unicast):
    process = unicast.start()
    rng = made.rng(5)
    good = [*made.revolutions(1, start_s=today_s(), seen=SEEN)]
    for block in good:
        unicast.send([block, rng.bytes(int(rng.integers(1, 200))), b"\x30\xff\xff" + bytes(100)])
        unicast.send([b"\x30\x00\x05\xff\xff", block[:-1]])
    unicast.health.until("radar_1_2", lambda _, values: values["clouds"] == "32")
    status = unicast.health.until("input", lambda _, values: int(values["block_truncated"]) >= 66)
    assert status.level == b"\x01"
    assert "malformed" in status.message
    assert process.poll() is None


def test_second_radar_of_a_number_and_a_wrong_clock_are_reported(unicast):
    unicast.start("-p", "max_clock_offset_s:=10.0")
    blocks = [*made.revolutions(1, start_s=today_s(7200.0))]
    first, second = unicast.radar(), unicast.radar("127.0.0.2")
    for block in blocks:
        unicast.send([block], first)
    unicast.health.until("radar_1_2", lambda status, _: "its clock is" in status.message)
    for block in blocks:
        unicast.send([block], second)
    status = unicast.health.until("radar_1_2", lambda status, _: "two sources" in status.message)
    values = diagnostics.values_of(status)
    assert values["second_source"] == str(len(blocks))
    assert float(values["clock_shift_s"]) == pytest.approx(7200.0, abs=60.0)
    assert "127.0.0.1 to" in status.message
    assert "127.0.0.2 to" in status.message


def test_bridge_that_receives_nothing_says_so_and_fails(unicast):
    process = unicast.start()
    unicast.peer.said(process, f"on {LOOPBACK}:{unicast.port}; check the address and port")
    process.terminate()
    assert process.wait(10.0) == 1
    assert f"nothing was received on {LOOPBACK}:{unicast.port}" in process.log.read_text()


def test_bridge_stops_and_starts_again_on_request(unicast):
    process = unicast.start("-p", "autostart:=true")
    bridge = partial(change, unicast.peer, node="/asterix_bridge")
    # From here on the address is free, and taken again.
    assert bridge("DEACTIVATE")
    other = sockets.receiving_socket(sockets.Address(LOOPBACK, unicast.port), "")
    assert not bridge("ACTIVATE")
    other.close()
    assert bridge("ACTIVATE")
    unicast.send(made.revolutions(1, start_s=today_s()))
    unicast.health.until("radar_1_2", lambda _, values: values["clouds"] == "32")
    process.terminate()
    assert process.wait(10.0) == 0
    assert "stopped; radar_1_2 0 plots in 32 clouds; 0 tracks sent" in process.log.read_text()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["inputs:=['host:1']"], "inputs: host:1 given, must be an IPv4 address and a port"),
        (["output:=239.1.1.1"], "output: 239.1.1.1 given, must be"),
        (["interface:=eth0"], "interface: eth0 given, must be an IPv4 address"),
        (["world_origin:=[95.0, 0.0, 0.0]"], "world_origin: [95.0, 0.0, 0.0] given"),
        (["inputs:=['192.0.2.1:8600']"], "192.0.2.1:8600: "),
    ],
)
def test_wrong_parameters_end_the_node(processes, arguments, expected):
    given = [word for argument in arguments for word in ("-p", argument)]
    status, log = processes.run("asterix_bridge", "--ros-args", *given)
    assert status == 2
    assert expected in log
    assert "Traceback" not in log


def test_positions_of_aircraft_become_clouds_of_reports(processes, peer):
    with closing(Site(processes, peer, LOOPBACK)) as site:
        clouds = peer.collect(PointCloud2, "/adsb_25_3/reports", 100)
        site.start(named=())
        who, place = (("SAC", 25), ("SIC", 3)), (("LAT", 52.0), ("LON", 4.5))
        for k in range(3):
            squitter = {"040": ((0, 0, 0, 0, None),), "131": place, "080": 0x40621D + 3 * k}
            now = made.ticks(today_s())
            site.send([made.block(21, [{"010": who, "071": now, **squitter}])])
        # The rest of them is sent without waiting for a next one.
        assert peer.spin_until(lambda: sum(cloud.width for cloud in clouds) == 3)
        status = site.health.until("adsb_25_3", lambda _, found: found["positions"] == "3")
        assert status.message.startswith("3 positions in ")
