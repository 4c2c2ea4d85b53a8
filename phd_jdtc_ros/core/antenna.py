# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The motion of a turning antenna, estimated from the azimuths and times of its detections.

Every detection, true or false, is made where the antenna points. Its phase is the azimuth that it
points to, in the direction in which it turns and counted on over the turns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from .arrays import FloatArray
from .types import FULL_TURN

# A detection farther from the antenna's phase than this does not fit, rad: 23 degrees.
FARTHEST = 0.4
# With fewer detections that fit, of at least so many, the motion is unclear.
LEAST_FIT, LEAST_PLOTS = 0.7, 4
# Fewer detections than this say nothing of the phase that earlier ones did not say.
LEAST_FITTED = 3
# The rates that are tried first, relative to the latest: turns of 0.74 to 1.35 times the usual one.
RATES = np.exp(0.05 * np.arange(-6, 7))
# Standard deviations: of the logarithm of a turn's length, and of the phase at a detection, rad.
RATE_STD, PHASE_STD = 0.05, 0.05
# Weight of the fit against a turn of another length.
CONCENTRATION = 4.0
# How far beside the antenna a detection may be to count in each round of the regression, rad.
REFINEMENTS = (0.9, 0.5, FARTHEST)
# How much of a cloud's detections must speak for a direction before it is believed.
EVIDENCE = 4.0
# Age in turns at which a detection has half of its weight, and that from which on it has none.
HALF_AGE, OLDEST = 0.5, 2.2
# Detections of a cloud, and of those before it, that are looked at: a regular choice if there are
# more.
MOST = 250
# So many detections in nearly a turn must say how the antenna turns.
MANY_PLOTS, MOST_OF_A_TURN = 20, 0.8
BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Antenna:
    """An antenna that turns evenly.

    Parameters
    ----------
    reference_s : float
        A time, seconds.
    phase : float
        At that time, radians.
    rate : float
        Radians per second, above 0.
    direction : int
        1 if it turns counter-clockwise, -1 if clockwise.
    """

    reference_s: float
    phase: float
    rate: float
    direction: int

    def phase_at(self, time_s: FloatArray) -> FloatArray:
        """Return the phases at some times, shape kept."""
        return self.phase + self.rate * (time_s - self.reference_s)

    def time_of(self, phase: FloatArray) -> FloatArray:
        """Return the times of some phases, seconds; shape kept."""
        return self.reference_s + (phase - self.phase) / self.rate

    def phase_of(self, azimuth: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return detections' phases: of their azimuths, the turn that is nearest in time."""
        expected = self.phase_at(time_s)
        return expected + wrapped(self.direction * azimuth - expected)

    def through(self, time_s: float, phase: float) -> Antenna:
        """Return the antenna that has this phase at this time."""
        return replace(self, reference_s=time_s, phase=phase)


def wrapped(angle: FloatArray) -> FloatArray:
    """Return angles in [-pi, pi), shape kept."""
    return np.mod(angle + np.pi, FULL_TURN) - np.pi


@dataclass(frozen=True)
class _Plots:
    """Detections' times in seconds, azimuths in radians and weights, each of shape (M,)."""

    time_s: FloatArray
    azimuth: FloatArray
    weight: FloatArray

    def __len__(self) -> int:
        return len(self.time_s)

    def with_earlier(self, earlier: _Plots, turn_s: float) -> _Plots:
        """Return these and earlier ones, which weigh the less the older they are."""
        if not len(self):
            return self
        age = np.maximum(self.time_s.min() - earlier.time_s, 0.0) / turn_s
        kept = np.flatnonzero(age < OLDEST)[:: _step(len(earlier))]
        return _Plots(
            np.concatenate([earlier.time_s[kept], self.time_s]),
            np.concatenate([earlier.azimuth[kept], self.azimuth]),
            np.concatenate([0.5 ** (age[kept] / HALF_AGE), np.ones(len(self))]),
        )


def _step(count: int) -> int:
    """Return the step of the choice of so many detections."""
    return max(1, math.ceil(count / MOST))


NONE = _Plots(np.zeros(0), np.zeros(0), np.zeros(0))


class AntennaEstimator:
    """Follows an antenna from cloud to cloud.

    Parameters
    ----------
    rotation_s : float
        Usual time of a turn, seconds. It may differ by a third, and change from turn to turn.
    spread : float
        How far from the antenna's phase at its time a detection may be, radians: half a sector if
        the detections of a sector have one time.

    Attributes
    ----------
    antenna : Antenna or None
        The latest motion; None if it is not known.
    unclear : int
        Number of clouds in a row whose detections are not where one antenna could have been.
    """

    def __init__(self, rotation_s: float, spread: float) -> None:
        self._rate = FULL_TURN / rotation_s
        self._spread = spread
        self._earlier = NONE
        self.antenna: Antenna | None = None
        self.unclear = 0

    def fits(self, antenna: Antenna, time_s: FloatArray, azimuth: FloatArray) -> BoolArray:
        """Return which detections are where the antenna was, shape (M,)."""
        beside = wrapped(antenna.direction * azimuth - antenna.phase_at(time_s))
        near: BoolArray = np.abs(beside) <= self._spread + FARTHEST
        return near

    def update(self, time_s: FloatArray, azimuth: FloatArray) -> Antenna | None:
        """Return the antenna's motion during a cloud, None if it is not known.

        Parameters
        ----------
        time_s : array of shape (M,)
            Times of the cloud's detections, seconds.
        azimuth : array of shape (M,)
            Counter-clockwise, radians.
        """
        step = _step(len(time_s))
        own = _Plots(time_s[::step], azimuth[::step], np.ones(len(time_s[::step])))
        found = self._followed(own)
        if self.unclear > 1 and self.antenna is not None:
            # Once may be chance; now the antenna moves in another way than before.
            self._earlier, self.antenna = NONE, None
            found = self._followed(own)
        return found

    def _followed(self, own: _Plots) -> Antenna | None:
        """Return the motion that fits a cloud and those before it, and count it if none does."""
        turn_s = FULL_TURN / (self._rate if self.antenna is None else self.antenna.rate)
        rich = len(own) >= MANY_PLOTS and np.ptp(own.time_s) > MOST_OF_A_TURN * turn_s
        # The speed may have changed, and a whole turn tells all.
        plots = own if rich else own.with_earlier(self._earlier, turn_s)
        found = self._fitted(plots)
        if found is None:
            span_s = np.ptp(plots.time_s) if len(plots) else 0.0
            # In a whole turn it must become clear in which direction the antenna turns.
            lost = len(plots) >= MANY_PLOTS and span_s > MOST_OF_A_TURN * turn_s
            self.unclear = self.unclear + 1 if lost else 0
        elif len(own) >= LEAST_PLOTS and self._share(found, own) < LEAST_FIT:
            self.unclear += 1
            return None
        else:
            self.unclear = 0
            self.antenna = found
        if len(own):
            self._earlier = plots
        return found

    def _share(self, antenna: Antenna, plots: _Plots) -> float:
        """Return the share of detections that are where the antenna was."""
        return float(self.fits(antenna, plots.time_s, plots.azimuth).mean())

    def _fitted(self, plots: _Plots) -> Antenna | None:
        """Return the motion that fits some detections best; the latest if they are too few."""
        if plots.weight.sum() < LEAST_FITTED:
            return self.antenna
        if self.antenna is not None:
            found = self._refined(self.antenna, plots)
            if self._share(found, plots) >= LEAST_FIT:
                return found
        directions = (1, -1) if self.antenna is None else (self.antenna.direction,)
        tried = [self._coarse(plots, direction) for direction in directions]
        if len(tried) > 1 and self._spread < 0.5 * np.pi:
            evidence = plots.weight.sum() * (tried[0][1] ** 2 - tried[1][1] ** 2)
            if abs(evidence) < EVIDENCE:
                return None
            tried.sort(key=lambda entry: -entry[1])
        return self._refined(tried[0][0], plots)

    def _coarse(self, plots: _Plots, direction: int) -> tuple[Antenna, float]:
        """Return the best of some rates with its phase, and how well it fits, from 0 to 1."""
        reference_s = float(plots.time_s[-1])
        usual = self._rate if self.antenna is None else self.antenna.rate
        rates = usual * RATES
        rates = rates[(rates > 0.5 * self._rate) & (rates < 2.0 * self._rate)]
        turned = np.exp(
            1j * (direction * plots.azimuth - rates[:, None] * (plots.time_s - reference_s))
        )
        mean = turned @ plots.weight / plots.weight.sum()
        score = CONCENTRATION * plots.weight.sum() * np.abs(mean)
        best = int(np.argmax(score - 0.5 * (np.log(rates / usual) / RATE_STD) ** 2))
        phase = float(np.angle(mean[best]))
        return Antenna(reference_s, phase, float(rates[best]), direction), float(abs(mean[best]))

    def _refined(self, antenna: Antenna, plots: _Plots) -> Antenna:
        """Return the regression of phase on time, in the turn that the latest motion is in."""
        usual = self._rate if self.antenna is None else self.antenna.rate
        ridge = (PHASE_STD**2 + self._spread**2 / 3.0) / RATE_STD**2
        for farthest in REFINEMENTS:
            beside = wrapped(antenna.direction * plots.azimuth - antenna.phase_at(plots.time_s))
            weight = plots.weight * (np.abs(beside) <= self._spread + farthest)
            passed = antenna.rate * (plots.time_s - antenna.reference_s)
            normal = np.array(
                [
                    [weight.sum() + 1e-9, weight @ passed],
                    [weight @ passed, weight @ passed**2 + ridge],
                ]
            )
            slower = math.log(usual / antenna.rate)
            right = np.array([weight @ beside, weight * passed @ beside + ridge * slower])
            offset, faster = np.linalg.solve(normal, right)
            rate = float(np.clip(antenna.rate * (1.0 + faster), 0.5 * self._rate, 2.0 * self._rate))
            antenna = replace(antenna, phase=antenna.phase + float(offset), rate=rate)
        if self.antenna is None:
            return antenna
        expected = float(self.antenna.phase_at(np.array(antenna.reference_s)))
        turns = round((expected - antenna.phase) / FULL_TURN)
        return replace(antenna, phase=antenna.phase + turns * FULL_TURN)
