"""Cuts the plots of one radar into slices of time, each sent when its plots are complete.

The delay is estimated from the plots: on arrival, a plot's delay is the time of the radar's latest
message minus the plot's own time.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from .messages import Plot

# Upper bound of plots that wait for the end of their slice or sector; the oldest are dropped first.
MAX_PENDING = 20_000
# A slice is 1/PARTS of a revolution, but at least SHORTEST_NS, because an airport radar turns in a
# second.
PARTS, SHORTEST_NS = 8, 250_000_000
# Largest accepted delay of a plot, for which the first slice waits too, and the time for which the
# maximum delay is remembered.
MAX_DELAY_NS, MEMORY_NS = 2 * 10**9, 60 * 10**9


class SectorReport(NamedTuple):
    """The plots of a sector or a slice of time."""

    stamp_ns: int  # End of the slice, or the time at which the antenna passed the end of the sector
    sector: int | None  # Index from 0, clockwise from north; None for a slice
    times_ns: list[int]  # Times of the plots
    plots: list[Plot]


@dataclass
class RecentMaximum:
    """Maximum of recent values, over one to two spans of time."""

    most: int  # Larger values are ignored
    start: int  # Value that holds until a span has passed
    memory_ns: int  # Length of a span

    def __post_init__(self) -> None:
        self._before, self._now = self.start, 0
        self._since_ns: int | None = None

    @property
    def value(self) -> int:
        """The current maximum."""
        return max(self._before, self._now)

    def add(self, value: int, time_ns: int) -> None:
        """Add a value that was observed at `time_ns`."""
        if self._since_ns is None:
            self._since_ns = time_ns
        if abs(time_ns - self._since_ns) >= self.memory_ns:
            self._before, self._now, self._since_ns = self._now, 0, time_ns
        if value <= self.most:
            self._now = max(self._now, value)


class RevolutionFinder(Protocol):
    """Estimates the rotation period from plots."""

    @property
    def revolution_s(self) -> float:
        """Rotation period, seconds; 0 if unknown."""

    def add(self, azimuth: float, time_ns: int) -> None:
        """Add a plot's azimuth, radians clockwise from north, and its time."""

    def begin_again(self) -> None:
        """Forget the plots because times have gone back, but keep the rotation period."""


@dataclass
class NoRevolutionFinder:
    """A revolution finder for radars whose rotation period remains unknown."""

    revolution_s: float = 0.0

    def add(self, azimuth: float, time_ns: int) -> None:
        """Ignore a plot."""

    def begin_again(self) -> None:
        """Do nothing, because there are no plots to forget."""


@dataclass
class Slicer:
    """Cuts plots into slices by their times alone."""

    # Two messages this far behind the latest show that the times have gone back.
    BACK_NS = 60 * 10**9
    # After this time without plots the radar counts as off, and no empty slices are sent.
    SILENCE_NS = 15 * 10**9
    # Factor on the delay of plots for which a slice waits.
    MARGIN = 1.25

    rotation_s: float  # Rotation period, seconds, until it is estimated from plots; 0 if unknown
    # It counts ``late_plots``, plots that arrived after their slice was sent and go with the next
    # one, and ``overflow``, plots dropped because too many waited.
    counts: Counter[str]
    finder: RevolutionFinder = field(default_factory=NoRevolutionFinder)
    _delay: RecentMaximum = field(init=False)

    def __post_init__(self) -> None:
        self._delay = RecentMaximum(MAX_DELAY_NS, round(MAX_DELAY_NS / self.MARGIN), MEMORY_NS)
        self._pending: list[tuple[int, Plot]] = []
        # Plots with implausible times, which go with the next slice.
        self._aside: list[tuple[int, Plot]] = []
        # End of the last slice sent, the latest time that two messages have reached, and the time
        # of the last message.
        self._sent_ns = 0
        self.latest_ns = 0
        self._last_ns: int | None = None

    @property
    def _width_ns(self) -> int:
        revolution_s = self.finder.revolution_s or self.rotation_s
        return max(SHORTEST_NS, round(revolution_s * 1e9 / PARTS))

    def add(self, plot: Plot, time_ns: int) -> list[SectorReport]:
        """Add a plot, and return the slices that it completes."""
        found = self.advance(time_ns)
        self.finder.add(plot.azimuth, time_ns)
        self._delay.add(max(self.latest_ns - time_ns, 0), self.latest_ns)
        self.counts["late_plots"] += time_ns < self._sent_ns
        self.keep(plot, time_ns)
        return found

    def keep(self, plot: Plot, time_ns: int) -> None:
        """Add a plot without advancing the time, so that no slice is completed."""
        insort(self._pending, (time_ns, plot), key=_time_of)
        if len(self._pending) > MAX_PENDING:
            # Plots far ahead would wait forever and displace all others.
            ahead = self._pending[-1][0] > self.latest_ns + self.SILENCE_NS
            del self._pending[-1 if ahead else 0]
            self.counts["overflow"] += 1

    def keep_aside(self, plot: Plot, time_ns: int) -> None:
        """Add a plot with an implausible time, which goes with the next slice."""
        if len(self._aside) < MAX_PENDING:
            self._aside.append((time_ns, plot))
        else:
            self.counts["overflow"] += 1

    def advance(self, time_ns: int) -> list[SectorReport]:
        """Process the time of a radar's message, and return the slices that it completes."""
        found = self.follow(time_ns)
        return found or self._until(self.latest_ns - round(self.MARGIN * self._delay.value))

    def follow(self, time_ns: int) -> list[SectorReport]:
        """Process the time of a message; return the pending slices if times have gone back.

        A single message with a wrong time has no effect; two of them have.
        """
        last_ns = time_ns if self._last_ns is None else self._last_ns
        self._last_ns = time_ns
        if max(last_ns, time_ns) < self.latest_ns - self.BACK_NS:
            found = self.finish()
            self._sent_ns, self.latest_ns = 0, max(last_ns, time_ns)
            self.finder.begin_again()
            return found
        self.latest_ns = max(self.latest_ns, min(last_ns, time_ns))
        return []

    def take(self) -> list[tuple[int, Plot]]:
        """Remove and return the pending plots, sorted by time."""
        pending, self._pending = self._pending, []
        return pending

    def begin(self, time_ns: int) -> None:
        """Begin slices at a time until which plots have been reported by sector."""
        # After times have gone back, the reports by sector may be of later times.
        if time_ns < self.latest_ns + self.BACK_NS:
            self._sent_ns = max(self._sent_ns, time_ns)

    def finish(self) -> list[SectorReport]:
        """Return the slices of all pending plots.

        The last slice includes plots far ahead of all messages, and the plots kept aside.
        """
        far = bisect_left(self._pending, self.latest_ns + self.SILENCE_NS, key=_time_of)
        ahead, self._pending = self._pending[far:], self._pending[:far]
        found = []
        while self._pending:
            found.append(self._next())
        ahead, self._aside = ahead + self._aside, []
        if ahead and not found:
            self._sent_ns = max(self._sent_ns, self.latest_ns) + 1
            found.append(SectorReport(self._sent_ns, None, [], []))
        for time_ns, plot in ahead:
            found[-1].times_ns.append(time_ns)
            found[-1].plots.append(plot)
        return found

    def _until(self, time_ns: int) -> list[SectorReport]:
        """Return the slices that end by a time.

        A slice without plots is returned too, because the antenna saw nothing there. After a long
        silence slices begin again with the next plot.
        """
        found = []
        while (end_ns := self._end_ns()) is not None and end_ns <= time_ns:
            found.append(self._next())
        return found

    def _end_ns(self) -> int | None:
        """Return the end of the next slice, None if it depends on the next plot."""
        width_ns = self._width_ns
        first_ns = self._pending[0][0] if self._pending else self.latest_ns
        if self._sent_ns and first_ns - self._sent_ns < self.SILENCE_NS:
            return self._sent_ns + width_ns
        if not self._pending:
            return None
        return (max(first_ns, self._sent_ns) // width_ns + 1) * width_ns

    def _next(self) -> SectorReport:
        end_ns = self._end_ns() or self._sent_ns
        count = bisect_left(self._pending, end_ns, key=_time_of)
        taken, self._aside = self._pending[:count] + self._aside, []
        del self._pending[:count]
        self._sent_ns = end_ns
        return SectorReport(end_ns, None, [t for t, _ in taken], [p for _, p in taken])


def _time_of(entry: tuple[int, Plot]) -> int:
    return entry[0]
