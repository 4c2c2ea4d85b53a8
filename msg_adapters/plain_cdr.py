"""Serialises any message object as plain CDR with zero padding.

The middleware leaves padding uninitialised, so that the bytes of equal messages differ. Here a
message is written member by member, by the types that its class declares.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray

from .cdr import ENCAPSULATION, Writer

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
}
_SEQUENCE = re.compile(r"sequence<(.+?)(?:, \d+)?>")
_ARRAY = re.compile(r"(.+)\[\d+\]")

Put = Callable[[Writer, Any], object]


def encode(message: Any, **rows: FloatArray) -> bytes:
    """Serialise a message reproducibly as CDR; see `put_message` for `rows`.

    Raises
    ------
    TypeError
        If it contains wide strings.
    """
    writer = Writer()
    put_message(writer, message, **rows)
    return ENCAPSULATION + bytes(writer.data)


def put_message(writer: Writer, message: Any, **rows: FloatArray) -> None:
    """Append a message; `rows` are written for sequences of messages of doubles, by member."""
    for name, put in _members(message.__class__):
        if name in rows:
            writer.put("I", len(rows[name]))
            writer.doubles(rows[name])
        else:
            put(writer, getattr(message, name))


@cache
def _members(kind: Any) -> tuple[tuple[str, Put], ...]:
    """Return the names of a class's members with their writers."""
    types = kind.get_fields_and_field_types()
    # An IDL structure cannot be empty, so an empty message has one byte.
    return tuple((name, _put_of(text)) for name, text in types.items()) or (("__doc__", _put_none),)


def _put_of(kind: str) -> Put:
    """Return the writer of a type, named as by `get_fields_and_field_types`."""
    if match := _SEQUENCE.fullmatch(kind):
        return partial(_put_sequence, _put_entries_of(match[1]))
    if match := _ARRAY.fullmatch(kind):
        return _put_entries_of(match[1])
    if kind in _CODES:
        return partial(_put_number, _CODES[kind])
    if kind == "octet":
        return _put_octet
    if kind.startswith("wstring"):
        raise TypeError(f"{kind}: wide strings cannot be written")
    return _put_string if kind.startswith("string") else put_message


def _put_entries_of(kind: str) -> Put:
    if kind in _CODES:
        return partial(_put_numbers, _CODES[kind])
    return partial(_put_entries, _put_of(kind))


def _put_number(code: str, writer: Writer, value: Any) -> None:
    writer.put(code, value)


def _put_octet(writer: Writer, value: bytes) -> None:
    writer.put("B", value[0])


def _put_none(writer: Writer, _: object) -> None:
    writer.put("B", 0)


def _put_string(writer: Writer, text: str) -> None:
    writer.string(text)


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
        writer.data += np.asarray(numbers, dtype=np.dtype(code).newbyteorder("<")).tobytes()
