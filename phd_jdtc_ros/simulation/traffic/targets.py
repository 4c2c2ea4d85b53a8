"""The block ``targets`` of a scenario document: targets by scan, and flights with legs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from phd_jdtc_ros.configuration.schema import SMALL, Parameter
from phd_jdtc_ros.core.targets.amplitude_density import snr_from_db

from ..checked import mappings, take
from .flight import Flight, Leg
from .generators import SNR
from .target_script import TargetScript, Turn

HEIGHT = Parameter("height", 0.0, "Height above the world's zero, m.", -1e4, 3e4)
TARGET = (
    Parameter("class_id", 0, "Class, from 0.", 0, 1000),
    Parameter("snr_db", 30.0, "Mean signal-to-noise ratio, dB.", -100.0, 200.0),
    Parameter("position", [0.0, 0.0], "Position at the first scan, world frame, m.", length=2),
    Parameter("velocity", [0.0, 0.0], "Velocity at the first scan, world frame, m/s.", length=2),
    Parameter("first_scan", 0, "First scan in which the target exists.", 0, 10**6),
    Parameter("last_scan", 0, "Last scan in which the target exists.", 0, 10**6),
    HEIGHT,
)
FLIGHT = (
    Parameter("class_id", 0, "Class, from 0.", 0, 1000),
    SNR,
    Parameter("start_s", 0.0, "Time of appearance, s after scan 0.", 0.0, 1e7),
    Parameter("position", [0.0, 0.0], "Position at the start, world frame, m.", length=2),
    Parameter("velocity", [0.0, 0.0], "Velocity at the start, world frame, m/s.", length=2),
    HEIGHT,
)
LEG = (
    Parameter("duration_s", 0.0, "Length of the leg, s.", SMALL, 1e7),
    Parameter(
        "turn_rate_deg_s", 0.0, "Turn rate, counter-clockwise, degrees per second.", -180.0, 180.0
    ),
    Parameter("acceleration", 0.0, "Change of the speed, m/s^2.", -1e3, 1e3),
)
TURN = (
    Parameter("first_scan", 0, "Scan at which the turn begins.", 0, 10**6),
    Parameter("last_scan", 0, "Scan at which the turn ends.", 0, 10**6),
    Parameter(
        "turn_rate_deg_s", 0.0, "Turn rate, counter-clockwise, degrees per second.", -180.0, 180.0
    ),
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
    values = take(FLIGHT, script, prefix, found, ("snr_db", "start_s", "height"), ("legs",))
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
        except ValueError as error:
            found.append(f"{prefix}{error}")
    faults += found
    return None


def legs(script: Mapping[str, Any], prefix: str, faults: list[str]) -> tuple[Leg, ...]:
    """Return the checked legs of a block; add faults to `faults` and then return none."""
    found: list[str] = []
    every = []
    for index, given in enumerate(mappings(script, "legs", prefix, found)):
        name = f"{prefix}legs[{index}]."
        leg = take(LEG, given, name, found, ("turn_rate_deg_s", "acceleration"))
        if leg.get("turn_rate_deg_s") and leg.get("acceleration"):
            found.append(f"{name}acceleration: {leg['acceleration']} given, must be 0 in a turn")
        every.append(leg)
    if not every and not found:
        found.append(f"{prefix}legs: none given, must be at least one")
    faults += found
    if found:
        return ()
    return tuple(
        Leg(leg["duration_s"], math.radians(leg["turn_rate_deg_s"]), leg["acceleration"])
        for leg in every
    )


def _target(script: Mapping[str, Any], prefix: str, faults: list[str]) -> TargetScript | None:
    """Return a checked target; add its faults to `faults` and return None if there are any."""
    found: list[str] = []
    target = take(TARGET, script, prefix, found, ("height",), ("turns",))
    turns = [
        take(TURN, turn, f"{prefix}turns[{index}].", found)
        for index, turn in enumerate(mappings(script, "turns", prefix, found))
    ]
    found = found or _order_faults(target, turns, prefix)
    faults += found
    if found:
        return None
    return TargetScript(
        class_id=target["class_id"],
        snr=snr_from_db(target["snr_db"]),
        position=tuple(target["position"]),
        velocity=tuple(target["velocity"]),
        first_scan=target["first_scan"],
        last_scan=target["last_scan"],
        turns=tuple(
            Turn(turn["first_scan"], turn["last_scan"], math.radians(turn["turn_rate_deg_s"]))
            for turn in turns
        ),
        height=target["height"],
    )


def _order_faults(
    target: Mapping[str, Any], turns: Sequence[Mapping[str, Any]], prefix: str
) -> list[str]:
    """Return the faults in the order of a target's scans."""
    first, last = target["first_scan"], target["last_scan"]
    if last < first:
        return [f"{prefix}last_scan: {last} given, must be at least first_scan, {first}"]
    faults = []
    earliest = first
    for index, turn in enumerate(turns):
        begin, end = turn["first_scan"], turn["last_scan"]
        name = f"{prefix}turns[{index}]"
        if begin < earliest:
            event = "previous turn ends" if index else "target appears"
            faults.append(
                f"{name}.first_scan: {begin} given, must be at least {earliest}, when the {event}"
            )
        if not begin < end <= last:
            faults.append(
                f"{name}.last_scan: {end} given, must be above its first_scan, {begin}, and at "
                f"most the target's last_scan, {last}"
            )
        earliest = end
    return faults
