"""Reads datagrams from recordings of ASTERIX.

The first bytes identify the format: plain consecutive data blocks (`RawBlocks`), data blocks in
envelopes of the IOSS "final" format, or a network capture (`pcap`); each may be packed.
"""

from __future__ import annotations

import mmap
import re
from collections import Counter
from collections.abc import Iterator
from functools import lru_cache
from itertools import islice

from phd_jdtc_ros.transport import pcap
from phd_jdtc_ros.transport.network import Datagram, Entry, RecordingError, follow
from phd_jdtc_ros.transport.pcap import NS_PER_DAY

from . import records, specification

BLOCK_HEADER = 3
# Upper bound of a usual data block, bytes: radars send a block in one Ethernet packet. Others are
# followed, but are no evidence, because by chance most lengths are larger.
LARGEST_BLOCK = 2047
# Number of blocks that are tried for evidence, and of usual ones that suffice if none decodes.
LOOKAHEAD, USUAL = 8, 4


class RawBlocks:
    """The data blocks of a file; ``padding_bytes`` counts zeros between them."""

    # A data source that this number of decodable blocks has is not there by chance.
    SURE = 3
    _NOT_ZERO = re.compile(rb"[^\0]")

    def __init__(self, data: bytes | mmap.mmap, counts: Counter[str]) -> None:
        self._data, self._size, self._counts = data, len(data), counts
        self._decodes = lru_cache(maxsize=64)(self._decode)
        self._known = lru_cache(maxsize=1)(self._sources)

    def begins_within(self, limit: int) -> bool:
        """Return whether there is a data block in the first bytes of the file."""
        limit, first = min(limit, self._size), self.read(0)
        return first.end > first.begin if first else self._next(1, limit) < limit

    def read(self, at: int) -> Entry | None:
        """Return the block at a place or after zeros, an empty entry at the end; see `follow`."""
        begin = self._after_zeros(at)
        end = self._end(begin) if begin < self._size else begin
        if not end or (begin < end and not self._is_block(begin, end)):
            return None
        self._counts["padding_bytes"] += begin - at
        return Entry(begin, end)

    def resume(self, at: int) -> int:
        """Return the next place from which blocks follow each other; see `follow`."""
        at = self._next(at, self._size)
        while at < self._size and self._hides_others(at, self._end(at)):
            at = self._next(at + 1, self._size)
        return at

    def _next(self, at: int, limit: int) -> int:
        """Return the next block that decodes and is followed by others, `limit` if none is.

        A block of a known source needs no follower: recorders may write something between blocks.
        """
        for begin, end in self._decoded(at, limit):
            if self._goes_on(end) or self._source(begin) in self._known():
                return begin
        return limit

    def _decoded(self, at: int, limit: int) -> Iterator[tuple[int, int]]:
        """Yield begin and end of what decodes as a usual block, wherever it begins."""
        header = _usual_header()
        while found := header.search(self._data, at, limit):
            at = found.start()
            end = self._end(at)
            if end and self._decodes(at, end):
                yield at, end
            at += 1

    def _sources(self) -> frozenset[bytes]:
        """Return the data sources that several blocks in the begin of the file have."""
        begin = min(BEGIN, self._size)
        found = Counter(self._source(at) for at, _ in self._decoded(0, begin))
        return frozenset(source for source, count in found.items() if count >= self.SURE)

    def _is_known(self, at: int) -> bool:
        """Return whether a block is of a source of which there are several, if there is any."""
        return not self._known() or self._source(at) in self._known()

    def _source(self, at: int) -> bytes:
        """Return the data source, SAC and SIC, of a block: the first item of its first record."""
        at += BLOCK_HEADER
        while self._data[at] & 1:
            at += 1
        return self._data[at + 1 : at + 3]

    def _after_zeros(self, at: int) -> int:
        if at < self._size and self._data[at]:
            return at
        found = self._NOT_ZERO.search(self._data, at)
        return found.start() if found else self._size

    def _end(self, at: int) -> int:
        """Return the end of a block by its header, 0 if there is no possible header."""
        if self._size - at < BLOCK_HEADER or not self._data[at]:
            return 0
        length = self._data[at + 1] << 8 | self._data[at + 2]
        return at + length if length >= BLOCK_HEADER and at + length <= self._size else 0

    def _decode(self, begin: int, end: int) -> bool:
        block = self._data[begin:end]
        return records.count(block[0], block, BLOCK_HEADER, len(block)) > 0

    def _is_block(self, begin: int, end: int) -> bool:
        """Return whether what has the header of a block is one."""
        decodes = self._decodes(begin, end)
        if decodes and self._is_known(begin):
            return True
        if self._separates(begin, end):
            return False
        return decodes or (self._goes_on(end) and not self._hides_others(begin, end))

    def _separates(self, begin: int, end: int) -> bool:
        """Return whether this is what a recorder writes before a block of a known source.

        Blocks may also contain such blocks: some behind their header, or one to their end.
        """
        # Upper bound of what a recorder writes between blocks, bytes.
        for at, until in self._decoded(begin + 1, min(begin + 32, end)):
            if self._is_known(at):
                return at > begin + BLOCK_HEADER and until != end
        return False

    def _goes_on(self, at: int) -> bool:
        """Return whether a block that decodes follows, several usual ones, or the end."""
        usual = 0
        for _ in range(LOOKAHEAD):
            at = self._after_zeros(at)
            end = self._end(at)
            if at == self._size or (end and self._decodes(at, end)):
                return True
            usual += end - at <= LARGEST_BLOCK
            if not end or usual == USUAL:
                break
            at = end
        return end > 0 and usual == USUAL

    def _hides_others(self, begin: int, end: int) -> bool:
        """Return whether a wrong length makes one block of several.

        Blocks of a foreign category may contain such blocks: one, or some behind their header.
        """
        if self._next(begin + 1, end) == begin + BLOCK_HEADER:
            return False
        hidden = (at for at, _ in self._decoded(begin + 1, end) if self._is_known(at))
        return len([*islice(hidden, 2)]) > (0 if records.readers(self._data[begin]) else 1)


@lru_cache(maxsize=1)
def _usual_header() -> re.Pattern[bytes]:
    """Return the begin of a usual block of a category whose records can be decoded.

    Its first record has the item that is the first one in the categories: the data source.
    """
    known = b"".join(re.escape(bytes([number])) for number in specification.known_categories())
    return re.compile(b"[" + known + rb"][\x00-\x07].[\x80-\xff]", re.DOTALL)


# The header of an envelope has its length with header and footer (2 bytes), the numbers of board
# and line, the day of the recording, and the time in 10 ms since midnight (3 bytes). The footer is
# four times A5. Sources: Luciad's documentation of the format, and the example of asterix_decoder.
# The numbers of board, line and day are often 0 and are ignored.
FINAL_HEADER, FINAL_FOOTER = 8, b"\xa5\xa5\xa5\xa5"
RAW, FINAL, CAPTURE = "data blocks", "final", "capture"
# A recording may begin within a data block; the first whole one must begin in these bytes.
BEGIN = 2**17


def kind_of(data: bytes | mmap.mmap) -> str:
    """Return the format of a recording; raise `RecordingError` if it is unknown."""
    if pcap.is_capture(data[:4]):
        return CAPTURE
    if _envelope(data, 0):
        return FINAL
    if RawBlocks(data, Counter()).begins_within(BEGIN):
        return RAW
    raise RecordingError(
        "is not a recording of ASTERIX: it must begin with a data block, with an envelope of the "
        "final format, or as a capture (pcap, pcapng), each as it is or packed by one of "
        f"{pcap.PACKINGS}"
    )


def datagrams(
    data: bytes | mmap.mmap, midnight_ns: int | None, counts: Counter[str]
) -> Iterator[Datagram]:
    """Yield the datagrams of a recording in order.

    `midnight_ns` is the beginning of the day of the first datagram. Captures have dates, and are
    moved by whole days; other formats are dated 1970 without it.

    `counts` gains the skipped data: ``bytes_skipped``, ``resynchronised`` and ``recording_cut`` as
    in `follow`, ``padding_bytes`` as in `RawBlocks`, and the reasons of `pcap.packets`.
    """
    kind = kind_of(data)
    if kind == CAPTURE:
        yield from pcap.on_day(pcap.packets(data, counts), midnight_ns)
    elif kind == FINAL:
        yield from _final(data, midnight_ns or 0, counts)
    else:
        blocks = RawBlocks(data, counts)
        for begin, end, _ in follow(len(data), blocks.read, blocks.resume, counts):
            if end > begin:
                yield Datagram(data[begin:end])


def _envelope(data: bytes | mmap.mmap, at: int) -> int:
    """Return the length of the envelope at `at`, 0 if there is none."""
    if len(data) - at < FINAL_HEADER + len(FINAL_FOOTER):
        return 0
    length = data[at] << 8 | data[at + 1]
    end = at + length
    least = FINAL_HEADER + len(FINAL_FOOTER)
    return length if length >= least and data[end - 4 : end] == FINAL_FOOTER else 0


def _final(data: bytes | mmap.mmap, midnight_ns: int, counts: Counter[str]) -> Iterator[Datagram]:
    """Yield the contents of envelopes; the day advances when the time falls by half a day."""
    last_ns = 0

    def read(at: int) -> Entry | None:
        length = _envelope(data, at)
        return Entry(at, at + length) if length else None

    def resume(at: int) -> int:
        """Return the next envelope; each footer shows where one ends.

        Of several lengths that fit the shortest is the likeliest, because chance gives long ones.
        """
        while (footer := data.find(FINAL_FOOTER, at)) >= 0:
            end = footer + len(FINAL_FOOTER)
            for begin in range(footer, max(at, end - 2**16) - 1, -1):
                if begin + _envelope(data, begin) == end:
                    return begin
            at = end
        return len(data)

    for begin, end, _ in follow(len(data), read, resume, counts):
        time_ns = int.from_bytes(data[begin + 5 : begin + 8], "big") * 10_000_000
        if time_ns < last_ns - NS_PER_DAY // 2:
            midnight_ns += NS_PER_DAY
        last_ns = time_ns
        body = data[begin + FINAL_HEADER : end - len(FINAL_FOOTER)]
        line = f"board {data[begin + 2]} line {data[begin + 3]}"
        yield Datagram(body, midnight_ns + time_ns, line)
