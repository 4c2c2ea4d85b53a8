"""Targets whose life and turns are given in scans, for radars with a common scan."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.targets.motion import CoordinatedTurn

from .flight import ROUNDING_S, Flight, Leg

# True targets follow this model's mean; turn rate 0 is a straight line.
NOISE_FREE = CoordinatedTurn(noise_density=0.0, turn_noise_density=0.0)


@dataclass(frozen=True)
class Turn:
    """A part of a target's life in which its velocity rotates at a constant rate."""

    # `first_scan`, `last_scan`: the turn lasts from the stamp of the first scan to the stamp of the
    # last, at which the target flies straight again.
    first_scan: int
    last_scan: int
    turn_rate: float  # Radians per second, counter-clockwise


@dataclass(frozen=True)
class TargetScript:
    """One target that moves at constant velocity except in its turns."""

    class_id: int
    snr: float  # Mean signal-to-noise ratio, linear
    position: tuple[float, float]  # Position at the first scan, world frame, metres
    velocity: tuple[float, float]  # Velocity at the first scan, metres per second
    # `first_scan`, `last_scan`: first and last scan in which the target exists.
    first_scan: int
    last_scan: int
    turns: tuple[Turn, ...] = ()  # Successive turns, none before the first scan
    height: float = 0.0  # Height above the world's zero, metres

    def __post_init__(self) -> None:
        edges = [self.first_scan, *(e for t in self.turns for e in (t.first_scan, t.last_scan))]
        if edges != sorted(edges):
            raise ValueError(f"turns: {self.turns}, expected one after the other")

    def state_at(self, scan: int, interval_s: float) -> FloatArray | None:
        """Return the exact state at a scan, with the present turn's rate, (D,); None if absent.

        Scans are `interval_s` seconds apart.
        """
        if not self.first_scan <= scan <= self.last_scan:
            return None
        space = NOISE_FREE.space
        state = space.state(self.position, self.velocity, 0.0)[None]
        for scans, turn_rate in self._legs(scan):
            state[0, space.turn_rate] = turn_rate
            state = NOISE_FREE.mean(state, scans * interval_s)
        now = [turn.turn_rate for turn in self.turns if turn.first_scan <= scan < turn.last_scan]
        state[0, space.turn_rate] = sum(now)
        exact: FloatArray = state[0]
        return exact

    def _legs(self, scan: int) -> Iterator[tuple[int, float]]:
        """Yield the length in scans and the turn rate of every leg up to a scan."""
        reached = self.first_scan
        for turn in self.turns:
            for until, turn_rate in ((turn.first_scan, 0.0), (turn.last_scan, turn.turn_rate)):
                yield min(until, scan) - min(reached, scan), turn_rate
                reached = until
        yield scan - min(reached, scan), 0.0

    def flight(self, interval_s: float) -> Flight:
        """Return the same target with legs in seconds."""
        legs = [
            Leg(scans * interval_s, turn_rate)
            for scans, turn_rate in self._legs(self.last_scan)
            if scans
        ]
        return Flight(
            self.class_id,
            self.snr,
            self.first_scan * interval_s,
            self.position,
            self.velocity,
            tuple(legs) or (Leg(ROUNDING_S),),
            self.height,
        )
