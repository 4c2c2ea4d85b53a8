"""The block ``targets`` of a scenario document: targets by scan, and flights with legs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from phd_jdtc_ros.configuration.schema import ConfigError, Parameter
from phd_jdtc_ros.core.targets.amplitude_density import snr_from_db

from ..checked import mappings, read, read_list, take
from .flight import PLACES, Flight, Leg
from .target_script import HEIGHTS, TargetScript, Turn

FLIGHT = (
    Parameter("class_id", 0, "Class, from 0.", 0, 1000, required=True),
    Parameter("snr_db", 30.0, "Mean signal-to-noise ratio, dB.", -100.0, 200.0),
    Parameter("start_s", 0.0, "Time of appearance, s after scan 0.", 0.0, 1e7),
    *PLACES,
    Parameter("height", 0.0, "Height above the world's zero, m.", *HEIGHTS),
)


def targets(document: Mapping[str, Any], faults: list[str]) -> list[TargetScript | Flight]:
    """Return the checked targets; add faults to `faults`."""
    every = [
        (_flight if "legs" in script else _target)(script, f"targets[{index}].", faults)
        for index, script in enumerate(mappings(document, "targets", "", faults))
    ]
    return [target for target in every if target is not None]


def _flight(script: Mapping[str, Any], prefix: str, faults: list[str]) -> Flight | None:
    """Return a checked flight; add its faults to `faults` and return None if there are any."""
    found: list[str] = []
    values = take(FLIGHT, script, prefix, found, ("legs",))
    own = legs(script, prefix, found)
    if not found:
        try:
            return Flight(
                class_id=values["class_id"],
                snr=snr_from_db(values["snr_db"]),
                start_s=values["start_s"],
                position=tuple(values["position"]),
                velocity=tuple(values["velocity"]),
                legs=own,
                height=values["height"],
            )
        except ConfigError as error:
            found += [f"{prefix}{fault}" for fault in error.faults]
    faults += found
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
