# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The time of a turn of an antenna, from the plots of a radar that sends no sector crossings."""

from __future__ import annotations

import math

import numpy as np

from phd_jdtc_ros.core.antenna import Antenna, AntennaTrack
from phd_jdtc_ros.core.types import FULL_TURN

# The antenna is followed from so many plots to the next, seconds apart at least.
PLOTS, PERIOD_S = 12, 1.0
# No radar has more plots in that time.
MOST_PLOTS = 1000
# Plots that are older than others by more say that the times have gone back, seconds.
MOST_BACK_S = 60.0
# Over a gap of more turns nobody knows how often it has turned.
MOST_TURNS = 3.0
# An antenna whose turn differs by more from the mean so far was switched to another speed.
SWITCHED = 0.1


class PlotTurns:
    """Follows the antenna as the tracker does, and counts its turns, for their mean."""

    def __init__(self) -> None:
        self._track = AntennaTrack(0.0)
        self._zero_ns: int | None = None
        self._waiting: list[tuple[float, float]] = []
        self._now_s = 0.0
        self._before: tuple[float, Antenna] | None = None
        self._turned, self._passed_s = 0.0, 0.0

    @property
    def turn_s(self) -> float:
        """Mean time of a turn, seconds; 0 if it is not known."""
        if self._turned < FULL_TURN:
            return self._track.rotation_s
        return FULL_TURN * self._passed_s / self._turned

    def add(self, azimuth: float, time_ns: int) -> None:
        """Take a plot's azimuth, radians clockwise from north, and its time."""
        if self._zero_ns is None:
            self._zero_ns = time_ns
        time_s = (time_ns - self._zero_ns) * 1e-9
        if time_s < self._now_s - MOST_BACK_S:
            self._waiting.clear()  # times have gone back
            self._track, self._before, self._now_s = AntennaTrack(self.turn_s), None, time_s
        if len(self._waiting) < MOST_PLOTS:  # of a flood
            self._waiting.append((time_s, azimuth))
        if len(self._waiting) >= PLOTS and time_s - self._waiting[0][0] >= PERIOD_S:
            self.find()

    def find(self) -> None:
        """Follow the antenna to the latest plot."""
        if not self._waiting:
            return
        time_s, azimuth = np.array(sorted(self._waiting)).T
        self._waiting.clear()
        now_s = float(np.median(time_s))
        self._now_s = now_s
        self._track = self._track.followed(now_s, time_s, azimuth)
        line = self._track.antenna
        if line is None:
            self._before = None
            return
        if self._turned and abs(line.turn_s / self.turn_s - 1.0) > SWITCHED:
            self._turned, self._passed_s, self._before = 0.0, 0.0, None
        if self._before is not None:
            self._count(now_s, line, *self._before)
        self._before = now_s, line

    def _count(self, now_s: float, line: Antenna, before_s: float, before: Antenna) -> None:
        """Count what was turned since the antenna was followed last."""
        passed_s = now_s - before_s
        if not 0.0 < passed_s < MOST_TURNS * before.turn_s:
            return
        due = before.rate * passed_s
        turned = line.azimuth_at(now_s) - before.azimuth_at(before_s)
        self._turned += abs(due + math.remainder(turned - due, FULL_TURN))
        self._passed_s += passed_s
