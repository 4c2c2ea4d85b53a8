"""The live hand-over between trackers that part an area, over DDS."""

import estimate_sets
import numpy as np
import pytest
import tower
import yaml
from bag_content import messages, write
from diagnostic_msgs.msg import DiagnosticStatus
from live_radars import Health, options
from reference import resolve
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger
from two_regions import MARGIN, REGIONS, given

from msg_adapters.encoding import names
from msg_adapters.incoming import detections as plots
from msg_adapters.outgoing import diagnostics
from msg_adapters.targets import estimates
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, SOURCES, Detections
from phd_jdtc_ros.parameter_files import bag_parameters

NS = 10**9
START_S, PERIOD_S, SCANS = 1_700_000_000, round(tower.PERIOD_S), 16
# East, north and velocities at the start: one that crosses the seam each way, and one that stays.
AIRCRAFT = np.array([[-8e3, 12e3, 220.0, 0.0], [9e3, -14e3, -230.0, 0.0], [30e3, 20e3, 0.0, 150.0]])
CODES = np.array([0o4521, 0o7000, 0o1234])
HEIGHTS = np.array([3048.0, 9144.0, 6096.0])
TOWER = {**tower.PARAMETERS, "tower.fields.height": "altitude"}
QOS = {"qos_overrides./tower/plots.subscription.reliability": "reliable"}


def parameters(tracker):
    return {**TOWER, "region": [*REGIONS[tracker], MARGIN]}


def joining(**more):
    """Return the parameters of the hand-over as ROS arguments."""
    return ["--ros-args", *options(**given(**more))]


def seen(scan):
    """Return the radar's plots of a scan; none before the first."""
    if scan < 0:
        none = np.zeros(0, dtype=int)
        return Detections(np.zeros((0, 2)), None, code=none, height=np.zeros(0))
    rng = np.random.default_rng((11, scan))
    world = AIRCRAFT[:, :2] + AIRCRAFT[:, 2:] * scan * PERIOD_S
    distance = np.hypot(*world.T) + 30.0 * rng.standard_normal(len(world))
    azimuth = np.arctan2(*world.T[::-1]) + np.radians(0.1) * rng.standard_normal(len(world))
    measured = np.stack([distance, azimuth], axis=1)
    return Detections(measured, None, code=CODES, height=HEIGHTS)


class Stack:
    """Two trackers in namespaces of their own, what joins them, and their radar."""

    def __init__(self, processes, peer, directory, **more):
        self.peer = peer
        for tracker in REGIONS:
            file = directory / f"{tracker}.yaml"
            given = {f"/{tracker}/tracker": {"ros__parameters": {**parameters(tracker), **QOS}}}
            file.write_text(yaml.safe_dump(given))
            ros = ["--ros-args", "-r", f"__ns:=/{tracker}", "--params-file", file]
            processes.start("tracker", *ros)
        # Both must have reported, so that the picture is complete from the first scan on.
        self.node = processes.start("hand_over", *joining(max_delay_s=600.0, **more))
        self.said = {
            (tracker, source): peer.collect(
                PointCloud2, names.estimates(source, f"/{tracker}/tracker"), 100
            )
            for tracker in REGIONS
            for source in SOURCES
        }
        self.joint = {
            source: peer.collect(PointCloud2, names.estimates(source, "/hand_over"), 100)
            for source in SOURCES
        }
        self.output = peer.publisher(PointCloud2, "/tower/plots", 50)
        self.config = resolve(parameters("west"))
        peer.meet("/hand_over")
        for tracker in REGIONS:
            peer.meet(f"/{tracker}/tracker")
        self.connect()

    def send(self, scan):
        radar = self.config.inputs[0]
        stamp_ns = (START_S + scan * PERIOD_S) * NS
        self.output.publish(plots.to_msg(seen(scan), stamp_ns, radar.frame, radar))

    def connect(self):
        """Send scans without plots until both trackers are in the picture."""
        # A tracker waits for a second report after a gap of more than fifteen revolutions.
        for scan in range(-10, 0):
            self.send(scan)
            if self.peer.spin_until(lambda: self.joint[FILTERED], 5.0):
                break
        assert self.joint[FILTERED], self.node.log.read_text()

    def track(self, scan):
        """Send a scan and wait until it is in the picture."""
        stamp = START_S + scan * PERIOD_S
        self.send(scan)
        assert self.peer.spin_until(
            lambda: any(cloud.header.stamp.sec == stamp for cloud in self.joint[FILTERED])
        ), f"scan {scan}"

    def flush(self):
        """Have all published that waits, and wait until it has come."""
        for node in ("/west/tracker", "/east/tracker"):
            assert self.peer.call(Trigger, f"{node}/flush").success
        last = START_S + (SCANS - 1) * PERIOD_S
        everywhere = [*(self.said[tracker, SMOOTHED] for tracker in REGIONS)]
        assert self.peer.spin_until(
            lambda: all(found and found[-1].header.stamp.sec == last for found in everywhere)
        )
        self.peer.meet("/hand_over", times=2)
        assert self.peer.call(Trigger, "/hand_over/flush").success
        smoothed = self.joint[SMOOTHED]
        assert self.peer.spin_until(lambda: smoothed and smoothed[-1].header.stamp.sec == last)


def of_run(clouds):
    """Return the bytes of clouds with plots by stamp."""
    return {
        cloud.header.stamp.sec: bytes(cloud.data)
        for cloud in clouds
        if cloud.header.stamp.sec >= START_S
    }


def joined_offline(said, directory):
    """Return the clouds that the offline tool makes of the trackers' estimates, by source."""
    for tracker in REGIONS:
        entries = [
            (names.estimates(source), cloud, cloud.header.stamp.sec * NS)
            for source in SOURCES
            for cloud in said[tracker, source]
        ]
        write(directory / tracker, map(names.estimates, SOURCES), entries)
        values = resolve(parameters(tracker)).values
        bag_parameters.write(directory / tracker / bag_parameters.NAME, values)
    bags, out = [str(directory / tracker) for tracker in REGIONS], directory / "joint"
    assert run("hand_over", [*bags, "--out", str(out)]) == 0
    return {source: messages(out, names.estimates(source)) for source in SOURCES}


@pytest.mark.live
def test_live_picture_keeps_numbers_and_is_that_of_the_offline_tool(processes, peer, tmp_path):
    stack = Stack(processes, peer, tmp_path)
    for scan in range(SCANS):
        stack.track(scan)
    stack.flush()

    numbers = {}
    for source, clouds in stack.joint.items():
        for cloud in clouds:
            found = estimates.from_msg(cloud)
            for number, code in zip(found.track_id, found.attributes.code, strict=True):
                numbers.setdefault((source, int(code)), set()).add(int(number))
        last = estimates.from_msg(clouds[-1])
        assert sorted(last.attributes.code.tolist()) == sorted(CODES.tolist())
    # Each aircraft has one number, and no other aircraft has it.
    assert all(len(numbers[FILTERED, code]) == 1 for code in CODES)
    assert len(set.union(*(numbers[FILTERED, code] for code in CODES))) == len(CODES)
    assert all(numbers[SMOOTHED, code] == numbers[FILTERED, code] for code in CODES)
    # Both trackers have tracked the aircraft that cross, each with a number of its own.
    for tracker in REGIONS:
        own = [estimates.from_msg(cloud) for cloud in stack.said[tracker, FILTERED]]
        codes = {int(code) for found in own for code in found.attributes.code}
        assert codes >= set(CODES[:2].tolist())

    offline = joined_offline(stack.said, tmp_path)
    for source in SOURCES:
        assert of_run(stack.joint[source]) == of_run(offline[source])
        assert len(of_run(stack.joint[source])) == SCANS


def said(stamp, rows, classes=1, frame="map", covariance=None):
    """Return the cloud of a tracker's estimates: (number, x) of what flies east."""
    if covariance is None:
        covariance = np.diag(np.array([50.0, 5.0, 50.0, 5.0, 1e-3]) ** 2)
    found = estimate_sets.estimates(
        estimate_sets.states([(x, 0.0) for _, x in rows], (200.0, 0.0)),
        covariance,
        stamp_ns=stamp * NS,
        class_probability=np.full((len(rows), classes), 1.0 / classes),
        track_id=np.array([number for number, _ in rows]),
    )
    return estimates.to_msg(found, frame)


class Replayed:
    """Estimates of two trackers that the test itself publishes, and the node's outputs."""

    def __init__(self, processes, peer, **more):
        self.peer = peer
        self.node = processes.start("hand_over", *joining(**more))
        self.outputs = {
            tracker: peer.publisher(
                PointCloud2, names.estimates(FILTERED, f"/{tracker}/tracker"), 50
            )
            for tracker in REGIONS
        }
        self.joint = peer.collect(PointCloud2, "/hand_over/filtered/estimates", 100)
        self.health = Health(peer, "/hand_over")
        self.until = self.health.until_level
        peer.meet("/hand_over")
        peer.settled(*self.outputs.values())

    def stamps(self):
        return [cloud.header.stamp.sec for cloud in self.joint]


@pytest.mark.live
def test_picture_goes_on_without_a_silent_tracker_with_a_warning(processes, peer):
    # All parameters have their defaults, and revolutions take 6 s.
    rig = Replayed(processes, peer)
    for count, stamp in enumerate((100, 106), start=1):
        rig.outputs["west"].publish(said(stamp, [(5, -2e3)]))
        # It has been taken in, and waits for east's.
        assert rig.until("west", DiagnosticStatus.OK, f"{count} stamps")
        rig.outputs["east"].publish(said(stamp, [(5, 30e3)]))
        assert peer.spin_until(lambda stamp=stamp: rig.stamps()[-1:] == [stamp])
    assert "silent" not in rig.node.log.read_text()
    # East is silent from now on: it is waited for until the others are 6 s ahead.
    rig.outputs["west"].publish(said(112, [(5, -1e3)]))
    rig.outputs["west"].publish(said(118, [(5, 0.0)]))
    assert peer.spin_until(lambda: rig.stamps() == [100, 106, 112, 118])
    assert [cloud.width for cloud in rig.joint] == [2, 2, 1, 1]
    words = rig.until("east", DiagnosticStatus.WARN, "silent: its estimates are 12.0 s behind")
    assert words.hardware_id == "/east/tracker"
    assert rig.until("picture", DiagnosticStatus.WARN, "of one tracker alone: west")
    assert "east: silent, its estimates are 12.0 s behind" in rig.node.log.read_text()
    # It comes back with an old stamp, which is left out, and is waited for again.
    rig.outputs["east"].publish(said(118, [(5, 31e3)]))
    assert rig.until("east", DiagnosticStatus.WARN, "left out: late 1")
    rig.outputs["west"].publish(said(124, [(5, 1e3)]))
    rig.outputs["east"].publish(said(124, [(5, 31e3)]))
    assert peer.spin_until(lambda: rig.stamps()[-1] == 124)
    assert rig.joint[-1].width == 2
    assert "east: in the picture again" in rig.node.log.read_text()
    numbers = [estimates.from_msg(cloud).track_id.tolist() for cloud in rig.joint]
    assert numbers == [[1, 2], [1, 2], [1], [1], [1, 2]]


@pytest.mark.live
def test_estimates_that_cannot_be_joined_are_left_out_and_counted(processes, peer):
    rig = Replayed(processes, peer)
    rig.outputs["west"].publish(said(100, [(5, -2e3)]))
    unjoinable = (
        said(100, [(5, 30e3)], classes=2),
        said(100, [(5, 30e3)], frame="odom"),
        said(100, [(0, 30e3)]),
        # A metre of slack leaves this covariance singular.
        said(100, [(5, 30e3)], covariance=-0.5 * np.eye(5)),
    )
    for cloud in unjoinable:
        rig.outputs["east"].publish(cloud)
    words = "left out: classes 1, covariance 1, frame 1, unlabelled 1"
    status = rig.until("east", DiagnosticStatus.WARN, words)
    assert diagnostics.values_of(status)["refused_frame"] == "1"
    assert rig.stamps() == []
    # It is not called silent while it reports.
    for stamp in (106, 112):
        rig.outputs["west"].publish(said(stamp, [(5, -2e3)]))
    assert rig.until("east", DiagnosticStatus.WARN, f"{words}; the picture is without it")
    assert f"east: its estimates are left out ({words[10:]})" in rig.node.log.read_text()
    # The node is there still, and takes what can be joined.
    rig.outputs["east"].publish(said(118, [(5, 30e3)]))
    assert peer.spin_until(lambda: "east: in the picture again" in rig.node.log.read_text())
    rig.outputs["west"].publish(said(118, [(5, -2e3)]))
    assert peer.spin_until(lambda: rig.stamps()[-1:] == [118])
    assert rig.joint[-1].width == 2


@pytest.mark.live
def test_a_tracker_whose_clock_is_wrong_does_not_end_the_picture(processes, peer):
    rig = Replayed(processes, peer, max_delay_s=0.5)
    for stamp in (100, 101):
        for tracker in REGIONS:
            rig.outputs[tracker].publish(said(stamp, []))
    assert peer.spin_until(lambda: rig.stamps() == [100, 101])
    # The status comes once a second, and on a quiet machine a hundred stamps take less.
    for stamp in range(102, 2000):
        rig.outputs["west"].publish(said(stamp + 3600, []))
        rig.outputs["east"].publish(said(stamp, []))
        assert peer.spin_until(lambda stamp=stamp: rig.stamps()[-1] >= stamp - 1)
        west = rig.health.all().get("west", ())
        if any(status.level == DiagnosticStatus.ERROR for status in west):
            break
    assert "s ahead of those of the other trackers" in west[-1].message
    # The last stamp may still wait for west.
    assert rig.stamps() == [*range(100, rig.stamps()[-1] + 1)]
    assert rig.stamps()[-1] <= stamp
    # Then both are quiet.
    assert rig.until("picture", DiagnosticStatus.WARN, "all trackers are silent")
    assert rig.until("east", DiagnosticStatus.WARN, "silent for")


def test_executable_without_parameters_is_the_node_and_lists_what_it_needs(processes):
    status, text = processes.run("hand_over")
    assert status == 2
    assert "hand_over: trackers: [] given, must be two names or more" in text
