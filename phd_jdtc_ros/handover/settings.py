"""Checks the parameters of the hand-over, and builds its settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

from msg_adapters.encoding import names
from phd_jdtc_ros.configuration.parameters import replaced
from phd_jdtc_ros.configuration.parameters.place_forms import is_region
from phd_jdtc_ros.configuration.schema import (
    ConfigError,
    Parameter,
    check,
    parameter,
    table,
    with_members,
)
from phd_jdtc_ros.core.tracks.region import Region

# A smoothed estimate waits until the filtered picture is SMOOTHED_WAIT_S seconds ahead of it,
# because the smoother reports a target before the filter has confirmed and numbered it. If the
# smoother's lag is longer than this, no estimate has to wait.
SMOOTHED_WAIT_S = 8.0
# Upper bound of every waiting time, seconds.
LONGEST_S = 600.0


@dataclass(frozen=True)
class TrackerParameters:
    """Parameters of each tracker whose estimates are joined."""

    region: list[float] = parameter(
        [], "The tracker's region: [x_min, y_min, x_max, y_max, margin], world frame, m."
    )


@dataclass(frozen=True)
class HandOverParameters:
    """Parameters of the hand-over node."""

    trackers: list[str] = parameter(
        [],
        "Names of the trackers that share the area, two or more, each with its region. The node of "
        "NAME is /NAME/tracker.",
        element=str,
        # Largest number of trackers, because each pair of them is compared at every stamp.
        most=50,
    )
    max_delay_s: float = parameter(
        5.0,
        "Longest time that a stamp waits for a tracker, measured by the other trackers' stamps, s. "
        "A tracker that is further behind the newest stamp is left out until it has caught up.",
        (0.1, LONGEST_S),
    )


TRACKER, TABLE = table(TrackerParameters), table(HandOverParameters)


@dataclass(frozen=True)
class Settings:
    """The settings of the hand-over."""

    values: dict[str, Any]  # All parameters by name
    table: dict[str, Parameter]
    names: tuple[str, ...]  # Names of the trackers
    nodes: tuple[str, ...]  # Full names of their nodes
    regions: tuple[Region, ...]
    hysteresis: float  # Metres

    def topic(self, tracker: int, source: str) -> str:
        """Return the topic of a tracker's estimates."""
        return names.estimates(source, self.nodes[tracker])


def resolve(given: Mapping[str, Any]) -> Settings:
    """Check the parameters of the node, given by dotted name; `ConfigError` lists every fault."""
    parameters = with_members(TABLE, "trackers", TRACKER, given)
    values, faults = check(
        parameters.values(), given, replaced.HAND_OVER, replaced.HAND_OVER_TRACKER
    )
    if None not in values.values():
        faults += _faults(values)
    if faults:
        raise ConfigError(*faults)
    trackers = tuple(values["trackers"])
    regions = tuple(Region(*values[f"{name}.region"]) for name in trackers)
    faults = region_faults([f"{name}." for name in trackers], regions)
    if faults:
        raise ConfigError(*faults)
    return Settings(
        values,
        parameters,
        trackers,
        tuple(f"/{name}{names.TRACKER}" for name in trackers),
        regions,
        hysteresis(regions),
    )


def hysteresis(regions: Sequence[Region]) -> float:
    """Return the distance beyond a seam at which a target is handed over, metres."""
    # Distance beyond a seam at which a target is handed over, as a share of the smallest margin.
    return 0.2 * min(region.margin for region in regions)


def region_faults(owners: Sequence[str], regions: Sequence[Region]) -> list[str]:
    """Return the faults of adjacent regions; `owners` are the prefixes of their parameters."""
    faults = [
        f"{owner}region: margin {region.margin:g} given, must be above 0: a target is handed over "
        "where both trackers have it"
        for owner, region in zip(owners, regions, strict=True)
        if region.margin <= 0.0
    ]
    for (one, mine), (other, theirs) in combinations(zip(owners, regions, strict=True), 2):
        if min(mine.x_max, theirs.x_max) > max(mine.x_min, theirs.x_min) and (
            min(mine.y_max, theirs.y_max) > max(mine.y_min, theirs.y_min)
        ):
            given = f"[{theirs.x_min:g}, {theirs.y_min:g}, {theirs.x_max:g}, {theirs.y_max:g}]"
            faults.append(f"{other}region: {given} given, must not overlap {one}region")
    return faults


def _faults(values: Mapping[str, Any]) -> list[str]:
    trackers = values["trackers"]
    faults = []
    if len(trackers) < 2:
        faults.append(f"trackers: {trackers} given, must be two names or more")
    for name in trackers:
        region = values[f"{name}.region"]
        if not is_region(region):
            faults.append(
                f"{name}.region: {region} given, must be [x_min, y_min, x_max, y_max, margin] of "
                "the tracker's region"
            )
    return faults
