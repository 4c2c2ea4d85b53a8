"""Writes datagrams to a pcap capture: UDP over IPv4 on Ethernet, with microseconds."""

from __future__ import annotations

import struct
from typing import NamedTuple

_MAGIC, _ETHERNET, _LONGEST = 0xA1B2C3D4, 1, 65535
_HEADER, _PACKET, _UDP = struct.Struct("<IHHiIII"), struct.Struct("<IIII"), struct.Struct(">HHHH")
_IP = struct.Struct(">BBHHHBBH4s4s")
_DESTINATION, _SOURCE = b"\x01\x00\x5e\x01\x01\x01", b"\x02\x00\x00\x00\x00\x01"


class Line(NamedTuple):
    """The IPv4 addresses of sender and receiver."""

    sender: tuple[int, int, int, int] = (10, 0, 0, 1)
    receiver: tuple[int, int, int, int] = (239, 1, 1, 1)
    port: int = 8600  # UDP port of sender and receiver


def header() -> bytes:
    """Return the header of a capture."""
    return _HEADER.pack(_MAGIC, 2, 4, 0, 0, _LONGEST, _ETHERNET)


def packet(time_ns: int, payload: bytes, line: Line) -> bytes:
    """Return a datagram, received at a time since the epoch, as a captured packet."""
    # A checksum of 0 means that it is absent.
    udp = _UDP.pack(line.port, line.port, _UDP.size + len(payload), 0) + payload
    fixed = 0x45, 0, _IP.size + len(udp), 0, 0x4000, 1, 17
    addresses = bytes(line.sender), bytes(line.receiver)
    checksum = _checksum(_IP.pack(*fixed, 0, *addresses))
    data = _DESTINATION + _SOURCE + b"\x08\x00" + _IP.pack(*fixed, checksum, *addresses) + udp
    seconds, rest_ns = divmod(time_ns, 10**9)
    return _PACKET.pack(seconds, rest_ns // 1000, len(data), len(data)) + data


def _checksum(head: bytes) -> int:
    """Return the checksum of an IPv4 header (RFC 791) with a zero checksum field."""
    total: int = sum(struct.unpack(f">{len(head) // 2}H", head))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF
