"""Estimates the motion of a turning antenna from the times and azimuths of its detections.

The antenna points at every detection, true or false, at the detection's time. Azimuth against time
is therefore a line. After each report, the line is fitted again to the detections of the last two
revolutions. Azimuths are circular, so that the line cannot slip by a whole revolution.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from ..arrays import BoolArray, FloatArray, median, wrap_angle
from ..types import FULL_TURN

# Largest residuals in the rounds of the regression, radians; a detection outside the last one does
# not fit.
REFINEMENT_GATES = (0.9, 0.5, 0.4)
# Largest age of a detection in revolutions.
MAX_AGE = 2.2
# Rates that are tried when there is no line, relative to the latest or the nominal rate.
RATES = np.exp(0.05 * np.arange(-6, 7))
# Standard deviation of the logarithm of the rotation period.
RATE_STD = 0.05
# A time is an outlier if its distance from the median exceeds both this number of median deviations
# and this number of seconds.
MAX_MEDIAN_DEVIATIONS = 4.0
MIN_OUTLIER_S = 1.0
# Largest number of detections that are used; of more, an even selection is used.
MAX_SIGHTINGS = 250
# Smallest number of detections that show the motion without older ones, and smallest share of a
# revolution over which they extend.
MIN_SUFFICIENT = 20
MIN_SUFFICIENT_REVOLUTION = 0.8
# Bounds of the search for an unknown rotation period, seconds.
MIN_PERIOD_S = 0.5
MAX_PERIOD_S = 60.0
# Smallest number of detections in which an unknown period is searched.
MIN_SEARCHED = 30
# Difference of the searched rates, in revolutions over the searched time.
RATE_STEP = 0.1
# Smallest number of revolutions in the searched time.
MIN_REVOLUTIONS = 1.5


class Antenna(NamedTuple):
    """An antenna that turns at a constant rate."""

    time_s: float  # Reference time, seconds
    azimuth: float  # Direction at the reference time, radians counter-clockwise
    rate: float  # Radians per second; negative for an antenna that turns clockwise

    @property
    def period_s(self) -> float:
        """Rotation period, seconds."""
        return FULL_TURN / abs(self.rate)

    def azimuth_at(self, time_s: float) -> float:
        """Return the direction at a time, radians; it is not wrapped."""
        return self.azimuth + self.rate * (time_s - self.time_s)

    def time_near(self, azimuth: float, time_s: float) -> float:
        """Return the time nearest to `time_s` at which it points to an azimuth, seconds."""
        off = math.remainder(azimuth - self.azimuth_at(time_s), FULL_TURN)
        return time_s + off / self.rate

    def residual(self, time_s: FloatArray, azimuth: FloatArray) -> FloatArray:
        """Return the azimuths less its direction at their times, wrapped, radians, (M,)."""
        return wrap_angle(azimuth - self.azimuth - self.rate * (time_s - self.time_s))

    def fits(self, time_s: FloatArray, azimuth: FloatArray) -> BoolArray:
        """Return a mask of the detections that agree with its motion, (M,)."""
        return np.abs(self.residual(time_s, azimuth)) <= REFINEMENT_GATES[-1]


class Sightings(NamedTuple):
    """Times in seconds and azimuths in radians of detections, each of shape (M,)."""

    time_s: FloatArray = np.zeros(0)
    azimuth: FloatArray = np.zeros(0)

    def since(self, oldest_s: float) -> Sightings:
        """Return the sightings after a time, at most `MAX_SIGHTINGS`, evenly selected."""
        (rows,) = (self.time_s > oldest_s).nonzero()
        if rows.size > MAX_SIGHTINGS:
            rows = rows[:: math.ceil(rows.size / MAX_SIGHTINGS)]
        return Sightings(self.time_s[rows], self.azimuth[rows])

    def plausible(self) -> Sightings:
        """Return those of a report with times near the median; others come from a wrong clock."""
        time_s = self.time_s
        # Smallest number of detections in a report whose times are checked for outliers.
        if time_s.size < 3 or time_s.max() - time_s.min() <= MIN_OUTLIER_S:
            return self
        off_s = np.abs(time_s - median(time_s))
        near = off_s <= max(MAX_MEDIAN_DEVIATIONS * median(off_s), MIN_OUTLIER_S)
        return Sightings(time_s[near], self.azimuth[near])

    def with_latest(self, latest: Sightings, seconds: float) -> Sightings:
        """Return the sightings of a new report and of the given seconds before its end."""
        older = self.since(float(latest.time_s.max()) - seconds)
        return Sightings(
            np.concatenate([older.time_s, latest.time_s]),
            np.concatenate([older.azimuth, latest.azimuth]),
        )

    def suffice(self, period_s: float) -> bool:
        """Return whether they suffice to show the antenna's motion."""
        return self.time_s.size >= MIN_SUFFICIENT and bool(
            np.ptp(self.time_s) > MIN_SUFFICIENT_REVOLUTION * period_s
        )


class AntennaTrack(NamedTuple):
    """Estimate of an antenna's motion, and the detections from which it is updated."""

    # Rotation period, configured or as first estimated, seconds; 0 if unknown.
    nominal_period_s: float
    antenna: Antenna | None = None  # Current motion; None if unknown
    sightings: Sightings = Sightings()  # The latest detections
    unclear: int = 0  # Number of consecutive reports whose detections fitted no line
    searched_s: float = -math.inf  # Time of the last search for an unknown period, seconds

    @property
    def period_s(self) -> float:
        """Current estimate of the rotation period, seconds; 0 if unknown."""
        return self.nominal_period_s if self.antenna is None else self.antenna.period_s

    def follow(
        self,
        now_s: float,
        time_s: FloatArray,
        azimuth: FloatArray,
        min_period_s: float = MIN_PERIOD_S,
    ) -> AntennaTrack:
        """Return the estimate after a report.

        `now_s` is the stamp of the report, seconds. Its detections have times, seconds, and
        azimuths, radians counter-clockwise, (M,). `min_period_s` bounds the search for an unknown
        period.
        """
        period_s, line = self.period_s, self.antenna
        # Number of revolutions without detections after which the line is dropped, because wind
        # changes an antenna's speed.
        if line is not None and now_s - line.time_s > 10.0 * period_s:
            return AntennaTrack(self.nominal_period_s).follow(now_s, time_s, azimuth)
        if not len(time_s):
            return self
        latest = Sightings(time_s, azimuth).plausible().since(-math.inf)
        if not period_s:
            sightings = self.sightings.with_latest(latest, MAX_PERIOD_S)
            return self._search(now_s, sightings, min_period_s)
        sightings = (
            latest
            if latest.suffice(period_s)
            else self.sightings.with_latest(latest, MAX_AGE * period_s)
        )
        # Age in revolutions at which a detection's weight is halved.
        weight = 0.5 ** ((sightings.time_s.max() - sightings.time_s) / (0.5 * period_s))
        total = np.add.reduce(weight)
        # Smallest sum of weights for a fit.
        if total < 3.0:
            return self._replace(sightings=sightings)
        for line in self._candidate_lines(sightings, weight, FULL_TURN / period_s):
            # Smallest share of fitting detections, by weight.
            fits = weight @ line.fits(*sightings) >= 0.7 * total
            # Largest period of a line in nominal periods: a longer one would follow an antenna that
            # stops, and not find it when it starts again.
            if fits and line.period_s < 2.0 * self.nominal_period_s:
                return AntennaTrack(self.nominal_period_s, line, sightings)
        if self.antenna is None and not sightings.suffice(period_s):
            return self._replace(sightings=sightings)
        # After many unclear reports the assumed period itself is probably wrong.
        # Number of consecutive unclear reports after which the rotation period is searched again.
        nominal_period_s = self.nominal_period_s if self.unclear < 8 else 0.0
        return AntennaTrack(nominal_period_s, None, latest, self.unclear + 1)

    def with_period(self, period_s: float) -> AntennaTrack:
        """Return the estimate with a more accurate period, seconds; 0 changes nothing."""
        if self.antenna is None or not period_s:
            return self
        rate = math.copysign(FULL_TURN / period_s, self.antenna.rate)
        return self._replace(antenna=self.antenna._replace(rate=rate))

    def _candidate_lines(
        self, sightings: Sightings, weight: FloatArray, rate: float
    ) -> Iterator[Antenna]:
        """Yield candidate lines: the previous one refined, then the best of a search.

        `rate` is that of the current period, radians per second.
        """
        if self.antenna is not None:
            yield _refine(self.antenna, sightings, weight, rate)
        log_prior = -0.5 * (np.log(RATES) / RATE_STD) ** 2
        (fit, line), (other_fit, _) = search_lines(sightings, weight, rate * RATES, log_prior)
        # Required advantage over the best line of the other direction.
        if weight.sum() * (fit**2 - other_fit**2) >= 4.0:
            yield _refine(line, sightings, weight, rate)

    def _search(self, now_s: float, sightings: Sightings, min_period_s: float) -> AntennaTrack:
        """Return the estimate for an unknown period, which is searched at intervals."""
        # Interval between searches, seconds, and as a share of the searched time.
        due_s = self.searched_s + min(10.0, 0.2 * float(np.ptp(sightings.time_s)))
        if len(sightings.time_s) < MIN_SEARCHED or now_s < due_s:
            return self._replace(sightings=sightings)
        # The detections of this time are searched first, seconds: the antenna may have just
        # started.
        for longest_s in (15.0, MAX_PERIOD_S):
            latest = sightings.since(float(sightings.time_s.max()) - longest_s)
            count, span_s = len(latest.time_s), float(np.ptp(latest.time_s))
            if count < MIN_SEARCHED or span_s < MIN_REVOLUTIONS * min_period_s:
                continue
            revolutions = np.arange(MIN_REVOLUTIONS, span_s / min_period_s + RATE_STEP, RATE_STEP)
            (fit, line), _ = search_lines(latest, np.ones(count), revolutions * FULL_TURN / span_s)
            standing = float(np.abs(np.exp(1j * latest.azimuth).mean()))
            # Smallest coherence of these detections with the line, from 0 to 1; chance gives 0.5
            # with so few. And the required advantage over an antenna that stands still: a target
            # that is seen at one azimuth once a second also agrees with a period of one second.
            if fit >= 0.85 and count * (fit**2 - standing**2) >= 15.0:
                track = AntennaTrack(line.period_s).follow(now_s, *latest)
                return track._replace(nominal_period_s=track.period_s)
        return self._replace(sightings=sightings, searched_s=now_s)


def search_lines(
    sightings: Sightings, weight: FloatArray, rates: FloatArray, log_prior: FloatArray | float = 0.0
) -> list[tuple[float, Antenna]]:
    """Return the best line of each direction, the better first, with its fit from 0 to 1.

    Each sighting has a weight, (M,), and each candidate rate, radians per second, the logarithm of
    its prior, (R,).
    """
    last_s, phasors = float(sightings.time_s[-1]), weight * np.exp(1j * sightings.azimuth)
    rotation_back = np.exp(-1j * rates[:, None] * (sightings.time_s - last_s))
    lines = []
    for sign, rotation in ((1, rotation_back), (-1, rotation_back.conj())):
        # Each sum points to the azimuth at the last detection, if the antenna has that rate.
        total = rotation @ phasors
        # Weight of the fit against the prior of the rate.
        best = int(np.argmax(4.0 * np.abs(total) + log_prior))
        line = Antenna(last_s, float(np.angle(total[best])), sign * float(rates[best]))
        lines.append((float(abs(total[best]) / weight.sum()), line))
    return sorted(lines, reverse=True)


def _refine(line: Antenna, sightings: Sightings, weight: FloatArray, prior_rate: float) -> Antenna:
    """Return the regression of azimuth on time near a line, at a rate near the usual one, rad/s."""
    # Standard deviation of a detection's azimuth, radians.
    ridge, last_s = (0.05 / RATE_STD) ** 2, float(sightings.time_s[-1])
    azimuth, rate, since_s = line.azimuth_at(last_s), line.rate, sightings.time_s - last_s
    for farthest in REFINEMENT_GATES:
        passed = rate * since_s
        off = wrap_angle(sightings.azimuth - azimuth - passed)
        weight_in_gate = weight * (np.abs(off) <= farthest)
        total, across = np.add.reduce(weight_in_gate) + 1e-9, weight_in_gate @ passed
        normal = np.array([[total, across], [across, weight_in_gate @ passed**2 + ridge]])
        prior = ridge * math.log(prior_rate / abs(rate))
        # LAPACK itself takes a sixth of the time of `numpy.linalg.solve` for two unknowns.
        _, _, (shift, faster), _ = lapack.dgesv(
            normal, [weight_in_gate @ off, weight_in_gate * passed @ off + prior]
        )
        azimuth += float(shift)
        rate *= min(max(1.0 + float(faster), 0.7), 1.4)
    return Antenna(last_s, azimuth, rate)
