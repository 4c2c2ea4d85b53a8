"""What track_bag refuses, and what it makes of damaged bags."""

import numpy as np
import pytest
from bag_content import recorded, rewrite
from mcap.reader import make_reader
from mcap.writer import Writer
from small_bags import chunked

from msg_adapters.encoding import interfaces, names

RADARS = [names.detections("radar_1"), names.detections("radar_2")]
POSES = "geometry_msgs/msg/PoseArray"


def foreign(file, topic, kind):
    """Write an MCAP file whose topic has a type that is not installed."""
    with file.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        schema = writer.register_schema(kind, "ros2msg", b"float64 x\n")
        writer.register_channel(topic, "cdr", schema)
        for radar in RADARS:
            definition = interfaces.definition(names.CLOUD).encode()
            schema = writer.register_schema(names.CLOUD, "ros2msg", definition)
            if radar != topic:
                writer.register_channel(radar, "cdr", schema)
        writer.finish()
    return file


def test_track_bag_refuses_missing_bags_and_to_overwrite(track, tmp_path, faults, short_bag):
    status, out = track(tmp_path / "none")
    assert status == 2
    assert faults() == [f"{tmp_path / 'none'}: no such bag"]
    assert not out.exists()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine").write_text("kept")
    status, out = track(short_bag)
    assert status == 2
    assert faults() == [f"{out}: already exists, a bag is not overwritten"]
    assert [path.name for path in out.iterdir()] == ["mine"]


def test_track_bag_of_a_bag_without_a_radar_names_the_topic(short_bag, track, faults):
    status, out = track(short_bag, "-p", "radar_2.topic:=/other")
    assert status == 2
    _, fault = faults()
    assert fault == f"{short_bag}: /other is missing, must be {names.CLOUD}"
    assert not out.exists()


@pytest.mark.parametrize(("silent", "expected"), [(RADARS[1:], 0), (RADARS, 3)])
def test_track_bag_names_silent_radars(short_bag, track, tmp_path, faults, silent, expected):
    bag = rewrite(short_bag, tmp_path / "kept", lambda e: [] if e[0] in silent else [e])
    status, _ = track(bag)
    assert status == expected
    said = faults()
    assert [line for line in said if line.endswith(": silent, without a message")] == [
        f"{topic}: silent, without a message" for topic in silent
    ]
    fault = f"{bag}: nothing to track, without a message on {' or '.join(RADARS)}"
    assert (said[-1] == fault) is (expected == 3)


def test_track_bag_refuses_the_truth_as_a_radars_topic(short_bag, track, faults):
    status, out = track(short_bag, "-p", f"radar_1.topic:={names.TRUTH}")
    assert status == 2
    assert faults()[-1] == f"radar_1.topic: {names.TRUTH} given, which is that of the truth"
    assert not out.exists()


@pytest.mark.parametrize(
    ("topic", "kind"),
    [
        (RADARS[0], "radar_msgs/msg/RadarScan"),
        (names.TRUTH, POSES),
        (names.TRUTH, "radar_msgs/msg/RadarTracks"),
    ],
)
def test_track_bag_of_another_type_names_topic_and_type(track, tmp_path, faults, topic, kind):
    bag = foreign(tmp_path / "foreign.mcap", topic, kind)
    status, out = track(bag)
    assert status == 2
    assert faults() == [f"{bag}: {topic} is {kind}, must be {names.CLOUD}"]
    assert not out.exists()


def test_track_bag_lists_every_fault_of_the_parameters(short_bag, track, faults):
    status, out = track(
        short_bag, "-p", "lag:=101", "-p", "engine:=best", "-p", "radar_3.yaw_deg:=0.0"
    )  # fmt: skip
    assert status == 2
    listed = faults()
    assert len(listed) == 3
    assert listed[1].startswith("lag: 101 given, must be a whole number, at least 0")
    assert listed[0].startswith("engine: 'best' given, must be one of ")
    assert listed[2] == (
        "radar_3.yaw_deg: unknown parameter, radar_3 is not in sensors (radar_1, radar_2)"
    )
    assert not out.exists()


@pytest.mark.parametrize("given", ["0", "-1", "nan", "inf", "near"])
def test_track_bag_refuses_a_cutoff_that_is_no_distance(short_bag, track, given, capsys):
    with pytest.raises(SystemExit) as caught:
        track(short_bag, f"--cutoff={given}")
    assert caught.value.code == 2
    assert f"--cutoff: {given} given, must be a number of at least" in capsys.readouterr().err


def assert_tracks_what_precedes(status, out, end_ns, tracked):
    assert status == 3
    expected = [e for e in recorded(tracked) if e.stamp_ns < end_ns]
    assert len(expected) >= 3
    survivors = recorded(out)
    assert len(expected) <= len(survivors) <= 8
    assert len(recorded(out, "smoothed")) == len(survivors)
    for one, other in zip(expected, survivors, strict=False):
        assert one.stamp_ns == other.stamp_ns
        np.testing.assert_array_equal(one.state, other.state)


@pytest.mark.parametrize(
    ("damage", "reason"), [("cut", ""), ("flipped", "is damaged: ")], ids=["cut", "flipped"]
)
def test_track_bag_of_a_bag_damaged_in_the_middle_tracks_what_precedes(
    short_bag, track, tracked, tmp_path, faults, damage, reason
):
    bag = chunked(tmp_path / "small", short_bag, chunk_size=2000)
    with bag.open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    middle = chunks[len(chunks) // 2]
    data = bytearray(bag.read_bytes())
    at = middle.chunk_start_offset + middle.chunk_length // 2
    if damage == "cut":
        del data[at:]
    else:
        data[at] ^= 1
    bag.write_bytes(data)
    status, out = track(bag)
    (fault,) = faults()
    assert fault.startswith(f"{bag}: {reason}")
    assert_tracks_what_precedes(status, out, middle.message_start_time, tracked)


@pytest.mark.parametrize(
    "content",
    [
        lambda _: b"",
        lambda _: b"no bag",
        lambda _: b"\0" * 500,
        lambda whole: whole[:20],
        lambda whole: whole[:1000],
        lambda whole: whole[:-100],
    ],
    ids=["nothing", "text", "zeros", "20 bytes", "1000 bytes", "all but the end"],
)
def test_track_bag_of_a_corrupt_bag_ends_with_status_3(short_bag, track, tmp_path, faults, content):
    bag = tmp_path / "bad.mcap"
    bag.write_bytes(content((short_bag / "short_0.mcap").read_bytes()))
    status, out = track(bag)
    assert status == 3
    (fault,) = faults()
    assert fault.startswith(f"{bag}: ")
    # Nothing is written unless some of it could be read.
    assert out.exists() == (bag.stat().st_size > 1000)
