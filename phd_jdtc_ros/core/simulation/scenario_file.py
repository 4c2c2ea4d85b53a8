# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scenario files: checks a document as a whole and turns it into a `Scenario`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ..configuration.schema import SMALL, ConfigError, Parameter
from ..models.amplitude_density import snr_from_db
from ..models.radar import RadarModel
from .scenario import Scenario, TargetScript, Turn

# Stamps count seconds in signed 32-bit integers.
END_OF_TIME_S = 2**31
TIMING = (
    # No real scan has the stamp 0.
    Parameter("start_s", 1000.0, "Stamp of scan 0, s.", 1e-3, 4e9),
    Parameter("interval_s", 6.0, "Interval between scans, s.", SMALL, 1e6),
    Parameter("scans", 80, "Number of scans.", 1, 10**6),
)
TARGET = (
    Parameter("class_id", 0, "Class, from 0.", 0, 1000),
    Parameter("snr_db", 30.0, "Mean signal-to-noise ratio, dB.", -100.0, 200.0),
    Parameter("position", [0.0, 0.0], "Position at its first scan, world frame, m.", length=2),
    Parameter("velocity", [0.0, 0.0], "Velocity at its first scan, world frame, m/s.", length=2),
    Parameter("first_scan", 0, "First scan in which it exists.", 0, 10**6),
    Parameter("last_scan", 0, "Last scan in which it exists.", 0, 10**6),
)
TURN = (
    Parameter("first_scan", 0, "Scan at which the turn begins.", 0, 10**6),
    Parameter("last_scan", 0, "Scan at which the turn ends.", 0, 10**6),
    Parameter(
        "turn_rate_deg_s", 0.0, "Turn rate, counter-clockwise, degrees per second.", -180.0, 180.0
    ),
)


def resolve(document: Any, radars: tuple[RadarModel, ...]) -> Scenario:
    """Check a scenario document and build what it describes.

    Parameters
    ----------
    document : mapping
        The keys of `TIMING`, all optional, and ``targets``: a list of mappings with all keys of
        `TARGET`. A target may have ``turns``: a list of mappings with all keys of `TURN`.
        ``parameters`` are those of the tracker and the radars, and are ignored here.
    radars : tuple of RadarModel

    Raises
    ------
    ConfigError
        With every fault.
    """
    if not isinstance(document, Mapping):
        raise ConfigError(["scenario: must be a mapping"])
    faults: list[str] = []
    timing = _take(TIMING, document, "", faults, True, ("targets", "parameters"))
    scripts = _mappings(document, "targets", "", faults)
    targets = [
        _target(script, f"targets[{index}].", faults) for index, script in enumerate(scripts)
    ]
    faults = faults or _time_faults(timing)
    if faults:
        raise ConfigError(faults)
    return Scenario(
        start_ns=round(timing["start_s"] * 1e9),
        interval_s=timing["interval_s"],
        scans=timing["scans"],
        targets=tuple(target for target in targets if target is not None),
        radars=radars,
    )


def _target(script: Mapping[str, Any], prefix: str, faults: list[str]) -> TargetScript | None:
    """Return a checked target; add its faults to `faults` and return None if there are any."""
    found: list[str] = []
    target = _take(TARGET, script, prefix, found, False, ("turns",))
    turns = [
        _take(TURN, turn, f"{prefix}turns[{index}].", found, False)
        for index, turn in enumerate(_mappings(script, "turns", prefix, found))
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


def _time_faults(timing: Mapping[str, Any]) -> list[str]:
    """Return the fault of the last scan's stamp, if it has one."""
    start, interval, scans = timing["start_s"], timing["interval_s"], timing["scans"]
    if start + (scans - 1) * interval < END_OF_TIME_S:
        return []
    return [
        f"start_s: {start} given, with {scans} scans {interval} s apart the last stamp must be "
        f"below {END_OF_TIME_S} s"
    ]


def _mappings(
    given: Mapping[str, Any], name: str, prefix: str, faults: list[str]
) -> list[Mapping[str, Any]]:
    """Return a list of mappings, empty if it is absent; add a fault if it is something else."""
    value = given.get(name, [])
    if isinstance(value, list) and all(isinstance(entry, Mapping) for entry in value):
        return value
    faults.append(f"{prefix}{name}: must be a list of mappings")
    return []


def _take(
    table: tuple[Parameter, ...],
    given: Mapping[str, Any],
    prefix: str,
    faults: list[str],
    optional: bool,
    also: tuple[str, ...] = (),
) -> dict[str, Any]:
    """Return the checked values of a table; add faults to `faults`."""
    known = {parameter.name for parameter in table}.union(also)
    faults += [f"{prefix}{name}: unknown key" for name in given if name not in known]
    values = {}
    for parameter in table:
        if parameter.name not in given and not optional:
            faults.append(f"{prefix}{parameter.name}: missing, must be {parameter.allowed}")
            continue
        value = given.get(parameter.name, parameter.default)
        values[parameter.name] = parameter.coerce(value)
        if values[parameter.name] is None:
            faults.append(f"{prefix}{parameter.name}: {value!r} given, must be {parameter.allowed}")
    return values
