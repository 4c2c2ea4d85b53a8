"""Reads the UDP payloads of pcap and pcapng captures.

The parser is our own: of the maintained libraries, scapy needs 20 MB and 0.1 ms per packet, and no
other reads both formats without dissecting unneeded layers. It reads the blocks of two file
formats, four link layers, IPv4 and UDP.
"""

from __future__ import annotations

import mmap
import struct
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

from .datagram import Datagram

# The first four bytes of a pcap file: byte order, and nanoseconds per unit of the times.
_MAGICS = {
    b"\xd4\xc3\xb2\xa1": ("<", 1000),
    b"\xa1\xb2\xc3\xd4": (">", 1000),
    b"\x4d\x3c\xb2\xa1": ("<", 1),
    b"\xa1\xb2\x3c\x4d": (">", 1),
}
_PCAPNG = b"\x0a\x0d\x0d\x0a"
_ORDER_MAGIC = b"\x1a\x2b\x3c\x4d"
_SECTION, _INTERFACE, _SIMPLE, _ENHANCED = 0x0A0D0D0A, 1, 3, 6
_RESOLUTION = 9
# Link layers by their number: loopback, Ethernet, IP without one, Linux "cooked" 1 and 2.
_NULL, _ETHERNET, _RAW, _COOKED, _RAW4, _COOKED2 = 0, 1, 101, 113, 228, 276
_IP, _VLANS = 0x0800, (0x8100, 0x88A8, 0x9100)
_UDP = 17


class Packet(NamedTuple):
    """A captured packet."""

    data: bytes  # Bytes from the link layer on
    time_ns: int | None  # Time of capture since the epoch; None if unknown
    link: int  # Number of the link layer


def is_capture(begin: bytes) -> bool:
    """Return whether these first four bytes of a file identify a capture."""
    return begin in _MAGICS or begin == _PCAPNG


def packets(data: bytes | mmap.mmap, counts: Counter[str]) -> Iterator[Datagram]:
    """Yield the UDP payloads of a capture.

    `counts` gains ``not_udp``, ``fragment``, ``packet_cut`` (captured incompletely), ``link``
    (unknown link layer), and ``recording_cut`` if the rest of the file is damaged.
    """
    found = _classic(data, counts) if data[:4] in _MAGICS else _next_generation(data, counts)
    for packet in found:
        datagram = _datagram(packet, counts)
        if datagram is not None:
            yield datagram


def _classic(data: bytes | mmap.mmap, counts: Counter[str]) -> Iterator[Packet]:
    order, unit_ns = _MAGICS[data[:4]]
    if len(data) < 24:
        counts["recording_cut"] += 1
        return
    (link,) = struct.unpack(order + "I", data[20:24])
    at, header = 24, struct.Struct(order + "IIII")
    while at < len(data):
        if len(data) - at < header.size:
            counts["recording_cut"] += 1
            return
        seconds, fraction, length, _ = header.unpack(data[at : at + header.size])
        at += header.size
        if at + length > len(data):
            counts["recording_cut"] += 1
            return
        # The upper bits give the length of checksums.
        yield Packet(data[at : at + length], seconds * 10**9 + fraction * unit_ns, link & 0xFFFF)
        at += length


def _next_generation(data: bytes | mmap.mmap, counts: Counter[str]) -> Iterator[Packet]:
    order, at = "<", 0
    interfaces: list[tuple[int, int]] = []  # link layer and units per second
    while at < len(data):
        if data[at : at + 4] == _PCAPNG:
            order = ">" if data[at + 8 : at + 12] == _ORDER_MAGIC else "<"
            interfaces = []
        if len(data) - at < 12:
            counts["recording_cut"] += 1
            return
        kind, length = struct.unpack(order + "II", data[at : at + 8])
        if length < 12 or length % 4 or at + length > len(data):
            counts["recording_cut"] += 1
            return
        body = data[at + 8 : at + length - 4]
        at += length
        if kind == _INTERFACE and len(body) >= 8:
            (link,) = struct.unpack(order + "H", body[:2])
            interfaces.append((link, _units_per_s(body[8:], order)))
        elif kind == _ENHANCED and len(body) >= 20:
            number, high, low, captured, _ = struct.unpack(order + "IIIII", body[:20])
            if number >= len(interfaces) or captured > len(body) - 20:
                counts["packet_cut"] += 1
                continue
            link, units = interfaces[number]
            time_ns = (high << 32 | low) * 10**9 // units
            yield Packet(body[20 : 20 + captured], time_ns, link)
        elif kind == _SIMPLE and len(body) >= 4 and interfaces:
            yield Packet(body[4:], None, interfaces[0][0])


def _units_per_s(options: bytes, order: str) -> int:
    """Return the units per second of an interface's times; microseconds by default."""
    at = 0
    while at + 4 <= len(options):
        code, length = struct.unpack(order + "HH", options[at : at + 4])
        if code == _RESOLUTION and length >= 1 and at + 4 < len(options):
            power = options[at + 4]
            # Finer resolutions are implausible.
            base, most = (2, 64) if power & 0x80 else (10, 18)
            return int(base ** min(power & 0x7F, most))
        if not code:
            break
        at += 4 + (length + 3) // 4 * 4
    return 10**6


def _datagram(packet: Packet, counts: Counter[str]) -> Datagram | None:
    """Return the UDP payload of a packet, None if there is none."""
    at = _ip_begin(packet)
    if at is None:
        counts["link"] += 1
        return None
    data = packet.data
    if at < 0 or len(data) < at + 20 or data[at] >> 4 != 4 or data[at + 9] != _UDP:
        counts["not_udp"] += 1
        return None
    if (data[at + 6] << 8 | data[at + 7]) & 0x3FFF:
        counts["fragment"] += 1
        return None
    udp = at + 4 * (data[at] & 15)
    if len(data) < udp + 8:
        counts["packet_cut"] += 1
        return None
    port, length = struct.unpack(">HH", data[udp + 2 : udp + 6])
    payload = data[udp + 8 : udp + length]
    if len(payload) < length - 8:
        counts["packet_cut"] += 1
        return None
    sender, receiver = (".".join(map(str, data[k : k + 4])) for k in (at + 12, at + 16))
    return Datagram(payload, packet.time_ns, f"{sender} to {receiver}:{port}")


def _ip_begin(packet: Packet) -> int | None:
    """Return the beginning of the IP header, -1 if absent, None for an unknown link layer."""
    data, link = packet.data, packet.link
    if link in (_RAW, _RAW4):
        return 0
    if link == _NULL:
        return 4
    if link in (_COOKED, _COOKED2):
        kind_at, at = (14, 16) if link == _COOKED else (0, 20)
        return at if _kind(data, kind_at) == _IP else -1
    if link != _ETHERNET:
        return None
    at = 12
    while _kind(data, at) in _VLANS:
        at += 4
    return at + 2 if _kind(data, at) == _IP else -1


def _kind(data: bytes, at: int) -> int:
    """Return the protocol number of the next layer, 0 if it is cut off."""
    return int.from_bytes(data[at : at + 2], "big")
