"""The block ``targets`` of a scenario document: targets by scan, and flights with legs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from phd_jdtc_ros.configuration.schema import parameter

from ..checked import collecting_faults, mappings, pair, read, read_list, signal_to_noise
from .flight import Flight, Leg
from .target_script import HEIGHTS, TargetScript, Turn


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
    every = [
        (_flight if "legs" in script else _target)(script, f"targets[{index}].", faults)
        for index, script in enumerate(mappings(document, "targets", "", faults))
    ]
    return [target for target in every if target is not None]


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
    every = read_list(Leg, script, "legs", prefix, found)
    if not every and not found:
        found.append(f"{prefix}legs: none given, must be at least one")
    faults += found
    return () if found else every


def _target(script: Mapping[str, Any], prefix: str, faults: list[str]) -> TargetScript | None:
    """Return a checked target; add its faults to `faults` and return None if there are any."""
    turns: list[str] = []
    own = read_list(Turn, script, "turns", prefix, turns)
    target = read(TargetScript, script, prefix, faults, ("turns",), turns=own)
    faults += turns
    return None if turns else target
