"""Amplitude models: the likelihood of a detection's amplitude, in three variants.

`Band` averages over the signal-to-noise ratios of a class and has no memory. With `Memory` a target
has its own ln(1 + SNR), drawn from its class's band at birth, so that its SNR is estimated from
scan to scan. `Ignored` uses positions only.

The engine distributes the weight of each class over its `SnrCells`.
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
    """Use of amplitudes: their likelihood, averaged over the SNR band of a class."""

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

    def log_cell_likelihood(
        self, log_snr: FloatArray, report: View, modes: ModeSpace
    ) -> FloatArray:
        """Return log p_D g^tau(a) of every cell, (C, S), and detection; broadcasts to (C, S, M)."""
        return report.log_class_likelihood(modes.classes)[:, None]

    def cells(self, modes: ModeSpace) -> SnrCells:
        """Return the cells of the classes' SNR bands, for weighted hypotheses: one per class."""
        classes = len(modes.classes)
        return SnrCells(np.zeros((classes, 1)), np.zeros((classes, 1, 1)))


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

    def detection_probability(
        self, mode: IntArray, log_snr: FloatArray, threshold: float, modes: ModeSpace
    ) -> FloatArray:
        """Return exp(-tau^2 / 2(1 + d)) of a Rayleigh target, shape (N,)."""
        return np.exp(-0.5 * threshold**2 * np.exp(-log_snr))

    def log_cell_likelihood(
        self, log_snr: FloatArray, report: View, modes: ModeSpace
    ) -> FloatArray:
        """Return log a - ln(1 + d) - a^2 / 2(1 + d) of each, (C, S, M); see `log_detected`."""
        log_snr, density = log_snr[..., None], None
        power = np.exp(-log_snr)
        if (amplitude := report.detections.amplitude) is not None:
            a = np.maximum(amplitude, SMALLEST_AMPLITUDE)
            density = np.log(a) - log_snr - 0.5 * a**2 * power
        measured = report.detections.measurement
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

    # At the centre of each cell, ln(1 + d), (C, S); 0 in models without a memory.
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
