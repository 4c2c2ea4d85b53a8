"""The axes of the state: names and quantities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .arrays import FloatArray, IntArray


@dataclass(frozen=True)
class StateSpace:
    """The names of a state's axes, and the indices of position, velocity and turn rate."""

    axes: tuple[str, ...]
    position: tuple[int, ...]  # World frame, x first, metres
    velocity: tuple[int, ...]  # World frame, x first, metres per second
    turn_rate: int  # Radians per second
    # Height, metres, and climb rate, metres per second; empty in the plane.
    vertical: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.axes)

    @cached_property
    def place(self) -> tuple[int, ...]:
        """The axes of the position that sensors measure: with the height, if there is one."""
        return (*self.position, *self.vertical[:1])

    @cached_property
    def motion(self) -> tuple[int, ...]:
        """The axes of the velocity of `place`."""
        return (*self.velocity, *self.vertical[1:])

    @cached_property
    def planar_axes(self) -> IntArray:
        """Indices of the axes of position and velocity, (4,)."""
        return np.array([*self.position, *self.velocity])

    def state(
        self,
        position: Sequence[float] | FloatArray | float,
        velocity: Sequence[float] | FloatArray | float,
        turn_rate: float,
        vertical: Sequence[float] = (0.0, 0.0),
    ) -> FloatArray:
        """Return a state with these values, shape (D,); a single number stands for both axes.

        `vertical` has height and climb rate, for a state that has them.
        """
        state = np.zeros(len(self))
        state[list(self.position)] = position
        state[list(self.velocity)] = velocity
        state[self.turn_rate] = turn_rate
        state[list(self.vertical)] = vertical[: len(self.vertical)]
        return state


# The axes of `SPATIAL`, for code that depends on the layout: motions, radars and messages. Those of
# `PLANAR` are the first ones, so that a planar state is a spatial one without height.
X, VX, Y, VY, OMEGA, Z, VZ = range(7)
PLANAR = StateSpace(
    axes=("x", "vx", "y", "vy", "omega"), position=(X, Y), velocity=(VX, VY), turn_rate=OMEGA
)
SPATIAL = StateSpace(
    axes=(*PLANAR.axes, "z", "vz"),
    position=PLANAR.position,
    velocity=PLANAR.velocity,
    turn_rate=OMEGA,
    vertical=(Z, VZ),
)
