import struct
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap_files import write

from msg_adapters.encoding import names
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.nodes.playback import TOGETHER_NS, BagClock, Playback

TYPES = {
    "/a/detections": "sensor_msgs/msg/PointCloud2",
    "/b/detections": "sensor_msgs/msg/PointCloud2",
    "/note": "std_msgs/msg/String",
}
SHIPPED = Path(__file__).parents[3] / "bags" / "paper_scenario"
SCANS = ("/a/detections", "/b/detections")
S = 1_000_000_000


def scan(topic, stamp_s, log_ns):
    # The encapsulation, then the header's stamp.
    return topic, log_ns, b"\0\1\0\0" + struct.pack("<iI", stamp_s, 0)


def playback(tmp_path, messages, start_s=0.0, duration_s=0.0):
    path = tmp_path / "bag.mcap"
    if not path.exists():
        write(path, TYPES, messages)
    return Playback(BagReader(path), list(TYPES), SCANS, start_s, duration_s)


def groups(played):
    found = []
    while played.upcoming is not None:
        found.append(
            (played.upcoming.stamp_ns, [message.topic for message in played.upcoming.messages])
        )
        played.advance()
    return found


def test_messages_of_one_stamp_go_together_with_what_is_between_them(tmp_path):
    a, b = SCANS
    messages = [
        scan(a, 1, 1 * S),
        ("/note", 1 * S + 1, b""),
        scan(b, 1, 1 * S + 2),
        ("/note", 1 * S + 3, b""),
        scan(a, 2, 2 * S),
        scan(b, 3, 3 * S),
    ]
    assert groups(playback(tmp_path, messages)) == [
        (1 * S, [a, "/note", b]),
        (None, ["/note"]),
        (2 * S, [a]),
        (3 * S, [b]),
    ]


def test_a_late_foreign_message_does_not_hold_a_scan_back(tmp_path):
    a, _ = SCANS
    played = playback(tmp_path, [scan(a, 1, 0), ("/note", TOGETHER_NS + 1, b""), scan(a, 1, 9 * S)])
    assert groups(played) == [(1 * S, [a]), (None, ["/note"]), (1 * S, [a])]


def test_seek_goes_to_the_first_group_from_then_on_and_back(tmp_path):
    a, _ = SCANS
    played = playback(tmp_path, [scan(a, 100 + k, (100 + k) * S) for k in range(5)])
    played.seek(played.time_ns(2.5))
    assert played.upcoming.log_time_ns == 103 * S
    played.seek(played.time_ns(0.0))
    assert len(groups(played)) == 5


def test_the_chosen_part_ends_where_it_should(tmp_path):
    a, _ = SCANS
    played = playback(tmp_path, [scan(a, k, k * S) for k in range(1, 9)], 2.0, 3.0)
    assert [stamp // S for stamp, _ in groups(played)] == [3, 4, 5, 6]
    assert played.seconds(played.last_ns) == 5.0


def test_before_yields_what_was_recorded_earlier(tmp_path):
    a, _ = SCANS
    messages = [("/note", 1 * S, b"first"), scan(a, 2, 2 * S), ("/note", 3 * S, b"later")]
    played = playback(tmp_path, messages)
    assert [message.data for message in played.before(2 * S, ["/note"])] == [b"first"]


def test_an_empty_part_or_a_start_beyond_all_numbers_is_refused(tmp_path):
    a, _ = SCANS
    with pytest.raises(BagError, match="contains nothing in the selected part"):
        playback(tmp_path, [scan(a, 1, 1 * S)], 5.0)
    a, _ = SCANS
    with pytest.raises(BagError, match="contains nothing in the selected part"):
        playback(tmp_path, [scan(a, 1, 1 * S)], 1e300)


def broken(tmp_path, choose):
    """Return a copy of the shipped bag with a damaged chunk: the first in time, or the last."""
    whole = next(SHIPPED.glob("*.mcap"))
    data = bytearray(whole.read_bytes())
    with whole.open("rb") as stream:
        indexes = make_reader(stream).get_summary().chunk_indexes
    chunk = choose(indexes, key=lambda c: c.message_start_time)
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0x40
    path = tmp_path / "broken.mcap"
    path.write_bytes(data)
    return BagReader(path)


def test_before_reads_no_further_than_it_must(tmp_path):
    bag = broken(tmp_path, max)
    played = Playback(bag, [names.TRUTH], [names.TRUTH], 0.0, 0.0)
    assert len(list(played.before(played.time_ns(12.0), [names.TRUTH]))) == 2
    assert played.damage is None
    assert len(list(played.before(bag.end_ns + 1, [names.TRUTH]))) < 80
    assert "damaged" in str(played.damage)


@pytest.mark.parametrize(("choose", "reported"), [(min, True), (max, False)])
def test_a_part_is_read_no_further_and_its_own_damage_reported(tmp_path, choose, reported):
    played = Playback(broken(tmp_path, choose), [names.TRUTH], [names.TRUTH], 0.0, 60.0)
    groups(played)
    assert (played.damage is not None) == reported


def test_a_duration_beyond_all_numbers_is_the_rest(tmp_path):
    a, _ = SCANS
    messages = [scan(a, k, k * S) for k in range(1, 5)]
    assert len(groups(playback(tmp_path, messages, 1.0, 1e300))) == 3


@pytest.mark.parametrize("rate", [0.5, 60.0])
def test_bag_clock_runs_at_its_rate_and_never_beyond_what_is_due(monkeypatch, rate):
    now_s = 1000.0
    monkeypatch.setattr("time.monotonic", lambda: now_s)
    clock = BagClock(rate, 5 * S)
    due_ns = 5 * S + round(2.0 * rate * S)
    for elapsed_s in (0.0, 0.01, 1.0, 1.99):
        now_s = 1000.0 + elapsed_s
        assert not clock.is_due(due_ns)
        assert clock.now_ns == pytest.approx(5 * S + elapsed_s * rate * S, abs=1e3)
    now_s = 1002.5
    assert clock.is_due(due_ns)
    # The scan that is due sets the clock, and not the wall.
    assert clock.now_ns < due_ns
