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


@pytest.mark.parametrize("order", "<>")
def test_packets_of_old_captures_are_read(blocks, order):
    """The block of packets that the enhanced one has replaced has a shorter number."""
    data, sent = made.pcapng(packets(blocks), order), bytearray()
    for at, after in itertools.pairwise([*begins(data, order, made.pcapng), len(data)]):
        kind, size, interface = struct.unpack(order + "III", data[at : at + 12])
        if kind == 6:
            head = struct.pack(order + "IIHH", 2, size, interface, 0xFFFF)
            sent += head + data[at + 12 : after]
        else:
            sent += data[at:after]
    found, counts = read(bytes(sent))
    assert (found, counts) == read(data)
    assert data_of(found) == blocks


@pytest.mark.parametrize("kind", [made.pcap, made.pcapng])
def test_a_time_of_zero_is_unknown(blocks, kind):
    found, counts = read(kind([(0, made.packet(block)) for block in blocks]))
    assert data_of(found) == blocks
    assert {each.received_ns for each in found} == {None}
    assert not counts


LOOPBACK, COOKED_VLAN = b"\x02\0\0\0", bytes(14) + b"\x81\0\0\5\x08\0"
ERF = bytes(8) + b"\x82" + bytes(7) + b"\x80" + bytes(7) + bytes(8) + bytes(2)
LINKS = {
    "raw": (12, b""),
    "loop": (108, LOOPBACK[::-1]),
    "PPP": (9, b"\xff\x03\0\x21"),
    "PPP without address": (50, b"\0\x21"),
    "Cisco HDLC": (104, b"\x0f\0\x08\0"),
    "cooked with VLAN": (113, COOKED_VLAN),
    "ERF with further headers": (197, ERF + bytes(12) + b"\x08\0"),
    "VLAN in VLAN": (1, bytes(12) + b"\x92\0\0\5\x93\0\0\6\x08\0"),
    "PPP in Ethernet": (1, bytes(12) + b"\x88\x64\x11\0\0\1\0\x40\0\x21"),
}


def captured(packets, link=1):
    data = bytearray(made.pcap([(START + k, each) for k, each in enumerate(packets)]))
    data[20:24] = link.to_bytes(4, "little")
    return bytes(data)


def ip(protocol, body, offset=0, more=False, number=0):
    place = (more << 13) | offset // 8
    head = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(body), number, place, 9, protocol, 0)
    return head + bytes(8) + body


def on_ethernet(packet):
    return bytes(12) + b"\x08\0" + packet


@pytest.mark.parametrize(("link", "head"), LINKS.values(), ids=LINKS)
def test_datagrams_are_found_behind_every_link_layer(blocks, link, head):
    found, counts = read(captured([head + made.packet(block)[14:] for block in blocks], link))
    assert (data_of(found), counts) == (blocks, {})


def udp(port, body):
    return ip(17, struct.pack(">HHHH", 1, port, 8 + len(body), 0) + body)


TUNNELS = {
    "TZSP": lambda frame: udp(37008, b"\1\0\0\1\x0a\1\7\0\1" + frame),
    "VXLAN": lambda frame: udp(4789, b"\x08" + bytes(7) + frame),
    "ERSPAN I": lambda frame: ip(47, b"\0\0\x88\xbe" + frame),
    "ERSPAN II": lambda frame: ip(47, b"\x10\0\x88\xbe" + bytes(4) + bytes(8) + frame),
    "ERSPAN III": lambda frame: ip(47, b"\x10\0\x22\xeb" + bytes(4) + bytes(12) + frame),
    "GRE with key": lambda frame: ip(47, b"\x20\0\x65\x58" + bytes(4) + frame),
    "IP in IP": lambda frame: ip(4, frame[14:]),
}


@pytest.mark.parametrize("around", TUNNELS.values(), ids=TUNNELS)
def test_datagrams_are_found_in_what_switches_copy(blocks, around):
    packets = [on_ethernet(around(made.packet(block))) for block in blocks]
    found, counts = read(captured(packets))
    assert (data_of(found), counts) == (blocks, {})
    assert {each.source for each in found} == {"10.0.0.1 to 239.1.1.1:8600"}


@pytest.mark.parametrize("order", [1, -1])
def test_fragments_are_joined_in_any_order_and_counted_if_one_is_missing(blocks, order):
    pieces = []
    for number, block in enumerate(blocks):
        body = made.packet(block)[34:]
        parts = [*range(0, len(body), 8)][::order]
        pieces.append([ip(17, body[k : k + 8], k, k + 8 < len(body), number=number) for k in parts])
    mixed = [each for row in itertools.zip_longest(*pieces) for each in row if each is not None]
    found, counts = read(captured(map(on_ethernet, mixed)))
    assert (sorted(data_of(found)), counts) == (sorted(blocks), {})
    lost = pieces[0].pop(1)
    found, counts = read(captured([on_ethernet(each) for each in mixed if each != lost]))
    assert (sorted(data_of(found)), counts) == (sorted(blocks[1:]), {"fragment": len(pieces[0])})


def test_layers_of_random_bytes_end(blocks):
    rng = made.rng(3)
    for link in (0, 1, 9, 12, 104, 113, 197, 276):
        packets = [rng.bytes(int(rng.integers(200))) for _ in range(100)]
        packets += [on_ethernet(around(rng.bytes(60))) for around in TUNNELS.values()]
        found, _ = read(captured(packets, link) + captured([made.packet(blocks[0])]))
        assert data_of(found)[-1:] == [blocks[0]]
