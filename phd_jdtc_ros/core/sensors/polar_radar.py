"""The polar radar: geometry, detection probability, clutter, and the gated likelihood.

Range rates are in `range_rate`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray
from ..arrays import wrap_angle as wrap_angle
from ..clutter.amplitude_law import NOISE, ClutterAmplitude
from ..clutter.grid import GroundGrid
from ..clutter.map import ClutterMap
from ..clutter.rate import ClutterCount
from ..pair_search import kernels
from ..pair_search.gating import CellLists, cell_lists
from ..state_space import PLANAR, StateSpace
from ..targets import amplitude_density
from ..targets.modes import ClassModel
from ..types import FULL_TURN, Coverage, Detections, Pose
from .range_rate import RangeRateModel
from .slant_range import HeightReading
from .visibility import Visibility, within

# At six standard deviations the likelihood is 1e-8 of its peak.
GATE_SIGMA = 6.0
# At its own position a radar measures no azimuth; divisions by the range are bounded at this one.
LEAST_RANGE = 1.0


class Rates(NamedTuple):
    """The range rates of a report.

    Parameters
    ----------
    model : RangeRateModel
    rate : array of shape (M,)
        Metres per second relative to the radar; NaN where it is unknown.
    std : array of shape (M,)
        Metres per second.
    """

    model: RangeRateModel
    rate: FloatArray
    std: FloatArray

    def take(self, rows: IntArray) -> Rates:
        """Return those of these rows."""
        return Rates(self.model, self.rate[rows], self.std[rows])


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
        Measurement noise, metres and radians.
    visibility : Visibility
        Field of view, and the detection probability where it is given.
    clutter_rate : float
        Expected false detections per scan.
    clutter_max_range : float
        False detections are uniform in azimuth and in range up to this range, metres.
    threshold : float
        Detection threshold tau on the amplitude.
    space : StateSpace
        Of the states that it measures.
    range_growth : float
        Standard deviation that the range has in addition, in metres per metre of range.
    rotation_s : float
        Time of one turn of the antenna, seconds; 0 if it does not turn.
    clutter_amplitude : ClutterAmplitude
        Law of the amplitudes of false detections.
    clutter_map : ClutterMap or None
        Where they come from; None if that is not to be learned.
    clutter_count : ClutterCount or None
        What its clutter rate is learned from; None if that is given.
    clutter_map_speed : float
        What targets slower than this claim counts for the map all the same, metres per second.
    range_rate : RangeRateModel or None
        How it measures range rates; None if it does not, or if they are not to be used.
    velocity : tuple of two floats
        In the world frame, metres per second; range rates are relative to it.
    cluster_distance : float
        Within which detections are merged, metres; 0 for none. See `detection_clusters`.
    height_reading : HeightReading or None
        How ranges depend on heights that detections may have; None where they do not.

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
        """Targets beyond it are not detected and detections beyond it are rejected, metres."""
        return self.visibility.max_range

    def at(self, pose: Pose | None) -> RadarModel:
        """Return the radar at a pose; None is for where it is."""
        if pose is None:
            return self
        return replace(self, position=pose.position, yaw=pose.yaw, velocity=pose.velocity)

    def turning_in(self, rotation_s: float) -> RadarModel:
        """Return the radar with another time of a turn, seconds."""
        return replace(self, rotation_s=rotation_s)

    def measure(self, state: FloatArray) -> FloatArray:
        """Return noise-free (range, azimuth) of each state; shape (N, D) to (N, 2)."""
        x, y = self.space.position
        east, north = state[:, x] - self.position[0], state[:, y] - self.position[1]
        # Rotated into the sensor's frame first, so that the azimuth needs no wrapping.
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        ahead, left = cos * east + sin * north, cos * north - sin * east
        return np.stack([np.sqrt(ahead**2 + left**2), np.arctan2(left, ahead)], axis=1)

    def linearised(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (range, azimuth) of positions, and their derivatives by the position.

        Parameters
        ----------
        position : array of shape (..., 2)
            In the world frame, metres.

        Returns
        -------
        measured : array of shape (..., 2)
        jacobian : array of shape (..., 2, 2)
        """
        line = position - np.asarray(self.position)
        east, north = line[..., 0], line[..., 1]
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        ahead, left = cos * east + sin * north, cos * north - sin * east
        distance = np.maximum(np.sqrt(ahead**2 + left**2), LEAST_RANGE)
        along, across = east / distance, north / distance
        jacobian = np.empty((*position.shape, 2))
        jacobian[..., 0, 0], jacobian[..., 0, 1] = along, across
        jacobian[..., 1, 0], jacobian[..., 1, 1] = -across / distance, along / distance
        return np.stack([distance, np.arctan2(left, ahead)], axis=-1), jacobian

    def to_world(self, measurement: FloatArray) -> FloatArray:
        """Return world (x, y) in metres of (range, azimuth) rows; shape (M, 2)."""
        bearing = measurement[:, 1] + self.yaw
        direction = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
        world: FloatArray = np.asarray(self.position) + measurement[:, :1] * direction
        return world

    @cached_property
    def noise_std(self) -> FloatArray:
        """Standard deviations of (range, azimuth), shape (2,)."""
        return np.array([self.range_std, self.azimuth_std])

    def detection_noise(self, detections: Detections) -> FloatArray | None:
        """Return the deviations of each detection, shape (M, 2); None if all have `noise_std`.

        Where a detection has none of its own, its range's deviation grows with the range.
        """
        own = detections.noise_std
        if own is None and self.range_growth == 0.0:
            return None
        grown = np.hypot(self.range_std, self.range_growth * detections.measurement[:, 0])
        usual = np.stack([grown, np.full(len(detections), self.azimuth_std)], axis=1)
        return usual if own is None else np.where(np.isfinite(own), own, usual)

    def deviations(self, detections: Detections) -> FloatArray:
        """Return the deviations of each detection, shape (M, 2), also where all have the same."""
        own = self.detection_noise(detections)
        return np.tile(self.noise_std, (len(detections), 1)) if own is None else own

    def rates_of(self, detections: Detections) -> Rates | None:
        """Return the range rates of detections; None if there are none to be used."""
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
        """Return the log likelihood of the range rates of pairs, (P,); 0 where they are unknown.

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
        """Return the probability that the antenna passes each target and could report it, (N,).

        Parameters
        ----------
        predicted : array of shape (N, 2)
            `measure` of the targets.
        coverage : Coverage or None
            Of the report. A plot belongs to the sector in which it is measured.
        azimuth_std : array of shape (N,), float or None
            Standard deviation of the azimuth that would be measured, radians; None for the radar's
            own, if the positions are certain.
        """
        seen = self.visibility.sees(predicted)
        if coverage is not None:
            std = self.azimuth_std if azimuth_std is None else azimuth_std
            seen *= within(predicted[:, 1], coverage, std)
        return seen

    def log_clutter_intensity(self, detections: Detections) -> FloatArray:
        """Return log kappa(z) over (range, azimuth, range rate, amplitude), shape (M,).

        Where an amplitude or a range rate is unknown it is the intensity over the others.
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
        """Return the log density of clutter at (range, azimuth) over the uniform one, (M,).

        It is 0 without a map of clutter.
        """
        if self.clutter_map is None:
            return np.zeros(len(measurement))
        world = self.to_world(measurement)
        uniform = self._rate_of_turn, self.clutter_max_range
        return self.clutter_map.log_factor(measurement, world, *uniform)

    def clutter_about(self, measurement: FloatArray, world: FloatArray) -> FloatArray:
        """Return the neighbourhoods of places in the radar's map of clutter, (M,).

        Parameters
        ----------
        measurement, world : arrays of shape (M, 2)
            See `ClutterMap.about`. Where the radar does not see, nothing is known: infinity. One
            that moves may have seen any place.
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
        """Expected uniform clutter of a whole turn, of which the radar may see a part; above 0."""
        # A rate of zero is allowed; the floor keeps the update's quotient defined.
        rate = max(self.clutter_rate, np.finfo(float).tiny)
        return rate * FULL_TURN / self.visibility.fov.width

    def log_class_likelihood(
        self, detections: Detections, classes: tuple[ClassModel, ...]
    ) -> FloatArray:
        """Return log p_D,c g_c^tau(a) for every class and detection, shape (C, M).

        Notes
        -----
        Where p_D follows from the classes' signal-to-noise ratios, the product p_D g^tau is g_c
        itself. A given p_D is that at the detection's range. Where an amplitude is unknown, the
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
        line = state[:, position] - np.asarray(self.position)
        distance = np.maximum(np.sqrt((line**2).sum(axis=1)), LEAST_RANGE)
        along, across = line / distance[:, None], state[:, velocity]
        radial = (along * across).sum(axis=1)
        tangential = along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]
        return np.stack([radial, tangential / distance], axis=1)

    def gated_pairs(
        self, predicted: FloatArray, detections: Detections, rate: FloatArray | None = None
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the (particle, detection) pairs within the gate and their log likelihood.

        Parameters
        ----------
        predicted : array of shape (N, 2)
            `measure` of the particles at the scan's stamp.
        detections : Detections
        rate : array of shape (N, 2) or None
            `measurement_rate` of the particles; needed where detections have times of their own.

        Returns
        -------
        particle, detection : int arrays of shape (P,)
        log_likelihood : array of shape (P,)
            log N(z; predicted, R), azimuth wrapped, at the time of the detection.

        Notes
        -----
        The cost grows with the number of pairs found and not with N x M; see `gating`. To first
        order, a particle's measurement at the time t of a detection is that at the stamp plus rate
        times t. At 250 m/s and 5 km the error is 0.1 m after 0.125 s.
        """
        std, shift = self.detection_noise(detections), detections.time_s if len(predicted) else None
        if std is None and shift is None:
            lists, gate = self._lists(detections, self.noise_std)
            log_norm = -np.log(2.0 * np.pi * self.range_std * self.azimuth_std)
            particle, detection, square = kernels.chosen().near_detections(
                lists, predicted, self.noise_std, GATE_SIGMA, gate
            )
            return particle, detection, log_norm - 0.5 * square
        if std is None:
            std = np.tile(self.noise_std, (len(detections), 1))
        widest = std.max(axis=0, initial=0.0) if len(std) else self.noise_std
        if shift is not None and rate is not None and len(shift):
            fastest = np.abs(rate).max(axis=0) * np.abs(shift).max()
            # An ellipse this much larger contains the gate wherever the shift moves it.
            widest = widest + 1.5 * fastest / GATE_SIGMA
        lists, gate = self._lists(detections, widest)
        particle, detection, _ = kernels.chosen().near_detections(
            lists, predicted, widest, GATE_SIGMA, gate
        )
        error = detections.measurement[detection] - predicted[particle]
        if shift is not None and rate is not None:
            error -= rate[particle] * shift[detection, None]
        error[:, 1] = wrap_angle(error[:, 1])
        square = ((error / std[detection]) ** 2).sum(axis=1)
        near = np.flatnonzero(square <= GATE_SIGMA**2)
        log_norm_of = -np.log(2.0 * np.pi * std.prod(axis=1))
        kept = detection[near]
        return particle[near], kept, log_norm_of[kept] - 0.5 * square[near]

    def candidates(self, predicted: FloatArray, detections: Detections) -> int:
        """Return how many pairs `gated_pairs` would look at; about twice those that it finds."""
        lists, _ = self._lists(detections, self.noise_std)
        return int(np.diff(lists.start).take(lists.cell_of(predicted)).sum())

    def _lists(self, detections: Detections, std: FloatArray) -> tuple[CellLists, float]:
        """Return the detections by cell, and the half width of the gate in azimuth."""
        gate = min(GATE_SIGMA * float(std[1]), np.pi)
        measured = detections.measurement.copy()
        measured[:, 1] = wrap_angle(measured[:, 1])
        return cell_lists(measured, GATE_SIGMA * float(std[0]), gate), gate
