"""A datagram of a recording or of the network, and the error of an unreadable recording."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple


class Datagram(NamedTuple):
    """One received datagram."""

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
