"""The messages of one radar to the reports that become clouds.

There are two ways. Where sector crossings come, a report is a sector that the antenna passed, also
if nothing was seen in it: this is how the tracker knows what was missed. Without them it is a
slice of time, see `slices`; the tracker then finds in the plots where the antenna was.
"""

from __future__ import annotations

import math
from bisect import bisect_right, insort
from collections import Counter, deque
from dataclasses import dataclass, field

from .messages import Plot, ServiceMessage
from .slices import MAX_PENDING, Lateness, SectorReport, Slicer, TurnFinder, Unknown

FULL_TURN = 2.0 * math.pi
# Half of the unit of sector crossings: so much before its end a sector counts as passed.
TOLERANCE = 0.5 * FULL_TURN / 2**8
# Crossings are at most so far apart, four to a turn, and so long, seconds; north marks alone are
# none.
LARGEST_STEP, LONGEST_STEP_S = 0.25 * FULL_TURN + TOLERANCE, 15.0
# After so many turns without any the antenna is lost.
TURNS_LOST = 1.5
# `Assembler.hold` that is to be learned: within a quarter of a turn, an eighth at first, and
# remembered for so long.
LEARNED = -1
MEMORY_NS = 60 * 10**9
# No antenna turns faster or slower, seconds.
SHORTEST_TURN_S, LONGEST_TURN_S = 0.3, 60.0


@dataclass
class Assembler:
    """Makes reports of one radar's messages.

    Parameters
    ----------
    sectors : int
        To a turn, where sector crossings come.
    rotation_s : float
        Time of a turn, seconds, as the user knows it; 0 if it is not known. Service messages and
        plots tell, too.
    hold : int
        A sector is reported when the antenna is so many sectors beyond its end, for radars whose
        plots come later than their sector crossings; `LEARNED` for as many as they need.
    finder : TurnFinder
        Of radars without sector crossings.

    Attributes
    ----------
    counts : Counter
        ``late_plots``: plots that came after their sector or slice was reported, and go with the
        next. ``turns_lost``: times at which nothing told for longer than a turn where the antenna
        is. ``overflow``: plots that were too many to keep. ``sectors_bridged``: sectors whose
        crossing did not come.
    by_sector, by_time : int
        Numbers of reports of either way.
    """

    sectors: int = 32
    rotation_s: float = 0.0
    hold: int = 0
    counts: Counter[str] = field(default_factory=Counter)
    finder: TurnFinder = field(default_factory=Unknown)
    by_sector: int = field(init=False, default=0)
    by_time: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self._slicer = Slicer(self.rotation_s, self.counts, self.finder)
        quarter = self.sectors // 4
        self._lateness = Lateness(quarter, max(quarter // 2, 1), MEMORY_NS)
        # Plots of sectors not yet reported, by the number of the sector's end: that, time, plot.
        self._pending: list[tuple[int, int, Plot]] = []
        # Where and when the antenna passed last as a service message tells, NaN if none does. With
        # sector crossings it is counted on over the turns from `_begin`, which else is None.
        self._phase, self._phase_ns = math.nan, 0
        self._begin: tuple[float, int] | None = None
        # Ends of sectors passed, the last one's number, and the times of those not yet reported.
        self._passed = 0
        self._ends_ns: deque[int] = deque()
        self._stamp_ns = self._plot_ns = 0

    @property
    def _width(self) -> float:
        return FULL_TURN / self.sectors

    @property
    def turn_s(self) -> float:
        """Time of a turn, seconds, as crossings or plots tell it or it was given; 0 if unknown."""
        if self._seen_turn_s:
            return self._seen_turn_s
        found_s = self.finder.turn_s
        return found_s if _is_turn(found_s) else self.rotation_s

    @property
    def _seen_turn_s(self) -> float:
        """Time of a turn, seconds, as crossings tell it; 0 if they do not."""
        phase, begin_ns = self._begin or (math.nan, 0)
        turned = self._phase - phase
        if turned >= 0.5 * FULL_TURN:
            seen_s = (self._phase_ns - begin_ns) * 1e-9 * FULL_TURN / turned
            if _is_turn(seen_s):
                return seen_s
        return 0.0

    def add_plot(self, plot: Plot, time_ns: int) -> list[SectorReport]:
        """Take a plot; return what is complete by it."""
        # One plot with a wrong time is no sign that the crossings have ended.
        known_ns, self._plot_ns = min(time_ns, self._plot_ns), time_ns
        lost = self._lost(known_ns) if known_ns > self._phase_ns else []
        if self._begin is None:
            return lost + self._sliced(self._slicer.add(plot, time_ns))
        number = self._keep(plot, time_ns)
        self._lateness.take(max(self._passed + 1 - number, 0), self._phase_ns)
        return []

    def keep_plot(self, plot: Plot, time_ns: int) -> None:
        """Take a plot of a time that is not believed: it goes with what is reported next."""
        if self._begin is None:
            self._slicer.keep_aside(plot, time_ns)
        else:
            self._keep(plot, time_ns)

    def add_service(self, message: ServiceMessage, time_ns: int) -> list[SectorReport]:
        """Take a north mark or a sector crossing; return what is complete by it."""
        if not self.rotation_s and _is_turn(message.rotation_s):
            self.rotation_s = self._slicer.rotation_s = message.rotation_s
        if not math.isfinite(message.azimuth):
            return []
        found = []
        if self._begin is None:
            found = self._sliced(self._slicer.advance(time_ns))
            before = self._phase, self._phase_ns
            self._phase, self._phase_ns = message.azimuth, time_ns
            if not self._crosses(*before):
                return found
            found += self._anchor(*before)
        return found + self._advance(message.azimuth, time_ns)

    def finish(self) -> list[SectorReport]:
        """Return what waits: the end of a recording has come, or the radar is silent."""
        held = [self._close() for _ in range(len(self._ends_ns))]
        for _, own_ns, plot in self._pending:  # of a sector whose end did not come
            self._slicer.keep(plot, own_ns)
        self._pending.clear()
        return held + self._sliced(self._slicer.finish())

    def _sliced(self, found: list[SectorReport]) -> list[SectorReport]:
        self.by_time += len(found)
        self._stamp_ns = found[-1].stamp_ns if found else self._stamp_ns
        return found

    def _crosses(self, before: float, before_ns: int) -> bool:
        """Return whether two service messages are sector crossings, one after the other."""
        step, passed_ns = (self._phase - before) % FULL_TURN, self._phase_ns - before_ns
        return TOLERANCE < step <= LARGEST_STEP and 0 <= passed_ns < LONGEST_STEP_S * 1e9

    def _anchor(self, azimuth: float, time_ns: int) -> list[SectorReport]:
        """Begin to follow the antenna; return the plots of the part of a sector before."""
        # What is ahead of the antenna was seen just now, or a turn ago.
        oldest_ns = time_ns - round(0.5e9 * self.turn_s) if self.turn_s else 0
        self._phase, self._phase_ns = azimuth, time_ns
        self._begin = azimuth, time_ns
        self._passed = math.floor((azimuth + TOLERANCE) / self._width)
        for own_ns, plot in self._slicer.take():
            if own_ns >= oldest_ns and math.remainder(plot.azimuth - azimuth, FULL_TURN) > 0.0:
                self._keep(plot, own_ns)
            else:
                self._slicer.keep(plot, own_ns)
        return self._sliced(self._slicer.finish())

    def _lost(self, time_ns: int) -> list[SectorReport]:
        """Return what is left of the sectors if nothing tells any more where the antenna is."""
        turn_s = self.turn_s or LONGEST_TURN_S
        if self._begin is None or abs(time_ns - self._phase_ns) <= TURNS_LOST * turn_s * 1e9:
            return []
        self.counts["turns_lost"] += 1
        # How the antenna turned before is the best that is known.
        self.rotation_s = self._slicer.rotation_s = self.turn_s
        found = self.finish()
        self._slicer.begin(self._stamp_ns)
        self._phase, self._begin = math.nan, None
        return found

    def _advance(self, azimuth: float, time_ns: int) -> list[SectorReport]:
        """Move the antenna to an azimuth, and return the sectors that are complete by that."""
        found = self._lost(time_ns)
        if self._begin is None:
            self._phase, self._phase_ns = azimuth, time_ns
            return found + self._sliced(self._slicer.advance(time_ns))
        step = self._step(azimuth, time_ns)
        if step <= 0.0:
            return []
        before, before_ns = self._phase, self._phase_ns
        self._phase, self._phase_ns = before + step, time_ns
        last = math.floor((self._phase + TOLERANCE) / self._width)
        self.counts["sectors_bridged"] += max(last - self._passed - 1, 0)
        while self._passed < last:
            self._passed += 1
            part = (self._passed * self._width - before) / step
            # A sector's end may lie before the antenna's position before, by the tolerance.
            self._ends_ns.append(
                before_ns + round(min(max(part, 0.0), 1.0) * (time_ns - before_ns))
            )
        hold = self._lateness.value if self.hold == LEARNED else self.hold
        return [self._close() for _ in range(len(self._ends_ns) - hold)]

    def _step(self, azimuth: float, time_ns: int) -> float:
        """Return how far the antenna has turned, radians."""
        step = (azimuth - self._phase) % FULL_TURN
        # Only a turn that crossings have shown says that the antenna came past here in between: one
        # that is said or was found and is too short would show itself to be right.
        if not (turn_s := self._seen_turn_s):
            return step if step < FULL_TURN - TOLERANCE else 0.0
        expected = (time_ns - self._phase_ns) * 1e-9 / turn_s * FULL_TURN
        return step + round((expected - step) / FULL_TURN) * FULL_TURN

    def _keep(self, plot: Plot, time_ns: int) -> int:
        """Keep a plot for its sector, and return the number of that one's end."""
        if len(self._pending) >= MAX_PENDING:
            del self._pending[0]
            self.counts["overflow"] += 1
        width = FULL_TURN / self.sectors
        ahead = math.remainder(plot.azimuth - self._passed * width, FULL_TURN)
        # A plot at a sector's begin is in it, however its azimuth is rounded.
        number = self._passed + 1 + math.floor(ahead / width + 1e-9)
        insort(self._pending, (number, time_ns, plot), key=_number_of)
        return number

    def _close(self) -> SectorReport:
        """Return the first sector that is not reported yet, and the plots up to its end."""
        number = self._passed - len(self._ends_ns) + 1
        # Sorted, so that many sectors and many plots in one datagram do not take their product.
        count = bisect_right(self._pending, number, key=_number_of)
        taken = self._pending[:count]
        del self._pending[:count]
        self.counts["late_plots"] += sum(entry[0] < number for entry in taken)
        time_ns = self._ends_ns.popleft()
        # A stamp is above that of the one before, unless time went back.
        if 0 <= self._stamp_ns - time_ns < 2 * 10**9:
            time_ns = self._stamp_ns + 1
        self._stamp_ns = time_ns
        self.by_sector += 1
        return SectorReport(
            time_ns,
            (number - 1) % self.sectors,
            [own_ns for _, own_ns, _ in taken],
            [plot for _, _, plot in taken],
        )


def _is_turn(time_s: float) -> bool:
    """Return whether an antenna may turn in this time, seconds."""
    return SHORTEST_TURN_S <= time_s <= LONGEST_TURN_S


def _number_of(entry: tuple[int, int, Plot]) -> int:
    return entry[0]
