# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Datagrams to messages: data blocks, one after the other, and the records in them.

A block whose length cannot be true ends its datagram, because nothing says where the next begins.
A record that is malformed ends its block, for the same reason; what was before it is used.
Everything is counted by reason.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from .records import Message, reader
from .specification import MalformedError

HEADER = 3


def blocks(data: bytes, counts: Counter[str]) -> Iterator[tuple[int, int, int]]:
    """Yield category, begin and end of the records of each data block of a datagram.

    Parameters
    ----------
    data : bytes
    counts : Counter
        Gains ``block_truncated`` or ``block_length`` if the rest is no block.
    """
    at = 0
    while at < len(data):
        if len(data) - at < HEADER:
            counts["block_truncated"] += 1
            return
        length = data[at + 1] << 8 | data[at + 2]
        if length <= HEADER:
            counts["block_length"] += 1
            return
        if at + length > len(data):
            counts["block_truncated"] += 1
            return
        yield data[at], at + HEADER, at + length
        at += length


def messages(data: bytes, counts: Counter[str]) -> list[Message]:
    """Return the messages of a datagram in order.

    Parameters
    ----------
    data : bytes
    counts : Counter
        Gains what was left out, by reason: those of `blocks`, ``other_category``, the reasons of
        `MalformedError`, and those of `records`.
    """
    found = []
    for category, begin, end in blocks(data, counts):
        reads = reader(category)
        if reads is None:
            counts["other_category"] += 1
            continue
        at = begin
        try:
            while at < end:
                message, at = reads.read(data, at, end, counts)
                if message is not None:
                    found.append(message)
        except MalformedError as error:
            counts[error.reason] += 1
    return found
