# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""How an antenna turns, by the azimuths and times of its detections."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..arrays import FloatArray
from ..sectors import smallest_arc
from ..types import FULL_TURN
from .plots import Plots

# A turn takes at least and at most so long, seconds.
SHORTEST_S, LONGEST_S = 0.5, 60.0
# Plots that are looked at, a regular choice if there are more; fewer tell nothing.
MOST, LEAST = 3000, 12
# Turns may differ in length, so the phase is followed over some of them at a time only: over so
# many clouds, and so many seconds at least.
BLOCK_CLOUDS, BLOCK_S = 12, 12.0
# Where that is too short for several turns, a block is so many times longer.
LONGER, LEAST_TURNS = 4.0, 1.5
# How well azimuths must go with the times, from 0 to 1. Half a turn in one cloud of one time is
# 0.64; chance is 0.3 with ten plots.
LEAST_COHERENCE = 0.75


@dataclass(frozen=True)
class Timing:
    """When a radar looks.

    Parameters
    ----------
    cloud_interval_s : float
        Median time between clouds, seconds.
    interval_spread_s : float
        Median deviation of these times from it, seconds.
    rotation_s : float
        Time of one turn; 0 if the antenna does not turn, or not as far as the plots tell.
    rotation_std_s : float
        Standard deviation of the turns' mean, from block to block of the recording, seconds.
    sectors : int
        Clouds to a turn; 0 if a cloud is a whole turn.
    clockwise : bool
        Whether it turns clockwise.
    timed : bool
        Whether plots have times of their own, so that clouds may be of any length.
    """

    cloud_interval_s: float
    interval_spread_s: float
    rotation_s: float = 0.0
    rotation_std_s: float = 0.0
    sectors: int = 0
    clockwise: bool = False
    timed: bool = False

    @property
    def look_s(self) -> float:
        """Time between two chances to detect a target, seconds."""
        return self.rotation_s or self.cloud_interval_s


def timing(plots: Plots) -> Timing:
    """Return when a radar looked.

    Parameters
    ----------
    plots : Plots
        Of at least two clouds.
    """
    steps = np.diff(plots.cloud_s)
    interval_s = float(np.median(steps))
    spread_s = float(np.median(np.abs(steps - interval_s)))
    still = Timing(interval_s, spread_s)
    if len(plots) < LEAST or interval_s <= 0.0:
        return still
    # Without times of their own, plots say something of turns that take two clouds or more.
    shortest_s = max(SHORTEST_S, interval_s * (0.8 if plots.timed else 1.9))
    chosen = slice(None, None, max(1, len(plots) // MOST))
    time_s, azimuth = plots.time_s[chosen], plots.measurement[chosen, 1] + plots.pose[chosen, 2]
    block_s = max(BLOCK_CLOUDS * interval_s, BLOCK_S)
    found = None
    # A recording, or a part of it, without a whole turn tells nothing of one.
    while found is None and block_s < LONGER * plots.duration_s:
        block_s = min(block_s, plots.duration_s)
        found = _turning(time_s, azimuth, shortest_s, block_s)
        block_s *= LONGER
    if found is None:
        return still
    rate, std, way = found
    rotation_s = 1.0 / rate
    sectors = round(rotation_s / interval_s)
    return Timing(
        interval_s,
        spread_s,
        rotation_s,
        std * rotation_s**2,
        sectors if sectors > 1 and _narrow(plots, sectors) else 0,
        way < 0,
        plots.timed,
    )


def _turning(
    time_s: FloatArray, azimuth: FloatArray, shortest_s: float, block_s: float
) -> tuple[float, float, int] | None:
    """Return rate and its deviation, turns per second, and direction; None if it does not turn.

    Turns take at least `shortest_s`, and several are in a block of `block_s`, seconds.
    """
    longest_s = min(LONGEST_S, block_s / LEAST_TURNS)
    if longest_s <= shortest_s:
        return None
    block, step = np.floor(time_s / block_s), 0.1 / block_s
    rates = np.arange(1.0 / longest_s, 1.0 / shortest_s + step, step)
    fits = {way: _coherence(rates, time_s, way * azimuth, block) for way in (1, -1)}
    way = max(fits, key=lambda direction: float(fits[direction].max()))
    if fits[way].max() < LEAST_COHERENCE:
        return None
    rate = float(rates[np.argmax(fits[way])])
    even = rate + step * np.linspace(-1.0, 1.0, 2 * math.ceil(float(np.ptp(time_s)) / block_s) * 10)
    fit = _coherence(even, time_s, way * azimuth, np.zeros(len(time_s)))
    if fit.max() >= LEAST_COHERENCE:  # all turns are equally long
        rate, std = _peak(even, fit), 0.05 / max(float(np.ptp(time_s)), block_s)
        return rate, std / math.sqrt(len(time_s)), way
    return (*_refined(rate, step, time_s, way * azimuth, block), way)


def _peak(rates: FloatArray, fit: FloatArray) -> float:
    """Return where the parabola through the best of some rates and its neighbours is highest."""
    best = min(max(int(np.argmax(fit)), 1), len(fit) - 2)
    below, top, above = fit[best - 1 : best + 2]
    bend = below - 2.0 * top + above
    off = float(np.clip(0.5 * (below - above) / bend, -1.0, 1.0)) if bend < 0.0 else 0.0
    return float(rates[best] + off * (rates[1] - rates[0]))


def _coherence(
    rates: FloatArray, time_s: FloatArray, azimuth: FloatArray, block: FloatArray
) -> FloatArray:
    """Return how well azimuths go with each rate (turns per second), from 0 to 1."""
    fit, weight = np.zeros(len(rates)), 0.0
    for number in np.unique(block):
        inside = block == number
        if np.count_nonzero(inside) < LEAST:
            continue
        turned = azimuth[inside] - FULL_TURN * rates[:, None] * time_s[inside]
        count = float(np.count_nonzero(inside))
        fit += count * np.abs(np.exp(1j * turned).mean(axis=1))
        weight += count
    return fit / max(weight, 1.0)


def _refined(
    rate: float, step: float, time_s: FloatArray, azimuth: FloatArray, block: FloatArray
) -> tuple[float, float]:
    """Return the rate of the best fit near a coarse one, and the deviation of its mean."""
    found = []
    near = rate + step * np.linspace(-1.0, 1.0, 41)
    for number in np.unique(block):
        inside = block == number
        if np.count_nonzero(inside) < LEAST:
            continue
        fit = _coherence(near, time_s[inside], azimuth[inside], np.zeros(np.count_nonzero(inside)))
        found.append(_peak(near, fit))
    deviation = np.std(found) / np.sqrt(len(found)) if len(found) > 1 else step
    return float(np.mean(found)), float(max(deviation, 0.05 * step / np.sqrt(len(found))))


def _narrow(plots: Plots, sectors: int) -> bool:
    """Return whether the plots of a cloud are within a part of a turn."""
    edges = np.flatnonzero(np.diff(np.sort(plots.cloud))) + 1
    order = np.argsort(plots.cloud, kind="stable")
    parts = np.split(plots.measurement[order, 1], edges)
    widths = [smallest_arc(part)[1] for part in parts if len(part) > 1]
    return not widths or float(np.median(widths)) < 1.5 * FULL_TURN / sectors
