"""Stamps as integers in nanoseconds."""

from __future__ import annotations

import struct
from datetime import datetime, timezone

from builtin_interfaces.msg import Time
from std_msgs.msg import Header

from . import RejectedMessageError

NS_PER_S = 1_000_000_000


def to_ns(stamp: Time) -> int:
    """Return a stamp in nanoseconds."""
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec)


def from_ns(stamp_ns: int) -> Time:
    """Return the stamp message of a time in nanoseconds."""
    sec, nanosec = divmod(stamp_ns, NS_PER_S)
    return Time(sec=sec, nanosec=nanosec)


def to_iso(stamp_ns: int) -> str:
    """Return a stamp as ISO 8601 in UTC, with milliseconds."""
    whole, rest = divmod(stamp_ns, NS_PER_S)
    text = datetime.fromtimestamp(whole, timezone.utc).strftime("%Y-%m-%dT%H:%M:%S")
    return f"{text}.{rest // 1_000_000:03d}Z"


def header(stamp_ns: int, frame: str) -> Header:
    """Return a header with a stamp, nanoseconds since 1970, and a frame."""
    return Header(stamp=from_ns(stamp_ns), frame_id=frame)


def of_header(sent: Header) -> int:
    """Return a header's stamp in nanoseconds.

    Raise `RejectedMessageError`: ``schema`` if it is before 1970 or its nanoseconds are a second or
    more.
    """
    sec, nanosec = sent.stamp.sec, sent.stamp.nanosec
    if sec < 0 or nanosec >= NS_PER_S:
        raise RejectedMessageError(
            "schema", f"stamp {sec} s {nanosec} ns, must be from 0 s and below {NS_PER_S} ns"
        )
    return to_ns(sent.stamp)


def of_input(sent: Header) -> int:
    """Return the stamp of a measurement in nanoseconds.

    Raise `RejectedMessageError`: ``stamp_zero`` if it is 0, which drivers send that have no time
    yet; see also `of_header`.
    """
    stamp_ns = of_header(sent)
    if not stamp_ns:
        raise RejectedMessageError("stamp_zero", "its stamp is 0, must be the time of measurement")
    return stamp_ns


def restamped(data: bytes, stamp_ns: int) -> bytes:
    """Return a serialised message that begins with a header, with another stamp."""
    if len(data) < 12:
        return data
    stamp = struct.pack("<iI" if data[1] & 1 else ">iI", *divmod(stamp_ns, NS_PER_S))
    return data[:4] + stamp + data[12:]


def of_cdr(data: bytes, at: int = 4) -> int:
    """Return the stamp in nanoseconds of a serialised message's header, which begins at a byte.

    By default the message begins with the header.
    """
    # Byte 1 of the encapsulation gives the byte order.
    sec, nanosec = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, at)
    return int(sec) * NS_PER_S + int(nanosec)
