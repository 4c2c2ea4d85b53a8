"""Recordings of drivers that stamp nothing, or stamp with another clock, by the time of arrival."""

import moving
import pytest
from bag_content import messages, recorded, write
from moving_messages import CLOUDS, sent

from msg_adapters.encoding import names, stamps
from msg_adapters.incoming import moving_radars
from phd_jdtc_ros import resources
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.bags.writer import Topic
from phd_jdtc_ros.tools import command, track_bag

SHIPPED = "paper_scenario"
RADARS = [names.detections(radar) for radar in ("radar_1", "radar_2")]


@pytest.fixture(scope="module")
def unstamped(tmp_path_factory):
    """Return a bag with the start of the shipped one, all of whose stamps are 0."""
    entries = [
        (entry.topic, stamps.restamped(entry.data, 0), entry.log_time_ns)
        for entry in BagReader(resources.bag(SHIPPED)).messages(RADARS)
    ]
    return write(tmp_path_factory.mktemp("bags") / "unstamped", RADARS, entries[:20])


def track(bag, out, *arguments):
    given = [str(bag), "--out", str(out), "-p", "accuracy:=fast", "-p", "lag:=1", *arguments]
    return run("track_bag", given)


def test_without_stamps_nothing_is_tracked_by_them(unstamped, tmp_path, capsys):
    assert track(unstamped, tmp_path / "out") == 3
    assert "stamp_zero 20" in capsys.readouterr().out


def test_arrival_stands_for_the_stamps(unstamped, tmp_path):
    entries = [
        (entry.topic, entry.data, entry.log_time_ns)
        for entry in BagReader(resources.bag(SHIPPED)).messages(RADARS)
    ]
    stamped = write(tmp_path / "stamped", RADARS, entries[:20])
    assert track(stamped, tmp_path / "one") == 0
    assert track(unstamped, tmp_path / "two", "--clock=arrival") == 0
    one, other = (
        [(entry.topic, entry.log_time_ns, entry.data) for entry in BagReader(bag).messages()]
        for bag in (tmp_path / "one", tmp_path / "two")
    )
    # The clouds, filtered and smoothed estimates of each pair of them, and what was learned.
    assert len(one) == 41
    assert one == other


def test_a_ships_poses_arrive_by_the_same_clock(tmp_path):
    # The driver and the ship have clocks of their own, both of which are wrong.
    entries = [
        (topic, stamps.restamped(data, stamp_ns + late * 10**9), stamp_ns)
        for topic, data, stamp_ns in sent()
        for late in (5_000 if topic == CLOUDS else 1_000,)
    ]
    odometry = Topic(moving.ODOMETRY, moving_radars.POSE_TYPES["odometry"])
    bag = BagReader(write(tmp_path / "bag", [Topic(CLOUDS, names.CLOUD), odometry], entries))
    command.use_clock(bag, moving.config(), "arrival")
    track_bag.track_bag(bag, moving.config(), tmp_path / "out")
    found = recorded(tmp_path / "out")
    assert len(found) == moving.SCANS
    assert moving.errors(found).max() < 25.0
    clouds = messages(tmp_path / "out", CLOUDS)
    assert stamps.to_ns(clouds[0].header.stamp) == moving.stamp(0.0)


def test_restamped_keeps_what_is_no_message():
    assert stamps.restamped(b"\x00\x01\x00\x00", 5) == b"\x00\x01\x00\x00"
    for order in (b"\x00\x01", b"\x00\x00"):
        data = stamps.restamped(order + bytes(10) + b"rest", 3_000_000_007)
        assert (stamps.of_cdr(data), data[:2], data[12:]) == (3_000_000_007, order, b"rest")
