"""Splits bytes into sentences of NMEA and SBS, and frames of Mode S."""

from __future__ import annotations

import re
from collections import Counter, OrderedDict
from collections.abc import Iterator
from typing import NamedTuple

NMEA, SBS, MODE_S = "nmea", "sbs", "mode_s"
# Upper bound of a line, bytes: a sentence has 82 of them, a tag block not many more.
LONGEST_LINE = 1024
# Upper bound of the sources whose last line waits for its end.
MOST_SOURCES = 256
# A frame of Beast: an escape, its kind, a clock of 48 bits, the level, and the message by its kind.
# The escape is doubled within it. Source: the description of Mode-S Beast by its author.
ESCAPE = 0x1A
_BEAST = {ord("1"): 2, ord("2"): 7, ord("3"): 14, ord("4"): 2}
_BEAST_HEAD = 7
_SENTENCE = re.compile(rb"[!$][^*]*\*[0-9A-Fa-f]{2}$")
# Hexadecimal frames as dump1090 writes them, with the clock or without.
_HEXADECIMAL = re.compile(rb"(?:\*|@([0-9A-Fa-f]{12}))((?:[0-9A-Fa-f]{2}){2,14});")
_OF_SBS = (b"MSG,", b"MLAT,", b"SEL,", b"ID,", b"AIR,", b"STA,", b"CLK,")


class Unit(NamedTuple):
    """A line or a frame."""

    kind: str  # `NMEA`, `SBS` or `MODE_S`
    data: bytes  # A line without its end; for Mode S the message
    ticks: int | None = None  # The receiver's clock of 12 MHz, None if unknown


class Splitter:
    """Splits the pieces of several sources; `counts` gains what is left out.

    These are ``line_too_long``, ``other_line`` for lines of no known format, ``frame_broken``, and
    ``line_cut`` for lines whose end never came.
    """

    def __init__(self, counts: Counter[str]) -> None:
        self.counts = counts
        self._rests: OrderedDict[str, bytes] = OrderedDict()
        # Sources in the middle of a line that is too long.
        self._skipping: set[str] = set()

    def feed(self, data: bytes, source: str) -> Iterator[Unit]:
        """Yield the units that a piece of a source completes."""
        data, at = self._rests.pop(source, b"") + data, 0
        if source in self._skipping:
            at = data.find(b"\n") + 1
            if not at:
                return
            self._skipping.discard(source)
        while at < len(data):
            end = self._frame_end(data, at) if data[at] == ESCAPE else _line_end(data, at)
            if end < 0:
                break
            unit = _frame(data, at, end) if data[at] == ESCAPE else self._line(data[at:end])
            if unit is not None:
                yield unit
            at = end
        self._keep(data[at:], source)

    def finish(self) -> Iterator[Unit]:
        """Yield the last lines of the sources, at the end of a recording."""
        for rest in self._rests.values():
            if rest[0] == ESCAPE:
                self.counts["frame_broken"] += 1
            elif (unit := self._line(rest)) is not None:
                yield unit
        self._rests.clear()

    def _keep(self, rest: bytes, source: str) -> None:
        if not rest:
            return
        if len(rest) > LONGEST_LINE:
            self.counts["line_too_long"] += 1
            self._skipping.add(source)
            return
        self._rests[source] = rest
        if len(self._rests) > MOST_SOURCES:
            self._rests.popitem(last=False)
            self.counts["line_cut"] += 1

    def _line(self, line: bytes) -> Unit | None:
        line = line.strip()
        if not line:
            return None
        if len(line) > LONGEST_LINE:
            self.counts["line_too_long"] += 1
            return None
        if b"!" in line or line[:1] in b"\\$":
            return Unit(NMEA, line)
        if line.startswith(_OF_SBS):
            return Unit(SBS, line)
        found = _HEXADECIMAL.fullmatch(line)
        if found is None:
            self.counts["other_line"] += 1
            return None
        return Unit(
            MODE_S, bytes.fromhex(found[2].decode()), int(found[1], 16) if found[1] else None
        )

    def _frame_end(self, data: bytes, at: int) -> int:
        """Return the end of a frame of Beast, -1 if it is not there yet; pass a broken one."""
        if at + 1 >= len(data):
            return -1
        size = _BEAST.get(data[at + 1])
        end, left = at + 2, 0 if size is None else _BEAST_HEAD + size
        while left:
            if end >= len(data):
                return -1
            if data[end] == ESCAPE:
                if end + 1 >= len(data):
                    return -1
                if data[end + 1] != ESCAPE:  # the next frame begins
                    self.counts["frame_broken"] += 1
                    return end
                end += 1
            end, left = end + 1, left - 1
        if size is None:
            self.counts["frame_broken"] += 1
        return end


def _frame(data: bytes, at: int, end: int) -> Unit | None:
    """Return a frame of Beast with a message of Mode S, None for others and broken ones."""
    size = _BEAST.get(data[at + 1], 0)
    body = data[at + 2 : end].replace(b"\x1a\x1a", b"\x1a")
    if size < 7 or len(body) != _BEAST_HEAD + size:
        return None
    return Unit(MODE_S, body[_BEAST_HEAD:], int.from_bytes(body[:6], "big"))


def _line_end(data: bytes, at: int) -> int:
    """Return the end of a line, -1 if it is not there yet.

    A datagram may end without a line feed, after the checksum of its sentence.
    """
    found = data.find(b"\n", at)
    frame = data.find(ESCAPE, at)
    if frame >= 0 and (found < 0 or frame < found):
        return frame
    if found >= 0:
        return found + 1
    tail = data[at:].rstrip()
    if len(tail) <= LONGEST_LINE and (_SENTENCE.search(tail) or _HEXADECIMAL.fullmatch(tail)):
        return len(data)
    return -1
