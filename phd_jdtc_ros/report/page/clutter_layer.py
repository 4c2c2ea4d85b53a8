"""What was learned of where clutter comes from, beneath the page's picture."""

from __future__ import annotations

from typing import Any

import numpy as np

from phd_jdtc_ros.core.models.clutter_raster import ClutterRaster

from ..style import CLUTTER
from .packing import Columns

# Of false detections per turn and km^2, decimal logarithms: what has no colour, and what has all.
FAINTEST, STRONGEST = 0.0, 3.0
# Steps of the opacity.
STEPS = 100


def clutter_levels(shown: ClutterRaster, columns: Columns) -> dict[str, Any]:
    """Add the squares' opacity as a column, rows by y; return where they are, in metres."""
    level = np.log10(np.maximum(shown.density, 10.0**FAINTEST))
    columns.add("clutter", np.rint(np.minimum(level / STRONGEST, 1.0) * STEPS).ravel())
    low_x, _, low_y, _ = shown.extent
    rows, across = shown.density.shape
    return {
        "corner": [float(low_x), float(low_y)],
        "cell": float(shown.cell),
        "shape": [rows, across],
        "colour": CLUTTER,
        "steps": STEPS,
    }
