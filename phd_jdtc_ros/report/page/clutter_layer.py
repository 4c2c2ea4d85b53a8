# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What was learned of where clutter comes from, beneath the interactive map."""

from __future__ import annotations

import numpy as np
from plotly.graph_objects import Heatmap

from phd_jdtc_ros.core.models.clutter_raster import ClutterRaster

from ..lengths import MapScale
from ..style import CLUTTER

# Of false detections per turn and km^2, decimal logarithms: what has no colour, and what has all.
FAINTEST, STRONGEST = 0.0, 3.0
# A colour that is seen on light and on dark pages, by its opacity.
SHADES = [
    [0.0, f"rgba({CLUTTER},0.0)"],
    [0.3, f"rgba({CLUTTER},0.3)"],
    [1.0, f"rgba({CLUTTER},0.9)"],
]


def clutter_layer(shown: ClutterRaster, scale: MapScale) -> Heatmap:
    """Return the picture as a trace, on a logarithmic scale."""
    low_x, _, low_y, _ = shown.extent
    half = 0.5 * shown.cell
    level = np.log10(np.maximum(shown.density, 10.0**FAINTEST / 10.0))
    cells = [
        [round(value, 2) if value >= FAINTEST else None for value in row] for row in level.tolist()
    ]
    digits = scale.decimals - 1
    return Heatmap(
        z=cells,
        x0=float(scale.of_metres(np.array(low_x + half))),
        dx=float(scale.of_metres(np.array(shown.cell))),
        y0=float(scale.of_metres(np.array(low_y + half))),
        dy=float(scale.of_metres(np.array(shown.cell))),
        zmin=FAINTEST,
        zmax=STRONGEST,
        colorscale=SHADES,
        showscale=False,
        showlegend=True,
        name="learned clutter",
        hoverongaps=False,
        hovertemplate=(
            f"learned clutter<br>%{{x:.{digits}f}}, %{{y:.{digits}f}} {scale.unit}<br>"
            "10<sup>%{z:.1f}</sup> false detections per turn and km²<extra></extra>"
        ),
    )
