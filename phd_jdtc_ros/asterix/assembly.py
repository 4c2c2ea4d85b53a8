"""Groups the messages of one radar into reports, each of which becomes a cloud.

With sector crossings, a report is a sector that the antenna has passed. It is sent without plots
too, because it shows the tracker which detections were missed. Without crossings a report is a
slice of time, sent when its plots are complete, and the tracker estimates the antenna's motion from
the plots. On arrival, a plot's delay is the time of the radar's latest message minus the plot's own
time.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right, insort
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from .messages import FULL_TURN, Plot, ServiceMessage

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


# A sector counts as passed once the azimuth is within TOLERANCE of its end: half the resolution of
# sector-crossing messages, radians.
TOLERANCE = 0.5 * FULL_TURN / 2**8
# Upper bounds between consecutive sector crossings: a quarter of a revolution, and seconds. North
# marks alone are not sector crossings.
LARGEST_PART, LONGEST_STEP_S = 0.25, 15.0
# Value of `Assembler.hold` for which reports are held back for the largest plot delay of the last
# MEMORY_NS, in sectors: an eighth of a revolution at first, a quarter at most.
LEARNED = -1
# A revolution that differs from the mean by more than this share is of another speed.
OTHER_SPEED = 0.1
# Plausible rotation periods, seconds.
SHORTEST_REVOLUTION_S, LONGEST_REVOLUTION_S = 0.3, 60.0


@dataclass
class Assembler:
    """Assembles reports from one radar's messages; `by_sector` and `by_time` count them.

    `counts` has ``late_plots``, plots that arrived after the report of their sector or slice, and
    go with the next; ``revolutions_lost``, how often the antenna's azimuth was lost, after
    `REVOLUTIONS_LOST` revolutions without a sector crossing; ``overflow``, plots dropped because
    too many waited; and ``sectors_bridged``, sectors whose crossing is missing.
    """

    LARGEST_STEP = LARGEST_PART * FULL_TURN + TOLERANCE
    # After this many revolutions without a crossing the antenna's azimuth is unknown.
    REVOLUTIONS_LOST = 1.5

    sectors: int = 32  # Number of sectors per revolution, for radars with sector crossings
    # Rotation period, seconds; 0 until service messages or plots show it.
    rotation_s: float = 0.0
    # Number of sectors for which a report is held back after its sector has ended, because plots
    # may arrive after the sector crossing; `LEARNED` to estimate it.
    hold: int = 0
    counts: Counter[str] = field(default_factory=Counter)
    # Estimates the rotation period of radars without sector crossings.
    finder: RevolutionFinder = field(default_factory=NoRevolutionFinder)
    by_sector: int = field(init=False, default=0)
    by_time: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self._slicer = Slicer(self.rotation_s, self.counts, self.finder)
        quarter = self.sectors // 4
        self._delay = RecentMaximum(quarter, max(quarter // 2, 1), MEMORY_NS)
        # Plots of sectors that are not reported yet: number of the sector's end, time, plot.
        self._pending: list[tuple[int, int, Plot]] = []
        # Azimuth and time of the latest service message, NaN if there is none. With sector
        # crossings the azimuth is accumulated over the revolutions since `_begin`, which is None
        # otherwise.
        self._phase, self._phase_ns = math.nan, 0
        self._begin: tuple[float, int] | None = None
        # Azimuths and times of the latest ends of revolutions, and the parts that have ended: when,
        # and their rotation periods.
        self._turns: list[tuple[float, int]] = []
        self._ended: list[tuple[int, float]] = []
        # Number of the last sector end passed, and the times of the ends that are not reported yet.
        self._passed = 0
        self._ends_ns: deque[int] = deque()
        self._stamp_ns = self._plot_ns = 0

    @property
    def _width(self) -> float:
        return FULL_TURN / self.sectors

    @property
    def has_sectors(self) -> bool:
        """Whether reports have been sectors, or will be."""
        return self.by_sector > 0 or self._begin is not None

    @property
    def revolution_s(self) -> float:
        """Rotation period, s, by crossings, else plots, else the messages; 0 if unknown."""
        if self._measured_revolution_s:
            return self._measured_revolution_s
        found_s = self.finder.revolution_s
        return found_s if _is_revolution(found_s) else self.rotation_s

    @property
    def longest_revolution_s(self) -> float:
        """The longest of the rotation periods that the antenna has had, s; 0 if unknown."""
        return max((period_s for _, period_s in self.parts), default=self.revolution_s)

    @property
    def parts(self) -> list[tuple[int, float]]:
        """When each part of another rotation period has ended, by its crossings, and its period.

        Times are nanoseconds since the epoch, and periods seconds.
        """
        found: list[tuple[int, float]] = []
        for end_ns, period_s in [*self._ended, (self._phase_ns, self._measured_revolution_s)]:
            if found and period_s and not _differ(found[-1][1], period_s):
                found.pop()
            found += [(end_ns, period_s)] if period_s else []
        return found

    @property
    def _measured_revolution_s(self) -> float:
        """Rotation period by sector crossings, seconds; 0 if unknown."""
        begin = self._begin or (math.nan, 0)
        if self._phase - begin[0] >= 0.5 * FULL_TURN:
            revolution_s = _period_s(begin, (self._phase, self._phase_ns))
            if _is_revolution(revolution_s):
                return revolution_s
        return 0.0

    def add_plot(self, plot: Plot, time_ns: int) -> list[SectorReport]:
        """Add a plot, and return the reports that it completes."""
        # A single plot with a wrong time does not show that the crossings have ended.
        known_ns, self._plot_ns = min(time_ns, self._plot_ns), time_ns
        lost: list[SectorReport] = []
        if self._begin is not None and known_ns > self._phase_ns:
            self._slicer.follow(known_ns)
            lost = self._end_if_lost(known_ns)
        if self._begin is None:
            return lost + self._record_slices(self._slicer.add(plot, time_ns))
        self._slicer.follow(time_ns)
        number = self._keep(plot, time_ns)
        self._delay.add(max(self._last_end(self._phase) + 1 - number, 0), self._phase_ns)
        return []

    def keep_plot(self, plot: Plot, time_ns: int) -> None:
        """Add a plot with an implausible time, which goes with the next report."""
        if self._begin is None:
            self._slicer.keep_aside(plot, time_ns)
        else:
            self._keep(plot, time_ns)

    def add_service(self, message: ServiceMessage, time_ns: int) -> list[SectorReport]:
        """Process a north mark or a sector crossing, and return the reports that it completes."""
        if not self.rotation_s and _is_revolution(message.rotation_s):
            self.rotation_s = self._slicer.rotation_s = message.rotation_s
        if not math.isfinite(message.azimuth):
            return []
        found = []
        if self._begin is None:
            found = self._record_slices(self._slicer.advance(time_ns))
            before = self._phase, self._phase_ns
            self._phase, self._phase_ns = message.azimuth, time_ns
            if not self._crosses(*before):
                return found
            found += self._anchor(*before)
        else:
            self._slicer.follow(time_ns)
        return found + self._advance(message.azimuth, time_ns)

    def finish(self) -> list[SectorReport]:
        """Return all pending reports at the end of a recording or when the radar is silent."""
        if self._begin is None:
            return self._record_slices(self._slicer.finish())
        sectors = self._close_all()
        # The next crossing would come by this time.
        step_s = min(LARGEST_PART * (self.revolution_s or LONGEST_REVOLUTION_S), LONGEST_STEP_S)
        end_ns = self._phase_ns + round(step_s * 1e9)
        outside: list[tuple[int, int, Plot]] = []
        if self._slicer.latest_ns > end_ns:  # The crossings have ended
            outside = [entry for entry in self._pending if entry[1] > end_ns]
            self._pending = [entry for entry in self._pending if entry[1] <= end_ns]
        if self._pending:
            self._pass_pending(end_ns)
            sectors += self._close_all()
            for _, own_ns, plot in self._pending:  # Wrong azimuths put it ahead of the antenna
                sectors[-1].times_ns.append(own_ns)
                sectors[-1].plots.append(plot)
            self._pending.clear()
        self._slicer.begin(self._stamp_ns)
        for _, own_ns, plot in outside:
            self._slicer.keep(plot, own_ns)
        return sectors + self._record_slices(self._slicer.finish())

    def _pass_pending(self, end_ns: int) -> None:
        """Count the sectors of the pending plots as passed, though their crossings are missing.

        The latest plot before `end_ns` shows how far the antenna has turned.
        """
        farthest = self._passed + 1 + int(LARGEST_PART * self.sectors)
        ahead = [
            (own_ns, number)
            for number, own_ns, _ in self._pending
            if self._passed < number <= farthest and own_ns <= end_ns
        ]
        time_ns, last = max(ahead, default=(self._phase_ns, self._passed + 1))
        self._pass(last, last * self._width - self._phase, max(time_ns, self._phase_ns))

    def _record_slices(self, found: list[SectorReport]) -> list[SectorReport]:
        self.by_time += len(found)
        self._stamp_ns = found[-1].stamp_ns if found else self._stamp_ns
        return found

    def _crosses(self, before: float, before_ns: int) -> bool:
        """Return whether the last two service messages are consecutive sector crossings."""
        step, passed_ns = (self._phase - before) % FULL_TURN, self._phase_ns - before_ns
        return TOLERANCE < step <= self.LARGEST_STEP and 0 <= passed_ns < LONGEST_STEP_S * 1e9

    def _anchor(self, azimuth: float, time_ns: int) -> list[SectorReport]:
        """Begin to follow the antenna, and return the plots of the incomplete sector before."""
        # Plots ahead of the antenna are recent, or from the previous revolution.
        oldest_ns = time_ns - round(0.5e9 * self.revolution_s) if self.revolution_s else 0
        self._phase, self._phase_ns = azimuth, time_ns
        self._begin = azimuth, time_ns
        self._turns = [self._begin]
        self._passed = self._last_end(azimuth)
        for own_ns, plot in self._slicer.take():
            if own_ns >= oldest_ns and math.remainder(plot.azimuth - azimuth, FULL_TURN) > 0.0:
                self._keep(plot, own_ns)
            else:
                self._slicer.keep(plot, own_ns)
        return self._record_slices(self._slicer.finish())

    def _end_if_lost(self, time_ns: int) -> list[SectorReport]:
        """Return the pending reports if the antenna's azimuth has become unknown, else none."""
        revolution_s = self.revolution_s or LONGEST_REVOLUTION_S
        if (
            self._begin is None
            or abs(time_ns - self._phase_ns) <= self.REVOLUTIONS_LOST * revolution_s * 1e9
        ):
            return []
        self.counts["revolutions_lost"] += 1
        # Keep the last known rotation period.
        self.rotation_s = self._slicer.rotation_s = self.revolution_s
        self._ended.append((self._phase_ns, self._measured_revolution_s))
        found = self.finish()
        self._phase, self._begin = math.nan, None
        return found

    def _advance(self, azimuth: float, time_ns: int) -> list[SectorReport]:
        """Move the antenna to an azimuth, and return the sectors that this completes."""
        found = self._end_if_lost(time_ns)
        if self._begin is None:
            self._phase, self._phase_ns = azimuth, time_ns
            return found
        step = self._step(azimuth, time_ns)
        if step <= 0.0:
            return []
        last = self._last_end(self._phase + step)
        self.counts["sectors_bridged"] += max(last - self._passed - 1, 0)
        self._pass(last, step, time_ns)
        self._phase, self._phase_ns = self._phase + step, time_ns
        self._note_speed()
        hold = self._delay.value if self.hold == LEARNED else self.hold
        return [self._close() for _ in range(len(self._ends_ns) - hold)]

    def _note_speed(self) -> None:
        """Begin the mean of the rotation period again where two revolutions have another one.

        The first of them may still be of both speeds, and is left out.
        """
        turns = self._turns
        if self._phase - turns[-1][0] < FULL_TURN:
            return
        turns.append((self._phase, self._phase_ns))
        if len(turns) > 4:
            mean_s = _period_s(turns[0], turns[-4])
            before_s, last_s = _period_s(turns[-3], turns[-2]), _period_s(turns[-2], turns[-1])
            if _differ(mean_s, before_s) and _differ(mean_s, last_s):
                if not _differ(before_s, last_s):
                    self._ended.append((turns[-4][1], mean_s))
                    self._begin, self._turns = turns[-2], turns[-2:]
            else:
                del turns[1:-4]

    def _last_end(self, azimuth: float) -> int:
        """Return the number of the last sector end that the antenna has passed at an azimuth."""
        return math.floor((azimuth + TOLERANCE) / self._width)

    def _pass(self, last: int, step: float, time_ns: int) -> None:
        """Count the ends up to number `last` as passed, in a step that ended at a time."""
        while self._passed < last:
            self._passed += 1
            part = (self._passed * self._width - self._phase) / step
            # The tolerance may put a sector's end before the antenna's previous azimuth.
            passed_ns = round(min(max(part, 0.0), 1.0) * (time_ns - self._phase_ns))
            self._ends_ns.append(self._phase_ns + passed_ns)

    def _step(self, azimuth: float, time_ns: int) -> float:
        """Return the angle by which the antenna has turned, radians."""
        step = (azimuth - self._phase) % FULL_TURN
        # Whole revolutions are added only if crossings have measured the rotation period. A
        # configured or estimated period that is too short would add revolutions and so confirm
        # itself.
        if not (revolution_s := self._measured_revolution_s):
            # A message that is overtaken by a later one would add nearly a revolution.
            late = time_ns < self._phase_ns
            return step if step < FULL_TURN - TOLERANCE and not late else 0.0
        expected = (time_ns - self._phase_ns) * 1e-9 / revolution_s * FULL_TURN
        return step + round((expected - step) / FULL_TURN) * FULL_TURN

    def _keep(self, plot: Plot, time_ns: int) -> int:
        """Keep a plot for its sector, and return the number of the sector's end."""
        if len(self._pending) >= MAX_PENDING:
            del self._pending[0]
            self.counts["overflow"] += 1
        ahead = math.remainder(plot.azimuth - self._passed * self._width, FULL_TURN)
        # The tolerance assigns a plot at the beginning of a sector to it despite rounding.
        number = self._passed + 1 + math.floor(ahead / self._width + 1e-9)
        insort(self._pending, (number, time_ns, plot), key=_number_of)
        return number

    def _close_all(self) -> list[SectorReport]:
        return [self._close() for _ in range(len(self._ends_ns))]

    def _close(self) -> SectorReport:
        """Return the first sector that is not reported yet, with the plots up to its end."""
        number = self._passed - len(self._ends_ns) + 1
        # The pending plots are sorted, so that the cost is not the product of sectors and plots.
        count = bisect_right(self._pending, number, key=_number_of)
        plots = self._pending[:count]
        del self._pending[:count]
        self.counts["late_plots"] += sum(entry[0] < number for entry in plots)
        time_ns = self._ends_ns.popleft()
        # Stamps increase strictly, unless time has gone back.
        if 0 <= self._stamp_ns - time_ns < 2 * 10**9:
            time_ns = self._stamp_ns + 1
        self._stamp_ns = time_ns
        self.by_sector += 1
        return SectorReport(
            time_ns,
            (number - 1) % self.sectors,
            [own_ns for _, own_ns, _ in plots],
            [plot for _, _, plot in plots],
        )


def _is_revolution(time_s: float) -> bool:
    """Return whether a rotation period is plausible, seconds."""
    return SHORTEST_REVOLUTION_S <= time_s <= LONGEST_REVOLUTION_S


def _period_s(begin: tuple[float, int], end: tuple[float, int]) -> float:
    """Return the rotation period, seconds, by two azimuths with their times."""
    return (end[1] - begin[1]) * 1e-9 * FULL_TURN / (end[0] - begin[0])


def _differ(one_s: float, other_s: float) -> bool:
    return abs(other_s / one_s - 1.0) > OTHER_SPEED if one_s else True


def _number_of(entry: tuple[int, int, Plot]) -> int:
    return entry[0]
