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

    def __len__(self) -> int:
        return len(self.axes)

    @cached_property
    def planar_axes(self) -> IntArray:
        """Indices of the axes of position and velocity, (4,)."""
        return np.array([*self.position, *self.velocity])

    def state(
        self,
        position: Sequence[float] | FloatArray | float,
        velocity: Sequence[float] | FloatArray | float,
        turn_rate: float,
    ) -> FloatArray:
        """Return a state with these values, shape (D,); a single number stands for both axes."""
        state = np.zeros(len(self))
        state[list(self.position)] = position
        state[list(self.velocity)] = velocity
        state[self.turn_rate] = turn_rate
        return state


# The axes of `PLANAR`, for code that depends on the layout: motions, radars and messages.
X, VX, Y, VY, OMEGA = range(5)
PLANAR = StateSpace(
    axes=("x", "vx", "y", "vy", "omega"), position=(X, Y), velocity=(VX, VY), turn_rate=OMEGA
)
