"""Checked values of a scenario document's mappings; faults are collected, not raised.

A block is declared as a dataclass whose fields are parameters; `read` makes an instance of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

from phd_jdtc_ros.configuration.schema import (
    UNBOUNDED,
    ConfigError,
    Form,
    Parameter,
    build,
    parameter,
    table,
)
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.targets.amplitude_density import snr_from_db

PLACE = Parameter("", [0.0, 0.0], "Latitude and longitude, degrees.", -180.0, 360.0, length=2)
T = TypeVar("T")


def converted_parameter(
    default: Any,
    description: str,
    bounds: tuple[float, float],
    convert: Callable[[Any], Any],
    name: str = "",
    **more: Any,
) -> Any:
    """Return a field like `parameter`'s for a value that the document gives in another unit."""
    plain = Parameter(name, default, description, *bounds, **more)
    form = Form(plain.allowed, plain.coerce, convert)
    return parameter(default, description, bounds, name, form=form, **more)


def degrees(
    default: float, description: str, bounds: tuple[float, float], name: str, **more: Any
) -> Any:
    """Return a field in radians of a parameter in degrees."""
    return converted_parameter(default, description, bounds, math.radians, name, **more)


def pair(description: str, **more: Any) -> Any:
    """Return a field of x and y."""
    return converted_parameter([0.0, 0.0], description, UNBOUNDED, tuple, length=2, **more)


def signal_to_noise(default_db: float, **more: Any) -> Any:
    """Return a field of a linear signal-to-noise ratio, which the document gives in decibels."""
    text, bounds = "Mean signal-to-noise ratio, dB.", (-100.0, 200.0)
    return converted_parameter(default_db, text, bounds, snr_from_db, "snr_db", **more)


def take(
    parameters: Iterable[Parameter],
    given: Mapping[str, Any],
    prefix: str,
    faults: list[str],
    also: tuple[str, ...] = (),
) -> dict[str, Any]:
    """Return the checked values of parameters; add faults to `faults`.

    `prefix` is that of the names in faults, and `also` has other allowed keys.
    """
    by_name = {parameter.name: parameter for parameter in parameters}
    faults += [
        f"{prefix}{name}: unknown key" for name in given if name not in by_name and name not in also
    ]
    values = {}
    for name, own in by_name.items():
        if own.required and name not in given:
            faults.append(f"{prefix}{name}: missing, must be {own.allowed}")
            continue
        values[name] = own.coerce(given.get(name, own.default))
        if values[name] is None:
            faults.append(prefix + own.fault(given[name]))
    return values


def read(
    declared: type[T],
    given: Mapping[str, Any],
    prefix: str,
    faults: list[str],
    also: tuple[str, ...] = (),
    **others: Any,
) -> T | None:
    """Return an instance of a dataclass that declares a block; add faults and then return None.

    `others` are fields that are not parameters; the other arguments are those of `take`. Faults
    that the class itself finds, raised as a `ConfigError`, are added too.
    """
    found: list[str] = []
    values = take(table(declared), given, prefix, found, also)
    if not found:
        with collecting_faults(prefix, faults):
            return build(declared, values, **others)
    faults += found
    return None


@contextmanager
def collecting_faults(prefix: str, faults: list[str]) -> Iterator[None]:
    """Add the faults of a `ConfigError` in the block to `faults` instead of raising it."""
    try:
        yield
    except ConfigError as error:
        faults += [f"{prefix}{fault}" for fault in error.faults]


def mappings(
    given: Mapping[str, Any], name: str, prefix: str, faults: list[str]
) -> list[Mapping[str, Any]]:
    """Return a list of mappings, empty if absent; add a fault for any other value."""
    value = given.get(name, [])
    if isinstance(value, list) and all(isinstance(entry, Mapping) for entry in value):
        return value
    faults.append(f"{prefix}{name}: must be a list of mappings")
    return []


def read_list(
    declared: type[T], given: Mapping[str, Any], name: str, prefix: str, faults: list[str]
) -> tuple[T, ...]:
    """Return what a list of mappings declares, without those that have faults; see `read`."""
    checked = (
        read(declared, entry, f"{prefix}{name}[{index}].", faults)
        for index, entry in enumerate(mappings(given, name, prefix, faults))
    )
    return tuple(each for each in checked if each is not None)


def mapping(
    given: Mapping[str, Any], name: str, faults: list[str], prefix: str = ""
) -> Mapping[str, Any]:
    """Return a mapping, empty if absent; add a fault for any other value."""
    value = given.get(name, {})
    if isinstance(value, Mapping):
        return value
    faults.append(f"{prefix}{name}: must be a mapping")
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


def read_by_radar(
    declared: type[T],
    document: Mapping[str, Any],
    block: str,
    radars: tuple[RadarModel, ...],
    faults: list[str],
) -> list[T | None]:
    """Return what `read` finds for each radar in a block; None without a mapping."""
    given = by_radar(document, block, radars, faults)
    return [
        read(declared, mapping(given, radar.name, faults), f"{block}.{radar.name}.", faults)
        if radar.name in given
        else None
        for radar in radars
    ]


def place(given: Any, name: str, faults: list[str]) -> tuple[float, float]:
    """Return a latitude and a longitude, degrees; add a fault for any other value."""
    found = PLACE.coerce(given)
    if isinstance(found, list) and abs(found[0]) <= 90.0:
        return found[0], found[1]
    faults.append(f"{name}: {given!r} given, must be a latitude and a longitude, degrees")
    return 0.0, 0.0
