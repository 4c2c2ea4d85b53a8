"""The colours of the classes in markers, pages and pictures.

They are Okabe and Ito's palette without black, which is safe for colour-blind readers.
"""

from __future__ import annotations

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


def class_colour(class_id: int) -> str:
    """Return the colour of a class as ``#rrggbb``; colours repeat after the sixth."""
    return COLOURS[class_id % len(COLOURS)]


def class_rgb(class_id: int) -> tuple[float, float, float]:
    """Return the colour of a class as red, green and blue from 0 to 1."""
    digits = class_colour(class_id)
    red, green, blue = (int(digits[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    return red, green, blue
