# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page's colour scale of amplitudes: logarithmic, for light and for dark pages."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.colors import to_hex

from phd_jdtc_ros.core.arrays import FloatArray

from ..style import purples

BoolArray = npt.NDArray[np.bool_]


def _shades(weak: float, strong: float) -> list[list[Any]]:
    return [[k / 7.0, to_hex(shade)] for k, shade in enumerate(purples(weak, strong, 8))]


# By page: high amplitudes have the most contrast, and low ones remain visible.
AMPLITUDE_SCALES = {"light": _shades(0.45, 1.0), "dark": _shades(0.75, 0.0)}


def log_amplitude(amplitude: FloatArray) -> list[float | None]:
    """Return the decimal logarithm; None, which is drawn without colour, if there is none."""
    known = is_known(amplitude)
    return [
        round(float(np.log10(value)), 3) if good else None
        for value, good in zip(amplitude, known, strict=True)
    ]


def is_known(amplitude: FloatArray) -> BoolArray:
    """Return which amplitudes have a place on the scale."""
    known: BoolArray = np.isfinite(amplitude) & (amplitude > 0.0)
    return known


def colour_axis(amplitude: FloatArray) -> dict[str, Any]:
    """Return plotly's colour axis for amplitudes, on a logarithmic scale with round ticks.

    Parameters
    ----------
    amplitude : array of shape (M,)
        Known ones only, at least one.
    """
    low, high = amplitude.min(), amplitude.max()
    high = max(high, 1.1 * low)
    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    steps = [m * 10.0**d for d in decades for m in (1.0, 2.0, 5.0)]
    ticks = [step for step in steps if low <= step <= high]
    return {
        "cmin": float(np.log10(low)),
        "cmax": float(np.log10(high)),
        "colorscale": AMPLITUDE_SCALES["light"],
        "colorbar": {
            "title": {"text": "amplitude (noise std)", "side": "right"},
            "tickvals": [float(np.log10(tick)) for tick in ticks],
            "ticktext": [f"{tick:g}" for tick in ticks],
            "thickness": 12,
            "len": 0.6,
            "outlinewidth": 0,
        },
    }
