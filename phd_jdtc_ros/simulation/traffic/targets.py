"""The block ``targets`` of a scenario document: targets by scan, and flights with legs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from phd_jdtc_ros.configuration.schema import ConfigError, parameter
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.targets.motion import CoordinatedTurn

from ..checked import collecting_faults, mappings, pair, read, read_list, signal_to_noise
from .flight import ROUNDING_S, Flight, Leg, turn_rate_field

SCANS, HEIGHTS = (0, 10**6), (-1e4, 3e4)
# True targets follow this model's mean; turn rate 0 is a straight line.
NOISE_FREE = CoordinatedTurn(noise_density=0.0, turn_noise_density=0.0)


@dataclass(frozen=True)
class Turn:
    """A part of a target's life in which its velocity rotates at a constant rate."""

    # The turn lasts from the stamp of the first scan to that of the last, at which the target flies
    # straight again.
    first_scan: int = parameter(0, "Scan at which the turn begins.", SCANS, required=True)
    last_scan: int = parameter(0, "Scan at which the turn ends.", SCANS, required=True)
    turn_rate: float = turn_rate_field(required=True)


@dataclass(frozen=True)
class TargetScript:
    """One target that moves at constant velocity except in its turns."""

    class_id: int = parameter(0, "Class, from 0.", (0, 1000), required=True)
    snr: float = signal_to_noise(30.0, required=True)
    position: tuple[float, float] = pair(
        "Position at the first scan, world frame, m.", required=True
    )
    velocity: tuple[float, float] = pair(
        "Velocity at the first scan, world frame, m/s.", required=True
    )
    first_scan: int = parameter(0, "First scan in which the target exists.", SCANS, required=True)
    last_scan: int = parameter(0, "Last scan in which the target exists.", SCANS, required=True)
    turns: tuple[Turn, ...] = ()  # One after the other, none before the first scan
    height: float = parameter(0.0, "Height above the world's zero, m.", HEIGHTS)

    def __post_init__(self) -> None:
        faults = []
        first, last = self.first_scan, self.last_scan
        if last < first:
            faults = [f"last_scan: {last} given, must be at least first_scan, {first}"]
        event = "target appears"
        for index, turn in enumerate(() if faults else self.turns):
            begin, end = turn.first_scan, turn.last_scan
            if begin < first:
                faults.append(
                    f"turns[{index}].first_scan: {begin} given, must be at least {first}, when the "
                    f"{event}"
                )
            if not begin < end <= last:
                faults.append(
                    f"turns[{index}].last_scan: {end} given, must be above its first_scan, "
                    f"{begin}, and at most the target's last_scan, {last}"
                )
            first, event = end, "previous turn ends"
        if faults:
            raise ConfigError(*faults)

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


@dataclass(frozen=True)
class FlightBlock:
    """A target with legs in a document, without the legs."""

    class_id: int = parameter(0, "Class, from 0.", (0, 1000), required=True)
    position: tuple[float, float] = pair("Position, world frame, m.", required=True)
    velocity: tuple[float, float] = pair("Velocity, world frame, m/s.", required=True)
    snr: float = signal_to_noise(30.0)
    start_s: float = parameter(0.0, "Time of appearance, s after scan 0.", (0.0, 1e7))
    height: float = parameter(0.0, "Height above the world's zero, m.", HEIGHTS)


def targets(document: Mapping[str, Any], faults: list[str]) -> list[TargetScript | Flight]:
    """Return the checked targets; add faults to `faults`."""
    checked = [
        (_flight if "legs" in script else _target)(script, f"targets[{index}].", faults)
        for index, script in enumerate(mappings(document, "targets", "", faults))
    ]
    return [target for target in checked if target is not None]


def _flight(script: Mapping[str, Any], prefix: str, faults: list[str]) -> Flight | None:
    """Return a checked flight; add its faults to `faults` and return None if there are any."""
    block = read(FlightBlock, script, prefix, faults, ("legs",))
    own = legs(script, prefix, faults)
    if block and own:
        with collecting_faults(prefix, faults):
            return Flight(**vars(block), legs=own)
    return None


def legs(script: Mapping[str, Any], prefix: str, faults: list[str]) -> tuple[Leg, ...]:
    """Return the checked legs of a block; add faults to `faults` and then return none."""
    found: list[str] = []
    checked = read_list(Leg, script, "legs", prefix, found)
    if not checked and not found:
        found.append(f"{prefix}legs: none given, must be at least one")
    faults += found
    return () if found else checked


def _target(script: Mapping[str, Any], prefix: str, faults: list[str]) -> TargetScript | None:
    """Return a checked target; add its faults to `faults` and return None if there are any."""
    turns: list[str] = []
    own = read_list(Turn, script, "turns", prefix, turns)
    target = read(TargetScript, script, prefix, faults, ("turns",), turns=own)
    faults += turns
    return None if turns else target
