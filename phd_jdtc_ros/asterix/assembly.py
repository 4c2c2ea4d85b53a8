# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The plots of one radar to sectors, each complete when the antenna has passed its end.

Where the antenna is follows from north marks and sector crossings, or from the plots themselves if
the radar sends none. A sector that the antenna passed is reported even if nothing was seen in it:
this is how the tracker knows what was missed.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import NamedTuple

from .messages import Plot, ServiceMessage

FULL_TURN = 2.0 * math.pi
# Half of the unit of sector crossings: so much before its end a sector counts as passed.
TOLERANCE = 0.5 * FULL_TURN / 2**8
# After so many turns without north marks and sector crossings the plots tell where the antenna is;
# after so many without anything the turns are lost.
TURNS_WITHOUT, TURNS_LOST = 2.0, 1.5
# Plots that wait for their sector's end. More are lost, the oldest first.
MAX_PENDING = 20_000
# No plot is so late: what is older says that the times have gone back.
BACK_NS = 60 * 10**9


class SectorReport(NamedTuple):
    """The plots of a sector.

    Parameters
    ----------
    stamp_ns : int
        When the antenna passed the sector's end.
    sector : int or None
        Counted clockwise from north, from 0; None if the antenna's position is not known.
    times_ns : list of int
        Of the plots.
    plots : list of Plot
    """

    stamp_ns: int
    sector: int | None
    times_ns: list[int]
    plots: list[Plot]


@dataclass
class Assembler:
    """Makes sectors of one radar's messages.

    Parameters
    ----------
    sectors : int
        To a turn.
    rotation_s : float
        Time of a turn, seconds; 0 if it is not known. Service messages may tell.
    hold : int
        A sector is reported when the antenna is so many sectors beyond its end, for radars whose
        plots come later than their sector crossings.
    period_s : float
        Of the reports of a radar of which nothing tells where its antenna is.

    Attributes
    ----------
    counts : Counter
        ``before_start``: plots before the first known position of the antenna. ``late_plots``:
        plots that came after their sector was reported, and go with the next. ``turns_lost``:
        times at which nothing came for longer than a turn. ``overflow``: plots that were too many
        to keep. ``sectors_bridged``: sectors whose crossing did not come.
    """

    sectors: int = 32
    rotation_s: float = 0.0
    hold: int = 0
    period_s: float = 1.0
    counts: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self._pending: deque[tuple[int, Plot]] = deque()
        # The azimuth that the antenna passed last, counted on over the turns, and when.
        self._phase: float | None = None
        self._phase_ns = 0
        # Where and when it was first, without a gap since.
        self._begin: tuple[float, int] = (0.0, 0)
        # Ends of sectors passed, the last one's number, and the times of those not yet reported.
        self._passed = 0
        self._ends_ns: deque[int] = deque()
        self._service_ns: int | None = None
        self._first_ns: int | None = None
        self._stamp_ns = 0

    @property
    def _width(self) -> float:
        return FULL_TURN / self.sectors

    def add_plot(self, plot: Plot, time_ns: int) -> list[SectorReport]:
        """Take a plot; return the sectors that are complete by it, which is rare."""
        if self._first_ns is None or time_ns < max(self._first_ns, self._stamp_ns) - BACK_NS:
            self._first_ns, self._stamp_ns = time_ns, 0
        self._pending.append((time_ns, plot))
        if len(self._pending) > MAX_PENDING:
            self._pending.popleft()
            self.counts["overflow"] += 1
        if self._served(time_ns):
            return []
        if not self.rotation_s:
            return self._by_time(time_ns)
        return self._advance(plot.azimuth, time_ns, behind=self._width)

    def add_service(self, message: ServiceMessage, time_ns: int) -> list[SectorReport]:
        """Take a north mark or a sector crossing; return the sectors that are complete by it."""
        if not self.rotation_s and message.rotation_s > 0.0:
            self.rotation_s = message.rotation_s
        if not math.isfinite(message.azimuth):
            return []
        first = self._service_ns is None
        self._service_ns = time_ns
        if first:
            # What the plots told of the antenna is less exact.
            self._phase = None
        return self._advance(message.azimuth, time_ns)

    @property
    def observed_turn_s(self) -> float:
        """Mean time of a turn since the antenna is followed; `rotation_s` before half a turn."""
        phase, begin_ns = self._begin
        turned = 0.0 if self._phase is None else self._phase - phase
        if turned < 0.5 * FULL_TURN:
            return self.rotation_s
        return (self._phase_ns - begin_ns) * 1e-9 * FULL_TURN / turned

    def finish(self) -> list[SectorReport]:
        """Return what is left at the end of a recording if the sectors are not known."""
        if self._phase is None and self._service_ns is None and self._pending:
            return [self._all(self._pending[-1][0])]
        self.counts["after_end"] += len(self._pending)
        self._pending.clear()
        return []

    def _served(self, time_ns: int) -> bool:
        """Return whether service messages tell where the antenna is, or may soon do so."""
        since_ns = self._first_ns if self._service_ns is None else self._service_ns
        turn_s = self.rotation_s or (self.period_s if self._service_ns is None else 60.0)
        wait_s = turn_s * (TURNS_WITHOUT if self.rotation_s else 1.0)
        waits = since_ns is not None and time_ns - since_ns < wait_s * 1e9
        return waits and (self._service_ns is not None or self._phase is None)

    def _by_time(self, time_ns: int) -> list[SectorReport]:
        """Return what came in a period."""
        if time_ns - max(self._stamp_ns, self._first_ns or 0) < self.period_s * 1e9:
            return []
        return [self._all(time_ns)]

    def _all(self, time_ns: int) -> SectorReport:
        pending, self._pending = self._pending, deque()
        return self._report(time_ns, None, list(pending))

    def _advance(self, azimuth: float, time_ns: int, behind: float = 0.0) -> list[SectorReport]:
        """Move the antenna to an azimuth, and return the sectors whose end it passed.

        Those within `behind` of it are not reported yet, because other plots of them may follow.
        """
        if self._phase is None:
            self._anchor(azimuth, time_ns, behind)
            return []
        step = self._step(azimuth, time_ns)
        if step is None:
            self.counts["turns_lost"] += 1
            self._anchor(azimuth, time_ns, behind)
            return []
        if step <= 0.0:
            return []
        before, before_ns = self._phase, self._phase_ns
        self._phase, self._phase_ns = before + step, time_ns
        last = math.floor((self._phase + TOLERANCE - behind) / self._width)
        if not behind:
            self.counts["sectors_bridged"] += max(last - self._passed - 1, 0)
        reports = []
        while self._passed < last:
            self._passed += 1
            part = (self._passed * self._width - before) / step
            # A sector's end may lie before the antenna's position before, by the tolerance.
            self._ends_ns.append(
                before_ns + round(min(max(part, 0.0), 1.0) * (time_ns - before_ns))
            )
            if len(self._ends_ns) > self.hold:
                reports.append(self._close(self._passed - self.hold))
        return reports

    def _anchor(self, azimuth: float, time_ns: int, behind: float) -> None:
        """Begin with the antenna at an azimuth; a part of its sector is not known."""
        # What is ahead of the antenna was seen just now, or a turn ago.
        oldest_ns = time_ns - round(0.5e9 * self.rotation_s) if self.rotation_s else 0
        kept = [
            (own_ns, plot)
            for own_ns, plot in self._pending
            if own_ns >= oldest_ns and self._ahead(plot.azimuth, azimuth - behind) > 0.0
        ]
        self.counts["before_start"] += len(self._pending) - len(kept)
        self._pending = deque(kept)
        self._phase, self._phase_ns = azimuth, time_ns
        self._begin = azimuth, time_ns
        self._passed = math.floor((azimuth + TOLERANCE - behind) / self._width)
        self._ends_ns.clear()

    def _step(self, azimuth: float, time_ns: int) -> float | None:
        """Return how far the antenna has turned, radians; None if it may be anything."""
        before = self._phase or 0.0
        step = (azimuth - before) % FULL_TURN
        if not self.rotation_s:
            return step if step < FULL_TURN - TOLERANCE else 0.0
        expected = (time_ns - self._phase_ns) * 1e-9 / self.rotation_s * FULL_TURN
        if abs(expected) > TURNS_LOST * FULL_TURN:
            return None
        return step + round((expected - step) / FULL_TURN) * FULL_TURN

    @staticmethod
    def _ahead(azimuth: float, of: float) -> float:
        """Return how far an azimuth is clockwise of another, in [-pi, pi]."""
        return math.remainder(azimuth - of, FULL_TURN)

    def _close(self, number: int) -> SectorReport:
        """Return the sector with the end of this number, and the plots up to there."""
        end = number * self._width
        taken: list[tuple[int, Plot]] = []
        kept: deque[tuple[int, Plot]] = deque()
        for entry in self._pending:
            ahead = self._ahead(entry[1].azimuth, end)
            if ahead >= 0.0:
                kept.append(entry)
            else:
                taken.append(entry)
                self.counts["late_plots"] += ahead < -self._width - 1e-9
        self._pending = kept
        return self._report(self._ends_ns.popleft(), (number - 1) % self.sectors, taken)

    def _report(
        self, time_ns: int, sector: int | None, taken: list[tuple[int, Plot]]
    ) -> SectorReport:
        """Return a report whose stamp is above that of the one before, unless time went back."""
        if 0 <= self._stamp_ns - time_ns < 10**9:
            time_ns = self._stamp_ns + 1
        self._stamp_ns = time_ns
        return SectorReport(time_ns, sector, [entry[0] for entry in taken], [e[1] for e in taken])
