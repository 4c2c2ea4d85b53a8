# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The motion of a turning antenna: a line through azimuths against times of its detections.

Every detection, true or false, is made where the antenna points. With every report the line is
locked again to the detections of the last two turns. Azimuths are circular, so that it cannot slip
by a turn.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .arrays import BoolArray, FloatArray, wrap_angle
from .types import FULL_TURN

# A detection farther from the line than this does not fit, rad: 23 degrees.
FARTHEST = 0.4
# How far beside the line a detection may be to count in each round of the regression, rad.
REFINEMENTS = (0.9, 0.5, FARTHEST)
# This share of the detections must fit a line, and detections of so much weight find one.
LEAST_FIT, LEAST_WEIGHT = 0.7, 3.0
# Age in turns at which a detection has half of its weight, and that from which on it has none.
# After so many turns unseen the line is dropped: wind changes an antenna's speed.
HALF_AGE, OLDEST, LONGEST_UNSEEN = 0.5, 2.2, 10.0
# The rates that are tried without a line, relative to the latest or the given one.
RATES = np.exp(0.05 * np.arange(-6, 7))
# Standard deviations: of the logarithm of a turn's length, and of the azimuth of a detection, rad.
RATE_STD, AZIMUTH_STD = 0.05, 0.05
# How much more of the detections must be on the line than on that of the other direction, and their
# weight against an unusual rate.
EVIDENCE, CONCENTRATION = 4.0, 4.0
# After so many reports that are not clear the turn is looked for again.
MOST_UNCLEAR = 8
# In a report of at least so many detections, a time that is farther from the median than so many
# median deviations, and than so many seconds, tells nothing of the antenna.
LEAST_OF_REPORT, MOST_OFF, LEAST_OFF_S = 3, 4.0, 1.0
# Detections that are looked at: a regular choice of more.
MOST = 250
# So many detections on most of a turn show its motion without those before them.
MANY, MOST_OF_A_TURN = 20, 0.8
# Where nobody knows a turn, seconds, it is looked for in so many detections of a minute. They must
# go with it so well, from 0 to 1 (chance is 0.5 with as many), and so much better than with an
# antenna that stands: what is seen at one azimuth once a second goes with a turn of a second too.
SHORTEST_S, LONGEST_S = 0.5, 60.0
# It is looked for in those of the latest seconds first, and again after so many seconds.
SHORT_S, LOOK_S = 15.0, 10.0
LEAST_UNKNOWN, LEAST_COHERENCE, LEAST_EVIDENCE = 30, 0.85, 15.0


class Antenna(NamedTuple):
    """An antenna that turns evenly.

    Parameters
    ----------
    time_s : float
        A time, seconds.
    azimuth : float
        Where it points then, radians counter-clockwise.
    rate : float
        Radians per second; negative if it turns clockwise.
    """

    time_s: float
    azimuth: float
    rate: float

    @property
    def turn_s(self) -> float:
        """Time of a turn, seconds."""
        return FULL_TURN / abs(self.rate)

    def azimuth_at(self, time_s: float) -> float:
        """Return where it points at a time, radians; not wrapped."""
        return self.azimuth + self.rate * (time_s - self.time_s)

    def time_near(self, azimuth: float, time_s: float) -> float:
        """Return the time nearest to another at which it points to an azimuth, seconds."""
        off = math.remainder(azimuth - self.azimuth_at(time_s), FULL_TURN)
        return time_s + off / self.rate

    def beside(self, time_s: FloatArray, azimuth: FloatArray) -> FloatArray:
        """Return how far azimuths are from where it points at their times, radians; (M,)."""
        return wrap_angle(azimuth - self.azimuth - self.rate * (time_s - self.time_s))

    def fits(self, time_s: FloatArray, azimuth: FloatArray) -> BoolArray:
        """Return which detections are where it was, (M,)."""
        near: BoolArray = np.abs(self.beside(time_s, azimuth)) <= FARTHEST
        return near


class Sightings(NamedTuple):
    """Detections' times in seconds and azimuths in radians, each of shape (M,)."""

    time_s: FloatArray
    azimuth: FloatArray

    def since(self, oldest_s: float) -> Sightings:
        """Return those after a time, a regular choice of `MOST`."""
        kept = np.flatnonzero(self.time_s > oldest_s)
        kept = kept[:: max(1, math.ceil(len(kept) / MOST))]
        return Sightings(self.time_s[kept], self.azimuth[kept])

    def believed(self) -> Sightings:
        """Return those whose times are near the others'; far ones are of a wrong clock."""
        if len(self.time_s) < LEAST_OF_REPORT:
            return self
        off_s = np.abs(self.time_s - np.median(self.time_s))
        kept = off_s <= max(MOST_OFF * float(np.median(off_s)), LEAST_OFF_S)
        return Sightings(self.time_s[kept], self.azimuth[kept])

    def joined(self, newer: Sightings) -> Sightings:
        """Return these and newer ones."""
        return Sightings(*(np.concatenate(pair) for pair in zip(self, newer, strict=True)))

    def weight(self, turn_s: float) -> FloatArray:
        """Return weights that fall with the age, (M,)."""
        weight: FloatArray = 0.5 ** ((self.time_s.max() - self.time_s) / (HALF_AGE * turn_s))
        return weight

    def many(self, turn_s: float) -> bool:
        """Return whether they must show how the antenna turns."""
        return len(self.time_s) >= MANY and bool(np.ptp(self.time_s) > MOST_OF_A_TURN * turn_s)


NONE = Sightings(np.zeros(0), np.zeros(0))


class AntennaTrack(NamedTuple):
    """What is known of an antenna.

    Parameters
    ----------
    rotation_s : float
        Time of a turn, a first guess or the latest one, seconds; 0 if it is not known.
    antenna : Antenna or None
        Its motion; None if that is not known.
    sightings : Sightings
        The latest detections.
    unclear : int
        Number of reports in a row after which they were not where one antenna could have been.
    looked, looked_s : int, float
        For a turn that nobody knows: number of detections when it was looked for last, and when.
    """

    rotation_s: float
    antenna: Antenna | None = None
    sightings: Sightings = NONE
    unclear: int = 0
    looked: int = 0
    looked_s: float = -math.inf

    def followed(
        self, now_s: float, time_s: FloatArray, azimuth: FloatArray, shortest_s: float = SHORTEST_S
    ) -> AntennaTrack:
        """Return what is known after a report.

        Parameters
        ----------
        now_s : float
            Of the report, seconds.
        time_s : array of shape (M,)
            Times of its detections, seconds.
        azimuth : array of shape (M,)
            Counter-clockwise, radians.
        shortest_s : float
            A turn that nobody knows takes at least so long, seconds.
        """
        own = Sightings(time_s, azimuth).believed().since(-math.inf)
        if self.antenna is not None and now_s - self.antenna.time_s > (
            LONGEST_UNSEEN * self.rotation_s
        ):
            return AntennaTrack(self.rotation_s).followed(now_s, time_s, azimuth)
        if not len(time_s):
            return self
        if not self.rotation_s:
            return self._searched(own, shortest_s)
        seen = own
        if not own.many(self.rotation_s):
            oldest_s = float(own.time_s.max()) - OLDEST * self.rotation_s
            seen = self.sightings.since(oldest_s).joined(own)
        weight = seen.weight(self.rotation_s)
        if weight.sum() < LEAST_WEIGHT:
            return self._replace(sightings=seen)
        line = self._line(seen, weight)
        if line is not None and weight @ line.fits(*seen) >= LEAST_FIT * weight.sum():
            return AntennaTrack(line.turn_s, line, seen)
        lost = self.antenna is not None or seen.many(self.rotation_s)
        if not lost:
            return AntennaTrack(self.rotation_s, None, seen, self.unclear)
        # In the end it turns in another time than anybody thought.
        usual_s = self.rotation_s if self.unclear < MOST_UNCLEAR else 0.0
        return AntennaTrack(usual_s, None, own, self.unclear + 1)

    def turning_in(self, turn_s: float) -> AntennaTrack:
        """Return the same with a time of a turn that is known better, seconds; 0 if it is not."""
        if self.antenna is None or not turn_s:
            return self
        rate = math.copysign(FULL_TURN / turn_s, self.antenna.rate)
        return self._replace(rotation_s=turn_s, antenna=self.antenna._replace(rate=rate))

    def _searched(self, own: Sightings, shortest_s: float) -> AntennaTrack:
        """Return what is known of a turn that nobody gave: looked for as the detections grow."""
        seen = self.sightings.joined(own)
        seen = seen.since(float(seen.time_s.max()) - LONGEST_S)
        count, now_s = len(seen.time_s), float(seen.time_s[-1])
        due = count >= 1.25 * self.looked or now_s - self.looked_s > LOOK_S
        if count < LEAST_UNKNOWN or not due:
            return self._replace(sightings=seen)
        # It may have stood until just now.
        for latest in (seen.since(now_s - SHORT_S), seen):
            if (turn_s := _turn_s(latest, shortest_s)) is not None:
                return AntennaTrack(turn_s).followed(now_s, *latest)
        return self._replace(sightings=seen, looked=count, looked_s=now_s)

    def _line(self, seen: Sightings, weight: FloatArray) -> Antenna | None:
        """Return the line that fits detections best; None if no direction is much better."""
        if self.antenna is not None:
            line = self._refined(self.antenna, seen, weight)
            if weight @ line.fits(*seen) >= LEAST_FIT * weight.sum():
                return line
        rates, log_prior = (
            FULL_TURN / self.rotation_s * RATES,
            -0.5 * (np.log(RATES) / RATE_STD) ** 2,
        )
        (fit, line), (other, _) = sorted(
            (_coarse(seen, weight, way * rates, log_prior) for way in (1, -1)), reverse=True
        )
        if weight.sum() * (fit**2 - other**2) < EVIDENCE:
            return None
        return self._refined(line, seen, weight)

    def _refined(self, line: Antenna, seen: Sightings, weight: FloatArray) -> Antenna:
        """Return the regression of azimuth on time near a line, at a rate near the usual one."""
        usual = math.copysign(FULL_TURN / self.rotation_s, line.rate)
        ridge = (AZIMUTH_STD / RATE_STD) ** 2
        last_s = float(seen.time_s[-1])
        line = Antenna(last_s, line.azimuth_at(last_s), line.rate)
        for farthest in REFINEMENTS:
            off = line.beside(*seen)
            used = weight * (np.abs(off) <= farthest)
            passed = line.rate * (seen.time_s - last_s)
            across = used @ passed
            normal = np.array([[used.sum() + 1e-9, across], [across, used @ passed**2 + ridge]])
            right = np.array(
                [used @ off, used * passed @ off + ridge * math.log(usual / line.rate)]
            )
            shift, faster = np.linalg.solve(normal, right)
            rate = line.rate * min(max(1.0 + float(faster), 0.7), 1.4)
            line = Antenna(last_s, line.azimuth + float(shift), rate)
        return line


def _turn_s(seen: Sightings, shortest_s: float) -> float | None:
    """Return the time of a turn that nobody gave, seconds; None if detections show none."""
    count, span_s = len(seen.time_s), float(np.ptp(seen.time_s)) if len(seen.time_s) else 0.0
    if count < LEAST_UNKNOWN or span_s < 1.5 * shortest_s:
        return None
    slowest, fastest, step = 1.5 / span_s, 1.0 / shortest_s, 0.1 / span_s
    rates = FULL_TURN * np.arange(slowest, fastest + step, step)
    fit, line = max(_coarse(seen, np.ones(count), way * rates) for way in (1, -1))
    standing = float(np.abs(np.exp(1j * seen.azimuth).mean()))
    shown = fit >= LEAST_COHERENCE and count * (fit**2 - standing**2) >= LEAST_EVIDENCE
    return line.turn_s if shown else None


def _coarse(
    seen: Sightings, weight: FloatArray, rates: FloatArray, log_prior: FloatArray | float = 0.0
) -> tuple[float, Antenna]:
    """Return the best line of some rates, rad/s, and how well it fits, from 0 to 1."""
    last_s, total = float(seen.time_s[-1]), float(weight.sum())
    mean = np.exp(1j * (seen.azimuth - rates[:, None] * (seen.time_s - last_s))) @ weight / total
    best = int(np.argmax(CONCENTRATION * total * np.abs(mean) + log_prior))
    return float(abs(mean[best])), Antenna(last_s, float(np.angle(mean[best])), float(rates[best]))
