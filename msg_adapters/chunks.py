"""The chunks of an MCAP file, found and unpacked with care for what damage and malice can do.

The reader of the mcap library trusts a file's summary without looking at its checksum, gives
nothing of a file that has none, and unpacks whatever a chunk claims. Here a summary counts only if
its checksum matches; otherwise the file is gone through from its beginning, and every chunk that
is whole is used. Where a record's length makes no sense, the next chunk is looked for.
"""

from __future__ import annotations

import io
import re
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, BinaryIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Message, Schema, Statistics
from mcap.stream_reader import breakup_chunk

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD = 9  # opcode and length
FOOTER = RECORD_HEAD + 20
# A chunk larger than this, packed or unpacked, is refused; recorders write 1 MiB or less.
MAX_CHUNK = 64 * 2**20
# What a chunk begins with: opcode, length (below 2^40), first and last time, size, checksum,
# compression, length of its data.
_CHUNK_HEAD = re.compile(
    rb"\x06(?P<length>.{5}\0{3}).{16}.{5}\0{3}.{4}"
    rb"(?:\0{4}|\x04\0{3}zstd|\x03\0{3}lz4)(?P<data>.{5}\0{3})",
    re.DOTALL,
)
_LONGEST_HEAD = 64
_BLOCK = 2**20
# A file may be made so that every search ends at something that is no chunk.
_MOST_SEARCHES = 1000


class DamageError(Exception):
    """What the bytes say cannot be true."""


@dataclass
class Index:
    """What a file holds.

    Parameters
    ----------
    channels, schemas : dict by id
    chunks : list of (earliest log time, offset, length)
    counts : Counter
        Messages by channel id.
    expected : int or None
        Messages that there should be, where the file says so.
    start_ns, end_ns : int
        Log times of the first and the last message.
    damage : str
        Why not everything can be read; empty if all is well.
    """

    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    chunks: list[tuple[int, int, int]] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    expected: int | None = None
    start_ns: int = 0
    end_ns: int = 0
    damage: str = ""

    def define(self, record: Any) -> None:
        """Take in a channel or a schema; other records are passed over."""
        if isinstance(record, Channel):
            self.channels[record.id] = record
        elif isinstance(record, Schema):
            self.schemas[record.id] = record


def index(stream: BinaryIO) -> Index:
    """Return the index of a file: its summary's if that is whole, else by going through it."""
    size = stream.seek(0, io.SEEK_END)
    try:
        found = _from_summary(stream, size)
    except DamageError as error:
        found = _from_records(stream, size)
        found.damage = str(error)
    stream.seek(0)
    if stream.read(len(MAGIC)) != MAGIC:
        found.damage = "it does not begin as an MCAP file does"
    return found


def _from_summary(stream: BinaryIO, size: int) -> Index:
    if size < 2 * len(MAGIC) + FOOTER:
        raise DamageError("it is truncated")
    footer_at = size - len(MAGIC) - FOOTER
    stream.seek(footer_at)
    tail = stream.read()
    if tail[-len(MAGIC) :] != MAGIC or tail[0] != Opcode.FOOTER:
        raise DamageError("it is truncated")
    start = int.from_bytes(tail[9:17], "little")
    checksum = int.from_bytes(tail[25:29], "little")
    if not len(MAGIC) <= start < footer_at:
        raise DamageError("it has no summary")
    stream.seek(start)
    summary = stream.read(footer_at - start)
    # The checksum covers the summary and the footer up to the checksum itself.
    if checksum and zlib.crc32(summary + tail[:25]) != checksum:
        raise DamageError("its summary does not match its checksum")
    try:
        return _read_summary(summary)
    except Exception as error:  # a dozen kinds come out of damaged records
        raise DamageError("its summary cannot be read") from error


def _read_summary(summary: bytes) -> Index:
    found = Index()
    statistics = None
    for opcode, content in _records(summary):
        source = ReadDataStream(io.BytesIO(content))
        if opcode == Opcode.CHANNEL:
            found.define(Channel.read(source))
        elif opcode == Opcode.SCHEMA:
            found.define(Schema.read(source))
        elif opcode == Opcode.CHUNK_INDEX:
            chunk = ChunkIndex.read(source)
            place = (chunk.message_start_time, chunk.chunk_start_offset, chunk.chunk_length)
            found.chunks.append(place)
        elif opcode == Opcode.STATISTICS:
            statistics = Statistics.read(source)
    if statistics is None:
        raise DamageError("it has no statistics")
    found.counts.update(statistics.channel_message_counts)
    found.expected = statistics.message_count
    found.start_ns = statistics.message_start_time
    found.end_ns = statistics.message_end_time
    return found


def _records(data: bytes) -> Iterator[tuple[int, bytes]]:
    position = 0
    while position + RECORD_HEAD <= len(data):
        length = int.from_bytes(data[position + 1 : position + RECORD_HEAD], "little")
        position += RECORD_HEAD
        yield data[position - RECORD_HEAD], data[position : position + length]
        position += length


def _from_records(stream: BinaryIO, size: int) -> Index:
    """Go through a file's records and keep its whole chunks."""
    found = Index()
    times = []
    position, searches = len(MAGIC), 0
    while position + RECORD_HEAD <= size:
        opcode, length = _head(stream, position)
        end = position + length
        records: list[Any] = []
        if opcode == Opcode.CHUNK and end <= size:
            try:
                records = unpack(stream, position, length)
            except DamageError:
                # Its length may be what is damaged.
                end = end if _can_follow(stream, end, size) else size + 1
        if end > size:
            searches += 1
            after = _next_chunk(stream, position + 1, size)
            if after is None or searches > _MOST_SEARCHES:
                break
            position = after
            continue
        messages = [record for record in records if isinstance(record, Message)]
        for record in records:
            found.define(record)
        if messages:
            stamps = [message.log_time for message in messages]
            times += [min(stamps), max(stamps)]
            found.counts.update(message.channel_id for message in messages)
            found.chunks.append((min(stamps), position, length))
        position = end
    found.start_ns, found.end_ns = min(times, default=0), max(times, default=0)
    return found


def _head(stream: BinaryIO, position: int) -> tuple[int, int]:
    """Return a record's opcode and its length, the head included."""
    stream.seek(position)
    head = stream.read(RECORD_HEAD)
    return head[0], RECORD_HEAD + int.from_bytes(head[1:], "little")


def _can_follow(stream: BinaryIO, position: int, size: int) -> bool:
    """Return whether a record, or the end of a file that was cut short, may be at `position`."""
    if position + RECORD_HEAD > size:
        return position <= size
    opcode, length = _head(stream, position)
    return Opcode.HEADER <= opcode <= Opcode.DATA_END and position + length <= size


def _next_chunk(stream: BinaryIO, start: int, size: int) -> int | None:
    """Return where the next chunk seems to begin: both its lengths must agree and fit the file."""
    for block_at in range(start, size, _BLOCK):
        stream.seek(block_at)
        block = stream.read(_BLOCK + _LONGEST_HEAD)
        at = 0
        while (head := _CHUNK_HEAD.search(block, at)) is not None:
            length = int.from_bytes(head["length"], "little")
            data = int.from_bytes(head["data"], "little")
            begin, content = block_at + head.start(), head.end() - head.start() - RECORD_HEAD
            if length == content + data and begin + RECORD_HEAD + length <= size:
                return begin
            at = head.start() + 1
    return None


def unpack(stream: BinaryIO, offset: int, length: int) -> list[Any]:
    """Return the records of the chunk at `offset`, its head included in `length`.

    Raises
    ------
    DamageError
        If it does not match its checksum, or is larger than is allowed.
    """
    if length > MAX_CHUNK:
        raise DamageError(f"a chunk of {length} bytes, at most {MAX_CHUNK} are allowed")
    stream.seek(offset)
    data = stream.read(length)
    if len(data) != length or data[:1] != bytes([Opcode.CHUNK]):
        raise DamageError("a chunk is not where it should be")
    try:
        chunk = Chunk.read(ReadDataStream(io.BytesIO(data[RECORD_HEAD:])))
        plain = _decompress(chunk)
        if chunk.uncompressed_crc and zlib.crc32(plain) != chunk.uncompressed_crc:
            raise DamageError("a chunk does not match its checksum")
        whole = Chunk("", plain, chunk.message_end_time, chunk.message_start_time, 0, len(plain))
        return list(breakup_chunk(whole))
    except DamageError:
        raise
    except Exception as error:  # a dozen kinds come out of damaged records
        raise DamageError(f"a chunk cannot be read: {error}") from error


def _decompress(chunk: Chunk) -> bytes:
    """Return a chunk's records; never more bytes than it declares, which are bounded."""
    size = chunk.uncompressed_size
    if size > MAX_CHUNK:
        raise DamageError(f"a chunk of {size} bytes, at most {MAX_CHUNK} are allowed")
    if not chunk.compression:
        return bytes(chunk.data)
    if chunk.compression == "zstd":
        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as reader:
            plain = reader.read(size + 1)
    elif chunk.compression == "lz4":
        plain = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, size + 1)
    else:
        raise DamageError(f"compression {chunk.compression!r} is not known")
    if len(plain) != size:
        raise DamageError("a chunk has another size than it says")
    return bytes(plain)
