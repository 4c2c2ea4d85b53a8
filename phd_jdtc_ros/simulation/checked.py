"""Checked values of a scenario document's mappings; faults are collected, not raised."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from phd_jdtc_ros.configuration.schema import Parameter
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel

PLACE = Parameter("", [0.0, 0.0], "Latitude and longitude, degrees.", -180.0, 360.0, length=2)


def take(
    table: tuple[Parameter, ...],
    given: Mapping[str, Any],
    prefix: str,
    faults: list[str],
    optional: tuple[str, ...] = (),
    also: tuple[str, ...] = (),
) -> dict[str, Any]:
    """Return the checked values of a table; add faults to `faults`.

    Parameters
    ----------
    prefix : str
        Prefix of the names in faults.
    optional : tuple of str
        Names that have defaults and may be missing.
    also : tuple of str
        Other allowed keys.
    """
    known = {parameter.name for parameter in table}.union(also)
    faults += [f"{prefix}{name}: unknown key" for name in given if name not in known]
    values = {}
    for parameter in table:
        if parameter.name not in given and parameter.name not in optional:
            faults.append(f"{prefix}{parameter.name}: missing, must be {parameter.allowed}")
            continue
        value = given.get(parameter.name, parameter.default)
        values[parameter.name] = parameter.coerce(value)
        if values[parameter.name] is None:
            faults.append(f"{prefix}{parameter.name}: {value!r} given, must be {parameter.allowed}")
    return values


def names_of(table: tuple[Parameter, ...]) -> tuple[str, ...]:
    """Return the names in a table."""
    return tuple(parameter.name for parameter in table)


def mappings(
    given: Mapping[str, Any], name: str, prefix: str, faults: list[str]
) -> list[Mapping[str, Any]]:
    """Return a list of mappings, empty if absent; add a fault for any other value."""
    value = given.get(name, [])
    if isinstance(value, list) and all(isinstance(entry, Mapping) for entry in value):
        return value
    faults.append(f"{prefix}{name}: must be a list of mappings")
    return []


def mapping(given: Mapping[str, Any], name: str, faults: list[str]) -> Mapping[str, Any]:
    """Return a mapping, empty if absent; add a fault for any other value."""
    value = given.get(name, {})
    if isinstance(value, Mapping):
        return value
    faults.append(f"{name}: must be a mapping")
    return {}


def by_radar(
    document: Mapping[str, Any], block: str, radars: tuple[RadarModel, ...], faults: list[str]
) -> Mapping[str, Any]:
    """Return a block by name of the radar, empty if absent; add a fault for any other name."""
    given = mapping(document, block, faults)
    known = [radar.name for radar in radars]
    faults += [
        f"{block}.{name}: must be one of the radars, {', '.join(known)}"
        for name in given
        if name not in known
    ]
    return given


def values_by_radar(
    table: tuple[Parameter, ...],
    document: Mapping[str, Any],
    block: str,
    radars: tuple[RadarModel, ...],
    faults: list[str],
) -> list[dict[str, Any] | None]:
    """Return the checked values of each radar in a block, all optional; add faults to `faults`.

    They are None for a radar without a mapping there, or with faults.
    """
    given = by_radar(document, block, radars, faults)
    every: list[dict[str, Any] | None] = []
    for radar in radars:
        found: list[str] = []
        own = mapping(given, radar.name, found)
        values = take(table, own, f"{block}.{radar.name}.", found, names_of(table))
        every.append(values if radar.name in given and not found else None)
        faults += found
    return every


def place(given: Any, name: str, faults: list[str]) -> tuple[float, float]:
    """Return a latitude and a longitude, degrees; add a fault for any other value."""
    pair = PLACE.coerce(given)
    if isinstance(pair, list) and abs(float(pair[0])) <= 90.0:
        return float(pair[0]), float(pair[1])
    faults.append(f"{name}: {given!r} given, must be a latitude and a longitude, degrees")
    return 0.0, 0.0
