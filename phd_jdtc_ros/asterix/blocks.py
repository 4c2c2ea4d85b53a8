"""Reads messages from datagrams: consecutive data blocks, and the records in them.

A block with an impossible length ends its datagram, because the beginning of the next block is
unknown. A malformed record ends its block for the same reason; the records before it are used. All
faults are counted by reason.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from . import records
from .item_rules import MalformedError
from .messages import Message
from .transport.raw_blocks import BLOCK_HEADER, LARGEST_BLOCK

# Some recorders and networks append a trailer to every datagram. A rest of at most LONGEST_TRAILER
# bytes counts as a trailer once its length has occurred TRAILERS times.
LONGEST_TRAILER, TRAILERS = 16, 3
# Reasons for which a record is not to be used; any other is a fault of the record.
INTENDED = frozenset(("no_detection", "field_monitor", "test_target", ""))


class BlockReader:
    """Reads the datagrams of a stream; `categories` counts the records of all categories.

    `faulty` counts those of supported categories that should have been used and could not.

    `counts` gains the skipped data by reason: ``block_truncated`` or ``block_length`` if the rest
    of a datagram is not a data block; ``other_category`` for data blocks of unsupported categories;
    and the reasons of `MalformedError` and of `records`. `trailers` counts rests after the data
    blocks of datagrams, by length in bytes. Once a length has occurred `TRAILERS` times, such rests
    count as trailers and not as faults.
    """

    def __init__(self, counts: Counter[str]) -> None:
        self.counts = counts
        self.categories: Counter[int] = Counter()
        self.faulty: Counter[int] = Counter()
        self.trailers: Counter[int] = Counter()
        self._faults: dict[int, Counter[str]] = {}

    def known_trailers(self) -> dict[int, int]:
        """Return the numbers of trailers by length."""
        return {size: n for size, n in self.trailers.items() if n >= TRAILERS}

    def messages(self, data: bytes) -> Iterator[Message]:
        """Yield the messages of a datagram in order, each decoded on demand."""
        for category, begin, end in self._blocks(data):
            reads = records.reader(category)
            if reads is None:
                self.counts["other_category"] += 1
                self.categories[category] += max(records.count(category, data, begin, end), 1)
                continue
            at = begin
            try:
                while at < end:
                    found, at = reads.read(data, at, end)
                    self.categories[category] += 1
                    if not isinstance(found, str):
                        yield found
                        continue
                    self.faulty[category] += found not in INTENDED
                    if found:
                        self.counts[found] += 1
            except MalformedError as error:
                self.categories[category] += 1
                self.faulty[category] += 1
                self.counts[error.reason] += 1

    def _blocks(self, data: bytes) -> Iterator[tuple[int, int, int]]:
        """Yield category, begin and end of the records of each data block of a datagram."""
        at = 0
        while at < len(data):
            left = len(data) - at
            length = data[at + 1] << 8 | data[at + 2] if left >= BLOCK_HEADER else left + 1
            if not BLOCK_HEADER < length <= left:
                fault = "block_truncated" if length > left else "block_length"
                # The header of a cut block still gives its whole length.
                supported = records.reader(data[at]) is not None
                cut = supported and left < length <= LARGEST_BLOCK
                self._rest(fault, left, at > 0 and not cut)
                return
            yield data[at], at + BLOCK_HEADER, at + length
            at += length

    def _rest(self, fault: str, size: int, no_block: bool) -> None:
        """Count a rest of a datagram; `no_block` if it is not the beginning of a data block."""
        known = self.trailers[size] >= TRAILERS
        if size > LONGEST_TRAILER or not (known or no_block):
            self.counts[fault] += 1
            return
        self.trailers[size] += 1
        if not known:
            self.counts[fault] += 1
            self._faults.setdefault(size, Counter())[fault] += 1
            if self.trailers[size] >= TRAILERS:
                self.counts -= self._faults.pop(size)  # those rests were trailers
