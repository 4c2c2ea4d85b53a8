"""A datagram of a recording or of the network, and the error of an unreadable recording."""

from __future__ import annotations

from typing import NamedTuple


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
