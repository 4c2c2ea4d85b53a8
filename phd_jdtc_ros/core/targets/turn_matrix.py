"""The matrix of a coordinated turn for compiled functions; `motion` is without a compiler."""

from __future__ import annotations

import math

from ..arrays import FloatArray
from ..compilation import inner
from ..state_space import OMEGA, VX, VY, VZ, X, Y, Z


@inner
def turn_terms(omega: float, arc: FloatArray) -> tuple[float, float, float, float, float]:
    """Return the terms of F(omega, dt) of a `motion.CoordinatedTurn`; `arc` is `motion.turn_arc`.

    These are the displacements along and across of a unit velocity, the cosine and the sine of the
    angle turned, and the share of the turn rate that is left.
    """
    half = 0.5 * arc[0] * omega
    cos_half, sin_half = math.cos(half), math.sin(half)
    chord = arc[1] * sin_half / half if half != 0.0 else arc[1]
    cos, sin = 1.0 - 2.0 * sin_half * sin_half, 2.0 * sin_half * cos_half
    along, across = chord * cos_half + arc[2] * cos, chord * sin_half + arc[2] * sin
    return along, across, cos, sin, arc[3]


@inner
def write_turn(terms: tuple[float, float, float, float, float], matrix: FloatArray) -> None:
    """Write the matrix of these terms into zeros of shape (D, D)."""
    along, across, cos, sin, decay = terms
    matrix[X, X] = matrix[Y, Y] = 1.0
    matrix[OMEGA, OMEGA] = decay
    matrix[X, VX], matrix[Y, VY], matrix[Y, VX], matrix[X, VY] = along, along, across, -across
    matrix[VX, VX], matrix[VY, VY], matrix[VY, VX], matrix[VX, VY] = cos, cos, sin, -sin


@inner
def turn(
    terms: tuple[float, float, float, float, float], state: FloatArray, later: FloatArray
) -> None:
    """Write the product of the matrix of these terms and a state."""
    along, across, cos, sin, decay = terms
    vx, vy = state[VX], state[VY]
    later[X], later[Y] = state[X] + along * vx - across * vy, state[Y] + across * vx + along * vy
    later[VX], later[VY] = cos * vx - sin * vy, sin * vx + cos * vy
    later[OMEGA] = decay * state[OMEGA]


@inner
def write_climb(dt: float, matrix: FloatArray) -> None:
    """Write the matrix of a climb into zeros of shape (D, D) with a height."""
    matrix[Z, Z] = matrix[VZ, VZ] = 1.0
    matrix[Z, VZ] = dt


@inner
def climb(dt: float, state: FloatArray, later: FloatArray) -> None:
    """Write height and climb rate after `dt` seconds, of a state with a height."""
    later[Z], later[VZ] = state[Z] + dt * state[VZ], state[VZ]
