"""Finds the data blocks in a file that has nothing but data blocks, of any category.

A block is believed if its records decode. Not all do: those of unknown categories cannot, and
radars send malformed ones. Such a block is believed if other blocks follow it, and if it does not
hide blocks that go on behind its end, as one with a wrong length does.
"""

from __future__ import annotations

import mmap
import re
from collections import Counter
from functools import lru_cache

from .. import records, specification
from .entries import Entry

BLOCK_HEADER = 3
# Upper bound of a usual data block, bytes: radars send a block in one Ethernet packet. Others are
# followed, but are no evidence, because by chance most lengths are larger.
LARGEST_BLOCK = 2047
# Number of blocks that are tried for evidence, and of usual ones that suffice if none decodes.
LOOKAHEAD, USUAL = 8, 4
_NOT_ZERO = re.compile(rb"[^\0]")


class RawBlocks:
    """The data blocks of a file; ``padding_bytes`` counts zeros between them."""

    def __init__(self, data: bytes | mmap.mmap, counts: Counter[str]) -> None:
        self._data, self._size, self._counts = data, len(data), counts
        self._decodes = lru_cache(maxsize=64)(self._decode)

    def begins_within(self, limit: int) -> bool:
        """Return whether there is a data block in the first bytes of the file."""
        limit, first = min(limit, self._size), self.read(0)
        return first.end > first.begin if first else self._next(1, limit) < limit

    def read(self, at: int) -> Entry | None:
        """Return the block at a place or after zeros, an empty entry at the end; see `follow`."""
        begin = self._after_zeros(at)
        end = self._end(begin) if begin < self._size else begin
        if not (end and (begin == end or self._decodes(begin, end) or self._fits(begin, end))):
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
        """Return the next block that decodes and is followed by others, `limit` if none is."""
        header = _usual_header()
        while found := header.search(self._data, at, limit):
            at = found.start()
            end = self._end(at)
            if end and self._decodes(at, end) and self._goes_on(end):
                return at
            at += 1
        return limit

    def _after_zeros(self, at: int) -> int:
        if at < self._size and self._data[at]:
            return at
        found = _NOT_ZERO.search(self._data, at)
        return found.start() if found else self._size

    def _end(self, at: int) -> int:
        """Return the end of a block by its header, 0 if there is no possible header."""
        if self._size - at <= BLOCK_HEADER or not self._data[at]:
            return 0
        length = self._data[at + 1] << 8 | self._data[at + 2]
        return at + length if length > BLOCK_HEADER and at + length <= self._size else 0

    def _decode(self, begin: int, end: int) -> bool:
        block = self._data[begin:end]
        return records.count(block[0], block, BLOCK_HEADER, len(block)) > 0

    def _fits(self, begin: int, end: int) -> bool:
        """Return whether a block that does not decode has the right length."""
        return self._goes_on(end) and not self._hides_others(begin, end)

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
        """Return whether a chain of blocks leads from within a block to its end and beyond.

        Blocks of a foreign category may contain such blocks: one, or some behind their header.
        """
        at = self._next(begin + 1, end)
        if at == begin + BLOCK_HEADER:
            return False
        hidden = 0
        while at < end:
            until = self._end(at := self._after_zeros(at))
            if not until:
                return False
            hidden += self._decodes(at, until)
            at = until
        return hidden > (0 if records.reader(self._data[begin]) else 1)


@lru_cache(maxsize=1)
def _usual_header() -> re.Pattern[bytes]:
    """Return the begin of a usual block of a category whose records can be decoded.

    Its first record has the item that is the first one in the categories: the data source.
    """
    known = b"".join(re.escape(bytes([number])) for number in specification.known_categories())
    return re.compile(b"[" + known + rb"][\x00-\x07].[\x80-\xff]", re.DOTALL)
