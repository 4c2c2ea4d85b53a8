"""A report as the update sees it: a sensor at its pose, its detections, and what is expected.

The factors of the sensor, see `factors.factor`, fill in what they know: the noise and the rate of
false detections, the law of their amplitudes, where else they are expected, a learned detection
probability, and what earlier looks show of each target.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray, ReadOnly
from ..targets import amplitude_density
from ..targets.modes import ClassModel
from ..types import Coverage, Detections
from .gaussians import Heights
from .range_rate import Rates, Velocities
from .sensor import Sensor

# Rounding error of the sum of the probabilities of adjoining sectors.
ROUNDING = 1e-12


class AmplitudeLaw(Protocol):
    """A distribution of the envelopes of false detections."""

    def log_density(self, amplitude: FloatArray) -> FloatArray:
        """Return the log density of envelopes, elementwise; NaN for NaN."""

    def log_share(self, threshold: float, above: float = 0.0) -> float:
        """Return log P(a > threshold | a > above)."""


class NoiseEnvelopes:
    """Envelopes of the receiver's noise."""

    def log_density(self, amplitude: FloatArray) -> FloatArray:
        """Return the log density of envelopes, elementwise."""
        return amplitude_density.log_clutter_density(amplitude)

    def log_share(self, threshold: float, above: float = 0.0) -> float:
        """Return log P(a > threshold | a > above)."""
        return -0.5 * (threshold**2 - above**2)


class RangeLaw(Protocol):
    """A density of false detections over range."""

    def log_ratio(self, distance: FloatArray) -> FloatArray:
        """Return the log ratio of the density at ranges, metres, to the uniform one, (M,)."""


class LocalClutter(Protocol):
    """False detections at certain places, besides those that are everywhere."""

    def log_factor(self, log_factor: FloatArray, measurement: FloatArray, view: View) -> FloatArray:
        """Return the log ratio of clutter to that which is everywhere at measurements, (M,).

        `log_factor` is the ratio without these false detections.
        """


class FixedClutter(Protocol):
    """False detections that return from the same places in every revolution."""

    @property
    def speed(self) -> float:
        """Targets slower than this are such clutter, metres per second."""

    def around(self, view: View, measured: FloatArray, world: FloatArray) -> FloatArray:
        """Return the detections per revolution around places beyond uniform clutter, (M,).

        `measured` has the measurements of the places, (M, Z), and `world` their positions, metres,
        (M, 2). The result is infinite outside the field of view.
        """


class LearnedDetection(Protocol):
    """A detection probability relative to the configured one."""

    @property
    def mean(self) -> float:
        """Ratio for the sensor as a whole."""

    def probability(self, configured: FloatArray, place: FloatArray) -> FloatArray:
        """Return the probabilities at (range, azimuth), given the configured ones, (..., N)."""


class NoiseEstimate(Protocol):
    """The noise of a sensor while it is learned."""

    @property
    def learned(self) -> BoolArray:
        """Components whose noise is learned, (Z,)."""

    @property
    def certainty(self) -> float:
        """Certainty of the learned noise, from 0 to 1."""


class EarlierSectors(Protocol):
    """The adjoining sectors before a report, in the same pass of the antenna."""

    @property
    def coverage(self) -> Coverage:
        """Their azimuths."""

    def factor(
        self, label: IntArray, in_revolution: FloatArray, measured: FloatArray
    ) -> FloatArray | None:
        """Return the factor on the probability of a detection, shape (N, ...).

        It is None if these sectors cannot have detected any of the targets. `label` has the label
        of each row's target, (N,), `in_revolution` the probability that a whole revolution detects
        the target, and `measured` the probability that it is measured in these sectors, (N, ...).
        """


class LookPrediction(Protocol):
    """What the sensor's last look at each target shows about the next one."""

    @property
    def is_informative(self) -> bool:
        """Whether the next look depends on the previous one."""

    def of(self, label: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return l and d by label: a detection has the probability p (1 - l) + d, each (N,)."""

    def usual(self, probability: FloatArray, label: IntArray) -> FloatArray:
        """Return the usual probabilities p, given those of the next look, (N,)."""


NOISE = NoiseEnvelopes()


@dataclass(frozen=True)
class View(ReadOnly):
    """Detections of one sensor, with the sensor at its pose; computed columns are cached."""

    sensor: Sensor  # At its pose, with its learned noise
    detections: Detections  # M detections; a report without detections is valid
    # Expected uniform false detections in the field of view per revolution of the antenna, or per
    # scan if it does not turn; those at rejected ranges are included.
    clutter_rate: float
    stamp_ns: int = 0  # Stamp of the scan
    # Share of the detections that are used, if they have no amplitudes; see `factors.limit`.
    share: float = 1.0
    complete: bool = True  # Whether all detections of the sensor are used
    clutter_amplitude: AmplitudeLaw = NOISE  # Law of the amplitudes of false detections
    clutter_ranges: RangeLaw | None = None  # Their density over range; None if it is uniform
    local_clutter: tuple[LocalClutter, ...] = ()  # False detections at certain places
    fixed_clutter: FixedClutter | None = None  # None if its places are not known
    detection: LearnedDetection | None = None  # None if the detection probability is known
    noise: NoiseEstimate | None = None  # None if the noise is known
    # The sectors before the report; None if it continues no pass of the antenna.
    earlier_sectors: EarlierSectors | None = None
    # Prediction from the sensor's last look at each target; None if its misses are independent.
    look_prediction: LookPrediction | None = None

    @staticmethod
    def of(sensor: Sensor, detections: Detections, stamp_ns: int = 0, share: float = 1.0) -> View:
        """Return a report of a sensor at its pose, of which nothing has been learned."""
        if detections.area is not None:
            sensor = sensor.changed(visibility=sensor.visibility.of(detections))
        return View(sensor, detections, sensor.clutter_rate, stamp_ns, share)

    def __len__(self) -> int:
        return len(self.detections.measurement)

    def take(self, rows: IntArray) -> View:
        """Return the report of these detections alone."""
        return self.changed(detections=self.detections.take(rows))

    def project_as(self, detections: Detections) -> View:
        """Return the report with other projections of its detections."""
        return self if detections is self.detections else self.changed(detections=detections)

    @property
    def part_of_revolution(self) -> float:
        """Part of a revolution that the report covers; 0 if it is unknown."""
        coverage = self.detections.coverage
        return 1.0 if coverage is None else coverage.part_of_revolution

    @property
    def revolution_ns(self) -> float:
        """Duration of a revolution if the report is of a sector, nanoseconds; otherwise 0."""
        sector = self.detections.coverage
        return (
            0.0 if sector is None or not sector.part_of_revolution else 1e9 * self.sensor.rotation_s
        )

    def detection_probability(
        self,
        label: IntArray,
        in_revolution: FloatArray,
        measured_in: Callable[[Coverage], FloatArray],
    ) -> tuple[FloatArray, FloatArray | None]:
        """Return the probability that each target is detected, and the earlier sectors' factor.

        The factor is None if no earlier sector can have detected a target; see
        `EarlierSectors.factor`, also for `label` and `in_revolution`. `measured_in` returns the
        probability that each target is measured in a sector.
        """
        sector, earlier = self.detections.coverage, self.earlier_sectors
        if sector is None:
            return in_revolution, None
        measured = measured_in(sector)
        if earlier is None:
            return in_revolution * measured, None
        before = measured_in(earlier.coverage)
        factor = earlier.factor(label, in_revolution, before)
        # Sectors with estimated edges may overlap a little, but a target is measured once.
        probability = in_revolution * np.minimum(measured, 1.0 + ROUNDING - before)
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
    def position(self) -> FloatArray:
        """Position of each detection in the world frame, metres, shape (M, 2)."""
        return self.sensor.to_world(self.detections.measurement)

    @property
    def time_s(self) -> FloatArray:
        """Time of each detection relative to the stamp, seconds, shape (M,)."""
        times = self.detections.time_s
        return np.zeros(len(self)) if times is None else times

    @cached_property
    def _motion(self) -> Rates | Velocities | None:
        return self.sensor.motion_of(self.detections)

    @property
    def range_rates(self) -> Rates | None:
        """Range rates of the detections; None without usable ones."""
        motion = self._motion
        return motion if isinstance(motion, Rates) else None

    @property
    def velocities(self) -> Velocities | None:
        """Velocities of the detections in the world frame; None without usable ones."""
        motion = self._motion
        return motion if isinstance(motion, Velocities) else None

    @cached_property
    def heights(self) -> Heights | None:
        """Heights of the detections as measurements of z; None without any."""
        own = self.sensor.reported_heights
        return None if own is None else own.of(self.detections)

    def sensors_own_rate_std(self, rates: Rates) -> FloatArray:
        """Return the sensor's standard deviations of the detections' range rates, (M,).

        They are NaN where the noise cannot be learned: where the range rate is unknown, has its own
        standard deviation or what a climb can add, and where folds are too close together.
        """
        model, reported_std = rates.model, self.detections.range_rate_std
        usable = np.isfinite(rates.rate) & (rates.std == model.std)
        if reported_std is not None:
            usable &= ~np.isfinite(reported_std)
        if model.ambiguity:
            # Smallest distance of folds, in standard deviations of the noise, with which the noise
            # of range rates can be learned. `evidence_of` uses innovations whose standard deviation
            # is at most twice the noise's, so that the nearest fold is the true one up to three
            # such deviations.
            least_folds_apart = 12.0
            usable &= model.ambiguity >= least_folds_apart * rates.std
        return np.where(usable, rates.std, np.nan)

    @cached_property
    def _by_class(self) -> list[FloatArray]:
        return []

    def log_class_likelihood(self, classes: tuple[ClassModel, ...]) -> FloatArray:
        """Return log p_D,c g_c^tau(a) of each class and detection, (C, M); computed once.

        `classes` are the same for every call. If p_D follows from the classes' signal-to-noise
        ratios, the product p_D g^tau is g_c itself; see `log_detected`.
        """
        if not self._by_class:
            amplitude, density = self.detections.amplitude, None
            if amplitude is not None:
                bands = (target_class.snr_band for target_class in classes)
                log_density = amplitude_density.log_target_density
                density = np.stack([log_density(amplitude, band) for band in bands])
            self._by_class.append(self._log_detected(classes, density, self.detections.measurement))
        return self._by_class[0]

    def log_detection_probability(
        self, measured: FloatArray, classes: tuple[ClassModel, ...]
    ) -> FloatArray:
        """Return log p_D of each class at measurements, which are covered, (M, Z) to (C, M)."""
        return self._log_detected(classes, None, measured)

    def _log_detected(
        self, classes: tuple[ClassModel, ...], density: FloatArray | None, measured: FloatArray
    ) -> FloatArray:
        by_class = amplitude_density.of_classes(self.sensor.threshold, classes)
        log_likelihood = self.log_detected(np.log(by_class)[:, None], density, measured)
        # A configured probability is the same for all classes and has no axis for them.
        return np.zeros((len(classes), len(measured))) + log_likelihood

    def log_detected(
        self, log_p_d: FloatArray, log_density: FloatArray | None, measurement: FloatArray
    ) -> FloatArray:
        """Return log p_D g^tau(a) of detections, or log p_D where the amplitude is unknown.

        `log_p_d` and `log_density` are log p_D and log p_D g^tau(a) as they follow from the SNR,
        which can be broadcast to (..., M). The density is NaN for unknown amplitudes, and None
        without amplitudes. A configured or learned p_D at the measurements replaces that of the
        SNR.
        """
        from_snr, sensor = log_p_d, self.sensor
        configured = sensor.visibility.detection_probability(measurement)
        if configured is not None:
            log_p_d = np.log(configured)
        if self.detection is not None:
            log_p_d = np.log(self.detection_probability_at(np.exp(log_p_d), measurement))
        if log_density is None:
            return log_p_d
        if log_p_d is not from_snr:
            log_density = log_density + (log_p_d - from_snr)
        return np.where(np.isnan(log_density), log_p_d, log_density)

    def detection_probability_at(self, configured: FloatArray, measured: FloatArray) -> FloatArray:
        """Return the learned p_D at measurements, (..., N), given the configured one."""
        if self.detection is None:
            return configured
        return self.detection.probability(configured, self.sensor.visibility.place(measured))

    @property
    def log_uniform_clutter(self) -> float:
        """Mean log intensity of false detections without local ones, in measurement units."""
        return self.sensor.visibility.log_clutter(self.clutter_rate)

    def clutter_ratio(self, measurement: FloatArray) -> FloatArray | float:
        """Return the ratio of clutter without local one to its mean, (M,); 1 if it is uniform."""
        if self.clutter_ranges is None:
            return 1.0
        distance = self.sensor.visibility.place(measurement)[:, 0]
        return np.exp(self.clutter_ranges.log_ratio(distance))

    def log_place_clutter(self, measurement: FloatArray) -> FloatArray:
        """Return the log intensity of false detections over the places of measurements, (M,)."""
        log_intensity = self.log_uniform_clutter + self.log_clutter_factor(measurement)
        if self.clutter_ranges is not None:
            distance = self.sensor.visibility.place(measurement)[:, 0]
            log_intensity += self.clutter_ranges.log_ratio(distance)
        return log_intensity

    def log_clutter_factor(self, measurement: FloatArray) -> FloatArray:
        """Return the log ratio of all clutter to that without local one, (M,)."""
        log_factor = np.zeros(len(measurement))
        for clutter in self.local_clutter:
            log_factor = clutter.log_factor(log_factor, measurement, self)
        return log_factor

    @property
    def log_clutter(self) -> FloatArray:
        """Log intensity of false detections at each detection, shape (M,).

        For an unknown amplitude, range rate or velocity it is the intensity over the other
        components.
        """
        detections = self.detections
        log_intensity = self.log_place_clutter(detections.measurement)
        if (measured := self.range_rates) is not None:
            log_width = np.log(measured.model.clutter_width)
            log_intensity -= np.where(np.isnan(measured.rate), 0.0, log_width)
        velocities = None if detections.velocity is None else self.velocities
        if velocities is not None:
            log_intensity += velocities.log_clutter
        if detections.amplitude is None:
            return log_intensity
        law = self.clutter_amplitude
        density: FloatArray = (
            log_intensity
            + law.log_density(detections.amplitude)
            - law.log_share(self.sensor.threshold)
        )
        return np.where(np.isnan(density), log_intensity, density)
