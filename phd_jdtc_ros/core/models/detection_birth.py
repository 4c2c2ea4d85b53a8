"""Births at detections, for targets that appear at unknown places.

Undetected targets have a uniform intensity in every sensor's own coordinates. In the update, they
compete with clutter and with the known targets for each detection. The probability that an
undetected target is the source is the detection's newborn mass. A new target of this mass is added
at the detection's position, with the radar's noise and a broad distribution of velocity. A range
rate determines the radial velocity up to its ambiguity. Where other radars have looked since a
radar's previous report, only the undetected targets that they missed remain for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, ReadOnly
from ..sensors.polar_geometry import MIN_RANGE
from ..sensors.range_rate import Rates
from ..sensors.sensor import Sensor
from ..sensors.view import View
from ..targets import stationary
from ..targets.modes import ModeSpace
from .zones import Zone


class EarlierLooks(NamedTuple):
    """The looks since a sensor's previous report."""

    first_ns: int  # Stamp of the previous report
    others: Sequence[View]  # Later reports of other sensors, in the order of their stamps


@dataclass(frozen=True)
class DetectionBirthModel(ReadOnly):
    """The rate of undetected targets, and the distribution of their velocity."""

    # Expected births in a radar's field per nominal interval and class, (C,); all zero for none.
    rate: FloatArray
    velocity_std: float  # Standard deviation of the velocity along each axis, metres per second
    turn_rate_std: float  # Standard deviation of the turn rate, radians per second
    climb_std: float = 5.0  # Standard deviation of the climb rate in space, metres per second
    least_mass: float = 1e-4  # Smallest newborn mass with which a target is born at a detection
    excluded: tuple[Zone, ...] = ()  # Where no target is born

    @cached_property
    def enabled(self) -> bool:
        """Whether any class has births at detections."""
        return bool(np.any(self.rate > 0.0))

    def log_intensity(
        self,
        report: View,
        modes: ModeSpace,
        dt: float,
        earlier: Sequence[Newborn] = (),
        looks: EarlierLooks | None = None,
    ) -> FloatArray:
        """Return the log intensity of undetected targets at each detection, shape (C, M).

        These targets appeared since the sensor's previous report, and the looks of other sensors in
        between missed them, see `EarlierLooks`. If the previous report is unknown, they appeared in
        the last `dt` seconds; if the report covers a sector, since the antenna's previous pass. The
        intensity is the product of the birth rate over the field of view, of p_D g^tau of each
        class, of the density of the range rate or the velocity, and of the probability that the
        scan's earlier reports missed the target. `earlier` has the newborn targets of these.
        """
        sensor = report.sensor
        since = self._unseen_s(report, modes, dt, looks)
        appeared = self.rate[:, None] * since / modes.interval_s
        likelihood = report.log_class_likelihood(modes.classes)
        # The intensity is zero for classes without births, and where an earlier radar has p_D = 1.
        with np.errstate(divide="ignore"):
            intensity: FloatArray = np.log(appeared / sensor.visibility.size) + likelihood
            if earlier:
                missed = missed_by([newborn.report for newborn in earlier], report.position, modes)
                intensity = intensity + np.log(missed)
        if (measured := report.range_rates) is not None:
            line = report.position - sensor.origin[0]
            toward = line / np.maximum(np.sqrt((line**2).sum(axis=1)), MIN_RANGE)[:, None]
            intensity = intensity + self.log_range_rate(toward, measured, sensor)
        velocities = None if report.detections.velocity is None else report.velocities
        if velocities is not None:
            # A velocity alone does not tell a new target from a false detection.
            intensity = intensity + velocities.log_clutter
        for zone in self.excluded:
            inside = zone.contains(report.position[:, :2])
            intensity = np.where(inside, -np.inf, intensity)
        return intensity

    @staticmethod
    def _unseen_s(
        report: View, modes: ModeSpace, dt: float, looks: EarlierLooks | None
    ) -> FloatArray | float:
        """Return the seconds in which such targets appeared, (C, M) or one for all detections.

        The seconds before each look count with the probability that the look missed a target.
        """
        if report.detections.coverage is not None:
            return report.sensor.rotation_s or dt
        if looks is None:
            return dt
        end_ns, since, missed = report.stamp_ns, np.zeros((1, 1)), np.ones((1, 1))
        for look in reversed(looks.others):
            since = since + 1e-9 * (end_ns - look.stamp_ns) * missed
            missed = missed * missed_by([look], report.position, modes)
            end_ns = look.stamp_ns
        return since + (end_ns - looks.first_ns) * 1e-9 * missed

    def stationary(self, slower: FloatArray, bound: float) -> FloatArray:
        """Return the probability of being stationary at even prior odds, given that of being slow.

        Without births at detections the prior at birth is unknown, and `slower` is returned
        unchanged. See `stationary.at_even_odds`.
        """
        return stationary.at_even_odds(slower, bound, self.velocity_std) if self.enabled else slower

    def log_range_rate(self, toward: FloatArray, measured: Rates, sensor: Sensor) -> FloatArray:
        """Return the log density of range rates of targets of unknown velocity, (M,); 0 for NaN.

        `toward` has the directions from the sensor to the targets, world frame, (M, P).
        """
        level = 1.0 if measured.level is None else measured.level
        radial = measured.rate + level * (toward @ sensor.origin[1])
        variance: FloatArray | float = (level * self.velocity_std) ** 2
        if toward.shape[1] > 2:
            variance = variance + toward[:, 2] ** 2 * (self.climb_std**2 - variance)
        return measured.model.log_density(radial, variance + measured.std**2)

    def rate_ratio(self, measured: Rates) -> FloatArray:
        """Return the ratio of the densities of targets' and of false range rates, (M,).

        It is at most 1, and that of a sensor at rest.
        """
        variance, model = self.velocity_std**2 + measured.std**2, measured.model
        density = np.exp(model.log_density(measured.rate, variance))
        return np.minimum(density * model.clutter_width, 1.0)


@dataclass(frozen=True)
class Newborn:
    """Possible new targets at the detections of one report."""

    report: View  # The report with these M detections
    mass: FloatArray  # Probability that each detection is a new target of each class, (M, C)
    row: IntArray  # Row of each among all detections of the report, (M,)

    def __len__(self) -> int:
        return len(self.mass)

    def take(self, rows: IntArray) -> Newborn:
        """Return the newborn targets of these rows."""
        return Newborn(self.report.take(rows), self.mass[rows], self.row[rows])


def missed_by(reports: Sequence[View], position: FloatArray, modes: ModeSpace) -> FloatArray:
    """Return the probability that reports miss a target at each position, (M, P) to (C, M).

    A sensor's probability is its mean over the SNR band of the class.
    """
    missed = np.ones((len(modes.classes), len(position)))
    for report in reports:
        sensor = report.sensor
        measured, _ = sensor.linearise(position)
        sector = report.detections.coverage
        covered = sensor.visibility.coverage_probability(measured, sector, sensor.noise_std)
        covered *= report.share
        log_p_d = report.log_detection_probability(measured, modes.classes)
        missed *= 1.0 - covered * np.exp(log_p_d)
    return missed
