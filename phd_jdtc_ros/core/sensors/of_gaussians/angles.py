"""Compiled operations on angles; `arrays.wrap_angle` wraps arrays of them."""

from __future__ import annotations

import math

from ...compilation import inner


@inner
def wrapped(angle: float) -> float:
    """Return an angle wrapped to (-pi, pi]."""
    if -math.pi < angle <= math.pi:  # most are; a remainder takes ten times as long
        return angle
    turned = math.pi - (math.pi - angle) % (2.0 * math.pi)
    return turned if turned > -math.pi else math.pi
