import socket
import struct
import time
from collections import Counter

import asterix_records as made
import pytest

from phd_jdtc_ros.asterix import framing
from phd_jdtc_ros.asterix.clocks import NS_PER_DAY
from phd_jdtc_ros.transport import pcap
from phd_jdtc_ros.transport.network import Datagram
from phd_jdtc_ros.transport.pcap import Line
from phd_jdtc_ros.transport.sockets import MAX_BYTES, Address, Receiver

NS = 10**9
MIDNIGHT = 20_779 * NS_PER_DAY
LINE = Line((10, 1, 2, 3), (239, 4, 5, 6), 8611)
SENT = [(1_772_445_600_123_456_000, b"first"), (1_772_445_601_000_001_000, b"second one")]
LARGE = bytes(60_000)


@pytest.fixture(scope="module")
def blocks():
    return [*made.revolutions(1, sectors=8, seen=[(40.0, 10.0), (200.0, 20.0)])]


def read(data, midnight_ns=None):
    counts = Counter()
    return [*framing.datagrams(data, midnight_ns, counts)], +counts


def test_raw_recording_is_its_blocks_and_goes_on_behind_damage(blocks):
    found, counts = read(b"".join(blocks))
    assert found == [Datagram(block) for block in blocks]
    assert not counts
    damaged = b"".join([*blocks[:3], b"\x00\xff\x30" * 20, *blocks[3:], blocks[0][:4]])
    found, counts = read(damaged)
    assert [each.data for each in found] == blocks
    assert counts == {"bytes_skipped": 64, "resynchronised": 1, "recording_cut": 1}


@pytest.mark.parametrize("size", [1, 2, 4, 10, 30])
@pytest.mark.parametrize("before", [True, False])
def test_raw_recording_loses_no_block_to_what_a_recorder_writes_between_them(blocks, size, before):
    rng = made.rng(size)
    for between in (b"\n" * size, b"\xff" * size, None):
        parts = [between or rng.bytes(size) for _ in blocks]
        pairs = [*zip(parts, blocks, strict=True)]
        data = b"".join(part + block if before else block + part for part, block in pairs)
        found, counts = read(data)
        assert [each.data for each in found if each.data in blocks] == blocks
        others = sum(len(each.data) for each in found if each.data not in blocks)
        assert counts["bytes_skipped"] + counts["padding_bytes"] + others == size * len(blocks)
        assert others <= 40


def test_final_envelopes_have_the_times_of_their_receipt(blocks):
    data = b"".join(made.final(block, 100.0 + k, line=3) for k, block in enumerate(blocks))
    found, counts = read(data, MIDNIGHT)
    assert not counts
    assert [each.data for each in found] == blocks
    assert [each.received_ns for each in found] == [
        MIDNIGHT + (100 + k) * NS for k in range(len(blocks))
    ]
    assert {each.source for each in found} == {"board 0 line 3"}


def test_final_envelopes_go_on_after_midnight_and_behind_damage(blocks):
    times = (86_399.5, 86_399.99, 0.25, 1.0)
    data = b"".join(made.final(blocks[0], time_s) for time_s in times)
    found, _ = read(data, MIDNIGHT)
    expected = [86_399.5, 86_399.99, 86_400.25, 86_401.0]
    assert [(each.received_ns - MIDNIGHT) / NS for each in found] == expected
    first, second, third = (made.final(block, 5.0) for block in blocks[:3])
    found, counts = read(first + b"\x00\x40" + second[2:] + third + third[:9])
    assert [each.data for each in found] == [blocks[0], blocks[2]]
    assert counts["resynchronised"] == 1
    assert counts["recording_cut"] == 1


def test_wrong_byte_in_final_envelopes_loses_one_of_them_at_most(blocks):
    sent = blocks[:5]
    data = b"".join(made.final(block, 5.0) for block in sent)
    for at in range(len(made.final(sent[0], 5.0)), len(data)):
        for part in (b"", bytes([data[at] ^ 0x40]), bytes([7, data[at]])):
            found, counts = read(data[:at] + part + data[at + 1 :])
            assert len([block for block in sent if block not in [d.data for d in found]]) <= 1
            assert sum(len(each.data) + 12 for each in found) + counts["bytes_skipped"] == len(
                data
            ) - 1 + len(part)


@pytest.mark.parametrize("kind", [made.pcap, made.pcapng])
@pytest.mark.parametrize("order", "<>")
def test_capture_has_payloads_times_and_sources(blocks, kind, order):
    times = [MIDNIGHT + k * 250_000_000 for k in range(len(blocks))]
    packets = [made.packet(block, vlan=k % 2 == 1) for k, block in enumerate(blocks)]
    found, counts = read(kind([*zip(times, packets, strict=True)], order=order))
    assert not counts
    source = "10.0.0.1 to 239.1.1.1:8600"
    assert found == [Datagram(b, t, source) for b, t in zip(blocks, times, strict=True)]


def test_capture_has_nanoseconds_and_may_be_moved_to_a_day(blocks):
    found, _ = read(made.pcap([(MIDNIGHT + 123_456_789, made.packet(blocks[0]))], nanoseconds=True))
    assert found[0].received_ns == MIDNIGHT + 123_456_789
    times = [MIDNIGHT + NS_PER_DAY - NS, MIDNIGHT + NS_PER_DAY + NS]
    data = made.pcap([(time_ns, made.packet(blocks[0])) for time_ns in times])
    found, _ = read(data, MIDNIGHT + 5 * NS_PER_DAY)
    assert [each.received_ns for each in found] == [t + 5 * NS_PER_DAY for t in times]


def test_capture_counts_what_has_no_asterix(blocks):
    good = made.packet(blocks[0])
    arp = good[:12] + b"\x08\x06" + bytes(28)
    tcp, other = (good[:23] + protocol + good[24:] for protocol in (b"\x06", b"\x59"))
    mpls, unknown = (good[:12] + kind + good[14:] for kind in (b"\x88\x47", b"\x88\xcc"))
    logical = good[:12] + (len(good) - 14).to_bytes(2, "big") + good[14:]
    fragment = good[:20] + b"\x20\x00" + good[22:]
    cut = good[:-3], b"", good[:20]
    others = arp, tcp, other, mpls, unknown, logical, fragment
    found, counts = read(made.pcap([(0, each) for each in (*others, *cut, good)]))
    assert [each.data for each in found] == [blocks[0]]
    named = ("arp", "tcp", "not_udp", "mpls", "not_ip", "ieee_802_2", "fragment")
    assert counts == {**dict.fromkeys(named, 1), "packet_cut": 3}


@pytest.mark.parametrize(
    ("headers", "fragment"),
    [
        ([], False),
        ([(0, b"\x00" + bytes(6)), (60, b"\x01" + bytes(14)), (43, b"\x00" + bytes(6))], False),
        ([(44, bytes(7)), (51, b"\x01" + bytes(10))], False),
        ([(44, b"\x00\x00\x01" + bytes(4))], True),
        ([(60, b"\x00" + bytes(6)), (44, b"\x00\x05\x28" + bytes(4))], True),
    ],
)
def test_capture_of_ipv6_is_read_behind_its_extension_headers(blocks, headers, fragment):
    udp = struct.pack(">HHHH", 40000, 8600, len(blocks[0]) + 8, 0) + blocks[0]
    protocol = 17
    for kind, body in reversed(headers):
        udp, protocol = bytes([protocol]) + body + udp, kind
    ip = struct.pack(">IHBB", 6 << 28, len(udp), protocol, 64)
    ip += bytes.fromhex("fe80" + 13 * "00" + "07" + "ff02" + 12 * "00" + "0101") + udp
    frame = b"\x33\x33" + bytes(10) + b"\x86\xdd" + ip
    found, counts = read(made.pcap([(5 * NS, frame), (6 * NS, frame[:60])]))
    if fragment:
        assert (found, counts["fragment"]) == ([], 1)
    else:
        assert found == [Datagram(blocks[0], 5 * NS, "fe80::7 to [ff02::101]:8600")]
    assert counts["packet_cut"] == 1


def test_capture_that_was_cut_is_read_to_its_end(blocks):
    for kind in (made.pcap, made.pcapng):
        sent = [(0, made.packet(block)) for block in blocks]
        data = kind(sent)
        found, counts = read(data[:-5])
        assert [each.data for each in found] == blocks[:-1]
        assert counts == {"recording_cut": 1, "bytes_skipped": len(data) - 5 - len(kind(sent[:-1]))}


def test_random_bytes_behind_any_header_are_read_without_an_error(blocks):
    rng = made.rng(7)
    heads = [
        b"".join(blocks[:2]),
        made.final(blocks[0], 1.0),
        made.pcap([(0, made.packet(blocks[0]))]),
        made.pcapng([(0, made.packet(blocks[0]))]),
    ]
    for head in heads:
        for _ in range(100):
            data = bytearray(head * 3 + rng.bytes(int(rng.integers(300))))
            for _ in range(int(rng.integers(6))):
                data[int(rng.integers(len(head), len(data)))] = int(rng.integers(256))
            found, _ = read(bytes(data))
            assert found


def capture():
    return pcap.header() + b"".join(pcap.packet(t, data, LINE) for t, data in SENT)


def test_capture_is_read_again():
    counts = Counter()
    found = list(pcap.packets(capture(), counts))
    assert not counts
    assert pcap.is_capture(capture()[:4])
    assert [(each.received_ns, each.data) for each in found] == SENT
    assert {each.source for each in found} == {"10.1.2.3 to 239.4.5.6:8611"}


def test_headers_have_a_checksum_that_is_right():
    for time_ns, data in SENT:
        ip = pcap.packet(time_ns, data, LINE)[16 + 14 :][:20]
        total = sum(struct.unpack(">10H", ip))
        assert (total & 0xFFFF) + (total >> 16) == 0xFFFF


@pytest.fixture
def receiver():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        where = Address(*free.getsockname())
    made = Receiver([where], "", lambda: None)
    yield made, where
    made.close()


def sent(receiver, where, datagrams):
    """Send datagrams one after the other, each once the one before is received."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        for data in datagrams:
            before, until_s = receiver.received, time.monotonic() + 10.0
            sock.sendto(data, where)
            while receiver.received == before and time.monotonic() < until_s:
                time.sleep(1e-3)


def test_receiver_bounds_the_bytes_that_wait_and_counts_the_rest(receiver):
    made, where = receiver
    room = MAX_BYTES // len(LARGE)
    sent(made, where, [LARGE] * (room + 5))
    assert (made.waiting, made.lost) == (room, 5)


def test_receiver_has_room_again_for_what_was_taken(receiver):
    made, where = receiver
    room = MAX_BYTES // len(LARGE)
    sent(made, where, [LARGE] * (room + 1))
    assert made.take().data == LARGE
    sent(made, where, [b"abc" + LARGE[3:]])
    found = [made.take().data[:3] for _ in range(room)]
    assert found == [bytes(3)] * (room - 1) + [b"abc"]
    assert made.take() is None
    assert made.lost == 1
