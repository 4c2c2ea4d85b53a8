"""The polar radar: geometry, detection probability, clutter, and the gated likelihood."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray, wrap_angle
from ..clutter.amplitude_law import NOISE, ClutterAmplitude
from ..clutter.grid import GroundGrid
from ..clutter.map import ClutterMap
from ..clutter.rate import ClutterCount
from ..state_space import PLANAR, StateSpace
from ..targets import amplitude_density
from ..targets.modes import ClassModel
from ..types import FULL_TURN, Coverage, Detections, Pose
from . import polar_gate, polar_geometry
from .polar_gate import GATE_SIGMA
from .polar_geometry import LEAST_RANGE
from .range_rate import RangeRateModel, Rates
from .sensor import PlanePlots, Sensor
from .slant_range import HeightReading
from .visibility import Visibility, within


@dataclass(frozen=True)
class RadarModel:
    """One radar: its pose, its measurement noise, its coverage and its clutter.

    Parameters
    ----------
    name : str
        Also the radar's frame.
    position : tuple of two floats
        In the world frame, metres.
    yaw : float
        Direction of the sensor's x axis in the world frame, radians counter-clockwise.
    range_std, azimuth_std : float
        Standard deviations of the measurement noise, metres and radians.
    visibility : Visibility
        Field of view, and the detection probability if it is given.
    clutter_rate : float
        Expected false detections per scan.
    clutter_max_range : float
        Largest range of the uniform clutter, metres.
    threshold : float
        Detection threshold tau on the amplitude.
    space : StateSpace
        Axes of the measured states.
    range_growth : float
        Additional standard deviation of the range, metres per metre of range.
    rotation_s : float
        Time of one turn of the antenna, seconds; 0 if it does not turn.
    clutter_amplitude : ClutterAmplitude
        Law of the amplitudes of false detections.
    clutter_map : ClutterMap or None
        Learned map of false detections; None without a map.
    clutter_count : ClutterCount or None
        Learned clutter rate; None if the rate is given.
    clutter_map_speed : float
        Detections of targets slower than this count as clutter for the map, metres per second.
    range_rate : RangeRateModel or None
        Model of its range rates; None if it has none, or if they are not used.
    velocity : tuple of two floats
        In the world frame, metres per second; range rates are relative to it.
    cluster_distance : float
        Distance within which detections are merged, metres; 0 for none. See `detection_clusters`.
    height_reading : HeightReading or None
        Dependence of ground ranges on heights; None if they do not depend on them.

    Notes
    -----
    Sec. V, observation equation. Deviation: the arctangent has four quadrants, and innovations are
    wrapped.
    """

    name: str
    position: tuple[float, float]
    yaw: float
    range_std: float
    azimuth_std: float
    visibility: Visibility
    clutter_rate: float
    clutter_max_range: float
    threshold: float
    space: StateSpace = PLANAR
    range_growth: float = 0.0
    rotation_s: float = 0.0
    clutter_amplitude: ClutterAmplitude = NOISE
    clutter_map: ClutterMap | None = None
    clutter_map_speed: float = 0.0
    range_rate: RangeRateModel | None = None
    velocity: tuple[float, float] = (0.0, 0.0)
    cluster_distance: float = 0.0
    clutter_count: ClutterCount | None = None
    height_reading: HeightReading | None = None

    @property
    def max_range(self) -> float:
        """Largest range, metres: targets are not detected and detections are rejected beyond."""
        return self.visibility.max_range

    def at(self, pose: Pose | None) -> RadarModel:
        """Return the radar at a pose; None keeps its pose."""
        if pose is None:
            return self
        return replace(self, position=pose.position, yaw=pose.yaw, velocity=pose.velocity)

    @property
    def polar(self) -> bool:
        """True: it measures range and azimuth from its position."""
        return True

    @property
    def field_size(self) -> float:
        """Size of its field of view, radians times metres."""
        return self.visibility.fov.width * self.max_range

    def turning_in(self, rotation_s: float) -> RadarModel:
        """Return the radar with another period of its antenna, seconds."""
        return replace(self, rotation_s=rotation_s)

    def with_clutter(
        self,
        amplitude: ClutterAmplitude | None = None,
        places: ClutterMap | None = None,
        count: ClutterCount | None = None,
    ) -> RadarModel:
        """Return the radar with learned clutter; None keeps a model."""
        return replace(
            self,
            clutter_amplitude=self.clutter_amplitude if amplitude is None else amplitude,
            clutter_map=self.clutter_map if places is None else places,
            clutter_count=self.clutter_count if count is None else count,
            clutter_rate=self.clutter_rate if count is None else count.rate,
        )

    def limited(self, threshold: float, clutter_rate: float) -> RadarModel:
        """Return the radar with another threshold and clutter rate."""
        return replace(self, threshold=threshold, clutter_rate=clutter_rate)

    def measure(self, state: FloatArray) -> FloatArray:
        """Return noise-free (range, azimuth) of each state; shape (N, D) to (N, 2)."""
        position = state[:, list(self.space.position)]
        return polar_geometry.measure(position, self.position, self.yaw)

    def linearise(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (range, azimuth) of positions and Jacobians; see `polar_geometry.linearise`."""
        return polar_geometry.linearise(position, self.position, self.yaw)

    def wrap(self, error: FloatArray) -> FloatArray:
        """Return differences of (range, azimuth) with wrapped azimuths; (..., 2)."""
        wrapped: FloatArray = np.stack([error[..., 0], wrap_angle(error[..., 1])], axis=-1)
        return wrapped

    def reachable(self, measured: FloatArray) -> FloatArray:
        """Return (range, azimuth) with ranges beyond the radar's set to infinity."""
        inside: FloatArray = measured.copy()
        inside[inside[:, 0] > self.max_range, 0] = np.inf
        return inside

    def to_world(self, measurement: FloatArray) -> FloatArray:
        """Return world (x, y) in metres of (range, azimuth) rows; shape (M, 2)."""
        return polar_geometry.to_plane(measurement, self.position, self.yaw)

    def in_plane(self, detections: Detections) -> PlanePlots:
        """Return detections as positions with covariances, at their own times."""
        measured = detections.measurement
        sides = polar_geometry.error_axes(measured, self.deviations(detections), self.yaw)
        return PlanePlots(self.to_world(measured), *sides)

    def drawn_in_plane(self, detections: Detections, normal: FloatArray) -> FloatArray:
        """Return positions drawn from detections' noise, given (M, K, 2) normals; (M, K, 2)."""
        measured = (
            detections.measurement[:, None, :] + normal * self.deviations(detections)[:, None]
        )
        measured[..., 0] = np.abs(measured[..., 0])
        return self.to_world(measured.reshape(-1, 2)).reshape(measured.shape)

    def log_jacobian(self, measured: FloatArray) -> FloatArray:
        """Return log |dz/dp| at (range, azimuth), the log of one over the range; shape (N,)."""
        log_determinant: FloatArray = -np.log(np.maximum(measured[:, 0], LEAST_RANGE))
        return log_determinant

    def line_of_sight(self, position: FloatArray) -> FloatArray:
        """Return unit vectors from the radar to positions, world frame, shape (N, 2)."""
        return polar_geometry.line_of_sight(position, self.position)[0]

    @cached_property
    def noise_std(self) -> FloatArray:
        """Standard deviations of (range, azimuth), shape (2,)."""
        return np.array([self.range_std, self.azimuth_std])

    def detection_noise(self, detections: Detections) -> FloatArray | None:
        """Return the standard deviations of each detection, (M, 2); None if all have `noise_std`.

        Without a standard deviation of its own, a detection has one that grows with the range.
        """
        own = detections.noise_std
        if own is None and self.range_growth == 0.0:
            return None
        grown = np.hypot(self.range_std, self.range_growth * detections.measurement[:, 0])
        usual = np.stack([grown, np.full(len(detections), self.azimuth_std)], axis=1)
        return usual if own is None else np.where(np.isfinite(own), own, usual)

    def deviations(self, detections: Detections) -> FloatArray:
        """Return the standard deviations of each detection, shape (M, 2)."""
        own = self.detection_noise(detections)
        return np.tile(self.noise_std, (len(detections), 1)) if own is None else own

    def rates_of(self, detections: Detections) -> Rates | None:
        """Return the range rates of detections; None without usable ones."""
        model, rate = self.range_rate, detections.range_rate
        if model is None or rate is None:
            return None
        own = detections.range_rate_std
        usual = np.full(len(detections), model.std)
        return Rates(model, rate, usual if own is None else np.where(np.isfinite(own), own, usual))

    def range_rate_of(self, state: FloatArray, time_s: FloatArray | None = None) -> FloatArray:
        """Return the noise-free range rate of each state, m/s; shape (N, D) to (N,).

        Parameters
        ----------
        state : array of shape (N, D)
            At the scan's stamp.
        time_s : array of shape (N,) or None
            Time of each measurement relative to the stamp, seconds.
        """
        velocity = state[:, list(self.space.velocity)]
        line = state[:, list(self.space.position)] - np.asarray(self.position)
        if time_s is not None:
            line = line + time_s[:, None] * velocity
        distance = np.maximum(np.sqrt((line**2).sum(axis=1)), LEAST_RANGE)
        radial: FloatArray = (line * (velocity - self.velocity)).sum(axis=1) / distance
        return radial

    def log_range_rate(
        self, state: FloatArray, detections: Detections, pairs: tuple[IntArray, IntArray]
    ) -> FloatArray | float:
        """Return the log likelihood of the range rates of pairs, (P,); 0 for unknown ones.

        Parameters
        ----------
        state : array of shape (N, D)
        detections : Detections
        pairs : tuple of two int arrays of shape (P,)
            Rows of the states, and detections.
        """
        measured = self.rates_of(detections)
        if measured is None:
            return 0.0
        row, column = pairs
        if detections.time_s is None:
            expected = self.range_rate_of(state)[row]
        else:
            expected = self.range_rate_of(state[row], detections.time_s[column])
        error = measured.rate[column] - expected
        return measured.model.log_density(error, measured.std[column] ** 2)

    def given_detection_probability(self, measured: FloatArray) -> FloatArray | None:
        """Return the configured p_D at (range, azimuth), (N,); None without one."""
        return self.visibility.probability(measured[:, 0]) if self.visibility.given else None

    def miss_probability(self, log_snr: FloatArray) -> FloatArray:
        """Return 1 - p_D of targets by ln(1 + SNR), at the range of the best p_D; shape kept."""
        if self.visibility.given:
            return np.full_like(log_snr, 1.0 - max(self.visibility.probabilities))
        missed: FloatArray = -np.expm1(-0.5 * self.threshold**2 * np.exp(-log_snr))
        return missed

    def class_detection_probability(self, classes: tuple[ClassModel, ...]) -> FloatArray:
        """Return p_D of each class from its signal-to-noise ratios, shape (C,)."""
        return np.array(
            [amplitude_density.detection_probability(self.threshold, c.snr_band) for c in classes]
        )

    def missable(
        self,
        predicted: FloatArray,
        coverage: Coverage | None,
        azimuth_std: FloatArray | float | None = None,
    ) -> FloatArray:
        """Return the probability that a report covers each target, (N,).

        Parameters
        ----------
        predicted : array of shape (N, 2)
            Predicted measurements of the targets.
        coverage : Coverage or None
            Coverage of the report. A plot belongs to the sector of its measured azimuth.
        azimuth_std : array of shape (N,), float or None
            Standard deviation of the predicted azimuth, radians; None for the radar's own noise, if
            the positions are certain.
        """
        seen = self.visibility.sees(predicted)
        if coverage is not None:
            std = self.azimuth_std if azimuth_std is None else azimuth_std
            seen *= within(predicted[:, 1], coverage, std)
        return seen

    def log_clutter_intensity(self, detections: Detections) -> FloatArray:
        """Return log kappa(z) over (range, azimuth, range rate, amplitude), shape (M,).

        For an unknown amplitude or range rate it is the intensity over the other components.
        """
        area = FULL_TURN * self.clutter_max_range
        log_intensity = np.full(len(detections), np.log(self._rate_of_turn / area))
        log_intensity += self.log_clutter_factor(detections.measurement)
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

    def log_clutter_factor(self, measurement: FloatArray) -> FloatArray:
        """Return the log ratio of all clutter to the uniform one at (range, azimuth), (M,).

        It is 0 without a clutter map.
        """
        if self.clutter_map is None:
            return np.zeros(len(measurement))
        world = self.to_world(measurement)
        uniform = self._rate_of_turn, self.clutter_max_range
        return self.clutter_map.log_factor(measurement, world, *uniform)

    def neighbourhood_density(self, measurement: FloatArray, world: FloatArray) -> FloatArray:
        """Return the detections per turn around places in the radar's clutter map, (M,).

        Places outside the field of view have infinite density, except for a moving radar.

        Parameters
        ----------
        measurement, world : arrays of shape (M, 2)
            See `ClutterMap.about`.
        """
        if self.clutter_map is None:
            return np.zeros(len(measurement))
        uniform = self._rate_of_turn, self.clutter_max_range
        about = self.clutter_map.about(measurement, world, *uniform)
        if isinstance(self.clutter_map.grid, GroundGrid):
            return about
        return np.where(self.visibility.sees(measurement) > 0.0, about, np.inf)

    @property
    def _rate_of_turn(self) -> float:
        """Expected uniform clutter of a whole turn, scaled up from the field of view; above 0."""
        # A rate of zero is allowed; the floor keeps the update's quotient defined.
        rate = max(self.clutter_rate, np.finfo(float).tiny)
        return rate * FULL_TURN / self.visibility.fov.width

    def log_class_likelihood(
        self, detections: Detections, classes: tuple[ClassModel, ...]
    ) -> FloatArray:
        """Return log p_D,c g_c^tau(a) for every class and detection, shape (C, M).

        Notes
        -----
        If p_D follows from the classes' signal-to-noise ratios, the product p_D g^tau is g_c
        itself. A configured p_D is evaluated at the detection's range. For an unknown amplitude the
        result is log p_D,c.
        """
        log_band = np.log(self.class_detection_probability(classes))[:, None]
        log_p_d = np.repeat(log_band, len(detections), axis=1)
        if self.visibility.given:
            log_p_d[:] = np.log(self.visibility.probability(detections.measurement[:, 0]))
        if detections.amplitude is None:
            return log_p_d
        density = np.stack(
            [
                amplitude_density.log_target_density(detections.amplitude, c.snr_band)
                for c in classes
            ]
        )
        if self.visibility.given:
            density += log_p_d - log_band
        return np.where(np.isnan(density), log_p_d, density)

    def measurement_rate(self, state: FloatArray) -> FloatArray:
        """Return the rates of (range, azimuth) of each state, m/s and rad/s; (N, D) to (N, 2)."""
        position, velocity = list(self.space.position), list(self.space.velocity)
        return polar_geometry.rates(state[:, position], state[:, velocity], self.position)

    def gated_pairs(
        self, predicted: FloatArray, detections: Detections, rate: FloatArray | None = None
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the pairs of points and detections in the gate; see `polar_gate.gated_pairs`."""
        own = self.detection_noise(detections)
        return polar_gate.gated_pairs(predicted, detections, self.noise_std, own, rate)

    def candidates(self, predicted: FloatArray, detections: Detections) -> int:
        """Return the number of candidate pairs of `gated_pairs`."""
        return polar_gate.candidates(predicted, detections, self.noise_std)

    def passes(self, position: FloatArray, radius: FloatArray, detections: Detections) -> BoolArray:
        """Return whether the antenna may have swept the circles around positions, shape (T,)."""
        std = GATE_SIGMA * self.azimuth_std
        return polar_geometry.passes(position, radius, self.position, self.yaw, std, detections)


def polar_radars(sensors: Iterable[Sensor]) -> tuple[RadarModel, ...]:
    """Return the sensors as polar radars, for functions that support only these.

    Raises
    ------
    TypeError
        If a sensor is not a polar radar.
    """
    radars = []
    for sensor in sensors:
        if not isinstance(sensor, RadarModel):
            raise TypeError(f"{sensor.name}: {type(sensor).__name__} given, must be a polar radar")
        radars.append(sensor)
    return tuple(radars)
