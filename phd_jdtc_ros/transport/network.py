"""A datagram, and how it is found in a captured packet: five link layers, IPv4 and IPv6."""

from __future__ import annotations

import ipaddress
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

# Latest time that fits a stamp, which has 31 bits of seconds since 1970, less a day of margin
# because a slice ends after its plots.
LAST_NS = (2**31 - 1 - 86_400) * 10**9


def fits_stamp(time_ns: int) -> bool:
    """Return whether a time fits a stamp."""
    return 0 <= time_ns <= LAST_NS


class Datagram(NamedTuple):
    """One received datagram, or a piece of a stream."""

    data: bytes  # Data blocks
    received_ns: int | None = None  # Time of receipt since the epoch; None if unknown
    # ``SENDER to RECEIVER:PORT`` or ``board NUMBER line NUMBER``; None if unknown.
    source: str | None = None


def port_of(datagram: Datagram) -> int | None:
    """Return the destination UDP port of a datagram, None if unknown."""
    _, colon, port = (datagram.source or "").rpartition(":")
    return int(port) if colon else None


class RecordingError(ValueError):
    """The file is not a recording of ASTERIX."""


class Entry(NamedTuple):
    """An entry of a recording: a data block, an envelope, a captured packet, or a header."""

    begin: int
    end: int  # Where the next entry begins
    content: Any = None


def follow(
    size: int,
    read: Callable[[int], Entry | None],
    resume: Callable[[int], int],
    counts: Counter[str],
) -> Iterator[Entry]:
    """Yield the entries of a recording of `size` bytes in order.

    `read` returns the entry at a place, None if there is no plausible one. `resume` returns the
    first place from the given one on at which entries follow each other again, `size` if none
    does. An entry is yielded once the next one is there too: after damage, reading goes on within
    the last entry, because its length may be wrong, and the entry counts only if it ends before
    the next one begins.

    `counts` gains ``bytes_skipped``, which are all bytes outside the entries, and for each damaged
    place ``resynchronised``, or ``recording_cut`` if nothing follows.
    """
    at, last = 0, None
    while at < size or last is not None:
        entry = read(at) if at < size else None
        if entry is not None or at >= size:
            if last is not None:
                yield last
            at, last = (at, None) if entry is None else (entry.end, entry)
            continue
        found = resume(at + 1 if last is None else last.begin + 1)
        if last is not None and found >= last.end:
            yield last
        elif last is not None:
            at = last.begin
        counts["bytes_skipped"] += found - at
        counts["recording_cut" if found >= size else "resynchronised"] += 1
        at, last = found, None


# Link layers by their number: loopback, Ethernet, IP without one, Linux "cooked" 1 and 2.
_NULL, _ETHERNET, _COOKED, _COOKED2 = 0, 1, 113, 276
_BARE_IP = (101, 228, 229)
_IP, _VLANS = (0x0800, 0x86DD), (0x8100, 0x88A8, 0x9100)
_OTHER_LAYERS = {0x0806: "arp", 0x8847: "mpls", 0x8848: "mpls"}
# Smaller numbers in the place of the next layer's are lengths of IEEE 802.2.
_LEAST_ETHERTYPE = 0x600
_UDP = 17
_OTHER_PROTOCOLS = {1: "icmp", 2: "igmp", 6: "tcp", 58: "icmp", 132: "sctp"}
# Headers between that of IPv6 and UDP: options, routing and destination, fragments, authentication.
_OPTIONS, _FRAGMENT, _AUTHENTICATION = (0, 43, 60), 44, 51


class Packet(NamedTuple):
    """A captured packet."""

    data: bytes  # Bytes from the link layer on
    time_ns: int | None  # Time of capture since the epoch; None if unknown
    link: int | None  # Number of the link layer; None if the packet cannot be read


class _Internet(NamedTuple):
    """What the headers of the internet layer say."""

    protocol: int
    at: int  # Where the next layer begins
    fragment: bool
    sender: str
    receiver: str


def datagram_of(packet: Packet) -> Datagram | str:
    """Return the UDP datagram of a packet, or else the reason why there is none.

    Reasons are ``packet_cut`` (captured incompletely), ``link`` (unknown link layer), ``arp``,
    ``mpls``, ``ieee_802_2``, ``not_ip``, ``tcp``, ``icmp``, ``igmp``, ``sctp``, ``not_udp`` and
    ``fragment``.
    """
    at = "packet_cut" if packet.link is None else _internet_begin(packet.data, packet.link)
    found = at if isinstance(at, str) else _internet(packet.data, at)
    if isinstance(found, str):
        return found
    if found.protocol != _UDP:
        return _OTHER_PROTOCOLS.get(found.protocol, "not_udp")
    if found.fragment:
        return "fragment"
    data, at = packet.data, found.at
    if len(data) < at + 8:
        return "packet_cut"
    port, length = struct.unpack(">HH", data[at + 2 : at + 6])
    payload = data[at + 8 : at + length]
    if len(payload) < length - 8:
        return "packet_cut"
    return Datagram(payload, packet.time_ns, f"{found.sender} to {found.receiver}:{port}")


def _internet_begin(data: bytes, link: int) -> int | str:
    """Return the beginning of the IP header, or else the reason why there is none."""
    if link in _BARE_IP:
        return 0
    if link == _NULL:
        return 4
    if link == _COOKED:
        return _behind_kind(data, 14, 16)
    if link == _COOKED2:
        return _behind_kind(data, 0, 20)
    if link != _ETHERNET:
        return "link"
    at = 12
    while _word(data, at) in _VLANS:
        at += 4
    return _behind_kind(data, at, at + 2)


def _behind_kind(data: bytes, kind_at: int, at: int) -> int | str:
    """Return `at` if the number of the next layer is that of IP, or else that layer's name."""
    kind = _word(data, kind_at)
    if kind in _IP:
        return at
    if len(data) < at:
        return "packet_cut"
    return "ieee_802_2" if kind < _LEAST_ETHERTYPE else _OTHER_LAYERS.get(kind, "not_ip")


def _internet(data: bytes, at: int) -> _Internet | str:
    """Read the headers of IPv4 or IPv6, or return the reason why there are none."""
    version = data[at] >> 4 if at < len(data) else 0
    if len(data) < at + {4: 20, 6: 40}.get(version, 1):
        return "packet_cut"
    if version == 4:
        addresses = (ipaddress.IPv4Address(data[k : k + 4]) for k in (at + 12, at + 16))
        fragment = _word(data, at + 6) & 0x3FFF > 0
        return _Internet(data[at + 9], at + 4 * (data[at] & 15), fragment, *map(str, addresses))
    if version != 6:
        return "not_ip"
    sender, receiver = (ipaddress.IPv6Address(data[k : k + 16]) for k in (at + 8, at + 24))
    protocol, at, fragment = data[at + 6], at + 40, False
    while protocol in (*_OPTIONS, _FRAGMENT, _AUTHENTICATION):
        if len(data) < at + 8:
            return "packet_cut"
        size = 8 * (data[at + 1] + 1)
        if protocol == _FRAGMENT:
            # The offset, and whether more fragments follow.
            fragment, size = fragment or _word(data, at + 2) & 0xFFF9 > 0, 8
        elif protocol == _AUTHENTICATION:
            size = 4 * (data[at + 1] + 2)
        protocol, at = data[at], at + size
    return _Internet(protocol, at, fragment, str(sender), f"[{receiver}]")


def _word(data: bytes, at: int) -> int:
    """Return a number of two bytes, 0 if it is cut off."""
    return int.from_bytes(data[at : at + 2], "big")
