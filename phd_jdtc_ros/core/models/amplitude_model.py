"""Amplitude models: the likelihood of a detection's amplitude, in three variants.

`Band` averages over the signal-to-noise ratios of a class and has no memory. With `Memory` a target
has its own ln(1 + SNR), drawn from its class's band at birth, so that its SNR is estimated from
scan to scan. `Ignored` uses positions only.

The engine distributes the weight of each class over its `SnrCells`. A simulated target has a flat
mode and a log_snr, arrays of shape (N,); without a memory log_snr is zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import FloatArray, IntArray
from ..sensors.view import View
from ..targets.amplitude_density import SMALLEST_AMPLITUDE, of_classes
from ..targets.modes import ModeSpace
from ..types import Detections

# Number of cells of a class's SNR band; a cell of a band of 20 dB is 1.8 dB wide.
CELLS = 11


@dataclass(frozen=True)
class AmplitudeModel:
    """Use of amplitudes in the recursion: their likelihood, averaged over the SNR band of a class.

    Simulated targets are drawn and diffuse; the hypotheses of the engine have cells.
    """

    def select(self, detections: Detections) -> Detections:
        """Return the detections that the update uses, with or without amplitudes."""
        return detections

    def detection_probability(
        self, mode: IntArray, log_snr: FloatArray, threshold: float, modes: ModeSpace
    ) -> FloatArray:
        """Return p_D of every hypothesis from its signal-to-noise ratio at a threshold, (N,).

        One that is configured for the sensor takes its place.
        """
        return of_classes(threshold, modes.classes)[modes.class_of[mode]]

    def log_likelihood(
        self,
        mode: IntArray,
        log_snr: FloatArray,
        report: View,
        pairs: tuple[IntArray, IntArray],
        modes: ModeSpace,
    ) -> FloatArray:
        """Return log p_D g^tau(a) of every (hypothesis, detection) pair, shape (P,)."""
        row, column = pairs
        per_class = report.log_class_likelihood(modes.classes)
        index = (modes.class_of * len(report)).take(mode).take(row) + column
        return per_class.take(index)

    def log_cell_likelihood(
        self, log_snr: FloatArray, report: View, modes: ModeSpace
    ) -> FloatArray:
        """Return log p_D g^tau(a) of every cell, (C, S), and detection; broadcasts to (C, S, M)."""
        return report.log_class_likelihood(modes.classes)[:, None]

    def cells(self, modes: ModeSpace) -> SnrCells:
        """Return the cells of the classes' SNR bands, for weighted hypotheses: one per class."""
        classes = len(modes.classes)
        return SnrCells(np.zeros((classes, 1)), np.zeros((classes, 1, 1)))

    def draw(
        self,
        mode: IntArray,
        modes: ModeSpace,
        rng: np.random.Generator,
        amplitude: FloatArray | None = None,
    ) -> FloatArray:
        """Return the log_snr of new hypotheses of flat modes `mode`, shape (N,).

        `amplitude` is the amplitude of each one's detection, for births at detections.
        """
        return np.zeros(len(mode))

    def diffuse(
        self,
        log_snr: FloatArray,
        mode: IntArray,
        modes: ModeSpace,
        dt: float,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Return the log_snr of survivors `dt` seconds later, shape (N,)."""
        return log_snr


class Band(AmplitudeModel):
    """Likelihood averaged over the SNR band of a class, without a memory."""


class Ignored(AmplitudeModel):
    """Amplitudes are ignored: classes differ only in p_D."""

    def select(self, detections: Detections) -> Detections:
        """Return the detections without their amplitudes."""
        return detections.changed(amplitude=None)


@dataclass(frozen=True)
class Memory(AmplitudeModel):
    """Every hypothesis has a state ln(1 + d), for its target's mean signal-to-noise ratio d.

    Deviation: the paper has no such state. The backward step ignores log_snr: it smooths the
    marginal intensity over state and mode.
    """

    # Standard deviation of the step of ln(1 + d) per nominal interval, against depletion.
    jitter: float

    def draw(
        self,
        mode: IntArray,
        modes: ModeSpace,
        rng: np.random.Generator,
        amplitude: FloatArray | None = None,
    ) -> FloatArray:
        """Return ln(1 + d) drawn from the band of each mode's class, or given an amplitude.

        The prior is uniform over the band. Given an amplitude a, a^2 / 2(1 + d) has an exponential
        distribution that is truncated to its values at the edges of the band.
        """
        low, high = _band_edges(mode, modes)
        uniform = rng.random(len(mode))
        if amplitude is None:
            return low + (high - low) * uniform
        half = 0.5 * np.maximum(amplitude, SMALLEST_AMPLITUDE) ** 2
        least, most = half * np.exp(-high), half * np.exp(-low)
        exponential = least - np.log1p(uniform * np.expm1(least - most))
        drawn = np.clip(np.log(half / exponential), low, high)
        return np.where(np.isnan(amplitude), low + (high - low) * uniform, drawn)

    def diffuse(
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
        self, mode: IntArray, log_snr: FloatArray, threshold: float, modes: ModeSpace
    ) -> FloatArray:
        """Return exp(-tau^2 / 2(1 + d)) of a Rayleigh target, shape (N,)."""
        return np.exp(-0.5 * threshold**2 * np.exp(-log_snr))

    def log_likelihood(
        self,
        mode: IntArray,
        log_snr: FloatArray,
        report: View,
        pairs: tuple[IntArray, IntArray],
        modes: ModeSpace,
    ) -> FloatArray:
        """Return log a - ln(1 + d) - a^2 / 2(1 + d) of each pair, (P,); see `log_detected`."""
        row, column = pairs
        measured, amplitude = report.detections.measurement[column], report.detections.amplitude
        if amplitude is not None:
            amplitude = amplitude[column]
        return self._log_likelihood(log_snr[row], report, measured, amplitude)

    def log_cell_likelihood(
        self, log_snr: FloatArray, report: View, modes: ModeSpace
    ) -> FloatArray:
        """Return the log likelihood of every cell and detection; see `log_likelihood`."""
        measured = report.detections.measurement, report.detections.amplitude
        return self._log_likelihood(log_snr[..., None], report, *measured)

    @staticmethod
    def _log_likelihood(
        log_snr: FloatArray, report: View, measured: FloatArray, amplitude: FloatArray | None
    ) -> FloatArray:
        """Return `log_likelihood`, given ln(1 + d), (..., N) or (..., 1), of N detections."""
        density, power = None, np.exp(-log_snr)
        if amplitude is not None:
            a = np.maximum(amplitude, SMALLEST_AMPLITUDE)
            density = np.log(a) - log_snr - 0.5 * a**2 * power
        return report.log_detected(-0.5 * report.sensor.threshold**2 * power, density, measured)

    def cells(self, modes: ModeSpace) -> SnrCells:
        """Return `CELLS` cells per class, of equal width in ln(1 + d), with the diffusion of d."""
        edges = np.log1p([model.snr_band for model in modes.classes])
        width = (edges[:, 1] - edges[:, 0]) / CELLS
        centre = edges[:, :1] + width[:, None] * (np.arange(CELLS) + 0.5)
        # A random walk over the cells with this rate has the variance of the jitter.
        rate = 0.5 * (self.jitter / width) ** 2
        step = np.eye(CELLS, k=1) + np.eye(CELLS, k=-1)
        step -= np.diag(step.sum(axis=1))
        return SnrCells(centre, rate[:, None, None] * step / modes.interval_s)


@dataclass(frozen=True)
class SnrCells:
    """Cells of the signal-to-noise ratio of each class, in which a hypothesis has probabilities."""

    # ln(1 + d) at the centre of each cell, (C, S); 0 in models without a memory.
    log_snr: FloatArray
    # Rates of change from cell to cell per second, symmetric, (C, S, S); rows sum to 0.
    generator: FloatArray

    @cached_property
    def prior(self) -> FloatArray:
        """Probability of each cell of a class before any detection, shape (C, S)."""
        return np.full(self.log_snr.shape, 1.0 / self.log_snr.shape[1])

    @cached_property
    def _eigen(self) -> tuple[FloatArray, FloatArray]:
        values, vectors = np.linalg.eigh(self.generator)
        return values, vectors

    def transition(self, dt: float) -> FloatArray | None:
        """Return the (C, S, S) matrices over `dt` seconds; None if no cell is ever left."""
        if not self.generator.any():
            return None
        values, vectors = self._eigen
        diffused = (vectors * np.exp(values * dt)[:, None]) @ vectors.swapaxes(1, 2)
        matrix = np.maximum(diffused, 0.0)
        normalised: FloatArray = matrix / matrix.sum(axis=2, keepdims=True)
        return normalised


def _band_edges(mode: IntArray, modes: ModeSpace) -> tuple[FloatArray, FloatArray]:
    """Return ln(1 + d1) and ln(1 + d2) of each mode's class, shapes (N,)."""
    bands = np.log1p([model.snr_band for model in modes.classes])[modes.class_of[mode]]
    return bands[:, 0], bands[:, 1]
