"""Amplitude likelihoods of clutter, and of targets whose mean SNR lies in a known band.

The envelope a of a Rayleigh target of mean SNR d (linear) has density
``a/(1+d) exp(-a^2 / 2(1+d))``; clutter is the case d = 0. A class is a band [d1, d2] of SNRs, and
averaging over the band with a prior flat in ln(1+d) gives the closed form below. `a` is in units of
the noise's per-quadrature standard deviation, so E[a^2] is 2 for noise and 2(1+d) for a target.

All densities are logarithms: the clutter density underflows above a = 38, and a target of 45 dB
has a root mean square amplitude of 250.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.special import exp1

from ..arrays import FloatArray
from .modes import ClassModel

# Floor of the amplitude: the densities vanish at zero, and their logarithms must be finite.
SMALLEST_AMPLITUDE = 1e-6
# Decibels per unit of the natural logarithm of a power, 10 / ln 10.
DB_PER_NEPER = 10.0 / np.log(10.0)


def log_clutter_density(amplitude: FloatArray) -> FloatArray:
    """Return log g_0(a) = log a - a^2/2 of noise envelopes; elementwise.

    Sec. V, first amplitude equation.
    """
    a = np.maximum(amplitude, SMALLEST_AMPLITUDE)
    return np.log(a) - 0.5 * a**2


def log_target_density(amplitude: FloatArray, snr_band: tuple[float, float]) -> FloatArray:
    """Return log g_c(a) for a target whose linear mean SNR lies in `snr_band`; elementwise.

    Sec. V, g_a(a | d1, d2). Deviation: the printed denominator has a plus sign, with which the
    density integrates to 0.485 and 0.250 for the paper's two classes; with a minus sign the
    integral is one.
    """
    low, high = 1.0 + snr_band[0], 1.0 + snr_band[1]
    a = np.maximum(amplitude, SMALLEST_AMPLITUDE)
    half_square = 0.5 * a**2
    # This is exp(-h/high) - exp(-h/low), as a product that neither cancels nor underflows.
    difference = -half_square / high + np.log(-np.expm1(-half_square * (1.0 / low - 1.0 / high)))
    density: FloatArray = np.log(2.0) + difference - np.log(a) - np.log(np.log(high / low))
    return density


def threshold_for(false_alarm: float) -> float:
    """Return the threshold tau that noise exceeds with probability `false_alarm`."""
    return float(np.sqrt(-2.0 * np.log(false_alarm)))


@lru_cache(maxsize=256)
def detection_probability(threshold: float, snr_band: tuple[float, float]) -> float:
    """Return p_D of a class: the mass of its amplitude density above the threshold tau.

    Sec. V, p_D^tau. Deviation: printed as a function of a; it depends on class and tau alone, and
    has this closed form in the exponential integral E1.
    """
    low, high = 1.0 + snr_band[0], 1.0 + snr_band[1]
    half_square = 0.5 * threshold**2
    if half_square == 0.0:
        return 1.0
    mass = (exp1(half_square / high) - exp1(half_square / low)) / np.log(high / low)
    return float(np.clip(mass, 0.0, 1.0))


def level_db(amplitude: FloatArray) -> FloatArray:
    """Return the level 10 log10(a^2 / 2) of envelopes in dB, elementwise.

    It is the signal-to-noise ratio for which an envelope a is typical.
    """
    level: FloatArray = DB_PER_NEPER * np.log(0.5 * amplitude**2)
    return level


def of_classes(threshold: float, classes: Sequence[ClassModel]) -> FloatArray:
    """Return p_D of each class from its signal-to-noise ratios, shape (C,)."""
    return np.array([detection_probability(threshold, each.snr_band) for each in classes])


def snr_from_db(snr_db: float) -> float:
    """Return the linear signal-to-noise ratio of `snr_db`."""
    return float(10.0 ** (snr_db / 10.0))
