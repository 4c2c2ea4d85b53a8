"""A datagram, and how it is found in captured packets: link layers, tunnels, IPv4 and IPv6."""

from __future__ import annotations

import ipaddress
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple


def fits_stamp(time_ns: int) -> bool:
    """Return whether a time, nanoseconds since 1970, fits the 31 bits of a ROS stamp."""
    # Latest time that fits a stamp, which has 31 bits of seconds since 1970, less a day of margin
    # because a slice ends after its plots.
    return 0 <= time_ns <= (2**31 - 1 - 86_400) * 10**9


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


# What a layer is, by its EtherType; those that have none have negative numbers.
_IPV4, _IPV6, _ETHERNET, _PPP, _PPP_IN_ETHERNET = 0x0800, 0x86DD, 0x6558, 0x880B, 0x8864
_VLANS, _ERSPAN_2, _ERSPAN_3 = (0x8100, 0x88A8, 0x9100, 0x9200, 0x9300), 0x88BE, 0x22EB
_COOKED, _COOKED_2, _HDLC, _ERF, _TZSP, _VXLAN, _LOOPBACK = range(-7, 0)
# Link layers by their number in captures.
_LINKS = {
    **dict.fromkeys((12, 14, 101, 228, 229), _IPV4),  # Either version of IP
    **dict.fromkeys((0, 108), _LOOPBACK),
    **dict.fromkeys((9, 50), _PPP),
    **{1: _ETHERNET, 104: _HDLC, 113: _COOKED, 197: _ERF, 276: _COOKED_2},
}
# UDP ports of copies that switches send to a monitor.
_MONITORS = {37008: _TZSP, 4789: _VXLAN}
_PPP_LAYERS = {0x21: _IPV4, 0x57: _IPV6}
_UDP, _GRE, _IN_IP = 17, 47, (4, 41)
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
    end: int  # Where it ends
    sender: str
    receiver: str
    # Of a fragment: where it belongs, bytes, whether others follow, and the number of the whole.
    offset: int = 0
    more: bool = False
    number: int = 0


class Packets:
    """Finds the UDP datagrams in captured packets, joins fragments, and follows tunnels."""

    def __init__(self) -> None:
        self._waiting: dict[tuple[str, str, int, int], dict[int, tuple[bytes, bool]]] = {}
        self._lost = 0

    @property
    def incomplete(self) -> int:
        """Number of fragments of which others are missing."""
        return self._lost + sum(map(len, self._waiting.values()))

    def datagram_of(self, packet: Packet) -> Datagram | str:
        """Return the UDP datagram of a packet, or else the reason why there is none.

        Reasons are ``packet_cut`` (captured incompletely), ``link`` (unknown link layer), ``arp``,
        ``mpls``, ``ieee_802_2``, ``not_ip``, ``tcp``, ``icmp``, ``igmp``, ``sctp`` and ``not_udp``;
        the reason is empty for a fragment that waits for others.
        """
        other_protocols = {1: "icmp", 2: "igmp", 6: "tcp", 58: "icmp", 132: "sctp"}
        data, at, layer = packet.data, 0, _LINKS.get(packet.link or 0)
        if packet.link is None or layer is None:
            return "packet_cut" if packet.link is None else "link"
        while True:
            found = _internet(data, *_begin(data, at, layer))
            if isinstance(found, str):
                return found
            if found.more or found.offset:
                whole = self._join(found, data[found.at : found.end])
                if whole is None:
                    return ""
                data, found = whole, found._replace(at=0, end=len(whole))
            at = found.at
            if found.protocol == _GRE:
                layer, at = _behind_gre(data, at)
            elif found.protocol in _IN_IP:
                layer = _IPV4
            elif found.protocol != _UDP:
                return other_protocols.get(found.protocol, "not_udp")
            elif (port := _word(data, at + 2)) in _MONITORS:
                layer, at = _MONITORS[port], at + 8
            else:
                return _payload(data, found, port, packet.time_ns)

    def _join(self, found: _Internet, body: bytes) -> bytes | None:
        """Return the whole of which this is a fragment, None if others are missing."""
        key = found.sender, found.receiver, found.number, found.protocol
        pieces = self._waiting.setdefault(key, {})
        pieces[found.offset] = body, found.more
        parts: list[bytes] = []
        more, at = True, 0
        while more and at in pieces and (pieces[at][0] or not pieces[at][1]):
            part, more = pieces[at]
            parts.append(part)
            at += len(part)
        if not more:
            del self._waiting[key]
            return b"".join(parts)
        # Upper bound of fragments that wait for others.
        while self.incomplete - self._lost > 512:
            self._lost += len(self._waiting.pop(next(iter(self._waiting))))
        return None


def _payload(data: bytes, found: _Internet, port: int, time_ns: int | None) -> Datagram | str:
    """Return the content of a UDP datagram; a length of 0 is unknown, as in very large ones."""
    length = _word(data, found.at + 4) or found.end - found.at
    payload = data[found.at + 8 : found.at + length]
    if len(data) < found.at + 8 or len(payload) < length - 8:
        return "packet_cut"
    return Datagram(payload, time_ns, f"{found.sender} to {found.receiver}:{port}")


def _begin(data: bytes, at: int, layer: int) -> tuple[int, int]:
    """Return the first layer that is none of these, and where it begins."""
    while at < len(data):
        if layer == _ETHERNET:
            layer, at = _word(data, at + 12), at + 14
        elif layer in _VLANS:
            layer, at = _word(data, at + 2), at + 4
        elif layer == _PPP_IN_ETHERNET:
            layer, at = _PPP, at + 6
        elif layer == _PPP:
            at += 2 * (_word(data, at) == 0xFF03)
            layer, at = _PPP_LAYERS.get(_word(data, at), 0xFFFF), at + 2
        elif layer in (_HDLC, _COOKED, _COOKED_2):
            kind, size = {_HDLC: (2, 4), _COOKED: (14, 16), _COOKED_2: (0, 20)}[layer]
            layer, at = _word(data, at + kind), at + size
        elif layer == _LOOPBACK:
            layer, at = _IPV4, at + 4
        elif layer in (_ERSPAN_2, _VXLAN):
            layer, at = _ETHERNET, at + 8
        elif layer == _ERSPAN_3:
            layer, at = _ETHERNET, at + 12 + 8 * (_word(data, at + 10) & 1)
        elif layer == _ERF:
            # Further headers follow while the first bit of the byte that begins one says so.
            first, at = _word(data, at + 8), at + 16
            while first & 0x8000:
                first, at = _word(data, at), at + 8
            layer, at = _ETHERNET, at + 2
        elif layer == _TZSP:
            layer, at = _ETHERNET, _behind_tags(data, at + 4)
        else:
            break
    return layer, at


def _behind_tags(data: bytes, at: int) -> int:
    """Return the end of the tags of TZSP: 0 is padding, 1 the last one."""
    while at < len(data) and data[at] != 1:
        at += 1 if data[at] == 0 else 2 + (_word(data, at) & 0xFF)
    return at + 1


def _behind_gre(data: bytes, at: int) -> tuple[int, int]:
    """Return what is behind a header of GRE, and where it begins."""
    flags, layer = _word(data, at), _word(data, at + 2)
    numbered = bool(flags & 0x1000)
    if layer == _ERSPAN_2 and not numbered:  # This is type I.
        layer = _ETHERNET
    return layer, at + 4 + 4 * (bool(flags & 0x8000) + bool(flags & 0x2000) + numbered)


def _internet(data: bytes, layer: int, at: int) -> _Internet | str:
    """Read the headers of IPv4 or IPv6, or return the reason why there are none."""
    other_layers = {0x0806: "arp", 0x8847: "mpls", 0x8848: "mpls"}
    if at >= len(data):
        return "packet_cut"
    if layer not in (_IPV4, _IPV6):
        # Smaller numbers in the place of an EtherType are lengths of IEEE 802.2.
        return "ieee_802_2" if 0 <= layer < 0x600 else other_layers.get(layer, "not_ip")
    version = data[at] >> 4
    if len(data) < at + {4: 20, 6: 40}.get(version, 1):
        return "packet_cut"
    if version == 4:
        source, target = (ipaddress.IPv4Address(data[k : k + 4]) for k in (at + 12, at + 16))
        # The length is 0 if the network card divides packets.
        end, place = at + (_word(data, at + 2) or len(data)), _word(data, at + 6)
        return _Internet(
            data[at + 9],
            at + 4 * (data[at] & 15),
            end,
            str(source),
            str(target),
            offset=8 * (place & 0x1FFF),
            more=bool(place & 0x2000),
            number=_word(data, at + 4),
        )
    if version != 6:
        return "not_ip"
    sender, receiver = (ipaddress.IPv6Address(data[k : k + 16]) for k in (at + 8, at + 24))
    end = at + 40 + (_word(data, at + 4) or len(data))
    protocol, at, place, number = data[at + 6], at + 40, 0, 0
    while protocol in (*_OPTIONS, _FRAGMENT, _AUTHENTICATION):
        if len(data) < at + 8:
            return "packet_cut"
        size = 8 * (data[at + 1] + 1)
        if protocol == _FRAGMENT:
            place, size = _word(data, at + 2), 8
            number = int.from_bytes(data[at + 4 : at + 8], "big")
            if place & 0xFFF8:  # The other headers are in the first fragment
                protocol, at = data[at], at + size
                break
        elif protocol == _AUTHENTICATION:
            size = 4 * (data[at + 1] + 2)
        protocol, at = data[at], at + size
    offset, more = place & 0xFFF8, bool(place & 1)
    return _Internet(
        protocol, at, end, str(sender), f"[{receiver}]", offset=offset, more=more, number=number
    )


def _word(data: bytes, at: int) -> int:
    """Return a number of two bytes, 0 if it is cut off."""
    return int.from_bytes(data[at : at + 2], "big")
