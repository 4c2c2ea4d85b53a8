"""Reads datagrams from recordings of ASTERIX.

The first bytes identify the format: plain consecutive data blocks, data blocks in envelopes of the
IOSS "final" format, or a network capture (`pcap`).
"""

from __future__ import annotations

import mmap
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..clocks import NS_PER_DAY
from . import pcap
from .datagram import Datagram, RecordingError

# The header of an envelope has its length with header and footer (2 bytes), the numbers of board
# and line, the day of the recording, and the time in 10 ms since midnight (3 bytes). The footer is
# four times A5. Sources: Luciad's documentation of the format, and the example of asterix_decoder.
# The numbers of board, line and day are often 0 and are ignored.
FINAL_HEADER, FINAL_FOOTER = 8, b"\xa5\xa5\xa5\xa5"
RAW, FINAL, CAPTURE = "data blocks", "final", "capture"
# Categories that occur in recordings; they identify the next block after damaged data.
CATEGORIES = frozenset((1, 2, 8, 10, 11, 19, 20, 21, 23, 34, 48, 62, 63, 65, 247))
BLOCK_HEADER = 3


@contextmanager
def open_recording(path: Path) -> Iterator[bytes | mmap.mmap]:
    """Open a file as bytes that are read from the disk on demand; raise `OSError` if unreadable."""
    with path.open("rb") as stream:
        if not path.stat().st_size:
            yield b""
            return
        with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
            yield data


def kind_of(data: bytes | mmap.mmap) -> str:
    """Return the format of a recording; raise `RecordingError` if it is unknown."""
    if pcap.is_capture(data[:4]):
        return CAPTURE
    if _envelope(data, 0):
        return FINAL
    if len(data) >= BLOCK_HEADER and data[0] in CATEGORIES and _block_end(data, 0) > 0:
        return RAW
    raise RecordingError(
        "is not a recording of ASTERIX: it must begin with a data block, with an envelope of the "
        "final format, or as a capture (pcap, pcapng)"
    )


def datagrams(
    data: bytes | mmap.mmap, midnight_ns: int | None, counts: Counter[str]
) -> Iterator[Datagram]:
    """Yield the datagrams of a recording in order.

    `midnight_ns` is the beginning of the day of the first datagram. Captures have dates, and are
    moved by whole days; other formats are dated 1970 without it.

    `counts` gains the skipped data: ``bytes_skipped`` and ``resynchronised`` for damaged data,
    ``recording_cut`` if the end is missing, and the reasons of `pcap.packets`.
    """
    kind = kind_of(data)
    if kind == CAPTURE:
        yield from _on_day(pcap.packets(data, counts), midnight_ns)
    elif kind == FINAL:
        yield from _final(data, midnight_ns or 0, counts)
    else:
        yield from _raw(data, counts)


def _on_day(found: Iterator[Datagram], midnight_ns: int | None) -> Iterator[Datagram]:
    """Yield datagrams moved by whole days, so that the first is on the given day."""
    shift_ns: int | None = None
    for each in found:
        if midnight_ns is None or each.received_ns is None:
            yield each
            continue
        if shift_ns is None:
            shift_ns = midnight_ns - each.received_ns // NS_PER_DAY * NS_PER_DAY
        yield each._replace(received_ns=each.received_ns + shift_ns)


def _block_end(data: bytes | mmap.mmap, at: int) -> int:
    """Return the end of the block at `at`, -1 if there is no plausible block."""
    if len(data) - at < BLOCK_HEADER:
        return -1
    length = data[at + 1] << 8 | data[at + 2]
    return at + length if length > BLOCK_HEADER and at + length <= len(data) else -1


def _raw(data: bytes | mmap.mmap, counts: Counter[str]) -> Iterator[Datagram]:
    """Yield data blocks; after damaged data, continue with two consecutive plausible blocks."""
    at = 0
    while at < len(data):
        end = _block_end(data, at)
        if end > 0 and data[at] in CATEGORIES:
            yield Datagram(data[at:end])
            at = end
            continue
        begin = at
        at += 1
        while at < len(data) and not _plausible(data, at):
            at += 1
        counts["bytes_skipped"] += at - begin
        counts["resynchronised" if at < len(data) else "recording_cut"] += 1


def _plausible(data: bytes | mmap.mmap, at: int) -> bool:
    """Return whether a plausible block is here, followed by another one or the end."""
    if data[at] not in CATEGORIES:
        return False
    end = _block_end(data, at)
    if end < 0:
        return False
    return end == len(data) or (data[end] in CATEGORIES and _block_end(data, end) > 0)


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
    at, last_ns = 0, 0
    while at < len(data):
        length = _envelope(data, at)
        if not length:
            # Footers are the only marks for resynchronisation.
            found = data.find(FINAL_FOOTER, at)
            end = len(data) if found < 0 else found + len(FINAL_FOOTER)
            counts["bytes_skipped"] += end - at
            counts["recording_cut" if end == len(data) else "resynchronised"] += 1
            at = end
            continue
        time_ns = int.from_bytes(data[at + 5 : at + 8], "big") * 10_000_000
        if time_ns < last_ns - NS_PER_DAY // 2:
            midnight_ns += NS_PER_DAY
        last_ns = time_ns
        body = data[at + FINAL_HEADER : at + length - len(FINAL_FOOTER)]
        line = f"board {data[at + 2]} line {data[at + 3]}"
        yield Datagram(body, midnight_ns + time_ns, line)
        at += length
