# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""How every picture looks: sizes, the line and marker of a class, and bare axes.

The palette survives colour-blind eyes and the lines and markers survive a grey printer.
"""

from __future__ import annotations

from matplotlib.axes import Axes

from msg_adapters.palette import COLOURS as COLOURS
from msg_adapters.palette import class_colour as class_colour

WIDTH_IN = 8.0
DPI = 150

LINES = ("-", "--", "-.", ":")
MARKERS = ("o", "^", "s", "D", "v", "P")
INK, GREY, FAINT = "#222222", "#9A9A9A", "#E4E4E4"


def class_name(class_id: int) -> str:
    """Return what a class is called."""
    return f"class {class_id}"


def class_line(class_id: int) -> str:
    """Return the line style of a class."""
    return LINES[class_id % len(LINES)]


def class_marker(class_id: int) -> str:
    """Return the marker of a class."""
    return MARKERS[class_id % len(MARKERS)]


def plain_axes(axes: Axes) -> None:
    """Leave of the axes what the reading needs: two spines and a faint grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)
