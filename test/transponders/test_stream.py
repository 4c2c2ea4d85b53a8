"""The whole path: bytes to batches, and the columns of their clouds."""

import math

import ais_sentences as made
import numpy as np
import pytest

from phd_jdtc_ros.transponders.messages import AIS, MMSI, NONE, OTHER, Heard
from phd_jdtc_ros.transponders.stream import (
    UNKNOWN,
    Batch,
    Batches,
    ReportStream,
    StreamSettings,
    columns,
)
from phd_jdtc_ros.transponders.transmitters import Dated
from phd_jdtc_ros.transport.network import Datagram

S = 10**9
NOW = 1_700_000_000 * S


def stream(**more):
    return ReportStream(StreamSettings(S // 2, 10 * S, **more))


def fed(found, *pieces):
    """Return all batches of (data, time of receipt)."""
    batches = [each for data, ns in pieces for each in found.feed(Datagram(data, ns, "x")) if each]
    return [*batches, *found.finish()]


def test_networks_have_batches_of_their_own():
    lines = [made.class_a(211000001, 20), made.sbs(latitude=50.0, longitude=8.0, day="", time="")]
    found = stream()
    batches = dict(fed(found, (b"\n".join(lines) + b"\n", NOW)))
    assert sorted(batches) == ["adsb", "ais"]
    assert found.used == {"ais": 1, "adsb": 1}
    assert found.faulty == 0


def test_a_batch_ends_a_period_after_its_first_report():
    pieces = [(made.class_a(211000001 + k, 20 + k // 10), NOW + k * S // 10) for k in range(20)]
    batches = [batch for _, batch in fed(stream(), *pieces)]
    assert [len(batch.reports) for batch in batches] == [5, 5, 5, 5]
    assert [batch.stamp_ns - NOW for batch in batches] == [k * S // 10 for k in (4, 9, 14, 19)]


def test_pieces_of_any_size_make_the_same_batches():
    lines = [made.class_a(211000001 + k, k % 60, latitude=50.0 + k / 100) for k in range(200)]
    data = b"\n".join(lines) + b"\n"
    whole = fed(stream(start_ns=NOW), (data, None))
    for size in (1, 37, 1000):
        pieces = [(data[at : at + size], None) for at in range(0, len(data), size)]
        assert fed(stream(start_ns=NOW), *pieces) == whole


def test_frames_of_a_recording_are_dated_by_the_receivers_clock():
    pytest.importorskip("rs1090")
    frames = [
        (12_000_000 * 5, "8D40621D58C386435CC412692AD6"),
        (12_000_000 * 7, "8D40621D58C382D690C8AC2863A7"),
    ]
    data = b"".join(f"@{ticks:012X}{frame};\n".encode() for ticks, frame in frames)
    ((_, batch),) = fed(stream(start_ns=NOW), (data, None))
    assert [report.time_ns for report in batch.reports] == [NOW + 2 * S]


def test_frames_of_a_recording_without_any_clock_are_left_out():
    found = stream()
    assert fed(found, (b"*8D40621D58C382D690C8AC2863A7;\n", None)) == []
    assert found.counts == {"time_unknown": 1}
    assert found.faulty == 1


def test_receipts_that_fit_no_stamp_are_ignored():
    found = stream(start_ns=NOW)
    fed(found, (made.class_a(211000001, 20), -5), (made.class_a(211000002, 21), 2**62))
    assert found.counts == {"receipt_time": 2}
    assert found.used == {"ais": 2}


def test_batches_are_bounded():
    batches = Batches(S)
    report = Dated(NOW, Heard(MMSI, 5, latitude=1.0, longitude=2.0))
    ended = [batches.add(report, NOW) for _ in range(20_001)]
    assert [len(each.reports) for each in ended if each] == [10_000, 10_000]


def test_columns_have_all_that_was_heard():
    heard = Heard(MMSI, 211000001, 0, 0, 54.5, 10.25, 5.0, 45.0, 47.0, math.nan, 4.0, 4.0, 0.0, 1)
    ship = heard._replace(name="ANNA", type=70, hull=(100, 20, 10, 12), network=AIS)
    other = Heard(OTHER, NONE, latitude=50.0, longitude=8.0, hull=(0, 30, 0, 8))
    found = columns(Batch(NOW, [Dated(NOW + S // 4, ship), Dated(NOW, other)]))
    assert found["time"].tolist() == [1_700_000_000.25, 1_700_000_000.0]
    assert found["address"].tolist() == [211000001, UNKNOWN]
    assert (found["space"].tolist(), found["accurate"].tolist()) == ([MMSI, OTHER], [1, 255])
    assert found["name"].tobytes().rstrip(b"\0") == b"ANNA"
    assert found["name"].shape == (2, 20)
    assert found["std"].tolist()[0] == 4.0
    assert np.isnan(found["std"][1])
    # The antenna is 100 m behind the bow of 120 m, and 10 m right of the port side of 22 m.
    assert [found[name][0] for name in ("length", "beam", "ahead", "left")] == [120, 22, -40, 1]
    assert [found[name][1] for name in ("length", "beam")] == [30, 8]
    assert np.isnan([found["ahead"][1], found["left"][1]]).all()


def test_ellipses_have_three_columns_in_the_place_of_one():
    heard = Heard(OTHER, 1, latitude=50.0, longitude=8.0, x_std=3.0, y_std=4.0, correlation=0.5)
    found = columns(Batch(NOW, [Dated(NOW, heard)]), ellipses=True)
    assert [found[name].tolist() for name in ("x_std", "y_std", "correlation")] == [[3], [4], [0.5]]
    assert "std" not in found
