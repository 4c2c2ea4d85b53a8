"""A report for the update: a sensor at its pose, its detections, and values computed from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import FloatArray, IntArray, ReadOnly, matches
from ..learned.detection_chains import LookPrediction
from ..targets.modes import ClassModel
from ..types import Coverage, Detections
from .gaussians import PlanePlots
from .range_rate import Rates
from .sensor import Sensor

if TYPE_CHECKING:
    # The module imports numba, which a program that only makes or reads reports does not need.
    from ..learned.antenna_pass import AntennaPass

# Smallest probability that earlier sectors have not detected a target.
LEAST_UNSEEN = 1e-3
# Rounding error of the sum of the probabilities of adjoining sectors.
ROUNDING = 1e-12
# Smallest distance of folds, in standard deviations of the noise, with which the noise of range
# rates can be learned. `evidence_of` uses innovations whose standard deviation is at most twice the
# noise's, so that the nearest fold is the true one up to three such deviations.
LEAST_FOLDS_APART = 12.0


@dataclass(frozen=True)
class EarlierSectors:
    """The adjoining sectors before a report, in the same pass of the antenna."""

    coverage: Coverage  # Their azimuths
    continued: AntennaPass  # The pass that the report continues

    def factor(
        self, label: IntArray, in_turn: FloatArray, measured: FloatArray
    ) -> FloatArray | None:
        """Return the factor on the probability of a detection, shape (N, ...).

        It is None if these sectors cannot have detected any of the targets. `label` has the label
        of each row's target, (N,), `in_turn` the probability that a whole turn detects the target,
        and `measured` the probability that it is measured in these sectors, (N, ...).

        An antenna passes a target once. If p_A and p_B are the probabilities that it is detected in
        the earlier sectors and in this one, it is detected in this one with p_B / (1 - p_A), given
        that the earlier ones have not detected it.
        """
        row, target = matches(self.continued.label, label)
        if not len(row) and measured.max(initial=0.0) <= LEAST_UNSEEN:
            return None
        unseen = np.ones(len(label))
        unseen[row] = np.maximum(self.continued.unseen[target], LEAST_UNSEEN)
        by_row = unseen.reshape(-1, *(1,) * (in_turn.ndim - 1))
        factor: FloatArray = by_row / np.maximum(1.0 - in_turn * measured, LEAST_UNSEEN)
        return factor


@dataclass(frozen=True)
class Report(ReadOnly):
    """Detections of one sensor, with the sensor at its pose; computed columns are cached."""

    sensor: Sensor  # At its pose, with its learned clutter
    detections: Detections  # M detections; a report without detections is valid
    stamp_ns: int = 0  # Stamp of the scan
    # Share of the detections that `detection_limit` has kept, if they have no amplitudes.
    share: float = 1.0
    complete: bool = True  # Whether the report has all detections of the sensor
    # The sectors before the report; None if it continues no pass of the antenna.
    earlier_sectors: EarlierSectors | None = None
    # Prediction from the sensor's last look at each target; None if its misses are independent.
    look_prediction: LookPrediction | None = None

    def __len__(self) -> int:
        return len(self.detections.measurement)

    def take(self, rows: IntArray) -> Report:
        """Return the report of these detections alone."""
        return self.changed(detections=self.detections.take(rows))

    def project_as(self, detections: Detections) -> Report:
        """Return the report with other projections of its detections."""
        return self if detections is self.detections else self.changed(detections=detections)

    @property
    def part_of_turn(self) -> float:
        """Part of a turn that the report covers; 0 if it is unknown."""
        coverage = self.detections.coverage
        return 1.0 if coverage is None else coverage.part_of_turn

    @property
    def turn_ns(self) -> float:
        """Duration of a turn if the report is of a sector, nanoseconds; otherwise 0."""
        sector = self.detections.coverage
        return 0.0 if sector is None or not sector.part_of_turn else 1e9 * self.sensor.rotation_s

    def detection_probability(
        self,
        label: IntArray,
        in_turn: FloatArray,
        measured_in: Callable[[Coverage], FloatArray],
    ) -> tuple[FloatArray, FloatArray | None]:
        """Return the probability that each target is detected, and the earlier sectors' factor.

        The factor is None if no earlier sector can have detected a target; see
        `EarlierSectors.factor`, also for `label` and `in_turn`. `measured_in` returns the
        probability that each target is measured in a sector.
        """
        sector, earlier = self.detections.coverage, self.earlier_sectors
        if sector is None:
            return in_turn, None
        measured = measured_in(sector)
        if earlier is None:
            return in_turn * measured, None
        before = measured_in(earlier.coverage)
        factor = earlier.factor(label, in_turn, before)
        # Sectors with estimated edges may overlap a little, but a target is measured once.
        probability = in_turn * np.minimum(measured, 1.0 + ROUNDING - before)
        return probability if factor is None else probability * factor, factor

    @property
    def informative_prediction(self) -> LookPrediction | None:
        """The prediction of the last looks; None if no detection depends on them."""
        prediction = self.look_prediction
        return prediction if prediction is not None and prediction.is_informative else None

    @cached_property
    def detection_std(self) -> FloatArray:
        """Standard deviations of each detection, shape (M, Z)."""
        return self.sensor.noise_std_of(self.detections)

    @property
    def sensors_own_std(self) -> FloatArray:
        """Standard deviations of the sensor, (M, Z); NaN where a detection has its own."""
        reported_std, std = self.detections.noise_std, self.detection_std
        return std if reported_std is None else np.where(np.isfinite(reported_std), np.nan, std)

    @cached_property
    def in_plane(self) -> PlanePlots:
        """The detections in the world frame, at their own times."""
        return self.sensor.in_plane(self.detections)

    @cached_property
    def position(self) -> FloatArray:
        """Position of each detection in the world frame, metres, shape (M, 2)."""
        return self.sensor.to_world(self.detections.measurement)

    @property
    def time_s(self) -> FloatArray:
        """Time of each detection relative to the stamp, seconds, shape (M,)."""
        times = self.detections.time_s
        return np.zeros(len(self)) if times is None else times

    @cached_property
    def range_rates(self) -> Rates | None:
        """Range rates of the detections; None without usable ones."""
        return self.sensor.rates_of(self.detections)

    def sensors_own_rate_std(self, rates: Rates) -> FloatArray:
        """Return the sensor's standard deviations of the detections' range rates, (M,).

        They are NaN where the noise cannot be learned: where the range rate is unknown or has its
        own standard deviation, and where folds are too close together.
        """
        model, reported_std = rates.model, self.detections.range_rate_std
        usable = np.isfinite(rates.rate)
        if reported_std is not None:
            usable &= ~np.isfinite(reported_std)
        if model.ambiguity:
            usable &= model.ambiguity >= LEAST_FOLDS_APART * rates.std
        return np.where(usable, rates.std, np.nan)

    @cached_property
    def _by_class(self) -> list[FloatArray]:
        return []

    def log_class_likelihood(self, classes: tuple[ClassModel, ...]) -> FloatArray:
        """Return the log likelihood of each class and detection, (C, M); computed once.

        See `Sensor.log_class_likelihood`. `classes` are the same for every call.
        """
        if not self._by_class:
            log_likelihood = self.sensor.log_class_likelihood(self.detections, classes)
            self._by_class.append(log_likelihood)
        return self._by_class[0]

    @property
    def log_clutter(self) -> FloatArray:
        """Log intensity of false detections at each detection, shape (M,)."""
        return self.sensor.log_clutter_intensity(self.detections)
