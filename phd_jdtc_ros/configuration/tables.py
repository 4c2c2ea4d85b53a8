"""The tables of all parameters: by the kind of a sensor, and for the names in a list.

A further kind is a subclass of `SensorParameters` and a row in `KINDS`; CONTRIBUTING lists what
else it needs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

from phd_jdtc_ros.core.factors import Factor
from phd_jdtc_ros.core.intake.input_checks import PositionReportCheck, ReportCheck
from phd_jdtc_ros.core.sensors.sensor import Sensor

from . import sensor_models
from .parameters.position import PositionParameters
from .parameters.radar import RadarParameters
from .parameters.reports import ReportsParameters
from .parameters.sensor import SensorParameters
from .parameters.tracker import IMPLIED, USUAL, Birth, Motion, Parts, TargetClass, Tracking
from .schema import Parameter, build, expand, table

S = TypeVar("S", bound=SensorParameters)


@dataclass(frozen=True)
class SensorKind(Generic[S]):
    """What a value of a sensor's parameter `kind` stands for."""

    parameters: type[S]
    # None for a receiver of self-reports, which is no sensor of the engine.
    model: Callable[[S], Sensor] | None
    # Returns what else is assumed of its detections; see `core.factors`.
    factors: Callable[[S], tuple[Factor, ...]] = lambda _: ()
    # Checks of its parameters, each with a line per fault.
    checks: tuple[Callable[[S, Parts], Iterator[str]], ...] = ()
    # Returns the checks of its reports against its configuration.
    report_check: Callable[[S], ReportCheck] = lambda _: ReportCheck()


# By the value of ``kind``. The first one is the default.
KINDS: Mapping[str, SensorKind[Any]] = {
    "radar": SensorKind(
        RadarParameters,
        sensor_models.radar_model,
        sensor_models.radar_factors,
        sensor_models.RADAR_CHECKS,
        sensor_models.radar_report_check,
    ),
    "position": SensorKind(
        PositionParameters,
        sensor_models.position_model,
        sensor_models.position_factors,
        sensor_models.POSITION_CHECKS,
        lambda _: PositionReportCheck(),
    ),
    "reports": SensorKind(ReportsParameters, None, checks=sensor_models.REPORTS_CHECKS),
}


def _table(declared: type) -> tuple[Parameter, ...]:
    """Return the parameters of a kind, `kind` with the values that it may have."""
    return tuple(
        replace(each, choices=tuple(KINDS)) if each.name == "kind" else each
        for each in table(declared)
    )


TABLES: Mapping[str, tuple[Parameter, ...]] = {
    name: _table(kind.parameters) for name, kind in KINDS.items()
}
# The parameters of all kinds, by name; the first kind's where several have one of the same name.
ALL: Mapping[str, Parameter] = {
    each.name: each for own in reversed(list(TABLES.values())) for each in own
}


def model_of(sensor: SensorParameters) -> Sensor:
    """Return the model of a sensor that has one."""
    model = KINDS[sensor.kind].model
    if model is None:
        raise TypeError(f"{sensor.name}: kind {sensor.kind} has no detections")
    return model(sensor)


def parameters_of(kind: Any) -> tuple[Parameter, ...]:
    """Return the parameters of a sensor with this `kind`, those of the first if there is none."""
    known = isinstance(kind, str) and kind in TABLES
    return TABLES[kind if known else next(iter(TABLES))]


TOP = table(Tracking)
# The parameters of each name in a list; a sensor has those of its kind.
GROUPS = {
    "sensors": tuple(ALL.values()),
    "classes": table(TargetClass),
    "motions": table(Motion),
    "births": table(Birth),
}


def schema(given: Mapping[str, Any]) -> dict[str, Parameter]:
    """Return all parameters for the lists of names in `given`, by dotted name.

    Faulty lists are replaced by their defaults; `resolve` reports them.
    """

    def members(group: str, name: str) -> tuple[Parameter, ...]:
        if group == "sensors":
            return parameters_of(given.get(f"{name}.kind"))
        return GROUPS[group]

    # What the paper's filters and targets in space do not have is no default with them.
    implied = {
        name: value
        for (chosen, choice), own in IMPLIED.items()
        if given.get(chosen) == choice
        for name, value in own.items()
    }
    top = [replace(each, default=implied.get(each.name, each.default)) for each in TOP]

    def usual(name: str, member: Parameter) -> Any:
        return USUAL.get(name, implied.get(member.name, member.default))

    return expand(top, GROUPS, members, given, usual)


def parts_of(values: Mapping[str, Any]) -> Parts:
    """Return checked values as the dataclasses that declare them."""
    listed: dict[str, SensorParameters] = {}
    for name in values["sensors"]:
        declared: type[SensorParameters] = KINDS[values[f"{name}.kind"]].parameters
        addresses = {key: topic_or_frame(values, name, key) for key in ("topic", "frame")}
        listed[name] = build(declared, values, f"{name}.", name=name, **addresses)
    receivers = [n for n, own in listed.items() if isinstance(own, ReportsParameters)]
    return Parts(
        build(Tracking, values),
        {name: own for name, own in listed.items() if name not in receivers},
        {name: build(TargetClass, values, f"{name}.") for name in values["classes"]},
        {name: build(Motion, values, f"{name}.") for name in values["motions"]},
        {name: build(Birth, values, f"{name}.") for name in values["births"]},
        {name: listed[name] for name in receivers},
    )


def topic_or_frame(values: Mapping[str, Any], sensor: str, key: str) -> str:
    """Return a sensor's topic or frame, or its default if it is empty."""
    declared: type[SensorParameters] = KINDS[values[f"{sensor}.kind"]].parameters
    usual = {"topic": f"/{sensor}/{declared.TOPIC}", "frame": sensor}
    return str(values[f"{sensor}.{key}"] or usual[key])


def entries(given: Mapping[str, Any]) -> set[str]:
    """Return the names of all entries that the sensors' mappings may have."""
    listed = next(own for own in TOP if own.name == "sensors")
    names = listed.coerce(given.get("sensors", listed.default)) or ()
    return {
        f"{name}.{own.name}.{key}"
        for name in names
        for own in parameters_of(given.get(f"{name}.kind"))
        for key in own.keys
    }


def unlisted(given: Mapping[str, Any], name: str) -> str:
    """Return which list lacks the part that a parameter belongs to, or which parts have it.

    The text is empty if no part has such a parameter.
    """
    part, _, member = name.partition(".")
    listed = {
        own.name: own.coerce(given.get(own.name, own.default)) or ()
        for own in TOP
        if own.name in GROUPS
    }
    having = [
        group
        for group, members in GROUPS.items()
        if member.partition(".")[0] in {own.name for own in members}
    ]
    if having and any(part in names for names in listed.values()):
        own_name, _, key = member.partition(".")
        kinds = [
            kind
            for kind, own in TABLES.items()
            if any(each.name == own_name and key in (*each.keys, "") for each in own)
        ]
        of_kinds = f" of kind {' or '.join(kinds)}" if having == ["sensors"] else ""
        return f"{member} is a parameter of {' and '.join(having)}{of_kinds}"
    lacking = [f"{group} ({', '.join(listed[group])})" for group in having]
    return f"{part} is not in {' or '.join(lacking)}" if lacking else ""
