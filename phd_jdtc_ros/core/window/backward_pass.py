"""The way back over a window: which earlier set hears what from which later ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from ..arrays import IntArray
from .entries import Entry, LinkT, RowsT

MessageT = TypeVar("MessageT")


@dataclass(frozen=True)
class Told(Generic[MessageT]):
    """What a later set tells rows of an earlier one.

    Parameters
    ----------
    rows : int array or None
        Those rows, ascending; None for all of them.
    part : slice
        Their places in the message, which is about the rows of all sources of the later set.
    message : object
    """

    rows: IntArray | None
    part: slice
    message: MessageT


def smoothed_sets(
    entries: Sequence[Entry[RowsT, LinkT]],
    tell: Callable[[RowsT, LinkT], MessageT],
    hear: Callable[[RowsT, Sequence[Told[MessageT]]], RowsT],
) -> Iterator[RowsT]:
    """Yield the smoothed sets of a window, newest first: lag 0, lag 1 and so on.

    Parameters
    ----------
    entries : sequence of Entry
        Oldest first. Sources that are none of them have left the window.
    tell : callable
        Returns what a smoothed set tells the rows of its sources, given its link to them.
    hear : callable
        Returns the smoothed set, given the filtered one and what later sets tell its rows. Each row
        hears of one later set at most; rows that hear of none keep their filtered values.
    """
    told: dict[int, list[Told[MessageT]]] = {}
    kept = {entry.stamp_ns for entry in entries}
    for entry in reversed(entries):
        smoothed = entry.stored
        if entry.stamp_ns in told:
            smoothed = hear(smoothed, told.pop(entry.stamp_ns))
        yield smoothed
        if entry.link is None or not any(source.stamp_ns in kept for source in entry.sources):
            continue
        message, first = tell(smoothed, entry.link), 0
        for source in entry.sources:
            part = slice(first, first + source.size)
            first += source.size
            if source.stamp_ns in kept:
                told.setdefault(source.stamp_ns, []).append(Told(source.rows, part, message))
