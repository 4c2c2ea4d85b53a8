"""Unpacks the messages of an MCAP file piece by piece, within bounds.

A piece is a chunk, or a run of messages that a recorder wrote without chunks. The mcap library
allocates the size that a chunk declares, so that a damaged or malicious file could exhaust the
memory. Here every size is checked first.
"""

from __future__ import annotations

import io
import zlib
from typing import Any, BinaryIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.stream_reader import breakup_chunk

# Beginning of a message that rosbag2 has compressed by itself; CDR begins with a zero.
_ZSTD = b"\x28\xb5\x2f\xfd"
RECORD_HEAD = 9  # opcode and length
# Upper bound of a piece, packed or unpacked, bytes; rosbag2's largest chunks have 4 MiB.
MAX_CHUNK = 64 * 2**20
_PIECES = (bytes([Opcode.CHUNK]), bytes([Opcode.MESSAGE]))


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
    if len(data) != length or data[:1] not in _PIECES:
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
