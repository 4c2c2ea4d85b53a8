"""Estimates the motion of a turning antenna from the times and azimuths of its detections.

The antenna points at every detection when it makes it, whether the detection is true or false.
Azimuth against time is therefore a line. Each report fits the line again to the detections of the
last two turns. Azimuths are circular, so the line cannot slip by a whole turn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, wrap_angle
from ..types import FULL_TURN

# Gates of the successive rounds of the regression, rad; a detection outside the last one does not
# fit. A line needs at least this share of fitting detections, and this sum of weights.
REFINEMENTS, LEAST_FIT, LEAST_WEIGHT = (0.9, 0.5, 0.4), 0.7, 3.0
# Ages in turns at which a detection's weight is halved and at which it ends. The line is dropped
# after LONGEST_UNSEEN turns without detections, because wind changes an antenna's speed.
HALF_AGE, OLDEST, LONGEST_UNSEEN = 0.5, 2.2, 10.0
# Rates that are tried when there is no line, relative to the latest or the given rate.
RATES = np.exp(0.05 * np.arange(-6, 7))
# Standard deviations of the logarithm of a turn's length, and of a detection's azimuth, rad.
RATE_STD, AZIMUTH_STD = 0.05, 0.05
# Required advantage over the best line of the other direction, and weight of the fit against the
# prior of the rate.
EVIDENCE, CONCENTRATION = 4.0, 4.0
# The turn is searched again after MOST_UNCLEAR unclear reports. A line slower than SLOWEST usual
# turns is refused: it would follow an antenna that stops, and not find it when it starts again.
MOST_UNCLEAR, SLOWEST = 8, 2.0
# In a report of at least LEAST_OF_REPORT detections, a time is an outlier if its distance from the
# median exceeds both MOST_OFF median deviations and LEAST_OFF_S seconds.
LEAST_OF_REPORT, MOST_OFF, LEAST_OFF_S = 3, 4.0, 1.0
# At most MOST detections are used, regularly chosen. MANY of them over MOST_OF_A_TURN of a turn
# show the motion without older ones.
MOST, MANY, MOST_OF_A_TURN = 250, 20, 0.8
# An unknown turn between these lengths is searched in at least LEAST_UNKNOWN detections of a
# minute. Their coherence with the line (0 to 1; chance gives 0.5 with so few) must be at least
# LEAST_COHERENCE, and clearly better than with an antenna that stands: a target that is seen at one
# azimuth once a second also agrees with a turn of one second.
SHORTEST_S, LONGEST_S = 0.5, 60.0
LEAST_UNKNOWN, LEAST_COHERENCE, LEAST_EVIDENCE = 30, 0.85, 15.0
# The search begins with the latest SHORT_S seconds. Its rates differ by RATE_STEP turns over the
# searched time, which has at least LEAST_TURNS turns.
SHORT_S, RATE_STEP, LEAST_TURNS = 15.0, 0.1, 1.5
# The search is repeated after this share of the searched time, at most after LOOK_S seconds.
AGAIN, LOOK_S = 0.2, 10.0


class Antenna(NamedTuple):
    """An antenna that turns at a constant rate.

    Parameters
    ----------
    time_s : float
        Reference time, seconds.
    azimuth : float
        Direction at the reference time, radians counter-clockwise.
    rate : float
        Radians per second; negative for an antenna that turns clockwise.
    """

    time_s: float
    azimuth: float
    rate: float

    @property
    def turn_s(self) -> float:
        """Time of a turn, seconds."""
        return FULL_TURN / abs(self.rate)

    def azimuth_at(self, time_s: float) -> float:
        """Return the direction at a time, radians; it is not wrapped."""
        return self.azimuth + self.rate * (time_s - self.time_s)

    def time_near(self, azimuth: float, time_s: float) -> float:
        """Return the time nearest to `time_s` at which it points to an azimuth, seconds."""
        off = math.remainder(azimuth - self.azimuth_at(time_s), FULL_TURN)
        return time_s + off / self.rate

    def beside(self, time_s: FloatArray, azimuth: FloatArray) -> FloatArray:
        """Return the deviations of azimuths from its direction at their times, radians, (M,)."""
        return wrap_angle(azimuth - self.azimuth - self.rate * (time_s - self.time_s))

    def fits(self, time_s: FloatArray, azimuth: FloatArray) -> BoolArray:
        """Return a mask of the detections that agree with its motion, (M,)."""
        near: BoolArray = np.abs(self.beside(time_s, azimuth)) <= REFINEMENTS[-1]
        return near


class Sightings(NamedTuple):
    """Times in seconds and azimuths in radians of detections, each of shape (M,)."""

    time_s: FloatArray = np.zeros(0)
    azimuth: FloatArray = np.zeros(0)

    def since(self, oldest_s: float) -> Sightings:
        """Return the sightings after a time, at most `MOST` of them, regularly chosen."""
        kept = np.flatnonzero(self.time_s > oldest_s)
        kept = kept[:: max(1, math.ceil(len(kept) / MOST))]
        return Sightings(self.time_s[kept], self.azimuth[kept])

    def with_latest(self, own: Sightings, seconds: float) -> Sightings:
        """Return the sightings of a new report and of the given seconds before its end."""
        older = self.since(float(own.time_s.max()) - seconds)
        return Sightings(*(np.concatenate(pair) for pair in zip(older, own, strict=True)))

    def many(self, turn_s: float) -> bool:
        """Return whether they suffice to show the antenna's motion."""
        return len(self.time_s) >= MANY and bool(np.ptp(self.time_s) > MOST_OF_A_TURN * turn_s)


class AntennaTrack(NamedTuple):
    """Estimate of an antenna's motion, and the detections from which it is updated.

    Parameters
    ----------
    usual_s : float
        Time of a turn that was given or estimated, seconds; 0 if unknown.
    antenna : Antenna or None
        Current motion; None if unknown.
    sightings : Sightings
        The latest detections.
    unclear : int
        Number of consecutive reports whose detections fitted no line.
    looked_s : float
        Time of the last search for an unknown turn, seconds.
    """

    usual_s: float
    antenna: Antenna | None = None
    sightings: Sightings = Sightings()
    unclear: int = 0
    looked_s: float = -math.inf

    @property
    def rotation_s(self) -> float:
        """Best estimate of the time of a turn, seconds; 0 if unknown."""
        return self.usual_s if self.antenna is None else self.antenna.turn_s

    def follow(
        self, now_s: float, time_s: FloatArray, azimuth: FloatArray, shortest_s: float = SHORTEST_S
    ) -> AntennaTrack:
        """Return the estimate after a report.

        Parameters
        ----------
        now_s : float
            Stamp of the report, seconds.
        time_s, azimuth : arrays of shape (M,)
            Detections' times in seconds, and azimuths in radians counter-clockwise.
        shortest_s : float
            Lower bound of the search for an unknown turn, seconds.
        """
        turn_s, line = self.rotation_s, self.antenna
        if line is not None and now_s - line.time_s > LONGEST_UNSEEN * turn_s:
            return AntennaTrack(self.usual_s).follow(now_s, time_s, azimuth)
        if not len(time_s):
            return self
        near = _plausible(time_s)
        own = Sightings(time_s[near], azimuth[near]).since(-math.inf)
        if not turn_s:
            seen = self.sightings.with_latest(own, LONGEST_S)
            return self._found(now_s, seen, shortest_s)
        seen = own if own.many(turn_s) else self.sightings.with_latest(own, OLDEST * turn_s)
        weight = 0.5 ** ((seen.time_s.max() - seen.time_s) / (HALF_AGE * turn_s))
        if weight.sum() < LEAST_WEIGHT:
            return self._replace(sightings=seen)
        for line in self._lines(seen, weight):
            fits = weight @ line.fits(*seen) >= LEAST_FIT * weight.sum()
            if fits and line.turn_s < SLOWEST * self.usual_s:
                return AntennaTrack(self.usual_s, line, seen)
        if self.antenna is None and not seen.many(turn_s):
            return self._replace(sightings=seen)
        # After many unclear reports the assumed turn itself is probably wrong.
        usual_s = self.usual_s if self.unclear < MOST_UNCLEAR else 0.0
        return AntennaTrack(usual_s, None, own, self.unclear + 1)

    def turning_in(self, turn_s: float) -> AntennaTrack:
        """Return the estimate with a more accurate time of a turn, seconds; 0 changes nothing."""
        if self.antenna is None or not turn_s:
            return self
        rate = math.copysign(FULL_TURN / turn_s, self.antenna.rate)
        return self._replace(antenna=self.antenna._replace(rate=rate))

    def _lines(self, seen: Sightings, weight: FloatArray) -> Iterator[Antenna]:
        """Yield candidate lines: the previous one refined, then the best of a search."""
        usual = FULL_TURN / self.rotation_s
        if self.antenna is not None:
            yield _refine(self.antenna, seen, weight, usual)
        log_prior = -0.5 * (np.log(RATES) / RATE_STD) ** 2
        (fit, line), (other, _) = search_lines(seen, weight, usual * RATES, log_prior)
        if weight.sum() * (fit**2 - other**2) >= EVIDENCE:
            yield _refine(line, seen, weight, usual)

    def _found(self, now_s: float, seen: Sightings, shortest_s: float) -> AntennaTrack:
        """Return the estimate for an unknown turn, which is searched at intervals."""
        due_s = self.looked_s + min(LOOK_S, AGAIN * float(np.ptp(seen.time_s)))
        if len(seen.time_s) < LEAST_UNKNOWN or now_s < due_s:
            return self._replace(sightings=seen)
        for longest_s in (SHORT_S, LONGEST_S):  # the antenna may have just started
            latest = seen.since(float(seen.time_s.max()) - longest_s)
            count, span_s = len(latest.time_s), float(np.ptp(latest.time_s))
            if count < LEAST_UNKNOWN or span_s < LEAST_TURNS * shortest_s:
                continue
            turns = np.arange(LEAST_TURNS, span_s / shortest_s + RATE_STEP, RATE_STEP)
            (fit, line), _ = search_lines(latest, np.ones(count), turns * FULL_TURN / span_s)
            standing = float(np.abs(np.exp(1j * latest.azimuth).mean()))
            if fit >= LEAST_COHERENCE and count * (fit**2 - standing**2) >= LEAST_EVIDENCE:
                found = AntennaTrack(line.turn_s).follow(now_s, *latest)
                return found._replace(usual_s=found.rotation_s)
        return self._replace(sightings=seen, looked_s=now_s)


def _plausible(time_s: FloatArray) -> BoolArray:
    """Return a mask of the times near the median of a report; others come from a wrong clock."""
    off_s = np.abs(time_s - np.median(time_s))
    near: BoolArray = off_s <= max(MOST_OFF * float(np.median(off_s)), LEAST_OFF_S)
    return near | (len(time_s) < LEAST_OF_REPORT)


def search_lines(
    seen: Sightings, weight: FloatArray, rates: FloatArray, log_prior: FloatArray | float = 0.0
) -> list[tuple[float, Antenna]]:
    """Return the best line of each direction, the better first, with its fit from 0 to 1.

    Parameters
    ----------
    seen : Sightings
    weight : array of shape (M,)
    rates : array of shape (R,)
        Candidate rates, radians per second.
    log_prior : array of shape (R,) or float
        Logarithm of the prior of each rate.
    """
    last_s, sighted = float(seen.time_s[-1]), weight * np.exp(1j * seen.azimuth)
    back = np.exp(-1j * rates[:, None] * (seen.time_s - last_s))
    found = []
    for way, unturned in ((1, back), (-1, back.conj())):
        mean = unturned @ sighted
        best = int(np.argmax(CONCENTRATION * np.abs(mean) + log_prior))
        line = Antenna(last_s, float(np.angle(mean[best])), way * float(rates[best]))
        found.append((float(abs(mean[best]) / weight.sum()), line))
    return sorted(found, reverse=True)


def _refine(line: Antenna, seen: Sightings, weight: FloatArray, usual: float) -> Antenna:
    """Return the regression of azimuth on time near a line, at a rate near the usual one, rad/s."""
    ridge = (AZIMUTH_STD / RATE_STD) ** 2
    last_s = float(seen.time_s[-1])
    line = Antenna(last_s, line.azimuth_at(last_s), line.rate)
    for farthest in REFINEMENTS:
        off = line.beside(*seen)
        used = weight * (np.abs(off) <= farthest)
        passed = line.rate * (seen.time_s - last_s)
        across = used @ passed
        normal = np.array([[used.sum() + 1e-9, across], [across, used @ passed**2 + ridge]])
        prior = ridge * math.log(usual / abs(line.rate))
        shift, faster = np.linalg.solve(normal, [used @ off, used * passed @ off + prior])
        rate = line.rate * min(max(1.0 + float(faster), 0.7), 1.4)
        line = Antenna(last_s, line.azimuth + float(shift), rate)
    return line
