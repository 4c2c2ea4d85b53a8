"""The motion of a turning antenna: a line through azimuths against times of its detections.

Every detection, true or false, is made where the antenna points. With every report the line is
locked again to the detections of the last two turns. Azimuths are circular, so that it cannot slip
by a turn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, wrap_angle
from ..types import FULL_TURN

# How far beside the line a detection may be to count in each round of the regression, rad; one
# that is farther than the last does not fit. This share must fit, and so much weight finds a line.
REFINEMENTS, LEAST_FIT, LEAST_WEIGHT = (0.9, 0.5, 0.4), 0.7, 3.0
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
# After so many reports that are not clear the turn is looked for again. One of so many usual turns
# is none: a line follows an antenna that stops, and would not find it again.
MOST_UNCLEAR, SLOWEST = 8, 2.0
# In a report of at least so many detections, a time that is farther from the median than so many
# median deviations, and than so many seconds, tells nothing of the antenna.
LEAST_OF_REPORT, MOST_OFF, LEAST_OFF_S = 3, 4.0, 1.0
# Detections that are looked at, a regular choice of more; and so many on most of a turn show its
# motion without those before them.
MOST, MANY, MOST_OF_A_TURN = 250, 20, 0.8
# Where nobody knows a turn, seconds, it is looked for in so many detections of a minute. They must
# go with it so well, from 0 to 1 (chance is 0.5 with as many), and so much better than with an
# antenna that stands: what is seen at one azimuth once a second goes with a turn of a second too.
SHORTEST_S, LONGEST_S = 0.5, 60.0
LEAST_UNKNOWN, LEAST_COHERENCE, LEAST_EVIDENCE = 30, 0.85, 15.0
# It is looked for in those of the latest seconds first, at rates that differ by such a part of a
# turn over their time, and in so many turns at least.
SHORT_S, RATE_STEP, LEAST_TURNS = 15.0, 0.1, 1.5
# And again after such a part of that time, or so many seconds.
AGAIN, LOOK_S = 0.2, 10.0


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
        near: BoolArray = np.abs(self.beside(time_s, azimuth)) <= REFINEMENTS[-1]
        return near


class Sightings(NamedTuple):
    """Detections' times in seconds and azimuths in radians, each of shape (M,)."""

    time_s: FloatArray = np.zeros(0)
    azimuth: FloatArray = np.zeros(0)

    def since(self, oldest_s: float) -> Sightings:
        """Return those after a time, a regular choice of `MOST`."""
        kept = np.flatnonzero(self.time_s > oldest_s)
        kept = kept[:: max(1, math.ceil(len(kept) / MOST))]
        return Sightings(self.time_s[kept], self.azimuth[kept])

    def with_latest(self, own: Sightings, seconds: float) -> Sightings:
        """Return those of the last seconds up to the latest of a new report, and that."""
        older = self.since(float(own.time_s.max()) - seconds)
        return Sightings(*(np.concatenate(pair) for pair in zip(older, own, strict=True)))

    def many(self, turn_s: float) -> bool:
        """Return whether they must show how the antenna turns."""
        return len(self.time_s) >= MANY and bool(np.ptp(self.time_s) > MOST_OF_A_TURN * turn_s)


class AntennaTrack(NamedTuple):
    """What is known of an antenna.

    Parameters
    ----------
    usual_s : float
        Time of a turn as it was given or found out, seconds; 0 if it is not known.
    antenna : Antenna or None
        Its motion; None if that is not known.
    sightings : Sightings
        The latest detections.
    unclear : int
        Number of reports in a row after which they were not where one antenna could have been.
    looked_s : float
        When a turn that nobody knows was looked for last, seconds.
    """

    usual_s: float
    antenna: Antenna | None = None
    sightings: Sightings = Sightings()
    unclear: int = 0
    looked_s: float = -math.inf

    @property
    def rotation_s(self) -> float:
        """Time of a turn as far as it is known, seconds; 0 if it is not."""
        return self.usual_s if self.antenna is None else self.antenna.turn_s

    def followed(
        self, now_s: float, time_s: FloatArray, azimuth: FloatArray, shortest_s: float = SHORTEST_S
    ) -> AntennaTrack:
        """Return what is known after a report.

        Parameters
        ----------
        now_s : float
            Of the report, seconds.
        time_s, azimuth : arrays of shape (M,)
            Of its detections, seconds, and radians counter-clockwise.
        shortest_s : float
            A turn that nobody knows takes at least so long, seconds.
        """
        turn_s, line = self.rotation_s, self.antenna
        if line is not None and now_s - line.time_s > LONGEST_UNSEEN * turn_s:
            return AntennaTrack(self.usual_s).followed(now_s, time_s, azimuth)
        if not len(time_s):
            return self
        near = _believed(time_s)
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
        # In the end it turns in another time than anybody thought.
        usual_s = self.usual_s if self.unclear < MOST_UNCLEAR else 0.0
        return AntennaTrack(usual_s, None, own, self.unclear + 1)

    def turning_in(self, turn_s: float) -> AntennaTrack:
        """Return the same with a time of a turn that is known better, seconds; 0 if it is not."""
        if self.antenna is None or not turn_s:
            return self
        rate = math.copysign(FULL_TURN / turn_s, self.antenna.rate)
        return self._replace(antenna=self.antenna._replace(rate=rate))

    def _lines(self, seen: Sightings, weight: FloatArray) -> Iterator[Antenna]:
        """Yield the lines that detections may be on, by what is known of the antenna before."""
        usual = FULL_TURN / self.rotation_s
        if self.antenna is not None:
            yield _refined(self.antenna, seen, weight, usual)
        log_prior = -0.5 * (np.log(RATES) / RATE_STD) ** 2
        (fit, line), (other, _) = searched(seen, weight, usual * RATES, log_prior)
        if weight.sum() * (fit**2 - other**2) >= EVIDENCE:
            yield _refined(line, seen, weight, usual)

    def _found(self, now_s: float, seen: Sightings, shortest_s: float) -> AntennaTrack:
        """Return what is known where nobody knows the turn: it is looked for now and then."""
        due_s = self.looked_s + min(LOOK_S, AGAIN * float(np.ptp(seen.time_s)))
        if len(seen.time_s) < LEAST_UNKNOWN or now_s < due_s:
            return self._replace(sightings=seen)
        for longest_s in (SHORT_S, LONGEST_S):  # it may have stood until just now
            latest = seen.since(float(seen.time_s.max()) - longest_s)
            count, span_s = len(latest.time_s), float(np.ptp(latest.time_s))
            if count < LEAST_UNKNOWN or span_s < LEAST_TURNS * shortest_s:
                continue
            turns = np.arange(LEAST_TURNS, span_s / shortest_s + RATE_STEP, RATE_STEP)
            (fit, line), _ = searched(latest, np.ones(count), turns * FULL_TURN / span_s)
            standing = float(np.abs(np.exp(1j * latest.azimuth).mean()))
            if fit >= LEAST_COHERENCE and count * (fit**2 - standing**2) >= LEAST_EVIDENCE:
                found = AntennaTrack(line.turn_s).followed(now_s, *latest)
                return found._replace(usual_s=found.rotation_s)
        return self._replace(sightings=seen, looked_s=now_s)


def _believed(time_s: FloatArray) -> BoolArray:
    """Return which times of a report are near the others; far ones are of a wrong clock."""
    off_s = np.abs(time_s - np.median(time_s))
    near: BoolArray = off_s <= max(MOST_OFF * float(np.median(off_s)), LEAST_OFF_S)
    return near | (len(time_s) < LEAST_OF_REPORT)


def searched(
    seen: Sightings, weight: FloatArray, rates: FloatArray, log_prior: FloatArray | float = 0.0
) -> list[tuple[float, Antenna]]:
    """Return the best line in either direction, the better first, with its fit from 0 to 1.

    Parameters
    ----------
    seen : Sightings
    weight : array of shape (M,)
    rates : array of shape (R,)
        Those that are tried, radians per second.
    log_prior : array of shape (R,) or float
        Logarithms of what is thought of them.
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


def _refined(line: Antenna, seen: Sightings, weight: FloatArray, usual: float) -> Antenna:
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
