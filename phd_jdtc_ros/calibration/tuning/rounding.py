"""Rounds estimates to the digits that they have."""

from __future__ import annotations

import math


def round_to_std(value: float, std: float) -> float:
    """Return a value rounded to a twentieth of its standard deviation, and to five digits."""
    if not (math.isfinite(value) and value):
        return 0.0
    digits = 5
    if std > 0.0:
        digits = min(max(math.ceil(math.log10(abs(value) / std) + 1.3), 2), 5)
    return float(f"{value:.{digits}g}")


def round_up(value: float) -> float:
    """Return a value rounded up to two digits."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / step - 1e-9) * step:.6g}")
