"""Manual work on a live tracker's tracks: services, their opposites, and the same offline."""

import itertools
from functools import partial

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_radars import SCANS, TOPICS, cloud, connected, start_tracker
from mcap_files import write
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from replay_listener import playing
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import interfaces, names
from msg_adapters.incoming.readers import reader_of
from msg_adapters.outgoing import manual
from msg_adapters.targets import estimates
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.tracks.manual import Command
from phd_jdtc_ros.feed import Feed
from phd_jdtc_ros.tally import Tally

PLACE = (5000.0, -6000.0)


@pytest.fixture
def operator(processes, peer):
    """Return two radars of a tracker, what is recorded of manual work, and how to do some."""
    recorded = peer.collect(DiagnosticArray, "/tracker/manual", 100)
    start_tracker(processes)
    radars = connected(peer)

    def work(verb, **values):
        parameters = [
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
        ]
        request = SetParametersAtomically.Request(parameters=parameters)
        result = peer.call(SetParametersAtomically, f"/tracker/{verb}_track", request).result
        return result.successful, result.reason

    return radars, recorded, work


def numbers(sent):
    return set(estimates.from_msg(sent).track_id.tolist())


def offline(scans, commands):
    """Return the filtered estimates of scans with manual work after the scans of its stamps."""
    config = resolve({"accuracy": "fast", "lag": 2})
    feed, found, left = Feed(config, Tally(config)), [], [*commands]
    for index, radar in itertools.product(range(scans), range(2)):
        read = partial(reader_of(config.inputs[radar]).from_msg, cloud(index, radar))
        for event in feed.message(radar, partial(read, config.inputs[radar])):
            found += event.step.filtered
            while left and left[0][0] <= event.scan.stamp_ns:
                feed.pipeline.operate(left.pop(0)[1])
    return found


def test_manual_work_has_its_opposite_and_is_the_same_offline(operator, peer):
    radars, recorded, work = operator
    radars.track_all(*range(6))
    shown = numbers(radars.filtered[-1])
    first = min(shown)
    assert work("drop", track=first) == (True, f"track {first} dropped")
    radars.track(6)
    assert numbers(radars.filtered[-1]) == shown - {first}
    assert work("restore", track=first)[0]
    assert work("name", track=first, name="Aurora")[0]
    assert work("mark", track=first, mark="friend")[0]
    assert work("start", x=PLACE[0], y=PLACE[1], vx=10.0, vy=0.0)[0]
    radars.track(7)
    found = estimates.from_msg(radars.filtered[-1])
    assert shown < {*found.track_id.tolist()}
    distance = np.hypot(*(found.position - PLACE).T)
    new = int(found.track_id[distance.argmin()])
    assert distance.min() < 200.0
    assert new not in shown
    assert work("drop", track=new)[0]
    radars.track(8)
    assert new not in numbers(radars.filtered[-1])
    assert peer.spin_until(lambda: len(recorded) == 6)
    commands = [manual.from_msg(message) for message in recorded]
    assert [command.verb for _, command in commands] == [
        *("drop", "restore", "name", "mark", "start", "drop")
    ]
    expected = offline(9, commands)
    assert len(expected) == len(radars.filtered)
    for sent, other in zip(radars.filtered, expected, strict=True):
        assert bytes(sent.data) == bytes(estimates.to_msg(other, "map").data)


@pytest.mark.parametrize(
    ("verb", "values", "words"),
    [
        ("drop", {}, "track: None given, must be a whole number"),
        ("drop", {"track": 99}, "track: 99 given, must be from 1 to"),
        ("drop", {"track": 0}, "track: 0 given"),
        ("drop", {"number": 1}, "number: given, must be one of track"),
        ("restore", {"track": 1}, "track: 1 given, must be a dropped one"),
        ("name", {"track": 1, "name": 5}, "name: 5 given, must be a string"),
        ("name", {"track": 1, "name": "x" * 41}, "at most 40 letters"),
        (
            "mark",
            {"track": 1, "mark": "foe"},
            "mark: 'foe' given, must be one of own, friend, none",
        ),
        ("start", {"x": 1.0}, "y: None given, must be a number within 1e+07"),
        ("start", {"x": float("nan"), "y": 0.0}, "x: nan given"),
        ("start", {"latitude": 54.0, "longitude": 10.0}, "latitude: given, needs world_origin"),
    ],
)
def test_manual_work_that_cannot_be_done_is_refused(operator, verb, values, words):
    radars, recorded, work = operator
    radars.track_all(0, 1, 2)
    done, reason = work(verb, **values)
    assert not done
    assert words in reason
    radars.track(3)
    assert not recorded


def test_replay_repeats_the_manual_work_of_a_bag(processes, peer, tmp_path):
    done = {
        3: [Command("start", motion=(*PLACE, 10.0, 0.0)), Command("drop", 1)],
        5: [Command("restore", 1), Command("drop", 2), Command("restore", 3)],
        # It was recorded at the very end.
        7: [Command("name", 1, "Aurora")],
    }
    commands = [(SCANS[index].stamp_ns, each) for index, own in done.items() for each in own]
    messages = [
        (TOPICS[radar], SCANS[index].stamp_ns, interfaces.encode(cloud(index, radar)))
        for index, radar in itertools.product(range(8), range(2))
    ]
    for stamp_ns, command in commands:
        data = interfaces.encode(manual.to_msg(stamp_ns, command))
        messages.append((names.manual(), stamp_ns + 1000, data))
    types = {**dict.fromkeys(TOPICS, names.CLOUD), names.manual(): names.FIGURES}
    messages.sort(key=lambda message: message[1])
    bag = write(tmp_path / "worked.mcap", types, messages)
    filtered = peer.collect(PointCloud2, names.estimates("filtered"), 100)
    repeated = peer.collect(DiagnosticArray, names.manual(), 100)
    peer.said(start_tracker(processes), "tracking ")
    replay = processes.start("sensor_replay", *playing(0, bag=bag))
    log = peer.said(replay, "published: ")
    assert "manual work done 5, manual work refused 1\n" in log
    assert "/tracker/restore_track 3: track: 3 given, must be a dropped one" in log
    assert peer.spin_until(lambda: len(filtered) == 8 and len(repeated) == 5)
    possible = [each for each in commands if each[1] != Command("restore", 3)]
    assert [manual.from_msg(message) for message in repeated] == possible
    expected = offline(8, possible)
    for sent, other in zip(filtered, expected, strict=True):
        assert bytes(sent.data) == bytes(estimates.to_msg(other, "map").data)
    assert [1 in numbers(sent) for sent in filtered[3:]] == [True, False, False, True, True]
