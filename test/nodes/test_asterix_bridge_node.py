"""The live bridge between UDP on the loopback interface, DDS and a tracker."""

import socket
import time

import asterix_records as made
import estimate_sets
import numpy as np
import pytest
import yaml
from asterix_reference import decoded, value
from bag_content import messages
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters import detections, diagnostics, estimates, interfaces, names
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.asterix.transport import udp
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.schema import flatten
from phd_jdtc_ros.core.types import SOURCES

pytestmark = pytest.mark.live

LOOPBACK = "127.0.0.1"
GROUP = "239.255.86.1"
TOPIC = "/radar_1_2/detections"
SEEN = [(10.0, 20.0), (100.0, 30.0), (190.0, 40.0), (350.0, 50.0)]
NAMED = ("-p", "radars:=[radar_1_2]", "-p", "radar_1_2.source:=[1, 2]")
# A recording is sent faster than it was made, so that its times are not those of its receipt.
ANY_TIME = ("-p", "max_clock_offset_s:=86400.0")
TRACKER = {
    "engine": "gaussian",
    "sensors": ["radar_1_2"],
    "interval_s": 4.0,
    "lag": "4 s",
    "classes": ["aircraft"],
    "motions": ["cv"],
    "births": [],
    "detection_births": {"rates": [0.1], "velocity_std": 150.0},
    "spawn": {"rate": 0.0},
    "amplitude": "none",
    "aircraft": {"motions": ["cv"], "mode_transition": [1.0]},
    "cv": {"noise_density": 5.0},
    "radar_1_2": {
        "fields": {
            "amplitude": "",
            "time": "time",
            "sector": "sector",
            "code": "code",
            "address": "address",
        },
        "rotation_s": 4.0,
        "sectors": 32,
        "detection_probability": 0.95,
        "range_std": 30.0,
        "azimuth_std_deg": 0.1,
        "max_range": 200e3,
        "clutter_rate": 1.0,
        "clutter_max_range": 200e3,
    },
}


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((LOOPBACK, 0))
        return sock.getsockname()[1]


def today_s(before_s=0.0):
    """Return a time of day some seconds ago, far enough from midnight for a few turns."""
    now = time.time() % 86_400
    return (now - before_s) % 86_400


class Site:
    """A bridge, and sockets of a radar and of a display beside it."""

    def __init__(self, processes, peer, host):
        self.peer = peer
        self.host = host
        self.port, self.display = free_port(), udp.Address(LOOPBACK, free_port())
        self.processes = processes
        self._sockets = []
        self.clouds = peer.collect(PointCloud2, TOPIC, 1000)
        self.health = peer.collect(DiagnosticArray, "/diagnostics", 100)
        self._tracks = udp.receiving_socket(self.display, "")

    def start(self, *arguments, named=NAMED):
        """Start the bridge and wait until it receives."""
        given = ["-p", f"inputs:=['{self.host}:{self.port}']", "-p", f"interface:={LOOPBACK}"]
        given += ["-p", f"output:='{self.display}'", *named, *ANY_TIME, *arguments]
        process = self.processes.start("asterix_bridge", "--ros-args", *given)
        assert self.peer.spin_until(
            lambda: "receiving" in process.log.read_text() or process.poll() is not None
        )
        assert process.poll() is None, process.log.read_text()
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

    def status(self, name, wanted):
        """Wait for a status of the bridge's health that is as wanted."""

        def latest():
            found = [
                status
                for array in self.health
                for status in array.status
                if status.name == f"/asterix_bridge: {name}"
            ]
            return found[-1] if found else None

        def there():
            status = latest()
            return status is not None and wanted(status, diagnostics.values_of(status))

        assert self.peer.spin_until(there), latest()
        return latest()

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
    found = Site(processes, peer, request.param)
    yield found
    found.close()


@pytest.fixture
def unicast(processes, peer):
    found = Site(processes, peer, LOOPBACK)
    yield found
    found.close()


def test_datagrams_become_clouds(site):
    site.start()
    site.send(made.turns(2, start_s=today_s(), seen=SEEN, rotation_s=4.0))
    assert site.peer.spin_until(lambda: len(site.clouds) >= 64)
    radar = resolve({**dict(flatten(TRACKER))}).inputs[0]
    reports = [detections.from_msg(cloud, radar) for cloud in site.clouds]
    assert sum(len(report.detections) for report in reports) == 8
    stamps = np.array([report.stamp_ns for report in reports])
    assert abs(stamps[0] * 1e-9 - time.time()) < 60.0
    np.testing.assert_allclose(np.diff(stamps), 125e6, atol=1)
    numbers = {report.sector for report in reports if len(report.detections)}
    assert numbers == {7, 31, 23, 8}


def test_clouds_of_a_radar_without_crossings_are_those_of_the_file(unicast, tmp_path):
    seen = [(azimuth, 20.0 + azimuth / 10.0) for azimuth in range(3, 360, 17)]
    blocks = [block for block in made.turns(20, seen=seen) if block[0] == 48]
    recording, bag = tmp_path / "recording.ast", tmp_path / "bag"
    recording.write_bytes(b"".join(blocks))
    assert run("asterix_bridge", [str(recording), "--out", str(bag)]) == 0
    expected = messages(bag, TOPIC)
    unicast.start("-p", "replayed:=true")
    radar = unicast.radar()
    for block in blocks:
        radar.send(block)
        unicast.peer.pace(0.002)
    # The last ones come when nothing else does.
    assert unicast.peer.spin_until(lambda: len(unicast.clouds) >= len(expected))
    for live, offline in zip(unicast.clouds, expected, strict=True):
        stamps = [(c.header.stamp.sec, c.header.stamp.nanosec) for c in (live, offline)]
        assert stamps[0] == stamps[1]
        assert bytes(live.data) == bytes(offline.data)


def contents(message):
    """Return a cloud's content without its transport."""
    stamp, fields = message.header.stamp, message.fields
    layout = [(field.name, field.offset, field.datatype, field.count) for field in fields]
    return stamp.sec, stamp.nanosec, message.header.frame_id, layout, bytes(message.data)


def test_estimates_of_plots_by_udp_are_those_of_the_recording(unicast, peer, tmp_path):
    """The same bytes as of ``asterix_bridge`` and ``track_bag``, with what the bridge found out."""
    rng = np.random.default_rng(5)
    blocks = []
    for turn in range(20):
        azimuth = 3.0 + 0.4 * turn + 60.0 * np.arange(6) + rng.normal(0.0, 0.05, 6)
        far = 20.0 + 0.2 * turn + rng.normal(0.0, 0.02, 6)
        seen = [*zip(azimuth, far, strict=True)]
        own = made.turns(1, start_s=1000.0 + 4.0 * turn, seen=seen)
        blocks += [block for block in own if block[0] == 48]
    recording, bag, tracked = (tmp_path / name for name in ("recording.ast", "bag", "tracked"))
    recording.write_bytes(b"".join(blocks))
    assert run("asterix_bridge", [str(recording), "--out", str(bag)]) == 0
    assert run("track_bag", [str(bag), "--out", str(tracked)]) == 0

    topics = [names.estimates(source) for source in SOURCES]
    live = {topic: peer.collect(PointCloud2, topic, 1000) for topic in topics}
    bridge = unicast.start("-p", "replayed:=true")
    # The recording is sent faster than a busy machine may track it.
    own = f"qos_overrides.{TOPIC}.subscription"
    qos = ("-p", f"{own}.reliability:=reliable", "-p", f"{own}.depth:=1000")
    parameters = ("--params-file", bag / "parameters.yaml")
    unicast.processes.start("tracker", "--ros-args", *parameters, *qos)
    assert peer.spin_until(lambda: peer.node.count_publishers(topics[-1]))
    peer.meet()
    assert peer.spin_until(lambda: "radar_1_2: 2 subscribers" in bridge.log.read_text())
    radar, clouds = unicast.radar(), BagReader(bag).counts[TOPIC]

    def taken():
        """Return how many clouds the tracker has taken."""
        found = [status for array in unicast.health for status in array.status]
        found = [status for status in found if status.name == "/tracker: radar_1_2"]
        return int(diagnostics.values_of(found[-1]).get("received", 0)) if found else 0

    for number, block in enumerate(blocks, start=1):
        radar.send(block)
        peer.pace(0.005)
        if number % 20 == 0:
            # The bridge keeps fifty clouds for a tracker that a busy machine makes wait.
            assert peer.spin_until(lambda: taken() >= len(unicast.clouds) > 0)
    # The last ones come when nothing else does.
    assert peer.spin_until(lambda: taken() == len(unicast.clouds) == clouds)
    assert peer.call(Trigger, "/tracker/flush").success

    offline = {topic: [] for topic in topics}
    for entry in BagReader(tracked).messages(topics):
        offline[entry.topic].append(contents(interfaces.decode(entry.data, names.CLOUD)))
    for topic in topics:
        expected = offline[topic]
        assert sum(len(cloud[-1]) > 0 for cloud in expected) > 10
        assert peer.spin_until(lambda t=topic, e=expected: len(live[t]) >= len(e))
        assert [contents(message) for message in live[topic]] == expected


def flying(turns, start_s):
    """Yield the datagrams of an aircraft that flies east at 200 m/s, north of the radar."""
    for turn in range(turns):
        east, north = 200.0 * 4.0 * turn, 40e3
        azimuth = np.degrees(np.arctan2(east, north)) % 360.0
        far = np.hypot(east, north) / 1852.0
        yield from (
            block
            for k, block in enumerate(
                made.turns(1, start_s=start_s + 4.0 * turn, seen=[(azimuth + 0.01, far)])
            )
            if k or not turn
        )


def test_plots_go_through_the_tracker_and_come_back_as_tracks(unicast, peer, tmp_path):
    file = tmp_path / "tracker.yaml"
    # The recording is sent faster than a busy machine may track it.
    own = f"qos_overrides.{TOPIC}.subscription"
    qos = {f"{own}.reliability": "reliable", f"{own}.depth": 1000}
    given = {**dict(flatten(TRACKER)), **qos}
    file.write_text(yaml.safe_dump({"/tracker": {"ros__parameters": given}}))
    origin = ("-p", "world_origin:=[52.0, 4.5, 0.0]", "-p", "output_period_s:=0.0")
    unicast.start(*origin, "-p", "rotation_s:=4.0")
    unicast.processes.start("tracker", "--ros-args", "--params-file", file)
    assert peer.spin_until(lambda: peer.node.count_publishers("/tracker/filtered/estimates"))
    peer.meet()
    start_s = today_s()
    radar = unicast.radar()
    records = []

    def tracked():
        records.extend(unicast.tracks())
        return any(record["category"] == 62 for record in records)

    blocks = flying(15, start_s)
    for block in blocks:
        radar.send(block)
        peer.pace(0.002)
    assert peer.spin_until(tracked)
    peer.spin_until(lambda: not tracked(), 0.5)
    tracks = [record for record in records if record["category"] == 62]
    for record in tracks[-5:]:
        since_s = value(record, "I070", "ToT") - start_s
        assert value(record, "I100", "X") == pytest.approx(200.0 * since_s, abs=300.0)
        assert value(record, "I100", "Y") == pytest.approx(40e3, abs=300.0)
        assert value(record, "I185", "Vx") == pytest.approx(200.0, abs=30.0)
        assert value(record, "I105", "Lat") == pytest.approx(52.36, abs=0.01)
        assert value(record, "I080", "MON") == 1
    assert {record["category"] for record in records} == {62, 65}


def test_tracks_are_of_one_radar_until_another_reports(unicast, peer):
    unicast.start("-p", "output_period_s:=0.0", named=())
    topic = "/tracker/filtered/estimates"
    publisher = peer.node.create_publisher(PointCloud2, topic, 10)
    assert peer.spin_until(lambda: publisher.get_subscription_count() > 0)
    found = estimate_sets.of_tracks({1: (0.0, 0.0)}, variance=np.ones(5), stamp_ns=10**9)
    said = []
    for sic in (2, 3):
        unicast.send(made.turns(1, start_s=today_s(), sic=sic))
        unicast.status(f"radar_1_{sic}", lambda status, values: int(values["clouds"]) > 0)
        publisher.publish(estimates.to_msg(found, "map"))
        records = []

        def come(records=records):
            records += [each for each in unicast.tracks() if each["category"] == 62]
            return records

        assert peer.spin_until(come)
        said.append(value(records[0], "I080", "MON"))
    assert said == [1, 0]


def test_hostile_datagrams_are_counted_and_change_nothing(unicast):
    process = unicast.start()
    rng = made.rng(5)
    good = [*made.turns(1, start_s=today_s(), seen=SEEN)]
    for block in good:
        unicast.send([block, rng.bytes(int(rng.integers(1, 200))), b"\x30\xff\xff" + bytes(100)])
        unicast.send([b"\x30\x00\x05\xff\xff", block[:-1]])
    unicast.status("radar_1_2", lambda _, values: values["clouds"] == "32")
    status = unicast.status("input", lambda _, values: int(values["block_truncated"]) >= 66)
    assert status.level == b"\x01"
    assert "malformed" in status.message
    assert process.poll() is None


def test_second_radar_of_a_number_and_a_wrong_clock_are_reported(unicast):
    unicast.start("-p", "max_clock_offset_s:=10.0")
    blocks = [*made.turns(1, start_s=today_s(7200.0))]
    first, second = unicast.radar(), unicast.radar("127.0.0.2")
    for block in blocks:
        unicast.send([block], first)
    unicast.status("radar_1_2", lambda status, _: "its clock is" in status.message)
    for block in blocks:
        unicast.send([block], second)
    status = unicast.status("radar_1_2", lambda status, _: "two sources" in status.message)
    values = diagnostics.values_of(status)
    assert values["second_source"] == str(len(blocks))
    assert float(values["clock_shift_s"]) == pytest.approx(7200.0, abs=60.0)
    assert "127.0.0.1 to" in status.message
    assert "127.0.0.2 to" in status.message


def test_bridge_stops_and_starts_again_on_request(unicast):
    process = unicast.start("-p", "autostart:=true")

    def change(transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        return unicast.peer.call(ChangeState, "/asterix_bridge/change_state", request).success

    # From here on the address is free, and taken again.
    assert change(Transition.TRANSITION_DEACTIVATE)
    other = udp.receiving_socket(udp.Address(LOOPBACK, unicast.port), "")
    assert not change(Transition.TRANSITION_ACTIVATE)
    other.close()
    assert change(Transition.TRANSITION_ACTIVATE)
    unicast.send(made.turns(1, start_s=today_s()))
    unicast.status("radar_1_2", lambda _, values: values["clouds"] == "32")
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
