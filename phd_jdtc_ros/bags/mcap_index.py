"""Indexes the content of an MCAP file.

The mcap library's reader trusts a file's summary without verifying its checksum, reads nothing from
a file without a summary, and ignores messages outside of chunks. Here a summary is used only if it
matches its checksum or has none. Content that the summary does not list is read record by record;
without a usable summary the whole file is. A missing summary is not damage, nor is one without
statistics or channels, which are optional.
"""

from __future__ import annotations

import io
import zlib
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Statistics
from mcap.stream_reader import StreamReader

from .chunks import RECORD_HEAD, DamageError
from .salvage import Index, walk

MAGIC = b"\x89MCAP0\r\n"
FOOTER = RECORD_HEAD + 20


class _UnfinishedError(DamageError):
    """The file ends without a footer."""


def index(stream: BinaryIO) -> Index:
    """Return a file's index, from its summary if it is intact, else record by record."""
    size = stream.seek(0, io.SEEK_END)
    try:
        found = _from_summary(stream, size)
    except DamageError as error:
        found = Index(damage=str(error))
        walk(stream, len(MAGIC), size, found)
        found.unfinished = isinstance(error, _UnfinishedError) and not found.lost_bytes
    stream.seek(0)
    if stream.read(len(MAGIC)) != MAGIC:
        found.damage, found.unfinished = "it does not begin as an MCAP file does", False
    return found


def _from_summary(stream: BinaryIO, size: int) -> Index:
    if size < 2 * len(MAGIC) + FOOTER:
        raise _UnfinishedError("it is truncated")
    footer_at = size - len(MAGIC) - FOOTER
    stream.seek(footer_at)
    tail = stream.read()
    if tail[-len(MAGIC) :] != MAGIC or tail[0] != Opcode.FOOTER:
        raise _UnfinishedError("it is truncated")
    start = int.from_bytes(tail[9:17], "little")
    checksum = int.from_bytes(tail[25:29], "little")
    if start == 0 and checksum in (0, zlib.crc32(tail[:25])):
        return _walked(stream, footer_at, None)
    if not len(MAGIC) <= start < footer_at:
        raise DamageError("it has no summary")
    stream.seek(start)
    summary = stream.read(footer_at - start)
    # The checksum covers the summary and the footer up to the checksum itself.
    if checksum and zlib.crc32(summary + tail[:25]) != checksum:
        raise DamageError("its summary does not match its checksum")
    try:
        found, parts, is_enough = _read_summary(summary + tail)
    except DamageError:
        raise
    except Exception as error:  # damaged records raise many types of exception
        raise DamageError("its summary cannot be read") from error
    if not is_enough:
        return _walked(stream, start, found.expected)
    _add_remainder(stream, start, parts, found)
    return found


def _walked(stream: BinaryIO, end: int, expected: int | None) -> Index:
    """Return the index of records that end at `end`, without a summary of them."""
    found = Index(expected=expected)
    if walk(stream, len(MAGIC), end, found) != end:
        found.damage = found.damage or "its data do not end where they should"
    return found


def _read_summary(data: bytes) -> tuple[Index, list[ChunkIndex], bool]:
    """Return the index in a summary, its list of chunks, and whether it describes every message.

    `data` go on to the file's end.
    """
    found, parts, statistics = Index(), [], None
    for record in StreamReader(io.BytesIO(data), skip_magic=True, emit_chunks=True).records:
        found.define(record)
        if isinstance(record, ChunkIndex):
            parts.append(record)
        elif isinstance(record, Statistics):
            statistics = record
    if statistics is None:
        return found, parts, False
    found.chunks = [(c.message_start_time, c.chunk_start_offset, c.chunk_length) for c in parts]
    found.counts.update(statistics.channel_message_counts)
    found.expected = statistics.message_count
    found.start_ns = statistics.message_start_time
    found.end_ns = statistics.message_end_time
    is_counted = found.counts.total() == found.expected
    needed = {channel.schema_id for channel in found.channels.values()} - {0}
    is_described = found.counts.keys() <= found.channels.keys() and needed <= found.schemas.keys()
    return found, parts, is_counted and is_described


def _add_remainder(stream: BinaryIO, end: int, listed: list[ChunkIndex], found: Index) -> None:
    """Add what is before the summary and in none of its chunks; contradictions are damage."""
    extra = Index(channels=dict(found.channels), schemas=dict(found.schemas))
    begin = len(MAGIC)
    for part in sorted(listed, key=lambda part: part.chunk_start_offset):
        walk(stream, begin, min(part.chunk_start_offset, end), extra)
        behind = part.chunk_start_offset + part.chunk_length + part.message_index_length
        begin = max(begin, behind)
    walk(stream, begin, end, extra)
    found.channels, found.schemas = extra.channels, extra.schemas
    found.chunks += extra.chunks
    found.runs, found.damage = extra.runs, extra.damage
    if extra.counts and not found.start_ns <= extra.start_ns <= extra.end_ns <= found.end_ns:
        found.damage = found.damage or "its statistics do not match its messages"
