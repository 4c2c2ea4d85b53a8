"""The page's colour scale of amplitudes: logarithmic, for light and for dark pages."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from matplotlib.colors import to_hex

from phd_jdtc_ros.core.arrays import FloatArray, IntArray

from ..style import purples

BoolArray = npt.NDArray[np.bool_]
STEPS = 8


def _shades(weak: float, strong: float) -> list[str]:
    return [to_hex(shade) for shade in purples(weak, strong, STEPS)]


# By page: high amplitudes have the most contrast, and low ones remain visible.
AMPLITUDE_SCALES = {"light": _shades(0.45, 1.0), "dark": _shades(0.75, 0.0)}


def is_known(amplitude: FloatArray) -> BoolArray:
    """Return which amplitudes have a place on the scale."""
    known: BoolArray = np.isfinite(amplitude) & (amplitude > 0.0)
    return known


def shades_of(amplitude: FloatArray) -> IntArray:
    """Return the step of each amplitude on the scale from least to greatest; -1 for none."""
    shades = np.full(len(amplitude), -1, dtype=np.int64)
    known = is_known(amplitude)
    if known.any():
        level = np.log10(amplitude[known])
        span = max(float(np.ptp(level)), 0.04)
        shades[known] = np.minimum((level - level.min()) / span * STEPS, STEPS - 1).astype(int)
    return shades
