"""Scenario files: a document checked as a whole and turned into a `Scenario`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .amplitude import snr_from_db
from .config import ConfigError
from .parameters import SMALL, Parameter
from .radar import RadarModel
from .simulation import Scenario, TargetScript

TIMING = (
    Parameter("start_s", 1000.0, "Stamp of scan 0, s.", 0.0, 4e9),
    Parameter("interval_s", 6.0, "Between scans, s.", SMALL, 1e6),
    Parameter("scans", 80, "Number of scans.", 1, 10**6),
)

TARGET = (
    Parameter("class_id", 0, "Class, from 0.", 0, 1000),
    Parameter("snr_db", 30.0, "Mean signal-to-noise ratio, dB.", -100.0, 200.0),
    Parameter("position", [0.0, 0.0], "At its first scan, world frame, m.", length=2),
    Parameter("velocity", [0.0, 0.0], "World frame, m/s.", length=2),
    Parameter("first_scan", 0, "First scan it lives.", 0, 10**6),
    Parameter("last_scan", 0, "Last scan it lives.", 0, 10**6),
)


def resolve(document: Any, radars: tuple[RadarModel, ...]) -> Scenario:
    """Check a scenario document and build what it describes.

    Parameters
    ----------
    document : mapping
        The keys of `TIMING`, all optional, and ``targets``: a list of mappings with all keys of
        `TARGET`.
    radars : tuple of RadarModel

    Raises
    ------
    ConfigError
        With every fault.
    """
    if not isinstance(document, Mapping):
        raise ConfigError(["scenario: must be a mapping"])
    faults: list[str] = []
    timing = _take(TIMING, document, "", faults, optional=True, also=("targets",))
    scripts = document.get("targets", [])
    if not isinstance(scripts, list) or not all(isinstance(s, Mapping) for s in scripts):
        raise ConfigError([*faults, "targets: must be a list of mappings"])
    targets = [
        _take(TARGET, script, f"targets[{index}].", faults, optional=False)
        for index, script in enumerate(scripts)
    ]
    if faults:
        raise ConfigError(faults)
    return Scenario(
        start_ns=round(timing["start_s"] * 1e9),
        interval_s=timing["interval_s"],
        scans=timing["scans"],
        targets=tuple(
            TargetScript(
                class_id=target["class_id"],
                snr=snr_from_db(target["snr_db"]),
                position=tuple(target["position"]),
                velocity=tuple(target["velocity"]),
                first_scan=target["first_scan"],
                last_scan=target["last_scan"],
            )
            for target in targets
        ),
        radars=radars,
    )


def _take(
    table: tuple[Parameter, ...],
    given: Mapping[str, Any],
    prefix: str,
    faults: list[str],
    optional: bool,
    also: tuple[str, ...] = (),
) -> dict[str, Any]:
    """Return the checked values of a table; add what is wrong to `faults`."""
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
