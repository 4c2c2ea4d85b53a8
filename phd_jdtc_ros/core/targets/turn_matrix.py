"""The matrix of a coordinated turn for compiled functions; `motion` is without a compiler."""

from __future__ import annotations

import math

from ..arrays import FloatArray
from ..compilation import inner
from ..state_space import OMEGA, VX, VY, X, Y


@inner
def write_turn(omega: float, dt: float, matrix: FloatArray) -> None:
    """Write F(omega, dt) of a `motion.CoordinatedTurn` into zeros of shape (5, 5)."""
    half = 0.5 * dt * omega
    cos_half, sin_half = math.cos(half), math.sin(half)
    chord = dt * sin_half / half if half != 0.0 else dt
    along, across = chord * cos_half, chord * sin_half
    cos, sin = 1.0 - 2.0 * sin_half * sin_half, 2.0 * sin_half * cos_half
    matrix[X, X] = matrix[Y, Y] = matrix[OMEGA, OMEGA] = 1.0
    matrix[X, VX], matrix[Y, VY], matrix[Y, VX], matrix[X, VY] = along, along, across, -across
    matrix[VX, VX], matrix[VY, VY], matrix[VY, VX], matrix[VX, VY] = cos, cos, sin, -sin
