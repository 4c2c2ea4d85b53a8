"""Indexes the content of an MCAP file, and salvages the intact parts of a damaged one.

The mcap library's reader trusts a file's summary without verifying its checksum, reads nothing from
a file without a summary, and ignores messages outside of chunks. Here a summary is used only if it
matches its checksum or has none. Content that the summary does not list is read record by record;
without a usable summary the whole file is. A missing summary is not damage, nor is one without
statistics or channels, which are optional.

After a record with an impossible length, the next chunk or message is searched for. A chunk is
intact if it matches its checksum. A message outside of chunks has no checksum; it counts as intact
if another record can begin at its end.

A piece of a file is a chunk, or a run of messages that a recorder wrote without chunks. The mcap
library allocates the size that a chunk declares, so that a damaged or malicious file could exhaust
the memory. Here every size is checked first.
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, BinaryIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Message, Schema, Statistics
from mcap.stream_reader import StreamReader, breakup_chunk

# Beginning of a message that rosbag2 has compressed by itself; CDR begins with a zero.
_ZSTD = b"\x28\xb5\x2f\xfd"
RECORD_HEAD = 9  # The opcode and the length.
# Upper bound of a piece, packed or unpacked, bytes; rosbag2's largest chunks have 4 MiB.
MAX_CHUNK = 64 * 2**20


class DamageError(Exception):
    """The bytes contradict themselves or exceed a bound."""


def unpack(stream: BinaryIO, offset: int, length: int) -> list[Any]:
    """Return the records of the chunk, or of the run of messages, at `offset`.

    `offset` and `length` are those of the whole piece, with record headers. Raise `DamageError` if
    a chunk does not match its checksum, or a size exceeds `MAX_CHUNK`.
    """
    if length > MAX_CHUNK:
        raise DamageError(f"a chunk of {length} bytes, at most {MAX_CHUNK} are allowed")
    stream.seek(offset)
    data = stream.read(length)
    if len(data) != length or not data or data[0] not in (Opcode.CHUNK, Opcode.MESSAGE):
        raise DamageError("a chunk is not where it should be")
    try:
        plain = data if data[0] == Opcode.MESSAGE else _plain(data)
        return list(breakup_chunk(Chunk("", plain, 0, 0, 0, len(plain))))
    except DamageError:
        raise
    except Exception as error:  # Damaged records raise many types of exception
        raise DamageError(f"a chunk cannot be read: {error}") from error


def _plain(data: bytes) -> bytes:
    chunk = Chunk.read(ReadDataStream(io.BytesIO(data[RECORD_HEAD:])))
    plain = _decompress(chunk)
    if chunk.uncompressed_crc and zlib.crc32(plain) != chunk.uncompressed_crc:
        raise DamageError("a chunk does not match its checksum")
    return plain


def _decompress(chunk: Chunk) -> bytes:
    """Decompress a chunk to at most the size that it declares, which is bounded."""
    size = chunk.uncompressed_size
    if size > MAX_CHUNK:
        raise DamageError(f"a chunk of {size} bytes, at most {MAX_CHUNK} are allowed")
    if not chunk.compression:
        return bytes(chunk.data)
    if chunk.compression == "zstd":
        plain = _unzstd(chunk.data, size)
    elif chunk.compression == "lz4":
        plain = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, size + 1)
    else:
        raise DamageError(f"unknown compression {chunk.compression!r}")
    if len(plain) != size:
        raise DamageError("a chunk does not have the size that it declares")
    return bytes(plain)


def message_data(data: bytes) -> bytes:
    """Return a message's bytes without the compression of rosbag2's `compression_mode: message`.

    Raise `DamageError` if they cannot be decompressed.
    """
    if not data.startswith(_ZSTD):
        return data
    try:
        size = zstandard.frame_content_size(data)
        # The size may be unknown, which is -1.
        plain = _unzstd(data, MAX_CHUNK if size < 0 else min(size, MAX_CHUNK))
    except zstandard.ZstdError as error:
        raise DamageError(f"a compressed message cannot be read: {error}") from error
    if len(plain) > MAX_CHUNK or 0 <= size != len(plain):
        raise DamageError("a compressed message does not have the size that it declares")
    return plain


def _unzstd(data: bytes, size: int) -> bytes:
    """Decompress data to at most `size` bytes and one more."""
    with zstandard.ZstdDecompressor().stream_reader(data) as reader:
        return bytes(reader.read(size + 1))


MAGIC = b"\x89MCAP0\r\n"
FOOTER = RECORD_HEAD + 20


class _UnfinishedError(DamageError):
    """The file ends without a footer."""


def indexes(stream: BinaryIO) -> list[Index]:
    """Return a file's index, from its summary if it is intact, else record by record.

    There are several if whole files were joined, as by ``cat``.
    """
    size = stream.seek(0, io.SEEK_END)
    try:
        found = [_from_summary(stream, size)]
    except DamageError as error:
        found, begin = [], 0
        while not found or begin < size:
            own = Index(damage=str(error))
            after = walk(stream, begin + len(MAGIC), size, own)
            begin = _joined(stream, after, size)
            own.unfinished = isinstance(error, _UnfinishedError) and not own.lost_bytes
            # The checksum of the last summary is that of the last file, at another place.
            if not own.lost_bytes and (begin < size or (found and after < size)):
                own.damage, own.unfinished = "", False
            found.append(own)
    stream.seek(0)
    if stream.read(len(MAGIC)) != MAGIC:
        first = found[0]
        first.damage, first.unfinished = "it does not begin as an MCAP file does", False
    return found


def _joined(stream: BinaryIO, position: int, end: int) -> int:
    """Return where what follows the end of a file begins, or `end` if nothing does."""
    size = len(MAGIC)
    for block_at in range(position, end, _BLOCK):
        stream.seek(block_at)
        block = stream.read(_BLOCK + 2 * size)
        at = block.find(MAGIC)
        if at >= 0:
            # A file both begins and ends with it; one that was cut does not end.
            at += size * (block[at + size : at + 2 * size] == MAGIC)
            return block_at + at if block_at + at + size < end else end
    return end


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
    except Exception as error:  # Damaged records raise many types of exception
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


# Opcode, length, channel, sequence, log time, publish time.
_MESSAGE_HEAD = struct.Struct("<BQHIQQ")
# Messages outside of chunks are read in runs of at most this many bytes, or of one message.
RUN_SIZE = 2**20
# Records that may occur between the header and the end of the data.
_IN_DATA = {
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.MESSAGE,
    Opcode.CHUNK,
    Opcode.MESSAGE_INDEX,
    Opcode.ATTACHMENT,
    Opcode.METADATA,
    Opcode.DATA_END,
}
# Pattern of a chunk's beginning: opcode, length (below 2^40), first and last time, size, checksum,
# compression, length of its data.
_CHUNK_HEAD = (
    rb"\x06(?P<length>.{5}\0{3}).{16}.{5}\0{3}.{4}"
    rb"(?:\0{4}|\x04\0{3}zstd|\x03\0{3}lz4)(?P<data>.{5}\0{3})"
)
_BLOCK = 2**20
# Upper bound of searches, which limits the work on a malicious file with many false records.
_MOST_SEARCHES = 1000


@dataclass
class Index:
    """The content of a file."""

    channels: dict[int, Channel] = field(default_factory=dict)  # By id
    schemas: dict[int, Schema] = field(default_factory=dict)  # By id
    # Earliest log time, offset and length of each chunk, as `unpack` takes them.
    chunks: list[tuple[int, int, int]] = field(default_factory=list)
    # Earliest log time, offset and length of each run of consecutive messages outside of chunks.
    runs: list[tuple[int, int, int]] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)  # Messages by channel id
    expected: int | None = None  # Number of messages that the file declares
    start_ns: int = 0  # Log time of the first message
    end_ns: int = 0  # Log time of the last message
    damage: str = ""  # Fault that makes a part of the file unreadable; empty if there is none
    # True if the file is intact but ends too soon, as after a recorder was killed.
    unfinished: bool = False
    lost_bytes: int = 0  # Bytes of unreadable records, if the file was read record by record
    # Ids of the channels defined outside of chunks.
    loose_channels: set[int] = field(default_factory=set)

    def define(self, record: Any) -> None:
        """Add a channel or a schema; other records are ignored.

        Raise `DamageError` if the id has a different definition already, which is kept.
        """
        tables: dict[type, dict[int, Any]] = {Channel: self.channels, Schema: self.schemas}
        known = tables.get(type(record))
        if known is not None and known.setdefault(record.id, record) != record:
            raise DamageError("two of its records define a channel or a type differently")

    def add_chunk(self, offset: int, length: int, messages: Sequence[Message]) -> None:
        """Count the messages of a chunk; note its place, bytes, if it has any."""
        for message in messages:
            self._count(message.channel_id, message.log_time)
        if messages:
            self.chunks.append((min(message.log_time for message in messages), offset, length))

    def add_message(self, offset: int, length: int, channel_id: int, log_time: int) -> None:
        """Add a message outside of chunks; it extends a run that ends at its beginning."""
        self._count(channel_id, log_time)
        earliest, begin, size = self.runs[-1] if self.runs else (log_time, offset, 0)
        if begin + size == offset and size + length <= RUN_SIZE:
            self.runs[-1:] = [(min(earliest, log_time), begin, size + length)]
        else:
            self.runs.append((log_time, offset, length))

    def _count(self, channel_id: int, log_time: int) -> None:
        self.start_ns = min(self.start_ns, log_time) if self.counts else log_time
        self.end_ns = max(self.end_ns, log_time)
        self.counts[channel_id] += 1


def walk(stream: BinaryIO, begin: int, end: int, found: Index) -> int:
    """Read the intact records from `begin` to `end` into `found`, and return the end of the data.

    The bounds are those of the data section, or of a part of it. The first damage and the number
    of lost bytes are stored in `found` too.
    """
    position, searches = begin, 0
    while position + RECORD_HEAD <= end:
        opcode, length = head(stream, position)
        after = position + length
        if opcode == Opcode.DATA_END and length == RECORD_HEAD + 4:
            return after
        try:
            _add_record(stream, position, end, found)
        except DamageError as error:
            found.damage = found.damage or str(error)
            # The length itself may be damaged.
            if not _can_follow(stream, after, end):
                searches += 1
                after = _next_record(stream, position + 1, end, found)
                if searches > _MOST_SEARCHES:
                    after = end
            found.lost_bytes += after - position
        position = after
    found.lost_bytes += max(0, end - position)
    return position


def head(stream: BinaryIO, position: int) -> tuple[int, int]:
    """Return a record's opcode and its length including the header."""
    stream.seek(position)
    data = stream.read(RECORD_HEAD)
    return data[0], RECORD_HEAD + int.from_bytes(data[1:], "little")


def _add_record(stream: BinaryIO, position: int, end: int, found: Index) -> None:
    opcode, length = head(stream, position)
    if position + length > end:
        raise DamageError("a record does not end within the data")
    if opcode == Opcode.CHUNK:
        records = unpack(stream, position, length)
        for record in records:
            found.define(record)
        found.add_chunk(position, length, [each for each in records if isinstance(each, Message)])
    elif opcode == Opcode.MESSAGE:
        _add_message(stream, position, length, end, found)
    elif opcode in (Opcode.CHANNEL, Opcode.SCHEMA):
        _add_definition(stream, position, length, found)
    elif not _can_follow(stream, position + length, end):
        raise DamageError("a record does not end where another begins")


def _add_message(stream: BinaryIO, position: int, length: int, end: int, found: Index) -> None:
    if length > MAX_CHUNK:
        raise DamageError(f"a message of {length} bytes, at most {MAX_CHUNK} are allowed")
    if length < _MESSAGE_HEAD.size:
        raise DamageError(f"a message of {length} bytes, its header alone has {_MESSAGE_HEAD.size}")
    _, _, channel_id, _, log_time, _ = _message_head(stream, position)
    after = position + length
    if not (
        _can_follow(stream, after, end) or _is_damaged_message(stream, after, end, log_time, found)
    ):
        raise DamageError("a message does not end where another record begins")
    if channel_id not in found.channels:
        raise DamageError("a message belongs to an undefined channel")
    found.add_message(position, length, channel_id, log_time)


def _message_head(stream: BinaryIO, position: int) -> tuple[int, ...]:
    stream.seek(position)
    return _MESSAGE_HEAD.unpack(stream.read(_MESSAGE_HEAD.size))


def _is_damaged_message(
    stream: BinaryIO, position: int, end: int, log_time: int, found: Index
) -> bool:
    """Return whether a message with a damaged header seems to follow an intact one."""
    if position + _MESSAGE_HEAD.size > end:
        return False
    opcode, _, channel_id, _, its_time, _ = _message_head(stream, position)
    near = abs(its_time - log_time) < 86_400 * 10**9  # A day
    return sum((opcode == Opcode.MESSAGE, channel_id in found.channels, near)) >= 2


def _add_definition(stream: BinaryIO, position: int, length: int, found: Index) -> None:
    if length > MAX_CHUNK:
        raise DamageError(f"a definition of {length} bytes, at most {MAX_CHUNK} are allowed")
    stream.seek(position)
    data = stream.read(length)
    source = ReadDataStream(io.BytesIO(data[RECORD_HEAD:]))
    kind = Channel if data[0] == Opcode.CHANNEL else Schema
    try:
        record: Channel | Schema = kind.read(source)
    except Exception as error:  # Damaged records raise many types of exception
        raise DamageError(f"a definition cannot be read: {error}") from error
    found.define(record)
    if isinstance(record, Channel):
        found.loose_channels.add(record.id)
    # The content is readable, but the length, and therefore the next record's position, is wrong.
    if source.count != length - RECORD_HEAD:
        raise DamageError("a definition does not have the size that it declares")


def _can_follow(stream: BinaryIO, position: int, end: int) -> bool:
    """Return whether a record, or the end of a truncated file, may be at `position`."""
    if position + RECORD_HEAD > end:
        return position <= end
    opcode, length = head(stream, position)
    # First opcode of the records that programs may add for themselves.
    is_known = opcode in _IN_DATA or opcode >= 0x80
    return is_known and (length <= MAX_CHUNK or position + length <= end)


def _next_record(stream: BinaryIO, start: int, end: int, found: Index) -> int:
    """Return the position of the next plausible chunk or message, or `end`."""
    # A message in a damaged chunk must not be used without the chunk's checksum, so only those of
    # channels that are defined outside of chunks are searched for.
    ids = [re.escape(struct.pack("<H", key)) for key in sorted(found.loose_channels)]
    message = rb"|\x05.{4}\0{4}(?:" + b"|".join(ids) + rb")" if ids else b""
    heads = re.compile(_CHUNK_HEAD + message, re.DOTALL)
    for block_at in range(start, end, _BLOCK):
        stream.seek(block_at)
        # A head that begins at the block's end is shorter than this.
        block = stream.read(min(_BLOCK + 64, end - block_at))
        at = 0
        while (match := heads.search(block, at)) is not None:
            begin = block_at + match.start()
            if _seems_whole(stream, begin, end, match):
                return begin
            at = match.start() + 1
    return end


def _seems_whole(stream: BinaryIO, begin: int, end: int, match: re.Match[bytes]) -> bool:
    """Return whether the lengths of an apparent record header are plausible."""
    if match["length"] is None:
        _, length = head(stream, begin)
        return begin + length <= end and _can_follow(stream, begin + length, end)
    length = int.from_bytes(match["length"], "little")
    content = match.end() - match.start() - RECORD_HEAD
    data = int.from_bytes(match["data"], "little")
    return length == content + data and begin + RECORD_HEAD + length <= end
