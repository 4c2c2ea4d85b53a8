"""Captures with wrong lengths, and captures that were joined."""

import itertools
import struct
from collections import Counter

import asterix_records as made
import pytest

from phd_jdtc_ros.asterix import framing

NS = 10**9
START = 1_764_410_400 * NS


@pytest.fixture(scope="module")
def blocks():
    return [*made.revolutions(1, seen=[(20.0 * k, 10.0 + k) for k in range(18)])]


def packets(blocks, start_ns=START):
    return [(start_ns + k * NS // 8, made.packet(block)) for k, block in enumerate(blocks)]


def read(data):
    counts = Counter()
    return [*framing.datagrams(data, None, counts)], +counts


def data_of(found):
    return [each.data for each in found]


def begins(data, order, kind):
    """Return the places of the headers of a capture's packets or blocks."""
    at = 24 if kind is made.pcap else 0
    while at < len(data):
        yield at
        if kind is made.pcap:
            at += 16 + struct.unpack(order + "I", data[at + 8 : at + 12])[0]
        else:
            at += struct.unpack(order + "I", data[at + 4 : at + 8])[0]


def lengths(data, order, kind):
    """Return the places of all length fields of a capture, each of four bytes."""
    found = []
    for at in begins(data, order, kind):
        if kind is made.pcap:
            found += [at + 8, at + 12]
            continue
        end = at + struct.unpack(order + "I", data[at + 4 : at + 8])[0]
        block = struct.unpack(order + "I", data[at : at + 4])[0]
        found += [at + 4, end - 4] + ([at + 20, at + 24] if block == 6 else [])
    return found


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("kind", [made.pcap, made.pcapng])
def test_wrong_bit_in_any_length_loses_one_packet_at_most(blocks, kind, order):
    sent = blocks[:8]
    data = kind(packets(sent), order=order)
    for at, bit in itertools.product(lengths(data, order, kind), range(32)):
        wrong = bytearray(data)
        wrong[at + bit // 8] ^= 1 << bit % 8
        found, counts = read(bytes(wrong))
        lost = [block for block in sent if block not in data_of(found)]
        assert len(lost) <= 1, (at, bit, counts)
        assert not lost or counts["bytes_skipped"] or counts["packet_cut"]
        times = {each.data: each.received_ns for each in found}
        assert all(
            times.get(block, t) == t
            for t, block in zip((START + k * NS // 8 for k in range(8)), sent, strict=True)
        )


@pytest.mark.parametrize("kind", [made.pcap, made.pcapng])
def test_lost_or_inserted_byte_loses_one_packet_at_most(blocks, kind):
    sent = blocks[:8]
    data = kind(packets(sent))
    first = 24 if kind is made.pcap else [*begins(data, "<", kind)][2]
    for at, (gone, more) in itertools.product(range(first, len(data)), [(1, b""), (0, b"\x07")]):
        found, counts = read(data[:at] + more + data[at + gone :])
        # A packet whose content is damaged may be read; it is then another one.
        assert len([block for block in sent if block not in data_of(found)]) <= 1, (at, counts)


def test_joined_captures_are_all_read(blocks):
    kinds = [
        made.pcap(packets(blocks)),
        made.pcap(packets(blocks, START + 10**15), order=">"),
        made.pcap(packets(blocks, START - 10**15), nanoseconds=True),
        made.pcapng(packets(blocks, START + 10**14)),
        made.pcapng(packets(blocks), order=">"),
    ]
    for first, second in itertools.product(kinds, repeat=2):
        apart = read(first)[0] + read(second)[0]
        assert read(first + second) == (apart, {})
        # The end of the first one is missing.
        found, counts = read(first[:-30] + second)
        assert found == apart[: len(blocks) - 1] + apart[len(blocks) :]
        assert counts["resynchronised"] == 1
        assert counts["bytes_skipped"] > 0


def test_bytes_between_packets_are_counted(blocks):
    sent = packets(blocks)
    for garbage in (b"\xff" * 1000, bytes(1001), bytes(range(256)) * 9):
        data = made.pcap(sent[:5]) + garbage + made.pcap(sent[5:])[24:]
        found, counts = read(data)
        assert data_of(found) == blocks
        assert counts == {"bytes_skipped": len(garbage), "resynchronised": 1}


def test_times_of_an_interface_have_its_resolution_and_offset(blocks):
    for resolution, units in ((3, 10**3), (9, 10**9), (0x80 | 20, 2**20), (None, 10**6)):
        for offset_s in (None, 0, -3600, 1_764_410_400):
            data = bytearray(made.pcapng([]))
            options = b""
            if resolution is not None:
                options += struct.pack("<HHB3x", 9, 1, resolution)
            if offset_s is not None:
                options += struct.pack("<HHq", 14, 8, offset_s)
            body = struct.pack("<HHI", 1, 0, 65535) + options + bytes(4)
            size = struct.pack("<I", len(body) + 12)
            section = bytes(data[:28]) + b"\x01\0\0\0" + size + body + size
            frame = made.packet(blocks[0])
            frame += bytes(-len(frame) % 4)
            ticks = 5_000 * units + units // 4
            packet = struct.pack(
                "<IIIII", 0, ticks >> 32, ticks & 0xFFFFFFFF, len(frame), len(frame)
            )
            size = struct.pack("<I", len(packet) + len(frame) + 12)
            found, counts = read(section + b"\x06\0\0\0" + size + packet + frame + size)
            assert not counts
            expected_ns = (5_000 + (offset_s or 0)) * NS + NS // 4
            assert [each.received_ns for each in found] == [expected_ns]
