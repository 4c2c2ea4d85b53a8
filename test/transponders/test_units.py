"""Bytes to sentences and frames, however they are cut."""

from collections import Counter

import ais_sentences as made
import pytest

from phd_jdtc_ros.transponders.stream import LONGEST_LINE, MODE_S, NMEA, SBS, Splitter

FRAME = bytes.fromhex("8d40621d58c382d690c8ac2863a7")


def beast(message, kind=b"3", ticks=12_000_000):
    body = ticks.to_bytes(6, "big") + b"\x40" + message
    return b"\x1a" + kind + body.replace(b"\x1a", b"\x1a\x1a")


STREAM = b"".join(
    [
        made.class_a(211000001, 5) + b"\r\n",
        b"# a comment\n",
        made.sbs(latitude=50.0, longitude=8.0) + b"\r\n",
        beast(FRAME),
        beast(bytes(13) + b"\x1a", ticks=0x1A1A1A1A1A1A),
        beast(bytes(7), b"2"),
        beast(b"\0\0", b"1"),
        b"*8D40621D58C382D690C8AC2863A7;\n",
        b"@000000B71B008D40621D58C386435CC412692AD6;\n",
        made.tagged(made.class_a(211000001, 6), 1_700_000_000) + b"\n",
    ]
)
KINDS = [NMEA, SBS, MODE_S, MODE_S, MODE_S, MODE_S, MODE_S, NMEA]


def test_all_formats_come_in_one_stream():
    splitter = Splitter(Counter())
    units = list(splitter.feed(STREAM, "x"))
    assert [unit.kind for unit in units] == KINDS
    assert units[2].data == FRAME
    ticks = [12_000_000, 0x1A1A1A1A1A1A, 12_000_000]
    assert [units[k].ticks for k in (2, 3, 6)] == ticks
    assert splitter.counts == {"other_line": 1}


@pytest.mark.parametrize("size", [1, 2, 3, 7, 50])
def test_a_stream_may_be_cut_anywhere(size):
    whole = list(Splitter(Counter()).feed(STREAM, "x"))
    splitter, units = Splitter(Counter()), []
    for at in range(0, len(STREAM), size):
        units += splitter.feed(STREAM[at : at + size], "x")
    assert units == whole


def test_sources_are_cut_independently():
    line = made.class_a(211000001, 5)
    splitter = Splitter(Counter())
    assert not list(splitter.feed(line[:20], "a"))
    assert [unit.data for unit in splitter.feed(line, "b")] == [line]
    assert [unit.data for unit in splitter.feed(line[20:], "a")] == [line]


def test_datagrams_need_no_line_end():
    line = made.tagged(made.class_a(211000001, 5), 1_700_000_000)
    assert [unit.data for unit in Splitter(Counter()).feed(line, "x")] == [line]


def test_the_last_line_of_a_file_needs_no_end():
    line = made.sbs(latitude=50.0, longitude=8.0)
    splitter = Splitter(Counter())
    assert not list(splitter.feed(line, "x"))
    assert [unit.data for unit in splitter.finish()] == [line]


@pytest.mark.parametrize("piece", [700, 65_536, 2**20])
def test_lines_of_a_megabyte_are_passed_in_bounded_memory(piece):
    data = b"MSG,3," + b"9" * 2**20 + b"\n" + made.class_a(211000001, 5) + b"\n"
    splitter, units, most = Splitter(Counter()), [], 0
    for at in range(0, len(data), piece):
        units += splitter.feed(data[at : at + piece], "x")
        most = max(most, *map(len, splitter._rests.values()), 0)
    assert [unit.kind for unit in units] == [NMEA]
    assert splitter.counts == {"line_too_long": 1}
    assert most <= LONGEST_LINE


def test_a_cut_frame_costs_no_other():
    splitter = Splitter(Counter())
    units = list(splitter.feed(beast(FRAME)[:15] + beast(FRAME) + b"\x1a9" + beast(FRAME), "x"))
    assert [unit.data for unit in units] == [FRAME, FRAME]
    assert splitter.counts == {"frame_broken": 2}


def test_sources_are_bounded():
    splitter = Splitter(Counter())
    for number in range(1000):
        list(splitter.feed(b"MSG,3", f"source {number}"))
    assert len(splitter._rests) == 256
    assert splitter.counts == {"line_cut": 744}
