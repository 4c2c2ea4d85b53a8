"""A datagram of a recording or of the network, and what is wrong with a recording."""

from __future__ import annotations

from typing import NamedTuple


class Datagram(NamedTuple):
    """What was received at once.

    Parameters
    ----------
    data : bytes
        Data blocks.
    received_ns : int or None
        Since the epoch, if the recording says it.
    source : str or None
        ``SENDER to RECEIVER:PORT``, or ``board NUMBER line NUMBER``, if the recording says it.
    """

    data: bytes
    received_ns: int | None = None
    source: str | None = None


def port_of(datagram: Datagram) -> int | None:
    """Return the UDP port that a datagram was sent to; None if the recording does not say it."""
    _, colon, port = (datagram.source or "").rpartition(":")
    return int(port) if colon else None


class RecordingError(ValueError):
    """A file that is no recording of ASTERIX."""
