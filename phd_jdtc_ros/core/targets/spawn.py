"""Targets that split off other targets, possibly with another class."""

from __future__ import annotations

from dataclasses import dataclass

from ..arrays import FloatArray, ReadOnly


@dataclass(frozen=True)
class SpawnModel(ReadOnly):
    """The spawn intensity beta.

    Sec. V, beta_{k|k-1}. Deviation: the printed kernel is centred on x_{k-1}, one interval behind
    the parent (340 m for the scenario's targets). Here it is centred on F x_{k-1}, with F of the
    spawned target's mode.
    """

    rate: float  # lambda_beta, expected spawned targets per target and nominal interval
    # From the parent's flat mode to that of the spawned target, (O, O); rows sum to one. It is the
    # class matrix b times the mode matrix; unlike survival, it can change the class.
    transition: FloatArray
    # Standard deviations of the spawned state about its predicted parent, in the world frame, (D,).
    std: FloatArray
    # Number of particles for all targets that one target spawns.
    particles_per_target: int
