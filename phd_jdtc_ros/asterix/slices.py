"""The plots of one radar to slices of time, each complete when no plot of it is expected any more.

How late plots come is learned from the plots: from how far the radar's latest message is ahead of
a plot's own time when the plot comes.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from .messages import Plot

# Plots that wait for their slice's or sector's end. More are lost, the oldest first.
MAX_PENDING = 20_000
# Two messages that are so much behind the latest say that the times have gone back.
BACK_NS = 60 * 10**9
# A slice is an eighth of a turn; and no shorter than this, as an antenna on an airport turns in a
# second.
PARTS, SHORTEST_NS = 8, 250_000_000
# After a longer time without plots the radar was off, and no empty slices are sent for it.
SILENCE_NS = 15 * 10**9
# How late plots may be: at most, as assumed at first, and how long that is remembered.
LATEST_NS, MEMORY_NS = 2 * 10**9, 60 * 10**9
# A slice waits for so much more than plots were late.
MARGIN = 1.25


class SectorReport(NamedTuple):
    """The plots of a sector, or of a slice of time.

    Parameters
    ----------
    stamp_ns : int
        The slice's end, or when the antenna passed the sector's.
    sector : int or None
        Counted clockwise from north, from 0; None of a slice.
    times_ns : list of int
        Of the plots.
    """

    stamp_ns: int
    sector: int | None
    times_ns: list[int]
    plots: list[Plot]


@dataclass
class Lateness:
    """The largest of recent values, of the last one to two spans of time.

    Parameters
    ----------
    most : int
        Larger values are not believed.
    start : int
        What counts until a span has passed.
    memory_ns : int
        The length of a span.
    """

    most: int
    start: int
    memory_ns: int

    def __post_init__(self) -> None:
        self._before, self._now = self.start, 0
        self._since_ns: int | None = None

    @property
    def value(self) -> int:
        """The largest."""
        return max(self._before, self._now)

    def take(self, value: int, time_ns: int) -> None:
        """Take a value of a time."""
        if self._since_ns is None:
            self._since_ns = time_ns
        if abs(time_ns - self._since_ns) >= self.memory_ns:
            self._before, self._now, self._since_ns = self._now, 0, time_ns
        if value <= self.most:
            self._now = max(self._now, value)


class TurnFinder(Protocol):
    """What finds the time of a turn in plots."""

    @property
    def turn_s(self) -> float:
        """Time of a turn, seconds; 0 if it is not known."""

    def add(self, azimuth: float, time_ns: int) -> None:
        """Take a plot's azimuth, radians clockwise from north, and its time."""

    def begin_again(self) -> None:
        """Forget the plots, as times have gone back, but not the turn."""


@dataclass
class Unknown:
    """Finds nothing."""

    turn_s: float = 0.0

    def add(self, azimuth: float, time_ns: int) -> None:
        """Leave a plot alone."""

    def begin_again(self) -> None:
        """There is nothing to forget."""


@dataclass
class Slicer:
    """Cuts plots by their times alone.

    Parameters
    ----------
    rotation_s : float
        Time of a turn, seconds, until the plots tell it; 0 if it is not known.
    counts : Counter
        Gains ``late_plots``, plots that came after their slice was sent and go with the next one,
        and ``overflow``, plots that were too many to keep.
    """

    rotation_s: float
    counts: Counter[str]
    finder: TurnFinder = field(default_factory=Unknown)
    _lateness: Lateness = field(init=False)

    def __post_init__(self) -> None:
        self._lateness = Lateness(LATEST_NS, round(LATEST_NS / MARGIN), MEMORY_NS)
        self._pending: list[tuple[int, Plot]] = []
        # Plots of times that are not believed, which go with the next slice.
        self._aside: list[tuple[int, Plot]] = []
        # The end of the last slice sent, the latest time that two messages have reached, and the
        # time of the last message.
        self._sent_ns = 0
        self._latest_ns = 0
        self._last_ns: int | None = None

    @property
    def _width_ns(self) -> int:
        turn_s = self.finder.turn_s or self.rotation_s
        return max(SHORTEST_NS, round(turn_s * 1e9 / PARTS))

    def add(self, plot: Plot, time_ns: int) -> list[SectorReport]:
        """Take a plot; return the slices that are complete by it."""
        found = self.advance(time_ns)
        self.finder.add(plot.azimuth, time_ns)
        self._lateness.take(max(self._latest_ns - time_ns, 0), self._latest_ns)
        self.counts["late_plots"] += time_ns < self._sent_ns
        self.keep(plot, time_ns)
        return found

    def keep(self, plot: Plot, time_ns: int) -> None:
        """Take a plot that came before."""
        insort(self._pending, (time_ns, plot), key=_time_of)
        if len(self._pending) > MAX_PENDING:
            # Those of times far ahead would wait for ever, and take the place of all others.
            ahead = self._pending[-1][0] > self._latest_ns + SILENCE_NS
            del self._pending[-1 if ahead else 0]
            self.counts["overflow"] += 1

    def keep_aside(self, plot: Plot, time_ns: int) -> None:
        """Take a plot whose time says nothing of slices."""
        if len(self._aside) < MAX_PENDING:
            self._aside.append((time_ns, plot))
        else:
            self.counts["overflow"] += 1

    def advance(self, time_ns: int) -> list[SectorReport]:
        """Take the time of a message of the radar; return the slices that are complete by it.

        One message with a wrong time moves nothing; two of them do.
        """
        last_ns = time_ns if self._last_ns is None else self._last_ns
        self._last_ns = time_ns
        if max(last_ns, time_ns) < self._latest_ns - BACK_NS:
            found = self.finish()
            self._sent_ns, self._latest_ns = 0, max(last_ns, time_ns)
            self.finder.begin_again()
            return found
        self._latest_ns = max(self._latest_ns, min(last_ns, time_ns))
        return self._until(self._latest_ns - round(MARGIN * self._lateness.value))

    def take(self) -> list[tuple[int, Plot]]:
        """Give away the plots that wait, by time."""
        pending, self._pending = self._pending, []
        return pending

    def begin(self, time_ns: int) -> None:
        """Begin slices at a time up to which plots have been reported otherwise."""
        self._sent_ns = max(self._sent_ns, time_ns)

    def finish(self) -> list[SectorReport]:
        """Return the slices of all plots that wait.

        Plots of times far ahead, which nothing else has reached, and those that were kept aside go
        with the last one.
        """
        far = bisect_left(self._pending, self._latest_ns + SILENCE_NS, key=_time_of)
        ahead, self._pending = self._pending[far:], self._pending[:far]
        found = []
        while self._pending:
            found.append(self._next())
        ahead, self._aside = ahead + self._aside, []
        if ahead and not found:
            self._sent_ns = max(self._sent_ns, self._latest_ns) + 1
            found.append(SectorReport(self._sent_ns, None, [], []))
        for time_ns, plot in ahead:
            found[-1].times_ns.append(time_ns)
            found[-1].plots.append(plot)
        return found

    def _until(self, time_ns: int) -> list[SectorReport]:
        """Return the slices that end by a time.

        One without plots is a slice too: there the antenna saw nothing. After a long silence
        slices begin again with the next plot.
        """
        found = []
        while (end_ns := self._end_ns()) is not None and end_ns <= time_ns:
            found.append(self._next())
        return found

    def _end_ns(self) -> int | None:
        """Return when the next slice ends; None if that is not known before the next plot."""
        width_ns = self._width_ns
        first_ns = self._pending[0][0] if self._pending else self._latest_ns
        if self._sent_ns and first_ns - self._sent_ns < SILENCE_NS:
            return self._sent_ns + width_ns
        if not self._pending:
            return None
        return (max(first_ns, self._sent_ns) // width_ns + 1) * width_ns

    def _next(self) -> SectorReport:
        """Return the next slice."""
        end_ns = self._end_ns() or self._sent_ns
        count = bisect_left(self._pending, end_ns, key=_time_of)
        taken, self._aside = self._pending[:count] + self._aside, []
        del self._pending[:count]
        self._sent_ns = end_ns
        return SectorReport(end_ns, None, [t for t, _ in taken], [p for _, p in taken])


def _time_of(entry: tuple[int, Plot]) -> int:
    return entry[0]
