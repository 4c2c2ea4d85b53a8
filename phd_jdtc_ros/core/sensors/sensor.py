"""Base class of sensors, for engines: measurements, coverage, clutter, positions in the plane.

`polar_radar.RadarModel` is the only subclass. Engines, births, the region, clutter learning and the
reporting rule depend only on this class. A new kind of sensor implements the abstract members; the
other ones have defaults for a sensor that measures without a turning antenna, sees all targets and
has no learned map.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, TypeVar

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray, ReadOnly
from ..clutter.amplitude_law import NOISE, ClutterAmplitude
from ..clutter.map import ClutterMap
from ..clutter.multipath import Multipath
from ..clutter.rate import ClutterCount
from ..learned.correlation import Correlation
from ..learned.detection_factor import DetectionFactor
from ..learned.noise_factor import NoiseFactor
from ..learned.outliers import Outliers
from ..state_space import PLANAR, StateSpace
from ..targets import amplitude_density
from ..targets.modes import ClassModel
from ..types import Coverage, Detections, Pose
from . import polar_geometry
from .gaussians import PlanePlots, noise_covariance
from .of_gaussians.linearised import Linearised
from .polar_geometry import MIN_RANGE
from .range_rate import RangeRateModel, Rates
from .slant_range import HeightProjection

SensorT = TypeVar("SensorT", bound="Sensor")


@dataclass(frozen=True, kw_only=True)
class Sensor(ReadOnly, ABC):
    """A sensor at its pose, with models of its noise, its coverage and its clutter.

    Measurements have shape (..., Z), positions (..., 2) and states (..., D). Positions and states
    are in the world frame.
    """

    # True if its antenna may turn: the rotation is then estimated from the azimuths of detections.
    may_turn: ClassVar[bool] = False
    # Names of the components of a measurement.
    components: ClassVar[tuple[str, ...]] = ()

    name: str  # Also the sensor's frame
    position: tuple[float, float]  # In the world frame, metres
    yaw: float  # Direction of the sensor's x axis in the world frame, radians counter-clockwise
    threshold: float  # Detection threshold tau on the amplitude
    # Expected uniform false detections in the field of view per turn of the antenna, or per scan if
    # it does not turn; those at rejected ranges are included.
    clutter_rate: float
    # In the world frame, metres per second; range rates are relative to it.
    velocity: tuple[float, float] = (0.0, 0.0)
    space: StateSpace = PLANAR  # Axes of the measured states
    rotation_s: float = 0.0  # Rotation period of the antenna, seconds; 0 if it does not turn
    # Model of its range rates; None if it has none, or if they are not used.
    range_rate: RangeRateModel | None = None
    # Distance within which detections are merged, metres; 0 for none. See `detection_clusters`.
    cluster_distance: float = 0.0
    # Projection of its detections to the plane, given their heights; None if the measurements do
    # not depend on heights.
    height_projection: HeightProjection | None = None
    clutter_amplitude: ClutterAmplitude = NOISE  # Law of the amplitudes of false detections
    clutter_count: ClutterCount | None = None  # Learned clutter rate; None if the rate is given
    clutter_map: ClutterMap | None = None  # Learned map of false detections; None without a map
    # Detections of targets slower than this are learned as clutter, metres per second.
    clutter_map_speed: float = 0.0
    # Learned factor of its detection probability; None if the probability is known.
    detection_factor: DetectionFactor | None = None
    # Learned factors that its noise contains; None if the noise is known.
    noise_factor: NoiseFactor | None = None
    # Correlation of detections of a target in consecutive looks; None if they are independent.
    correlation: Correlation | None = None
    # Outliers among its measurements; None without any. The Gaussian engine uses them.
    outliers: Outliers | None = None
    # Smallest plausible noise of its components; no larger one is too large, (Z,). Zeros for any.
    least_std: tuple[float, ...] = (0.0, 0.0)
    # False detections behind the targets of a report; None if there are none.
    multipath: Multipath | None = None

    def at(self: SensorT, pose: Pose | None) -> SensorT:
        """Return the sensor at a pose; None keeps its pose."""
        if pose is None:
            return self
        return self.changed(position=pose.position, yaw=pose.yaw, velocity=pose.velocity)

    def scaled_noise(self, factor: NoiseFactor) -> dict[str, Any]:
        """Return the fields of its noise, with deviations multiplied by learned factors."""
        range_rate = self.range_rate
        if range_rate is None or not factor.learned[-1]:
            return {}
        return {"range_rate": replace(range_rate, std=float(factor.of_std[-1]) * range_rate.std)}

    @property
    def learns_figures(self) -> bool:
        """Whether figures of its detection or its noise are learned."""
        correlated = self.correlation is not None and self.correlation.learned
        return correlated or any((self.detection_factor, self.noise_factor, self.outliers))

    @property
    def clutter_share(self) -> float:
        """Share of its uniform clutter, `clutter_rate`, that is among its detections; above 0."""
        return 1.0

    @property
    def noise_components(self) -> tuple[str, ...]:
        """Names of the components whose noise may be learned, in the order of `NoiseFactor`."""
        return (*self.components, "range_rate")

    def with_known_targets(self: SensorT, measured: FloatArray, existence: FloatArray) -> SensorT:
        """Return the sensor with the false detections that the known targets cause.

        `measured` has the expected measurement of each target, (T, Z), and `existence` its
        existence probability, (T,).
        """
        if self.multipath is None:
            return self
        return self.changed(multipath=Multipath(measured, existence))

    @cached_property
    def of_gaussians(self) -> Linearised:
        """Its measurements of Gaussians; a subclass may have compiled ones."""
        return Linearised(self)

    @property
    @abstractmethod
    def noise_std(self) -> FloatArray:
        """Standard deviations of a measurement, (Z,)."""

    @abstractmethod
    def linearise(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the measurements of positions and their Jacobians, (..., Z) and (..., Z, 2)."""

    @abstractmethod
    def to_world(self, measurement: FloatArray) -> FloatArray:
        """Return the positions of measurements, (M, Z) to (M, 2)."""

    @abstractmethod
    def log_jacobian(self, measured: FloatArray) -> FloatArray:
        """Return log |dz/dp| at measurements: converts their density to one in the plane."""

    @abstractmethod
    def in_plane(self, detections: Detections) -> PlanePlots:
        """Return the detections as positions with covariances, for births and proposals."""

    @abstractmethod
    def draw_in_plane(self, detections: Detections, normal: FloatArray) -> FloatArray:
        """Return positions drawn from detections' noise, given (M, K, Z) normals; (M, K, 2)."""

    def noise_std_of(self, detections: Detections) -> FloatArray:
        """Return the standard deviations of each detection, its own or the sensor's, (M, Z)."""
        usual_std, reported_std = self.usual_noise_std(detections.measurement), detections.noise_std
        return (
            usual_std
            if reported_std is None
            else np.where(np.isfinite(reported_std), reported_std, usual_std)
        )

    def noise_covariance_of(self, detections: Detections) -> FloatArray:
        """Return the covariance of the noise of each detection, (M, Z, Z)."""
        return noise_covariance(self.noise_std_of(detections), detections.noise_correlation)

    def usual_noise_std(self, measurement: FloatArray) -> FloatArray:
        """Return the sensor's standard deviations of each measurement, (M, Z)."""
        return self.noise_std[None].repeat(len(measurement), axis=0)

    def measure(self, state: FloatArray) -> FloatArray:
        """Return the noise-free measurement of each state, (N, D) to (N, Z)."""
        return self.linearise(state[:, list(self.space.position)])[0]

    def measurement_rate(self, state: FloatArray) -> FloatArray:
        """Return the time derivative of each state's measurement, (N, D) to (N, Z)."""
        jacobian = self.linearise(state[:, list(self.space.position)])[1]
        return (jacobian @ state[:, list(self.space.velocity), None])[..., 0]

    def wrap(self, error: FloatArray) -> FloatArray:
        """Return differences of measurements, (..., Z), with wrapped angles."""
        return error

    @abstractmethod
    def gated_pairs(
        self, predicted: FloatArray, detections: Detections, rate: FloatArray | None = None
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the pairs of points and detections in the gate, with their log likelihoods."""

    def candidate_count(self, predicted: FloatArray, detections: Detections) -> int:
        """Return the number of candidate pairs of `gated_pairs`."""
        return len(predicted) * len(detections)

    @property
    def max_range(self) -> float:
        """Largest range of a detection, metres."""
        return math.inf

    @property
    def limits(self) -> tuple[IntArray, FloatArray]:
        """Intervals of components of a measurement in which targets are detected, (I, 2).

        The first array has the component of each, ascending, (I,). There are none if the sensor
        sees all targets.
        """
        return np.zeros(0, np.int64), np.zeros((0, 2))

    def is_nearly_normal(self, std: FloatArray) -> BoolArray:
        """Return whether expected measurements of Gaussians are nearly normal, (N, Z) to (N,).

        `std` has the standard deviations of the measurements.
        """
        return np.ones(len(std), dtype=np.bool_)

    def polar_place(self, measured: FloatArray) -> FloatArray:
        """Return ranges and azimuths of measurements from the sensor's position, (N, 2)."""
        return polar_geometry.measure(self.to_world(measured), self.position, self.yaw)

    def reachable(self, measured: FloatArray) -> FloatArray:
        """Return the measurements; those beyond the sensor's range are moved out of all gates."""
        return measured

    @property
    @abstractmethod
    def field_size(self) -> float:
        """Size of the field of view, in which unknown targets are uniform, in measurement units."""

    def coverage_probability(
        self, predicted: FloatArray, coverage: Coverage | None, std: FloatArray | None = None
    ) -> FloatArray:
        """Return the probability that a report covers each target, (N,).

        Only a covered target can be missed. A plot belongs to the sector of its measured azimuth.
        `predicted` has the predicted measurements, (N, Z), and `std` their standard deviations
        without the sensor's noise; None if the positions are certain.
        """
        return np.ones(len(predicted))

    def sector_probability(
        self, predicted: FloatArray, sector: Coverage, std: FloatArray | None = None
    ) -> FloatArray:
        """Return the probability that targets in the field of view are measured in a sector, (N,).

        For the parameters see `coverage_probability`.
        """
        return np.ones(len(predicted))

    def may_have_swept(
        self, position: FloatArray, radius: FloatArray, detections: Detections
    ) -> BoolArray:
        """Return a mask of the circles that the antenna may have swept for a report, (T,)."""
        return np.ones(len(position), dtype=np.bool_)

    @property
    def largest_detection_probability(self) -> float | None:
        """Largest configured p_D of covered targets; None if p_D follows from the SNR."""
        return None

    def configured_detection_probability(
        self, measured: FloatArray, std: FloatArray | None = None
    ) -> FloatArray | None:
        """Return the configured p_D of covered targets, (N,); None if it follows from the SNR.

        By default it is the largest one everywhere. `std` has the standard deviations of the
        measurements, (N, Z); None if they are certain.
        """
        largest = self.largest_detection_probability
        return None if largest is None else np.full(len(measured), largest)

    def learned_detection_probability(
        self, configured: FloatArray, measured: FloatArray
    ) -> FloatArray:
        """Return the learned p_D at measurements, (..., N), given the configured one."""
        if self.detection_factor is None:
            return configured
        return self.detection_factor.probability(configured, self.polar_place(measured))

    def miss_probability(self, log_snr: FloatArray) -> FloatArray:
        """Return 1 - p_D of targets of given ln(1 + SNR), where it is least."""
        if (largest := self.largest_detection_probability) is not None:
            return np.full_like(log_snr, 1.0 - largest)
        return -np.expm1(-0.5 * self.threshold**2 * np.exp(-log_snr))

    def class_detection_probability(self, classes: tuple[ClassModel, ...]) -> FloatArray:
        """Return p_D of each class from its signal-to-noise ratios, shape (C,)."""
        return np.array(
            [amplitude_density.detection_probability(self.threshold, c.snr_band) for c in classes]
        )

    def log_class_likelihood(
        self, detections: Detections, classes: tuple[ClassModel, ...]
    ) -> FloatArray:
        """Return log p_D,c g_c^tau(a) for every class and detection, shape (C, M).

        If p_D follows from the classes' signal-to-noise ratios, the product p_D g^tau is g_c
        itself; see `log_detected`.
        """
        log_p_d = np.log(self.class_detection_probability(classes))[:, None]
        amplitude, density = detections.amplitude, None
        if amplitude is not None:
            bands = (target_class.snr_band for target_class in classes)
            log_density = amplitude_density.log_target_density
            density = np.stack([log_density(amplitude, band) for band in bands])
        log_likelihood = self.log_detected(log_p_d, density, detections.measurement)
        # A configured probability is the same for all classes and has no axis for them.
        return np.zeros((len(classes), len(detections))) + log_likelihood

    def log_detected(
        self, log_p_d: FloatArray, log_density: FloatArray | None, measurement: FloatArray
    ) -> FloatArray:
        """Return log p_D g^tau(a) of detections, or log p_D where the amplitude is unknown.

        `log_p_d` and `log_density` are log p_D and log p_D g^tau(a) as they follow from the SNR,
        which can be broadcast to (..., M). The density is NaN for unknown amplitudes, and None
        without amplitudes. A configured or learned p_D at the measurements replaces that of the
        SNR.
        """
        from_snr, configured = log_p_d, self.configured_detection_probability(measurement)
        if configured is not None:
            log_p_d = np.log(configured)
        if self.detection_factor is not None:
            log_p_d = np.log(self.learned_detection_probability(np.exp(log_p_d), measurement))
        if log_density is None:
            return log_p_d
        if log_p_d is not from_snr:
            log_density = log_density + (log_p_d - from_snr)
        return np.where(np.isnan(log_density), log_p_d, log_density)

    def line_of_sight(self, position: FloatArray) -> FloatArray:
        """Return unit vectors from the sensor to positions, world frame, (N, 2)."""
        return polar_geometry.line_of_sight(position, self.position)[0]

    def rates_of(self, detections: Detections) -> Rates | None:
        """Return the range rates of detections; None without usable ones."""
        model, rate = self.range_rate, detections.range_rate
        if model is None or rate is None:
            return None
        reported_std = detections.range_rate_std
        usual_std = np.full(len(detections), model.std)
        return Rates(
            model,
            rate,
            usual_std
            if reported_std is None
            else np.where(np.isfinite(reported_std), reported_std, usual_std),
        )

    def range_rate_of(self, state: FloatArray, time_s: FloatArray | None = None) -> FloatArray:
        """Return the noise-free range rate of each state, m/s; shape (N, D) to (N,).

        `time_s` has the time of each measurement relative to the stamp of the states, seconds,
        (N,).
        """
        velocity = state[:, list(self.space.velocity)]
        line = state[:, list(self.space.position)] - np.asarray(self.position)
        if time_s is not None:
            line = line + time_s[:, None] * velocity
        distance = np.maximum(np.sqrt((line**2).sum(axis=1)), MIN_RANGE)
        radial: FloatArray = (line * (velocity - self.velocity)).sum(axis=1) / distance
        return radial

    def log_range_rate(
        self, state: FloatArray, detections: Detections, pairs: tuple[IntArray, IntArray]
    ) -> FloatArray | float:
        """Return the log likelihood of the range rates of pairs, (P,); 0 for unknown ones.

        The pairs are of rows of the states, (N, D), and detections.
        """
        measured = self.rates_of(detections)
        if measured is None:
            return 0.0
        error = self.range_rate_error(state, detections, measured, pairs)
        return measured.model.log_density(error, measured.std[pairs[1]] ** 2)

    def range_rate_error(
        self,
        state: FloatArray,
        detections: Detections,
        measured: Rates,
        pairs: tuple[IntArray, IntArray],
    ) -> FloatArray:
        """Return the measured less the expected range rates of pairs, (P,); NaN for unknown ones.

        For the parameters see `log_range_rate`.
        """
        row, column = pairs
        if detections.time_s is None:
            expected = self.range_rate_of(state)[row]
        else:
            expected = self.range_rate_of(state[row], detections.time_s[column])
        error: FloatArray = measured.rate[column] - expected
        return error

    @property
    @abstractmethod
    def log_uniform_clutter(self) -> float:
        """Log intensity of uniform false detections, in measurement units."""

    def log_clutter_factor(self, measurement: FloatArray) -> FloatArray:
        """Return the log ratio of all clutter to the uniform one, (M,); 0 if it is uniform."""
        return np.zeros(len(measurement))

    def neighbourhood_density(self, measurement: FloatArray, world: FloatArray) -> FloatArray:
        """Return the detections per turn around places in the clutter map, (M,)."""
        return np.zeros(len(measurement))

    def log_clutter_intensity(self, detections: Detections) -> FloatArray:
        """Return the log intensity of false detections at each detection, shape (M,).

        For an unknown amplitude or range rate it is the intensity over the other components.
        """
        log_intensity = self.log_uniform_clutter + self.log_clutter_factor(detections.measurement)
        if (measured := self.rates_of(detections)) is not None:
            log_width = np.log(measured.model.clutter_width)
            log_intensity -= np.where(np.isnan(measured.rate), 0.0, log_width)
        if detections.amplitude is None:
            return log_intensity
        density: FloatArray = (
            log_intensity
            + self.clutter_amplitude.log_density(detections.amplitude)
            - self.clutter_amplitude.log_share(self.threshold)
        )
        return np.where(np.isnan(density), log_intensity, density)
