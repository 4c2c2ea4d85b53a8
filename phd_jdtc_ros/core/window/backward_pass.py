"""Backward pass: the order in which later sets send messages to earlier sets they continue."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from ..arrays import IntArray
from .entries import Entry, LinkT, RowsT

MessageT = TypeVar("MessageT")


@dataclass(frozen=True)
class Message(Generic[MessageT]):
    """A backward message to some rows of an earlier set."""

    rows: IntArray | None  # Receiving rows, ascending; None for all rows
    # Indices of these rows in the content, which covers the rows of all sources of the later set.
    part: slice
    content: MessageT  # The engine's quantities for the rows of all sources


def smoothed_sets(
    entries: Sequence[Entry[RowsT, LinkT]],
    send: Callable[[RowsT, LinkT], MessageT],
    receive: Callable[[RowsT, Sequence[Message[MessageT]]], RowsT],
) -> Iterator[RowsT]:
    """Yield the smoothed sets of a window, newest first: lag 0, lag 1 and so on.

    Parameters
    ----------
    entries : sequence of Entry
        Oldest first. A source that is not among these entries has been dropped; nothing is sent to
        it.
    send : callable
        Returns the content of a smoothed set's message to the rows of its sources, given its link.
    receive : callable
        Returns the smoothed set, given the filtered one and the messages to its rows. Each row
        receives at most one message; rows without a message keep their filtered values.
    """
    received: dict[int, list[Message[MessageT]]] = {}
    stamps = {entry.stamp_ns for entry in entries}
    for entry in reversed(entries):
        smoothed = entry.stored
        if entry.stamp_ns in received:
            smoothed = receive(smoothed, received.pop(entry.stamp_ns))
        yield smoothed
        if entry.link is None or not any(source.stamp_ns in stamps for source in entry.sources):
            continue
        content, first = send(smoothed, entry.link), 0
        for source in entry.sources:
            part = slice(first, first + source.size)
            first += source.size
            if source.stamp_ns in stamps:
                message = Message(source.rows, part, content)
                received.setdefault(source.stamp_ns, []).append(message)
