# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Detections of an antenna that turns, as reports of whole turns or of sectors."""

from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.types import FULL_TURN, Detections

START_NS = 1_700_000_000_000_000_000


@dataclass(frozen=True)
class Sent:
    """A report as a radar sends it, and the azimuths that the antenna passed for it.

    `passed` are the phases from which and to which it covers, radians in the direction of turning.
    """

    stamp_ns: int
    detections: Detections
    sector: int
    passed: tuple


@dataclass(frozen=True)
class TurningRadar:
    """An antenna and how it reports.

    `rotation_s` is a turn's length, or a function of the time in seconds; `stamp_at` is the place
    of the stamp in what a report covers, from 0 to 1; `cut` is the phase at which reports begin.
    """

    rotation_s: float = 4.0
    sectors: int = 0
    clockwise: bool = False
    timed: bool = True
    stamp_at: float = 1.0
    cut: float = 0.3
    plots: int = 80
    noise: float = 0.002
    time_step_s: float = 1.0 / 128.0

    def reports(self, turns, seed=0, plots=None, rotations=None):
        """Return the reports of some turns; `rotations` gives the length of each turn."""
        rng = np.random.default_rng(seed)
        per_turn = max(self.sectors, 1)
        lengths = [self.rotation_s] * turns if rotations is None else rotations
        begins = np.concatenate([[0.0], np.cumsum(lengths)])
        sent = []
        for k in range(turns * per_turn):
            turn, part = divmod(k, per_turn)
            each = lengths[turn] / per_turn
            begin_s = begins[turn] + part * each
            many = self.plots if plots is None else plots
            share = np.sort(rng.uniform(0.0, 1.0, rng.poisson(many / per_turn) if many else 0))
            sent.append(self._report(k, begin_s, each, share, rng))
        return sent

    def _report(self, k, begin_s, length_s, share, rng):
        width = FULL_TURN / max(self.sectors, 1)
        first = self.cut + k * width
        time_s = begin_s + length_s * share
        if self.time_step_s:
            time_s = np.round(time_s / self.time_step_s) * self.time_step_s
        phase = first + width * share + self.noise * rng.standard_normal(len(share))
        azimuth = -phase if self.clockwise else phase
        stamp_s = begin_s + length_s * self.stamp_at
        measurement = np.stack(
            [
                1000.0 * (1.0 + np.arange(len(share))),
                np.remainder(azimuth + np.pi, FULL_TURN) - np.pi,
            ],
            axis=1,
        )
        detections = Detections(measurement, None, time_s - stamp_s if self.timed else None)
        number = k % max(self.sectors, 1)
        return Sent(START_NS + round(stamp_s * 1e9), detections, number, (first, first + width))
