"""CDR serialisation without rclpy, with zero padding.

The middleware leaves padding uninitialised, so that the bytes of equal messages differ. It also
needs about three microseconds per point, and the markers of 200 estimates have 11,000. Here a
message is written member by member, by the types that its class declares, and arrays of points in
one operation. A publisher also accepts a serialised message.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray

from .stamps import NS_PER_S

# Header of plain little-endian CDR. Alignment is counted from the byte after it.
ENCAPSULATION = b"\x00\x01\x00\x00"

# `struct` and numpy codes of the primitive types, by their IDL names.
_CODES = {
    "boolean": "?",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float": "f",
    "double": "d",
    "octet": "c",
}
_SIZES = {code: struct.calcsize(code) for code in _CODES.values()}


@dataclass
class Writer:
    """Writes members in order, each aligned to its own size with padding of zeros."""

    # Parts written so far, without the encapsulation header, and the number of their bytes. They
    # are joined once, because each copy of a large message takes as long as computing it.
    parts: list[bytes | memoryview] = field(default_factory=list)
    size: int = 0

    def add(self, part: bytes | memoryview) -> None:
        """Append bytes as they are; they must not change before the message is read."""
        self.parts.append(part)
        self.size += len(part)

    def put(self, code: str, *values: float | bytes) -> None:
        """Append numbers, or octets, of one `struct` code."""
        gap = bytes(-self.size % _SIZES[code])
        self.add(gap + struct.pack(f"<{len(values)}{code}", *values))

    def align(self, size: int) -> None:
        """Append zeros up to a multiple of `size` bytes."""
        missing = -self.size % size
        if missing:
            self.add(bytes(missing))

    def rows(self, values: FloatArray) -> None:
        """Append the rows of an array as a sequence of messages of doubles."""
        self.put("I", len(values))
        # An empty sequence has no padding after its length.
        if values.size:
            self.align(8)
            self.add(np.ascontiguousarray(values, "<f8").data.cast("B"))

    def string(self, text: str) -> None:
        """Append a string."""
        encoded = text.encode()
        gap = bytes(-self.size % 4)
        self.add(gap + struct.pack("<I", len(encoded) + 1) + encoded + b"\0")

    def header(self, stamp_ns: int, frame: str) -> None:
        """Append a ``std_msgs/Header``."""
        self.align(4)
        self.add(struct.pack("<iI", *divmod(stamp_ns, NS_PER_S)))
        self.string(frame)

    @property
    def data(self) -> bytes:
        """The bytes written so far, without the encapsulation header."""
        return b"".join(self.parts)

    def message(self) -> bytes:
        """Return what has been written as a serialised message."""
        return b"".join((ENCAPSULATION, *self.parts))


# --- messages -----------------------------------------------------------------------------------

Put = Callable[[Writer, Any], object]


def encode(message: Any) -> bytes:
    """Serialise a message reproducibly as CDR; raise `TypeError` if it contains wide strings."""
    writer = Writer()
    put_message(writer, message)
    return writer.message()


def put_message(writer: Writer, message: Any) -> None:
    """Append a message."""
    for name, put in _members(message.__class__):
        put(writer, getattr(message, name))


@cache
def _members(kind: Any) -> tuple[tuple[str, Put], ...]:
    """Return the names of a class's members with their writers."""
    types = kind.get_fields_and_field_types()
    # An IDL structure cannot be empty, so an empty message has one byte.
    return tuple((name, _put_of(text)) for name, text in types.items()) or (
        ("__doc__", lambda writer, _: writer.put("B", 0)),
    )


def _put_of(kind: str) -> Put:
    """Return the writer of a type, named as by `get_fields_and_field_types`."""
    if match := re.fullmatch(r"sequence<(.+?)(?:, \d+)?>", kind):
        return partial(_put_sequence, _put_entries_of(match[1]))
    if match := re.fullmatch(r"(.+)\[\d+\]", kind):
        return _put_entries_of(match[1])
    if code := _CODES.get(kind):
        return lambda writer, value: writer.put(code, value)
    if kind.startswith("wstring"):
        raise TypeError(f"{kind}: wide strings cannot be written")
    return Writer.string if kind.startswith("string") else put_message


def _put_entries_of(kind: str) -> Put:
    if kind in _CODES:
        return partial(_put_numbers, _CODES[kind])
    return partial(_put_entries, _put_of(kind))


def _put_sequence(put_entries: Put, writer: Writer, values: Any) -> None:
    writer.put("I", len(values))
    put_entries(writer, values)


def _put_entries(put: Put, writer: Writer, values: Any) -> None:
    for value in values:
        put(writer, value)


def _put_numbers(code: str, writer: Writer, values: Any) -> None:
    # An empty sequence has no padding after its length.
    if len(values):
        writer.put(code)
        numbers = np.frombuffer(values, code) if isinstance(values, bytes) else values
        writer.add(np.asarray(numbers, dtype=np.dtype(code).newbyteorder("<")).tobytes())
