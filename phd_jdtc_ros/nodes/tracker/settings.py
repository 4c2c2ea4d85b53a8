"""The settings of a live tracker: the tracker's parameters and the node's own.

When the tracker is configured, and at every change from then on, all parameters are checked
together, with the messages of the offline tools. Before that each value is checked by itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Any

from msg_adapters.outgoing import cot, outputs
from phd_jdtc_ros.configuration import build
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.configuration.schema import ConfigError, Parameter, check, table
from phd_jdtc_ros.configuration.tables import schema
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files.node_tables import NAMES, Node

from . import senders

# The words of `outputs`: the switches of the table, the radars' frames, and a monitor of their
# registration. Only the markers may change in a running tracker.
OUTPUTS = (*outputs.SWITCHES, "frames", "registration")
MARKERS = "markers"
TABLE = tuple(
    replace(each, choices=OUTPUTS) if each.name == "outputs" else each for each in table(Node)
)


@dataclass(frozen=True)
class Settings:
    """A checked set of parameters."""

    table: dict[str, Parameter]  # All parameters
    config: TrackerConfig
    node: dict[str, Any]  # Values of the parameters in `TABLE` by name

    @property
    def values(self) -> dict[str, Any]:
        """The values of all parameters."""
        return {**self.config.values, **self.node}

    @property
    def mutable(self) -> frozenset[str]:
        """Names of the parameters that may change while the tracker runs."""
        return frozenset(name for name, parameter in self.table.items() if parameter.mutable)


def resolve(given: Mapping[str, Any]) -> Settings:
    """Check parameters, or their defaults, together; `ConfigError` lists every fault."""
    of_tracker = {name: value for name, value in given.items() if name not in NAMES}
    node, faults = check(TABLE, {name: value for name, value in given.items() if name in NAMES})
    try:
        tracker = build.resolve(of_tracker, SystemPlane)
    except ConfigError as error:
        raise ConfigError(*faults, *error.faults) from error
    if tracker.known_plane is None and node["outputs"]:
        wanted = [name for name in outputs.ON_THE_EARTH if name in node["outputs"]]
        place = ", whose latitude and longitude are unknown" if tracker.plane else ""
        faults += [f"outputs: {name} given, needs world_origin{place}" for name in wanted]
    faults += _stream_faults(node, tracker)
    if "registration" in node["outputs"]:
        others = [each.name for each in tracker.inputs if not isinstance(each, RadarParameters)]
        faults += [f"outputs: registration given, {name} is not a radar" for name in others]
    if faults:
        raise ConfigError(*faults)
    return Settings(_table(of_tracker), tracker, node)


def _stream_faults(node: Mapping[str, Any], tracker: TrackerConfig) -> list[str]:
    """Return the faults of what is sent by UDP and TCP."""
    faults, forms = [], set()
    for text in node["destinations"]:
        try:
            forms.add(senders.destination(text).form)
        except ValueError as error:
            faults.append(f"destinations: {error}")
    faults += [
        f"outputs: {row.switch} given, needs {row.form}+... in destinations"
        for row in outputs.STREAMS
        if row.switch in node["outputs"] and row.form not in forms and not faults
    ]
    faults += [
        f"outputs: {row.switch} given, needs {row.imports}, see docs/outputs.md"
        for row in outputs.STREAMS
        if row.switch in node["outputs"] and row.imports and find_spec(row.imports) is None
    ]
    moving = next((each for each in tracker.inputs if each.pose.topic), None)
    if outputs.RELATIVE in node["outputs"] and not (moving and moving.pose.yaw):
        faults.append(f"outputs: {outputs.RELATIVE} given, needs pose of a radar, and its heading")
    types, classes = node["cot_types"], tracker.classes
    if types and len(types) != len(classes):
        faults.append(f"cot_types: {types} given, must be empty or one for each of {classes}")
    faults += [
        f"cot_types: {kind} given, must be such as a-u-S"
        for kind in types
        if not cot.TYPE.fullmatch(kind)
    ]
    return faults


def _table(given: Mapping[str, Any]) -> dict[str, Parameter]:
    return {**schema(given), **{parameter.name: parameter for parameter in TABLE}}


def edit(
    values: Mapping[str, Any], changes: Mapping[str, Any]
) -> tuple[dict[str, Parameter], dict[str, Any]]:
    """Return the table and the values after a change while the tracker is not configured.

    Every value is checked by itself, because changes may come one by one. A list such as
    ``sensors`` adds and removes the parameters of its names. `ConfigError` has every fault.
    """
    wanted = {**values, **changes}
    table = _table(wanted)
    # A parameter that another kind of sensor does not allow has its default there.
    known = {
        name: value
        for name, value in wanted.items()
        if name in table and (name in changes or table[name].coerce(value) is not None)
    }
    checked, faults = check(table.values(), known)
    faults += build.name_faults(changes, table, wanted)
    if faults:
        raise ConfigError(*faults)
    return table, checked


def change(settings: Settings, changes: Mapping[str, Any]) -> Settings:
    """Return settings changed while the tracker is configured; `ConfigError` has every fault."""
    faults = [
        f"{name}: cannot change while the tracker is configured, clean it up before"
        for name in changes
        if name in settings.table and name not in settings.mutable
    ]
    faults += build.name_faults(changes, settings.table, settings.values)
    allowed = {name: value for name, value in changes.items() if name in settings.mutable}
    try:
        found = resolve({**settings.values, **allowed})
    except ConfigError as error:
        raise ConfigError(*faults, *error.faults) from error
    before, after = ({*each.node["outputs"]} - {MARKERS} for each in (settings, found))
    if before != after:
        faults.append("outputs: only markers may come and go while the tracker is configured")
    if faults:
        raise ConfigError(*faults)
    return found
