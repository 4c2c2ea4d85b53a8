"""A live tracker's settings: the tracker's parameters and the node's own.

All are checked together, when the tracker is configured and at every change from then on, by the
same checks and with the same messages. While it is not configured, every value is checked by
itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from phd_jdtc_ros.configuration import build
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters import schema
from phd_jdtc_ros.configuration.schema import ConfigError, Parameter, unknown
from phd_jdtc_ros.earth import SystemPlane

from .schema import check

TABLE = (
    Parameter("autostart", True, "Configure and activate the node by itself at the start."),
    Parameter(
        "max_wait_s",
        0.0,
        "Longest time by the wall clock that a scan waits for radars that have not reported it, or "
        "is held back by reorder_scans, s; at 0 it waits for a later stamp.",
        0.0,
        3600.0,
    ),
    Parameter(
        "publish_detections",
        True,
        "Publish ~/detections: the detections of all radars in world_frame, for viewers.",
    ),
    Parameter(
        "publish_frames",
        True,
        "Publish the radars' frames on /tf_static, where tf2_msgs is installed; false if another "
        "node does.",
    ),
    Parameter("publish_markers", True, "Publish ~/markers.", mutable=True),
    Parameter(
        "publish_plots", True, "Publish ~/plot/..., one number per topic for plotting tools."
    ),
    Parameter("publish_path", False, "Publish ~/tracks/path, one message per track."),
    Parameter("publish_odometry", False, "Publish ~/odometry, one message per track."),
    Parameter("publish_radar_tracks", False, "Publish ~/radar_tracks (radar_msgs/RadarTracks)."),
    Parameter(
        "publish_detections_3d", False, "Publish ~/detections_3d (vision_msgs/Detection3DArray)."
    ),
    Parameter(
        "publish_navsat",
        False,
        "Publish ~/navsat (sensor_msgs/NavSatFix), one message per track; needs world_origin.",
    ),
    Parameter(
        "publish_geojson",
        False,
        "Publish ~/tracks/geojson (foxglove_msgs/GeoJSON), all tracks with where they were; needs "
        "world_origin.",
    ),
    Parameter(
        "checkpoint.path",
        "",
        "File in which the tracker's state is stored, for a warm restart; empty for none.",
    ),
    Parameter("checkpoint.every", 0, "Scans between checkpoints; 0 for on request only.", 0, 10**6),
    Parameter(
        "checkpoint.max_age_s",
        60.0,
        "Greatest age of a checkpoint, s: it is not used if the first scan comes later than this, "
        "or than max_gap_scans, after the checkpoint's last one.",
        0.0,
        86400.0,
    ),
    Parameter(
        "registration_monitor",
        False,
        "Watch whether radars agree: /diagnostics warns of one whose ranges or azimuths are off "
        "the tracks that others see too. It changes no estimate.",
    ),
    Parameter(
        "path_length",
        100,
        "Number of positions of a track in ~/tracks/path and ~/tracks/geojson.",
        2,
        10**5,
    ),
    Parameter(
        "silent_after_scans",
        2.0,
        "Number of its scans that a radar may miss; within half a second more it is called silent.",
        0.5,
        1000.0,
        mutable=True,
    ),
    Parameter(
        "step_time_limit",
        1.0,
        "Step time above which diagnostics warn, in intervals between scans.",
        0.01,
        100.0,
        mutable=True,
    ),
)
# What is published by latitude and longitude.
ON_THE_EARTH = ("publish_navsat", "publish_geojson")
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
    if tracker.plane is None:
        faults += [f"{name}: true given, needs world_origin" for name in ON_THE_EARTH if node[name]]
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
    one. A name that comes to a list such as ``radars`` brings its parameters, and one that goes
    takes them along.

    Raises
    ------
    ConfigError
        With every fault: unknown parameters, and values that are not allowed.
    """
    wanted = {**values, **changes}
    table = _table(wanted)
    found = {name: wanted.get(name, parameter.default) for name, parameter in table.items()}
    checked, faults = check(table.values(), found)
    faults += unknown(changes, table)
    if faults:
        raise ConfigError(faults)
    return table, checked


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
    faults += unknown(changes, settings.table)
    allowed = {name: value for name, value in changes.items() if name in settings.mutable}
    try:
        found = resolve({**settings.values, **allowed})
    except ConfigError as error:
        raise ConfigError([*faults, *error.faults]) from error
    if faults:
        raise ConfigError(faults)
    return found
