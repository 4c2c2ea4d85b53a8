"""Opens recordings, which may be packed; reads and writes captures of UDP datagrams.

Captures of the format pcap are read and written, and those of pcapng are read.

The parser is our own: of the maintained libraries, scapy needs 20 MB and 0.1 ms per packet, and no
other reads both formats without dissecting unneeded layers.

Captures that were joined, of either format, are sections of one. After damage, reading goes on at
the next plausible packet or section.
"""

from __future__ import annotations

import bz2
import gzip
import lzma
import mmap
import re
import struct
import tempfile
import zipfile
import zlib
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Literal, NamedTuple, TypeAlias

from .network import Datagram, Entry, Packet, Packets, RecordingError, follow

# The first four bytes of a pcap file: byte order, and units of the times per second.
_MAGICS = {
    b"\xd4\xc3\xb2\xa1": ("<", 10**6),
    b"\xa1\xb2\xc3\xd4": (">", 10**6),
    b"\x4d\x3c\xb2\xa1": ("<", 10**9),
    b"\xa1\xb2\x3c\x4d": (">", 10**9),
}
_PCAPNG = b"\x0a\x0d\x0d\x0a"
_ENDIAN: Mapping[str, Literal["little", "big"]] = {"<": "little", ">": "big"}
_ORDER_MAGICS = {b"\x4d\x3c\x2b\x1a": "<", b"\x1a\x2b\x3c\x4d": ">"}
_ANY_MAGIC = re.compile(b"|".join(map(re.escape, (*_MAGICS, _PCAPNG))))
_FILE_HEADER, _PART = 24, 2**20
# Upper bound of a captured packet, bytes; that of libpcap.
_LARGEST_PACKET = 2**18
_SECTION, _INTERFACE, _PACKET_BLOCK, _SIMPLE, _ENHANCED = 0x0A0D0D0A, 1, 2, 3, 6
_RESOLUTION, _OFFSET = 9, 14
# The begin of such a block of a usual kind, by byte order.
_BLOCK = {
    "<": re.compile(rb"[\x01-\x06]\x00\x00\x00..[\x00-\x0f]\x00", re.DOTALL),
    ">": re.compile(rb"\x00\x00\x00[\x01-\x06]\x00[\x00-\x0f]..", re.DOTALL),
}


def is_capture(begin: bytes) -> bool:
    """Return whether these first four bytes of a file identify a capture."""
    return begin in _MAGICS or begin == _PCAPNG


def packets(data: bytes | mmap.mmap, counts: Counter[str]) -> Iterator[Datagram]:
    """Yield the UDP payloads of a capture.

    `counts` gains the counts of `follow`, the reasons of `Packets.datagram_of` for other packets,
    and ``fragment`` for those of which others are missing.
    """
    capture, found_in = _Capture(data), Packets()
    for entry in follow(len(data), capture.read, capture.resume, counts):
        if entry.content is None:
            continue
        found = found_in.datagram_of(entry.content)
        if not isinstance(found, str):
            yield found
        elif found:
            counts[found] += 1
    if found_in.incomplete:
        counts["fragment"] += found_in.incomplete


# A part of a capture with one byte order.
_Section: TypeAlias = "_Classic | _NextGeneration"


class _Capture:
    """The sections of a capture."""

    def __init__(self, data: bytes | mmap.mmap) -> None:
        self._data = data
        self._section: _Section | None = None

    def read(self, at: int) -> Entry | None:
        """Return the header or packet at a place, see `follow`."""
        self._section = _section_at(self._data, at) or self._section
        return self._section.read(at) if self._section else None

    def resume(self, at: int) -> int:
        """Return the next packet or section, see `follow`."""
        size = len(self._data)
        while True:
            # Parts of the file are searched one after the other, for packets and sections.
            end = min(at + _PART, size)
            section = self._next_section(at, end)
            found = self._section.resume(at, section) if self._section else section
            if found < end or end == size:
                return found
            at = end - _FILE_HEADER

    def _next_section(self, at: int, end: int) -> int:
        while found := _ANY_MAGIC.search(self._data, at, end):
            at = found.start()
            if _section_at(self._data, at):
                return at
            at += 1
        return end


def _section_at(data: bytes | mmap.mmap, at: int) -> _Section | None:
    """Return the section that begins at a place, None if none does."""
    magic = data[at : at + 4]
    if magic in _MAGICS and at + _FILE_HEADER <= len(data):
        return _Classic(data, at)
    if magic == _PCAPNG and data[at + 8 : at + 12] in _ORDER_MAGICS:
        return _NextGeneration(data, at)
    return None


class _Classic:
    """A pcap file: its header and packets."""

    # In 2001, seconds since the epoch.
    _RECENT_S = 10**9

    def __init__(self, data: bytes | mmap.mmap, begin: int) -> None:
        self._data, self._begin = data, begin
        self._order, self._units_per_s = _MAGICS[data[begin : begin + 4]]
        # The upper bits give the length of checksums.
        self._link = struct.unpack(self._order + "I", data[begin + 20 : begin + 24])[0] & 0xFFFF
        self._header = struct.Struct(self._order + "IIII")
        # The first and the latest times of packets, seconds, in units of 2^16 s. There are several,
        # because one may be of a damaged header.
        self._first: int | None = None
        self._latest: deque[int] = deque(maxlen=3)

    def read(self, at: int) -> Entry | None:
        """See `follow`; the content is a packet, or None for a header."""
        if at == self._begin:
            return Entry(at, at + _FILE_HEADER)
        end = self._end(at)
        if not end:
            return None
        seconds, fraction, _, _ = self._header.unpack(self._data[at : at + 16])
        # A place four bytes behind a header looks like one, with a fraction for the seconds.
        if not (self._is_near(seconds) or (seconds >= self._RECENT_S and self._goes_on(end))):
            return None
        self._latest.append(seconds >> 16)
        self._first = self._latest[0] if self._first is None else self._first
        time_ns = seconds * 10**9 + fraction * (10**9 // self._units_per_s)
        # Programs that do not know the time write zeros.
        return Entry(at, end, Packet(self._data[at + 16 : end], time_ns or None, self._link))

    def resume(self, at: int, limit: int) -> int:
        """Return the next plausible place from `at` on and below `limit`, which it is without.

        The time must be within a day of the others, if they are known.
        """
        near = frozenset(time + more for time in self._times for more in (-1, 0, 1))
        header, shift = _packet_header(self._order, self._units_per_s, near)
        while found := header.search(self._data, at + shift, limit):
            at = found.start() - shift
            end = self._end(at)
            if end and self._goes_on(end):
                return at
            at += 1
        return limit

    @property
    def _times(self) -> list[int]:
        return [] if self._first is None else [self._first, *self._latest]

    def _is_near(self, seconds: int) -> bool:
        return not self._times or any(abs(t - (seconds >> 16)) <= 1 for t in self._times)

    def _goes_on(self, at: int) -> bool:
        """Return whether a packet or a section follows, or the end of the file."""
        if len(self._data) - at < 16 or _section_at(self._data, at):
            return True
        return self._is_packet(*self._header.unpack(self._data[at : at + 16]))

    def _end(self, at: int) -> int:
        """Return the end of a packet by its header, 0 if there is no plausible header."""
        header = self._data[at : at + 16]
        if len(header) < 16:
            return 0
        fields = self._header.unpack(header)
        end: int = at + 16 + fields[2]
        return end if end <= len(self._data) and self._is_packet(*fields) else 0

    def _is_packet(self, seconds: int, fraction: int, captured: int, _: int) -> bool:
        """Return whether a header is plausible; a packet without bytes must have a usual time."""
        sized = captured <= _LARGEST_PACKET and (captured > 0 or self._is_near(seconds))
        return sized and fraction < self._units_per_s


def _packet_header(
    order: str, units_per_s: int, near: frozenset[int]
) -> tuple[re.Pattern[bytes], int]:
    """Return a pattern of packet headers with usual times, and how far behind their begin it is.

    `near` are times in units of 2^16 s; if they are unknown, any time since 2001 is usual.
    """

    def number(most: int) -> bytes:
        """Return the pattern of a number of four bytes."""
        upper = b"[\\x00-" + re.escape(bytes([most >> 16 & 0xFF])) + b"]"
        if most >> 24:
            upper, top = b".", b"[\\x00-" + re.escape(bytes([most >> 24])) + b"]"
        else:
            top = b"\\x00"
        return b".." + upper + top if order == "<" else top + upper + b".."

    halves = (half.to_bytes(2, _ENDIAN[order]) for half in near if 0 <= half < 2**16)
    recent = b".[\\x3b-\\xff]" if order == "<" else b"[\\x3b-\\xff]."
    begin = b"(?:" + (b"|".join(map(re.escape, halves)) or recent) + b")"
    rest = number(units_per_s) + 2 * number(_LARGEST_PACKET)
    pattern = begin + (b"" if order == "<" else b"..") + rest
    return re.compile(pattern, re.DOTALL), 2 if order == "<" else 0


class _NextGeneration:
    """A section of a pcapng file: its blocks."""

    def __init__(self, data: bytes | mmap.mmap, begin: int) -> None:
        self._data = data
        self._order = _ORDER_MAGICS[data[begin + 8 : begin + 12]]
        # Link layer, units of the times per second, and the times' offset, seconds.
        self._interfaces: list[tuple[int, int, int]] = []
        self._block = _BLOCK[self._order]

    def read(self, at: int) -> Entry | None:
        """See `_Classic.read`."""
        end = self._end(at)
        if not end:
            return None
        (kind,) = struct.unpack(self._order + "I", self._data[at : at + 4])
        return Entry(at, end, self._packet(kind, self._data[at + 8 : end - 4]))

    def resume(self, at: int, limit: int) -> int:
        """See `_Classic.resume`."""
        while found := self._block.search(self._data, at, limit):
            at = found.start()
            if self._is_whole(at):
                return at
            at += 1
        return limit

    def _number(self, at: int) -> int:
        return int.from_bytes(self._data[at : at + 4], _ENDIAN[self._order])

    def _is_whole(self, at: int) -> bool:
        """Return whether there is a block with the same length at its begin and its end."""
        length = self._number(at + 4)
        return self._fits(at, length) and self._number(at + length - 4) == length

    def _fits(self, at: int, length: int) -> bool:
        return length >= 12 and length % 4 == 0 and at + length <= len(self._data)

    def _end(self, at: int) -> int:
        """Return the end of a block, 0 if it has none; one of its two lengths may be wrong."""
        end = at + self._number(at + 4)
        if self._is_whole(at):
            return end
        # Upper bound of a block's length that is sought, bytes.
        follower = self.resume(at + 12, min(at + 2**20, len(self._data)))
        length = follower - at
        if self._fits(at, length) and self._number(follower - 4) == length:
            return follower
        goes_on = end == len(self._data) or self._is_whole(end)
        return end if self._fits(at, end - at) and goes_on else 0

    def _packet(self, kind: int, body: bytes) -> Packet | None:
        """Return the packet of a block, None if it has none; note interfaces."""
        order, interfaces = self._order, self._interfaces
        if kind == _INTERFACE and len(body) >= 8:
            (link,) = struct.unpack(order + "H", body[:2])
            interfaces.append((link, *_times_of(body[8:], order)))
        elif kind in (_PACKET_BLOCK, _ENHANCED) and len(body) >= 20:
            form = "IIIII" if kind == _ENHANCED else "H2xIIII"
            number, high, low, captured, _ = struct.unpack(order + form, body[:20])
            if number >= len(interfaces) or captured > len(body) - 20:
                return Packet(b"", None, None)
            link, units, offset_s = interfaces[number]
            time_ns = (high << 32 | low) * 10**9 // units + offset_s * 10**9
            return Packet(body[20 : 20 + captured], time_ns or None, link)
        elif kind == _SIMPLE and len(body) >= 4 and interfaces:
            return Packet(body[4:], None, interfaces[0][0])
        return None


def _times_of(options: bytes, order: str) -> tuple[int, int]:
    """Return the units per second of an interface's times, microseconds by default, and offset."""
    units, offset_s, at = 10**6, 0, 0
    while at + 4 <= len(options):
        code, length = struct.unpack(order + "HH", options[at : at + 4])
        value = options[at + 4 : at + 4 + length]
        if code == _RESOLUTION and value:
            # Finer resolutions are implausible.
            base, most = (2, 64) if value[0] & 0x80 else (10, 18)
            units = base ** min(value[0] & 0x7F, most)
        elif code == _OFFSET and len(value) == 8:
            (offset_s,) = struct.unpack(order + "q", value)
        if not code:
            break
        at += 4 + (length + 3) // 4 * 4
    return units, offset_s


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


NS_PER_DAY = 86_400 * 10**9


def _only_file(packed: IO[bytes]) -> IO[bytes]:
    archive = zipfile.ZipFile(packed)
    files = [each for each in archive.infolist() if not each.is_dir()]
    if len(files) != 1:
        raise RecordingError(f"is a zip archive of {len(files)} files, must be of one")
    return archive.open(files[0])


# The programs that may have packed a recording, with the beginning of their files.
_PACKINGS: Mapping[bytes, tuple[str, Callable[[IO[bytes]], Any]]] = {
    b"\x1f\x8b\x08": ("gzip", gzip.open),
    b"BZh": ("bzip2", bz2.open),
    b"\xfd7zXZ\0": ("xz", lzma.open),
    b"PK\x03\x04": ("zip", _only_file),
}
# Those that must be unpacked before.
_UNREAD = {b"\x28\xb5\x2f\xfd": "zstd", b"\x04\x22\x4d\x18": "lz4", b"7z\xbc\xaf": "7z"}
PACKINGS = ", ".join(name for name, _ in _PACKINGS.values())
# Upper bound of an unpacked recording, bytes, so that a small file does not fill the disk.
LARGEST_UNPACKED, CHUNK = 2**35, 2**20


@contextmanager
def open_recording(path: Path, counts: Counter[str]) -> Iterator[bytes | mmap.mmap]:
    """Open a file as bytes that are read from the disk on demand; raise `OSError` if unreadable.

    A packed file is unpacked to a temporary file. If it is damaged, `counts` gains
    ``unpacking_ended``, and the bytes before the damage are used. Raise `RecordingError` if it is
    larger than `LARGEST_UNPACKED`, an archive of several files, or packed in another way.
    """
    with path.open("rb") as stream, tempfile.TemporaryFile() as unpacked:
        source: IO[bytes] = stream
        begin = stream.read(max(map(len, _PACKINGS)))
        if begin[:4] in _UNREAD:
            raise RecordingError(f"is packed by {_UNREAD[begin[:4]]}, must be unpacked before")
        stream.seek(0)
        for magic, packing in _PACKINGS.items():
            if begin.startswith(magic):
                _unpack(stream, packing[1], unpacked, counts)
                source = unpacked
        if not source.seek(0, 2):
            yield b""
            return
        with mmap.mmap(source.fileno(), 0, access=mmap.ACCESS_READ) as data:
            yield data


def _unpack(
    packed: IO[bytes],
    opened: Callable[[IO[bytes]], Any],
    unpacked: IO[bytes],
    counts: Counter[str],
) -> None:
    # Of encrypted archives and unknown methods.
    unreadable = RuntimeError, NotImplementedError
    try:
        with opened(packed) as stream:
            while part := stream.read1(CHUNK):
                if unpacked.tell() + len(part) > LARGEST_UNPACKED:
                    raise RecordingError(
                        f"is larger than {LARGEST_UNPACKED >> 30} GiB when it is unpacked"
                    )
                unpacked.write(part)
    except unreadable as error:
        raise RecordingError(f"cannot be unpacked: {error}") from error
    except (EOFError, zlib.error, lzma.LZMAError, zipfile.BadZipFile):
        counts["unpacking_ended"] += 1
    except OSError as error:
        # Damage of gzip's and bzip2's files, and no fault of the disk.
        if error.errno is not None:
            raise
        counts["unpacking_ended"] += 1
    unpacked.flush()


def on_day(found: Iterator[Datagram], midnight_ns: int | None) -> Iterator[Datagram]:
    """Yield datagrams moved by whole days, so that the first is on the given day."""
    shift_ns: int | None = None
    for each in found:
        if midnight_ns is None or each.received_ns is None:
            yield each
            continue
        if shift_ns is None:
            shift_ns = midnight_ns - each.received_ns // NS_PER_DAY * NS_PER_DAY
        yield each._replace(received_ns=each.received_ns + shift_ns)
