"""What a detection's amplitude says of a target: three ways to use it.

`Band` knows a class's signal-to-noise ratio only as an interval and forgets every amplitude at
once. With `Memory` every hypothesis of a target (a particle, say) carries ln(1 + SNR) of its own,
drawn from its class's band at birth, so that a target's amplitudes tell its ratio from scan to
scan. `Ignored` leaves positions only.

Engines hold, for each of N hypotheses, a flat mode and a log_snr; both are arrays of shape (N,).
Models that remember nothing keep log_snr at zero. Hypotheses that are not drawn but have weights
spread them over `SnrCells`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from ..arrays import FloatArray, IntArray
from ..sensors.report import Report
from ..sensors.sensor import Sensor
from ..targets.amplitude_density import SMALLEST_AMPLITUDE
from ..targets.modes import ModeSpace
from ..types import Detections

# Of a class's band; a cell of a band of 20 dB is 1.8 dB wide.
CELLS = 11


class AmplitudeModel(Protocol):
    """How amplitudes enter the recursion."""

    def used(self, detections: Detections) -> Detections:
        """Return the detections that the update uses, with or without amplitudes."""
        ...

    def born(
        self,
        mode: IntArray,
        modes: ModeSpace,
        rng: np.random.Generator,
        amplitude: FloatArray | None = None,
    ) -> FloatArray:
        """Return the log_snr of new hypotheses of flat modes `mode`, shape (N,).

        `amplitude` is that of the detection at which each particle is born, if there is one.
        """
        ...

    def moved(
        self,
        log_snr: FloatArray,
        mode: IntArray,
        modes: ModeSpace,
        dt: float,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Return the log_snr of survivors `dt` seconds later, shape (N,)."""
        ...

    def detection_probability(
        self,
        mode: IntArray,
        log_snr: FloatArray,
        measured: FloatArray,
        sensor: Sensor,
        modes: ModeSpace,
    ) -> FloatArray:
        """Return p_D of every hypothesis, given its measurement in the field of view, (N,)."""
        ...

    def log_likelihood(
        self,
        mode: IntArray,
        log_snr: FloatArray,
        report: Report,
        pairs: tuple[IntArray, IntArray],
        modes: ModeSpace,
    ) -> FloatArray:
        """Return log p_D g^tau(a) of every (hypothesis, detection) pair, shape (P,)."""
        ...

    def cells(self, modes: ModeSpace) -> SnrCells:
        """Return the cells into which the classes' bands are cut for hypotheses with weights."""
        ...


@dataclass(frozen=True)
class Band:
    """The likelihood of a class's whole SNR band; there is no memory."""

    def used(self, detections: Detections) -> Detections:
        """Return the detections unchanged."""
        return detections

    def born(
        self,
        mode: IntArray,
        modes: ModeSpace,
        rng: np.random.Generator,
        amplitude: FloatArray | None = None,
    ) -> FloatArray:
        """Return zeros; nothing is drawn."""
        return np.zeros(len(mode))

    def moved(
        self,
        log_snr: FloatArray,
        mode: IntArray,
        modes: ModeSpace,
        dt: float,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Return `log_snr` unchanged; nothing is drawn."""
        return log_snr

    def detection_probability(
        self,
        mode: IntArray,
        log_snr: FloatArray,
        measured: FloatArray,
        sensor: Sensor,
        modes: ModeSpace,
    ) -> FloatArray:
        """Return the sensor's given p_D, or that of each mode's class, shape (N,)."""
        if (given := sensor.given_detection_probability(measured)) is not None:
            return given
        per_class = sensor.class_detection_probability(modes.classes)
        probability: FloatArray = per_class[modes.class_of[mode]]
        return probability

    def log_likelihood(
        self,
        mode: IntArray,
        log_snr: FloatArray,
        report: Report,
        pairs: tuple[IntArray, IntArray],
        modes: ModeSpace,
    ) -> FloatArray:
        """Return log g_c(a) of each pair's class, shape (P,)."""
        row, column = pairs
        per_class = report.sensor.log_class_likelihood(report.detections, modes.classes)
        place = (modes.class_of * len(report)).take(mode).take(row) + column
        likelihood: FloatArray = per_class.take(place)
        return likelihood

    def cells(self, modes: ModeSpace) -> SnrCells:
        """Return one cell a class."""
        classes = len(modes.classes)
        return SnrCells(np.arange(classes), np.zeros(classes), np.zeros((classes, classes)))


@dataclass(frozen=True)
class Ignored(Band):
    """Amplitudes are ignored: classes differ only in p_D."""

    def used(self, detections: Detections) -> Detections:
        """Return the detections without their amplitudes."""
        return replace(detections, amplitude=None)


@dataclass(frozen=True)
class Memory:
    """Every hypothesis remembers ln(1 + d) of its target's mean signal-to-noise ratio d.

    Parameters
    ----------
    jitter : float
        Standard deviation of the step of ln(1 + d) per nominal interval, against depletion.

    Notes
    -----
    Beyond the paper. The backward step does not look at log_snr: it smooths the intensity over
    state and mode, with log_snr integrated out.
    """

    jitter: float

    def used(self, detections: Detections) -> Detections:
        """Return the detections unchanged."""
        return detections

    def born(
        self,
        mode: IntArray,
        modes: ModeSpace,
        rng: np.random.Generator,
        amplitude: FloatArray | None = None,
    ) -> FloatArray:
        """Return ln(1 + d): uniform over the band of each mode's class, or what an amplitude tells.

        Notes
        -----
        Given an amplitude a and the flat prior, a^2 / 2(1 + d) has an exponential distribution,
        truncated to its values at the edges of the band.
        """
        low, high = _band_edges(mode, modes)
        uniform = rng.random(len(mode))
        if amplitude is None:
            drawn: FloatArray = low + (high - low) * uniform
            return drawn
        half = 0.5 * np.maximum(amplitude, SMALLEST_AMPLITUDE) ** 2
        least, most = half * np.exp(-high), half * np.exp(-low)
        exponential = least - np.log1p(uniform * np.expm1(least - most))
        told = np.clip(np.log(half / exponential), low, high)
        return np.where(np.isnan(amplitude), low + (high - low) * uniform, told)

    def moved(
        self,
        log_snr: FloatArray,
        mode: IntArray,
        modes: ModeSpace,
        dt: float,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Return log_snr after a small random step, reflected into the band."""
        low, high = _band_edges(mode, modes)
        step = self.jitter * np.sqrt(dt / modes.interval_s)
        stepped = log_snr + step * rng.standard_normal(len(log_snr))
        stepped = np.where(stepped < low, 2.0 * low - stepped, stepped)
        stepped = np.where(stepped > high, 2.0 * high - stepped, stepped)
        inside: FloatArray = np.clip(stepped, low, high)
        return inside

    def detection_probability(
        self,
        mode: IntArray,
        log_snr: FloatArray,
        measured: FloatArray,
        sensor: Sensor,
        modes: ModeSpace,
    ) -> FloatArray:
        """Return the given p_D, or the Rayleigh target's, exp(-tau^2 / 2(1 + d)), shape (N,)."""
        if (given := sensor.given_detection_probability(measured)) is not None:
            return given
        probability: FloatArray = np.exp(-0.5 * sensor.threshold**2 * np.exp(-log_snr))
        return probability

    def log_likelihood(
        self,
        mode: IntArray,
        log_snr: FloatArray,
        report: Report,
        pairs: tuple[IntArray, IntArray],
        modes: ModeSpace,
    ) -> FloatArray:
        """Return log a - ln(1 + d) - a^2 / 2(1 + d) of each pair, shape (P,).

        Where the amplitude is unknown it is log p_D; a given p_D replaces that of d.
        """
        row, column = pairs
        own, detections = log_snr[row], report.detections
        log_p_d = log_own = -0.5 * report.sensor.threshold**2 * np.exp(-own)
        given = report.sensor.given_detection_probability(detections.measurement[column])
        if given is not None:
            log_p_d = np.log(given)
        if detections.amplitude is None:
            return log_p_d
        a = np.maximum(detections.amplitude[column], SMALLEST_AMPLITUDE)
        density = np.log(a) - own - 0.5 * a**2 * np.exp(-own)
        if given is not None:
            density += log_p_d - log_own
        return np.where(np.isnan(density), log_p_d, density)

    def cells(self, modes: ModeSpace) -> SnrCells:
        """Return `CELLS` cells a class, of equal width in ln(1 + d), between which d diffuses."""
        edges = np.log1p([model.snr_band for model in modes.classes])
        width = (edges[:, 1] - edges[:, 0]) / CELLS
        centre = edges[:, :1] + width[:, None] * (np.arange(CELLS) + 0.5)
        # A random walk over cells of this rate has the variance of the jitter.
        rate = 0.5 * (self.jitter / width) ** 2
        step = np.eye(CELLS, k=1) + np.eye(CELLS, k=-1)
        step -= np.diag(step.sum(axis=1))
        generator = np.asarray(np.kron(np.diag(rate), step) / modes.interval_s, dtype=np.float64)
        return SnrCells(np.arange(len(edges)).repeat(CELLS), centre.ravel(), generator)


@dataclass(frozen=True)
class SnrCells:
    """Cells of class and signal-to-noise ratio, over which a hypothesis can spread its weight.

    Parameters
    ----------
    class_of : int array of shape (S,)
        Class of each cell, ascending.
    log_snr : array of shape (S,)
        ln(1 + d) at the cell's centre; 0 in models that remember nothing.
    generator : array of shape (S, S)
        Rates of change from cell to cell per second, symmetric; rows sum to 0.
    """

    class_of: IntArray
    log_snr: FloatArray
    generator: FloatArray

    def __len__(self) -> int:
        return len(self.class_of)

    @cached_property
    def _eigen(self) -> tuple[FloatArray, FloatArray]:
        values, vectors = np.linalg.eigh(self.generator)
        return values, vectors

    def transition(self, dt: float) -> FloatArray | None:
        """Return the (S, S) matrix over `dt` seconds; None if no cell is ever left."""
        if not self.generator.any():
            return None
        values, vectors = self._eigen
        matrix = np.maximum((vectors * np.exp(values * dt)) @ vectors.T, 0.0)
        normalised: FloatArray = matrix / matrix.sum(axis=1, keepdims=True)
        return normalised


def _band_edges(mode: IntArray, modes: ModeSpace) -> tuple[FloatArray, FloatArray]:
    """Return ln(1 + d1) and ln(1 + d2) of each mode's class, shapes (N,)."""
    bands = np.log1p([model.snr_band for model in modes.classes])[modes.class_of[mode]]
    return bands[:, 0], bands[:, 1]
