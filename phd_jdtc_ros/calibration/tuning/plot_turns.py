"""The mean time of a turn, from plots one after the other."""

from __future__ import annotations

import math

import numpy as np

from phd_jdtc_ros.core.intake.antenna import SHORTEST_S, Antenna, AntennaTrack
from phd_jdtc_ros.core.types import FULL_TURN

# The antenna is followed from so many plots to the next, seconds apart at least.
PLOTS, PERIOD_S = 12, 1.0
# No radar has more plots in that time.
MOST_PLOTS = 1000
# Over a gap of more turns nobody knows how often it has turned.
MOST_TURNS = 3.0
# An antenna whose turn differs by more from the mean so far was switched to another speed.
SWITCHED = 0.1


class PlotTurns:
    """Follows the antenna as the tracker does, and counts its turns, for their mean.

    Parameters
    ----------
    shortest_s : float
        A turn takes at least so long, seconds.
    """

    def __init__(self, shortest_s: float = SHORTEST_S) -> None:
        self._shortest_s = shortest_s
        self._track = AntennaTrack(0.0)
        self._waiting: list[tuple[float, float]] = []
        self._before: tuple[float, Antenna] | None = None
        # Of the parts that were counted: their number, time, turned angle, and its sum of squares
        # by time.
        self._counted = np.zeros(4)

    @property
    def turn_s(self) -> float:
        """Mean time of a turn, seconds; 0 if it is not known."""
        _, passed_s, turned, _ = self._counted
        if turned < FULL_TURN:
            return self._track.rotation_s
        return float(FULL_TURN * passed_s / turned)

    @property
    def turn_std_s(self) -> float:
        """Standard deviation of `turn_s` as the parts tell it, seconds; infinite by too few."""
        count, passed_s, turned, squares = self._counted
        if count < 2:
            return math.inf
        variance = max(squares * passed_s / turned**2 - 1.0, 0.0) / (count - 1)
        return self.turn_s * math.sqrt(variance)

    @property
    def counted_s(self) -> float:
        """For how long turns have been counted, seconds."""
        return float(self._counted[1])

    @property
    def clockwise(self) -> bool:
        """Whether azimuths become less, as far as is known."""
        return self._before is not None and self._before[1].rate < 0.0

    def add(self, azimuth: float, time_ns: int) -> None:
        """Take a plot's azimuth, radians, and its time."""
        time_s = time_ns * 1e-9
        if len(self._waiting) < MOST_PLOTS:  # of a flood
            self._waiting.append((time_s, azimuth))
        past_s = time_s - self._waiting[0][0]
        if len(self._waiting) >= PLOTS and abs(past_s) >= PERIOD_S:
            self.find()

    def begin_again(self) -> None:
        """Forget the plots, as times have gone back, but not the turn."""
        self._track, self._before = AntennaTrack(self.turn_s), None
        self._waiting.clear()

    def find(self) -> None:
        """Follow the antenna to the latest plot."""
        if not self._waiting:
            return
        time_s, azimuth = np.array(self._waiting).T
        self._waiting.clear()
        now_s, before = float(np.median(time_s)), self._before
        self._track = self._track.followed(now_s, time_s, azimuth, self._shortest_s)
        line = self._track.antenna
        self._before = None if line is None else (now_s, line)
        if line is None:
            return
        if self.counted_s and abs(line.turn_s / self.turn_s - 1.0) > SWITCHED:
            self._counted = np.zeros(4)
        elif before is not None:
            self._count(now_s, line, *before)

    def _count(self, now_s: float, line: Antenna, before_s: float, before: Antenna) -> None:
        """Count what was turned since the antenna was followed last."""
        passed_s = now_s - before_s
        if not 0.0 < passed_s < MOST_TURNS * before.turn_s:
            return
        due = before.rate * passed_s
        turned = line.azimuth_at(now_s) - before.azimuth_at(before_s)
        turned = abs(due + math.remainder(turned - due, FULL_TURN))
        self._counted += 1.0, passed_s, turned, turned**2 / passed_s
