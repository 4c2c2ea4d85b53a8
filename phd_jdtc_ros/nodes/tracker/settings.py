# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a live tracker runs by: the tracker's configuration, and what only the node has.

Checked whole at the start and at every change while it runs, by the same checks and in the same
words.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from phd_jdtc_ros.core.configuration import build
from phd_jdtc_ros.core.configuration.build import TrackerConfig
from phd_jdtc_ros.core.configuration.parameters import schema
from phd_jdtc_ros.core.configuration.schema import ConfigError, Parameter

from ..common.parameters import check

TABLE = (
    Parameter("autostart", True, "Configure and activate at the start, without being asked."),
    Parameter(
        "max_wait_s",
        0.0,
        "Longest a scan waits by the wall clock for the radars that have not reported it, or is "
        "held back by reorder_scans, s; at 0 it waits for a later stamp.",
        0.0,
        3600.0,
    ),
    Parameter("publish_markers", True, "Publish ~/markers.", mutable=True),
    Parameter("publish_path", False, "Publish ~/tracks/path, a message a track."),
    Parameter("publish_odometry", False, "Publish ~/odometry, a message a track."),
    Parameter("publish_radar_tracks", False, "Publish ~/radar_tracks (radar_msgs/RadarTracks)."),
    Parameter(
        "publish_detections_3d", False, "Publish ~/detections_3d (vision_msgs/Detection3DArray)."
    ),
    Parameter(
        "checkpoint.path",
        "",
        "File that keeps what the tracker knows, for a warm restart; empty for none.",
    ),
    Parameter("checkpoint.every", 0, "Scans between checkpoints; 0 for on request only.", 0, 10**6),
    Parameter(
        "checkpoint.max_age_s",
        60.0,
        "A checkpoint whose last scan is older than this, or than max_gap_scans, at the first one "
        "is not used, s.",
        0.0,
        86400.0,
    ),
    Parameter("path_length", 100, "Positions that a path keeps.", 2, 10**5),
    Parameter(
        "silent_after_scans",
        2.0,
        "A radar is silent half a second after it has missed this many of its scans.",
        0.5,
        1000.0,
        mutable=True,
    ),
    Parameter(
        "step_time_limit",
        1.0,
        "Time for a step above which diagnostics warn, in intervals between scans.",
        0.01,
        100.0,
        mutable=True,
    ),
)
NAMES = frozenset(parameter.name for parameter in TABLE)


@dataclass(frozen=True)
class Settings:
    """A checked set of parameters.

    Parameters
    ----------
    table : dict of name to Parameter
        Every parameter there is.
    config : TrackerConfig
        What the tracker's own parameters describe.
    node : dict of name to value
        The node's, those of `TABLE`.
    """

    table: dict[str, Parameter]
    config: TrackerConfig
    node: dict[str, Any]

    @property
    def values(self) -> dict[str, Any]:
        """Every parameter in force."""
        return {**self.config.values, **self.node}

    @property
    def mutable(self) -> frozenset[str]:
        """Names of the parameters that may change while the tracker runs."""
        return frozenset(name for name, parameter in self.table.items() if parameter.mutable)


def resolve(given: Mapping[str, Any]) -> Settings:
    """Check parameters and build what they describe; what is not given has its default.

    Raises
    ------
    ConfigError
        With every fault, the tracker's and the node's.
    """
    of_node = {name: value for name, value in given.items() if name in NAMES}
    of_tracker = {name: value for name, value in given.items() if name not in NAMES}
    node, faults = check(TABLE, of_node)
    try:
        tracker = build.resolve(of_tracker)
    except ConfigError as error:
        raise ConfigError([*faults, *error.faults]) from error
    if faults:
        raise ConfigError(faults)
    table = {**schema(of_tracker), **{parameter.name: parameter for parameter in TABLE}}
    return Settings(table, tracker, node)


def changed(settings: Settings, changes: Mapping[str, Any]) -> Settings:
    """Return the settings with some parameters changed while the tracker runs.

    Raises
    ------
    ConfigError
        With every fault: what must not change, and what the changed whole must not be.
    """
    faults = [
        f"{name}: cannot change while the tracker runs, restart it with another"
        if name in settings.table
        else f"{name}: unknown parameter"
        for name in changes
        if name not in settings.mutable
    ]
    allowed = {name: value for name, value in changes.items() if name in settings.mutable}
    try:
        found = resolve({**settings.values, **allowed})
    except ConfigError as error:
        raise ConfigError([*faults, *error.faults]) from error
    if faults:
        raise ConfigError(faults)
    return found
