# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The polar radar: geometry, detection probability, clutter, and the gated likelihood."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import FloatArray, IntArray
from ..pair_search import kernels
from ..pair_search.gating import CellLists, cell_lists
from ..state_space import PLANAR, StateSpace
from ..types import Detections
from . import amplitude_density
from .modes import ClassModel

# At six standard deviations the likelihood is 1e-8 of its peak.
GATE_SIGMA = 6.0


def wrap_angle(angle: FloatArray) -> FloatArray:
    """Return `angle` in radians wrapped to (-pi, pi]; shape kept."""
    wrapped = np.pi - np.mod(np.pi - angle, 2.0 * np.pi)
    inside: FloatArray = np.where(wrapped > -np.pi, wrapped, np.pi)  # rounding may reach -pi
    return inside


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
    max_range : float
        Targets beyond it are not detected and detections beyond it are rejected, metres.
    clutter_rate : float
        Expected false detections per scan.
    clutter_max_range : float
        False detections are uniform in azimuth and in range up to this range, metres.
    threshold : float
        Detection threshold tau on the amplitude.
    space : StateSpace
        Of the states that it measures.

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
    max_range: float
    clutter_rate: float
    clutter_max_range: float
    threshold: float
    space: StateSpace = PLANAR

    def measure(self, state: FloatArray) -> FloatArray:
        """Return noise-free (range, azimuth) of each state; shape (N, D) to (N, 2)."""
        x, y = self.space.position
        east, north = state[:, x] - self.position[0], state[:, y] - self.position[1]
        # Rotated into the sensor's frame first, so that the azimuth needs no wrapping.
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        ahead, left = cos * east + sin * north, cos * north - sin * east
        return np.stack([np.sqrt(ahead**2 + left**2), np.arctan2(left, ahead)], axis=1)

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

    def class_detection_probability(self, classes: tuple[ClassModel, ...]) -> FloatArray:
        """Return p_D of each class inside the radar's range, shape (C,)."""
        return np.array(
            [amplitude_density.detection_probability(self.threshold, c.snr_band) for c in classes]
        )

    def log_clutter_intensity(self, detections: Detections) -> FloatArray:
        """Return log kappa(z) over (range, azimuth, amplitude), shape (M,).

        Without amplitudes it is the intensity over (range, azimuth).
        """
        area = 2.0 * np.pi * self.clutter_max_range
        # A rate of zero is allowed; the floor keeps the update's quotient defined.
        log_intensity = np.full(
            len(detections), np.log(max(self.clutter_rate, np.finfo(float).tiny) / area)
        )
        if detections.amplitude is None:
            return log_intensity
        log_false_alarm = -0.5 * self.threshold**2
        density: FloatArray = (
            log_intensity
            + amplitude_density.log_clutter_density(detections.amplitude)
            - log_false_alarm
        )
        return density

    def log_class_likelihood(
        self, detections: Detections, classes: tuple[ClassModel, ...]
    ) -> FloatArray:
        """Return log p_D,c g_c^tau(a) for every class and detection, shape (C, M).

        The product p_D g^tau is g_c itself, so p_D cancels. Without amplitudes the result is
        log p_D,c, the same for all detections.
        """
        if detections.amplitude is None:
            log_p_d = np.log(self.class_detection_probability(classes))
            return np.repeat(log_p_d[:, None], len(detections), axis=1)
        return np.stack(
            [
                amplitude_density.log_target_density(detections.amplitude, c.snr_band)
                for c in classes
            ]
        )

    def gated_pairs(
        self, predicted: FloatArray, detections: Detections
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the (particle, detection) pairs within the gate and their log likelihood.

        Parameters
        ----------
        predicted : array of shape (N, 2)
            `measure` of the particles.
        detections : Detections

        Returns
        -------
        particle, detection : int arrays of shape (P,)
        log_likelihood : array of shape (P,)
            log N(z; predicted, R), azimuth wrapped.

        Notes
        -----
        The cost grows with the number of pairs found and not with N x M; see `gating`.
        """
        lists, gate = self._lists(detections)
        log_norm = -np.log(2.0 * np.pi * self.range_std * self.azimuth_std)
        particle, detection, square = kernels.chosen().near_detections(
            lists, predicted, self.noise_std, GATE_SIGMA, gate
        )
        return particle, detection, log_norm - 0.5 * square

    def candidates(self, predicted: FloatArray, detections: Detections) -> int:
        """Return how many pairs `gated_pairs` would look at; about twice those that it finds."""
        lists, _ = self._lists(detections)
        return int(np.diff(lists.start).take(lists.cell_of(predicted)).sum())

    def _lists(self, detections: Detections) -> tuple[CellLists, float]:
        """Return the detections by cell, and the half width of the gate in azimuth."""
        gate = min(GATE_SIGMA * self.azimuth_std, np.pi)
        measured = detections.measurement.copy()
        measured[:, 1] = wrap_angle(measured[:, 1])
        return cell_lists(measured, GATE_SIGMA * self.range_std, gate), gate
