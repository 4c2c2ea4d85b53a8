"""Protocol of a sensor for engines: measurements, coverage, clutter, and positions in the plane.

`polar_radar.RadarModel` is the implementation. Engines, births, the region, clutter learning and
the reporting rule depend only on this protocol.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray
from ..clutter.amplitude_law import ClutterAmplitude
from ..clutter.map import ClutterMap
from ..clutter.rate import ClutterCount
from ..state_space import StateSpace
from ..targets.modes import ClassModel
from ..types import Coverage, Detections, Pose
from .range_rate import RangeRateModel, Rates
from .slant_range import HeightReading


class PlanePlots(NamedTuple):
    """Detections as positions in the world frame, at their own times.

    Parameters
    ----------
    position : array of shape (M, 2)
        Metres.
    axes : array of shape (M, 2, 2)
        Principal axes of the errors, unit vectors in columns.
    std : array of shape (M, 2)
        Standard deviations along these axes, metres.
    """

    position: FloatArray
    axes: FloatArray
    std: FloatArray

    @property
    def root(self) -> FloatArray:
        """Square roots of the covariances, metres, shape (M, 2, 2)."""
        return self.axes * self.std[:, None, :]

    @property
    def covariance(self) -> FloatArray:
        """Covariances of the positions, square metres, shape (M, 2, 2)."""
        covariance = np.zeros_like(self.axes)
        for std, axis in zip(self.std.T, np.moveaxis(self.axes, 2, 0), strict=True):
            covariance += (std**2)[:, None, None] * axis[:, :, None] * axis[:, None, :]
        return covariance


class Sensor(Protocol):
    """A sensor at its pose, with models of its noise, its coverage and its clutter.

    Measurements have shape (..., Z), positions (..., 2) and states (..., D). Positions and states
    are in the world frame.
    """

    @property
    def name(self) -> str:
        """Name of the sensor and of its frame."""

    @property
    def space(self) -> StateSpace:
        """Axes of the measured states."""

    @property
    def position(self) -> tuple[float, float]:
        """Position of the sensor, metres."""

    @property
    def velocity(self) -> tuple[float, float]:
        """Velocity of the sensor, metres per second; range rates are relative to it."""

    @property
    def yaw(self) -> float:
        """Direction of its x axis, radians counter-clockwise."""

    @property
    def polar(self) -> bool:
        """Whether it measures range and azimuth from its position, as compiled loops require."""

    @property
    def max_range(self) -> float:
        """Largest range of a detection, metres."""

    @property
    def noise_std(self) -> FloatArray:
        """Standard deviations of a measurement, (Z,)."""

    @property
    def range_rate(self) -> RangeRateModel | None:
        """Model of its range rates; None without any."""

    @property
    def rotation_s(self) -> float:
        """Period of a turning antenna, seconds; 0 if it does not turn."""

    @property
    def cluster_distance(self) -> float:
        """Distance within which detections are merged, metres; 0 for none."""

    @property
    def height_reading(self) -> HeightReading | None:
        """Dependence of its measurements on heights of targets; None without any."""

    @property
    def clutter_rate(self) -> float:
        """Expected false detections per scan."""

    @property
    def clutter_amplitude(self) -> ClutterAmplitude:
        """Law of the amplitudes of false detections."""

    @property
    def clutter_map(self) -> ClutterMap | None:
        """Learned map of false detections; None without a map."""

    @property
    def clutter_map_speed(self) -> float:
        """Detections of targets slower than this are learned as clutter, metres per second."""

    @property
    def clutter_count(self) -> ClutterCount | None:
        """Learned clutter rate; None if the rate is given."""

    @property
    def threshold(self) -> float:
        """Detection threshold on the amplitude."""

    @property
    def field_size(self) -> float:
        """Size of the field of view, in which unknown targets are uniform, in measurement units."""

    def at(self, pose: Pose | None) -> Sensor:
        """Return the sensor at a pose; None keeps its pose."""

    def turning_in(self, rotation_s: float) -> Sensor:
        """Return the sensor with another period of its antenna, seconds."""

    def with_clutter(
        self,
        amplitude: ClutterAmplitude | None = None,
        places: ClutterMap | None = None,
        count: ClutterCount | None = None,
    ) -> Sensor:
        """Return the sensor with learned clutter; None keeps a model."""

    def limited(self, threshold: float, clutter_rate: float) -> Sensor:
        """Return the sensor with another threshold and clutter rate."""

    def measure(self, state: FloatArray) -> FloatArray:
        """Return the noise-free measurement of each state, (N, D) to (N, Z)."""

    def measurement_rate(self, state: FloatArray) -> FloatArray:
        """Return the time derivative of each state's measurement, (N, D) to (N, Z)."""

    def linearise(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the measurements of positions and their Jacobians, (..., Z) and (..., Z, 2)."""

    def wrap(self, error: FloatArray) -> FloatArray:
        """Return differences of measurements, (..., Z), with wrapped angles."""

    def reachable(self, measured: FloatArray) -> FloatArray:
        """Return the measurements, changed so that none beyond its range is in any gate."""

    def deviations(self, detections: Detections) -> FloatArray:
        """Return the standard deviations of each detection, (M, Z)."""

    def gated_pairs(
        self, predicted: FloatArray, detections: Detections, rate: FloatArray | None = None
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the pairs of points and detections in the gate, with their log likelihoods."""

    def candidates(self, predicted: FloatArray, detections: Detections) -> int:
        """Return the number of candidate pairs of `gated_pairs`."""

    def missable(
        self,
        predicted: FloatArray,
        coverage: Coverage | None,
        azimuth_std: FloatArray | float | None = None,
    ) -> FloatArray:
        """Return the probability that a report covers each target, (N,)."""

    def passes(self, position: FloatArray, radius: FloatArray, detections: Detections) -> BoolArray:
        """Return whether a report may have swept the circles around positions, (T,)."""

    def given_detection_probability(self, measured: FloatArray) -> FloatArray | None:
        """Return the configured p_D at measurements, (N,); None if it follows from the SNR."""

    def miss_probability(self, log_snr: FloatArray) -> FloatArray:
        """Return 1 - p_D of targets by ln(1 + SNR), at the range of the best p_D; shape kept."""

    def class_detection_probability(self, classes: tuple[ClassModel, ...]) -> FloatArray:
        """Return p_D of each class from its signal-to-noise ratios, (C,)."""

    def log_class_likelihood(
        self, detections: Detections, classes: tuple[ClassModel, ...]
    ) -> FloatArray:
        """Return log p_D g(a) of every class and detection, (C, M)."""

    def rates_of(self, detections: Detections) -> Rates | None:
        """Return the range rates of detections; None without usable ones."""

    def range_rate_of(self, state: FloatArray, time_s: FloatArray | None = None) -> FloatArray:
        """Return the noise-free range rate of each state, m/s, (N,)."""

    def log_range_rate(
        self, state: FloatArray, detections: Detections, pairs: tuple[IntArray, IntArray]
    ) -> FloatArray | float:
        """Return the log likelihood of the range rates of pairs, (P,); 0 for unknown ones."""

    def line_of_sight(self, position: FloatArray) -> FloatArray:
        """Return unit vectors from the sensor to positions, (N, 2)."""

    def log_clutter_intensity(self, detections: Detections) -> FloatArray:
        """Return the log intensity of false detections at each detection, (M,)."""

    def log_clutter_factor(self, measurement: FloatArray) -> FloatArray:
        """Return the log ratio of all clutter to the uniform one, (M,)."""

    def neighbourhood_density(self, measurement: FloatArray, world: FloatArray) -> FloatArray:
        """Return the detections per turn around places in the clutter map, (M,)."""

    def to_world(self, measurement: FloatArray) -> FloatArray:
        """Return the positions of measurements, (M, Z) to (M, 2)."""

    def in_plane(self, detections: Detections) -> PlanePlots:
        """Return the detections as positions with covariances, for births and proposals."""

    def drawn_in_plane(self, detections: Detections, normal: FloatArray) -> FloatArray:
        """Return positions drawn from detections' noise, given (M, K, Z) normals; (M, K, 2)."""

    def log_jacobian(self, measured: FloatArray) -> FloatArray:
        """Return log |dz/dp| at measurements: converts their density to one in the plane."""
