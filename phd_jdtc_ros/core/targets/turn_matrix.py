"""The matrix of a coordinated turn for compiled functions; `motion` is without a compiler."""

from __future__ import annotations

import math

from ..arrays import FloatArray
from ..compilation import inner
from ..state_space import OMEGA, VX, VY, X, Y


@inner
def turn_terms(omega: float, dt: float) -> tuple[float, float, float, float]:
    """Return the terms of F(omega, dt) of a `motion.CoordinatedTurn`.

    These are the displacements along and across of a unit velocity, and the cosine and the sine of
    the angle turned.
    """
    half = 0.5 * dt * omega
    cos_half, sin_half = math.cos(half), math.sin(half)
    chord = dt * sin_half / half if half != 0.0 else dt
    turned = 1.0 - 2.0 * sin_half * sin_half, 2.0 * sin_half * cos_half
    return chord * cos_half, chord * sin_half, turned[0], turned[1]


@inner
def write_turn(terms: tuple[float, float, float, float], matrix: FloatArray) -> None:
    """Write the matrix of these terms into zeros of shape (5, 5)."""
    along, across, cos, sin = terms
    matrix[X, X] = matrix[Y, Y] = matrix[OMEGA, OMEGA] = 1.0
    matrix[X, VX], matrix[Y, VY], matrix[Y, VX], matrix[X, VY] = along, along, across, -across
    matrix[VX, VX], matrix[VY, VY], matrix[VY, VX], matrix[VX, VY] = cos, cos, sin, -sin


@inner
def turn(terms: tuple[float, float, float, float], state: FloatArray, later: FloatArray) -> None:
    """Write the product of the matrix of these terms and a state."""
    along, across, cos, sin = terms
    vx, vy = state[VX], state[VY]
    later[X], later[Y] = state[X] + along * vx - across * vy, state[Y] + across * vx + along * vy
    later[VX], later[VY], later[OMEGA] = cos * vx - sin * vy, sin * vx + cos * vy, state[OMEGA]
