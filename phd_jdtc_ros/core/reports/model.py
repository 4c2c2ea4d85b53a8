"""What is assumed of transmitters and their receivers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, ReadOnly, zeros_field
from ..types.reports import ICAO, MMSI

KNOT = 0.5144  # Metres per second


class Habits(NamedTuple):
    """What transmitters of one identity space have in common."""

    fastest: float  # Half of the span of false velocities, metres per second
    area: float  # Area over which the reports of unknown sources are uniform, square metres
    velocity_std: float  # Of reported velocities along each axis, metres per second
    # Standard deviations of positions along each axis without one of their own, metres: of those
    # that are said to be accurate, and of others.
    accurate_std: float
    usual_std: float
    time_step_s: float  # Step of the reported times, seconds
    cell: float  # Width of the cells of the map of a receiver's coverage, metres
    # Share of the transmitters that report no more often than every `rare_s` seconds.
    rare: float
    rare_s: float
    # Share of the time in which nothing of a transmitter is received, as something is in the way,
    # and how long that takes in the mean, seconds.
    hidden: float
    hidden_s: float


# AIS sends times in whole seconds, and its accuracy flag means 10 m (95 %); class B sends every
# 30 s; see ITU-R M.1371. Receivers have speeds within 0.1 m/s and courses within 3 degrees
# (IMO MSC.112(73)).
AIS = Habits(8.0, 1e8, 0.25, 4.0, 12.0, 1.0, 4000.0, 0.05, 30.0, 0.01, 20.0)
AIRCRAFT = Habits(250.0, 1e10, 1.0, 20.0, 50.0, 0.0, 20_000.0, 0.0, 1.0, 0.015, 10.0)
HABITS = {ICAO: AIRCRAFT, MMSI: AIS}


@dataclass(frozen=True)
class Receiver(ReadOnly):
    """A receiver of self-reports: what it hears of, and how well."""

    name: str
    space: int = MMSI  # Identity space of reports that do not say theirs
    # Standard deviation of an antenna's place ahead of the middle, metres; a fifth to the left.
    offset_std: float = 40.0
    lost: float = 0.2  # Probability that a report is not received
    off_prior: float = 0.1  # Probability that an obliged target does not transmit
    # Probability that a target of each class is obliged to transmit, (C,).
    obliged: FloatArray = zeros_field(0)
    # Reports are used up to this age, seconds.
    max_age_s: float = 10.0
    # Corners of the covered area in the world, metres, (K, 2); none if it is learned.
    coverage: FloatArray = zeros_field(0, 2)

    @property
    def habits(self) -> Habits:
        """What its transmitters have in common."""
        return HABITS.get(self.space, AIRCRAFT)

    def interval_of(
        self, speed: FloatArray, speed_std: FloatArray, least: FloatArray
    ) -> FloatArray:
        """Return the longest plausible interval of reports, seconds, (N,).

        Parameters
        ----------
        speed, speed_std : arrays of shape (N,)
            Speed with its standard deviation, metres per second: a limit of the rules counts as not
            reached within two deviations.
        least : array of shape (N,)
            The shortest interval between two reports that was observed, seconds; 0 without one. It
            tells those that report more rarely than the rules for class A.

        Notes
        -----
        Class A: every 180 s at rest, 10 s up to 14 kn, 6 s up to 23 kn, and 2 s above (ITU-R
        M.1371-5, annex 1, table 1). ADS-B sends positions twice a second; of receivers, one a
        second is usual.
        """
        if self.space != MMSI:
            every: FloatArray = np.maximum(1.0, least)
            return every
        surely = speed - np.minimum(2.0 * speed_std, 1.0)
        steps = np.select(
            [surely < SLOWEST * KNOT, surely < 14.0 * KNOT, surely < 23.0 * KNOT],
            [180.0, 10.0, 6.0],
            2.0,
        )
        found: FloatArray = np.maximum(steps, least)
        return found


# Speed in knots below which a ship may be at anchor or moored, and then reports rarely. The rules
# have 3 knots for class A and 2 for class B, but say it of ships that do not make way.
SLOWEST = 2.0


class Reliability(NamedTuple):
    """How sources turn wrong and right, and when a pair is given up."""

    turns_wrong: float = 1e-4  # Probability that an honest source turns wrong, per report
    turns_right: float = 1e-5  # Probability that a wrong source turns right, per report
    floor: float = -9.0  # Log likelihood ratio below which a pair is dropped
    later: float = -4.0  # Log likelihood ratio of a pair that begins late
    early_s: float = 30.0  # Time after a source's first report until which a pair begins early
    gate: float = 30.0  # Square distance of position and velocity within which pairs begin
    own_gate: float = 40.0  # The same of a source's own reports
    jumps: float = 1e-3  # Share of a source's reports that are anywhere
    noise_density: float = 0.0  # Spectral density of the tracks' acceleration, m^2/s^3
    # That of wrong sources relative to it. They may move as no target does; were they steadier than
    # tracks, each report of a straight way would be evidence against its owner.
    unsteady: float = 5.0


RELIABILITY = Reliability()
# Bounds against floods: sources, sources of one address, pairs of one source, and reports of one
# address in a second.
MOST_SOURCES, MOST_OF_ADDRESS, MOST_PAIRS, MOST_PER_SECOND = 10_000, 8, 4, 10
