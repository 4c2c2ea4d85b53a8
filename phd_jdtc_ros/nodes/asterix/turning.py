# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The time of a turn of an antenna, from the plots of a radar that sends no sector crossings."""

from __future__ import annotations

import cmath
import math

import numpy as np

from phd_jdtc_ros.core.tuning.rotation import LEAST_COHERENCE, LEAST_TURNS, coherence
from phd_jdtc_ros.core.types import FULL_TURN

# Plots of so long, and so many at least, are looked at first; of twice as long, and so on, up to
# the longest, if they do not tell the turn.
FIRST_NS, LONGEST_NS = 60 * 10**9, 960 * 10**9
LEAST_PLOTS, MOST_PLOTS = 60, 3000
# Turns may differ in length, so the phase is followed over so many seconds at a time only. Those
# in which azimuths go best with the times tell: long ones where turns are long, and short ones
# where an antenna wanders.
BLOCKS_S = (12.0, 24.0, 48.0)
# No antenna turns faster, seconds.
SHORTEST_S = 0.5
# A phase is the mean over so long and so many plots.
SPAN_NS, LEAST_OF_SPAN = 5 * 10**9, 12
# Over a gap of so many turns a phase is not followed.
MOST_TURNS = 30.0
# After so many spans in which azimuths do not go with the times the turn is another one.
MOST_ASTRAY = 12


class PlotTurns:
    """Finds the turn in the first minute, and makes it more exact as long as plots come.

    The phase of the plots against the first estimate is followed from span to span, and a line
    through all of them tells the mean turn, also of an antenna that wind slows down now and then.
    """

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        """Know nothing."""
        self._first: list[tuple[int, float]] = []
        self._wait_ns = FIRST_NS
        self._coarse_s = 0.0
        # The span under way: its zero, and the sums of times, ns, and of phases of its plots.
        self._span: tuple[int, int, complex, int] = (0, 0, 0j, 0)
        self._astray = 0
        # Time and phase of the last span; number and means of those since a gap; and sums of the
        # squares and products of what all differ from these means.
        self._last: tuple[float, float] | None = None
        self._count, self._mean_s, self._mean = 0, 0.0, 0.0
        self._square = self._product = 0.0

    @property
    def turn_s(self) -> float:
        """Mean time of a turn, seconds; 0 if it is not known."""
        if not self._coarse_s:
            return 0.0
        # The phase falls behind where turns are longer.
        return 1.0 / (1.0 / self._coarse_s + self._slope / FULL_TURN)

    @property
    def _slope(self) -> float:
        """Of the line through the phases, radians per second."""
        return self._product / self._square if self._square else 0.0

    def add(self, azimuth: float, time_ns: int) -> None:
        """Take a plot's azimuth, radians clockwise from north, and its time."""
        if self._coarse_s:
            self._refine(azimuth, time_ns)
            return
        if self._first and not 0 <= time_ns - self._first[0][0] < 4 * self._wait_ns:
            self._first.clear()
        self._first.append((time_ns, azimuth))
        if len(self._first) >= LEAST_PLOTS and time_ns - self._first[0][0] >= self._wait_ns:
            self.find()

    def find(self) -> None:
        """Find the turn in the plots so far, if it is not known yet."""
        first, self._first = self._first, []
        if self._coarse_s or not first:
            return
        self._coarse_s = _turn_s(first[:: 1 + len(first) // MOST_PLOTS])
        if not self._coarse_s:
            self._wait_ns = min(2 * self._wait_ns, LONGEST_NS)
            return
        for time_ns, azimuth in sorted(first):
            self._refine(azimuth, time_ns)

    def _refine(self, azimuth: float, time_ns: int) -> None:
        zero_ns, time, total, count = self._span
        if count and not 0 <= time_ns - zero_ns < 60 * SPAN_NS:
            count = 0
        if not count:
            zero_ns, time, total = time_ns, 0, 0j
        turned = time_ns % round(self._coarse_s * 1e9) / round(self._coarse_s * 1e9)
        total += cmath.exp(1j * (azimuth - FULL_TURN * turned))
        time, count = time + time_ns - zero_ns, count + 1
        if count >= LEAST_OF_SPAN and time_ns - zero_ns >= SPAN_NS:
            self._astray = 0 if abs(total) >= LEAST_COHERENCE * count else self._astray + 1
            if self._astray > MOST_ASTRAY:
                self._begin()
                return
            if not self._astray:
                self._follow(zero_ns * 1e-9 + time * 1e-9 / count, cmath.phase(total))
            count = 0
        self._span = zero_ns, time, total, count

    def _follow(self, time_s: float, phase: float) -> None:
        """Take the mean phase of a span into account."""
        if self._last is None or not 0.0 < time_s - self._last[0] < MOST_TURNS * self._coarse_s:
            self._count, self._mean_s, self._mean = 0, time_s, phase
        else:
            due = self._last[1] + (time_s - self._last[0]) * self._slope
            phase = due + math.remainder(phase - due, FULL_TURN)
        self._last = time_s, phase
        self._count += 1
        off_s, off = time_s - self._mean_s, phase - self._mean
        self._mean_s += off_s / self._count
        self._mean += off / self._count
        self._square += off_s * (time_s - self._mean_s)
        self._product += off_s * (phase - self._mean)


def _turn_s(plots: list[tuple[int, float]]) -> float:
    """Return the time of a turn in which azimuths go best with the times; 0 if they do not."""
    time_s = np.array([time_ns - plots[0][0] for time_ns, _ in plots]) * 1e-9
    azimuth = np.array([azimuth for _, azimuth in plots])
    best, found_s = LEAST_COHERENCE, 0.0
    for block_s in BLOCKS_S:
        step = 0.1 / block_s
        rates = np.arange(LEAST_TURNS / block_s, 1.0 / SHORTEST_S + step, step)
        fit = coherence(rates, time_s, azimuth, np.floor(time_s / block_s))
        if fit.max() > best:
            best, found_s = float(fit.max()), 1.0 / float(rates[np.argmax(fit)])
    return found_s
