"""A live tracker's settings: the tracker's parameters and the node's own.

All are checked together, when the tracker is configured and at every change from then on, by the
same checks and with the same messages. While it is not configured, every value is checked by
itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from phd_jdtc_ros.earth import SystemPlane

from . import build
from .build import TrackerConfig
from .parameters import schema
from .schema import ConfigError, Parameter, check, parameter, table

OUTPUTS = (
    *("detections", "frames", "markers", "plots", "paths", "odometry", "radar_tracks"),
    *("detections_3d", "navsat", "geojson", "registration"),
)
# What is published by latitude and longitude.
ON_THE_EARTH = ("navsat", "geojson")
# The one that may come and go while the tracker runs.
MARKERS = "markers"


@dataclass(frozen=True)
class Node:
    """What the live node has beside the tracker."""

    autostart: bool = parameter(True, "Configure and activate the node by itself at the start.")
    max_wait_s: float = parameter(
        0.0,
        "Longest time by the wall clock that a scan waits for radars that have not reported it, s; "
        "at 0 it waits for a later stamp.",
        0.0,
        3600.0,
    )
    outputs: list[str] = parameter(
        ["detections", "frames", "markers", "plots"],
        "What is published beside estimates, poses and figures. detections: ~/detections, all "
        "radars' in world_frame; frames: the radars' frames on /tf_static, where tf2_msgs is "
        "installed and no other node does; markers: ~/markers; plots: ~/plot/..., one number per "
        "topic for plotting tools; paths: ~/tracks/path, one message per track; odometry: "
        "~/odometry, one message per track; radar_tracks: ~/radar_tracks (radar_msgs); "
        "detections_3d: ~/detections_3d (vision_msgs); navsat: ~/navsat, one message per track, "
        "and geojson: ~/tracks/geojson (foxglove_msgs), all tracks with where they were, both "
        "with world_origin only; registration: a warning on /diagnostics where a radar's ranges "
        "or azimuths are off the tracks that others see too. Only markers may come and go while "
        "the tracker runs.",
        element=str,
        choices=OUTPUTS,
        mutable=True,
    )
    checkpoint_path: str = parameter(
        "",
        "File in which the tracker's state is stored, for a warm restart; empty for none.",
        name="checkpoint.path",
    )
    checkpoint_every: int = parameter(
        0, "Scans between checkpoints; 0 for on request only.", 0, 10**6, name="checkpoint.every"
    )


TABLE = table(Node)
NAMES = frozenset(parameter.name for parameter in TABLE)


@dataclass(frozen=True)
class Settings:
    """A checked set of parameters.

    Parameters
    ----------
    table : dict of name to Parameter
        All parameters.
    config : TrackerConfig
        What the tracker's parameters describe.
    node : dict of name to value
        Values of the node's own parameters, those of `TABLE`.
    """

    table: dict[str, Parameter]
    config: TrackerConfig
    node: dict[str, Any]

    @property
    def values(self) -> dict[str, Any]:
        """The values of all parameters."""
        return {**self.config.values, **self.node}

    @property
    def mutable(self) -> frozenset[str]:
        """Names of the parameters that may change while the tracker runs."""
        return frozenset(name for name, parameter in self.table.items() if parameter.mutable)


def resolve(given: Mapping[str, Any]) -> Settings:
    """Check parameters and build what they describe; those not given have their defaults.

    Raises
    ------
    ConfigError
        With every fault, the tracker's and the node's.
    """
    of_node = {name: value for name, value in given.items() if name in NAMES}
    of_tracker = {name: value for name, value in given.items() if name not in NAMES}
    node, faults = check(TABLE, of_node)
    try:
        tracker = build.resolve(of_tracker, SystemPlane)
    except ConfigError as error:
        raise ConfigError([*faults, *error.faults]) from error
    if tracker.plane is None and node["outputs"]:
        faults += [
            f"outputs: {name} given, needs world_origin"
            for name in ON_THE_EARTH
            if name in node["outputs"]
        ]
    if faults:
        raise ConfigError(faults)
    return Settings(_table(of_tracker), tracker, node)


def _table(given: Mapping[str, Any]) -> dict[str, Parameter]:
    return {**schema(given), **{parameter.name: parameter for parameter in TABLE}}


def edited(
    values: Mapping[str, Any], changes: Mapping[str, Any]
) -> tuple[dict[str, Parameter], dict[str, Any]]:
    """Return the table and the values after a change while the tracker is not configured.

    Every value is checked by itself, and not yet whether they fit together: they may come one by
    one. A name that comes to a list such as ``sensors`` brings its parameters, and one that goes
    takes them along.

    Raises
    ------
    ConfigError
        With every fault: unknown parameters, and values that are not allowed.
    """
    wanted = {**values, **changes}
    every = _table(wanted)
    found = {name: wanted.get(name, own.default) for name, own in every.items()}
    checked, faults = check(every.values(), found)
    faults += _refused(changes, every)
    if faults:
        raise ConfigError(faults)
    return every, checked


def _refused(changes: Mapping[str, Any], known: Mapping[str, Parameter]) -> list[str]:
    """Return a fault for each parameter that there is not."""
    return build.refused(changes, known)


def changed(settings: Settings, changes: Mapping[str, Any]) -> Settings:
    """Return the settings with some parameters changed while the tracker is configured.

    Raises
    ------
    ConfigError
        With every fault: parameters that cannot change, and values that are not allowed.
    """
    faults = [
        f"{name}: cannot change while the tracker is configured, clean it up before"
        for name in changes
        if name in settings.table and name not in settings.mutable
    ]
    faults += _refused(changes, settings.table)
    allowed = {name: value for name, value in changes.items() if name in settings.mutable}
    try:
        found = resolve({**settings.values, **allowed})
    except ConfigError as error:
        raise ConfigError([*faults, *error.faults]) from error
    before, after = ({*each.node["outputs"]} - {MARKERS} for each in (settings, found))
    if before != after:
        faults.append("outputs: only markers may come and go while the tracker is configured")
    if faults:
        raise ConfigError(faults)
    return found
