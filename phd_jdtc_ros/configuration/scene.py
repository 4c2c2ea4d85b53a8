"""The part of a configuration that describes what was recorded: radars, classes and birth places.

A tracker with another lag or another number of particles tracks the same recording differently. One
with another scene tracks something that was not there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .checks import name_or
from .radar_parameters import QUANTITIES, RADAR, USUAL_FIELDS

# What the whole scene has.
OF_ALL = ("world_origin",)
# What says where a radar is.
PLACE = ("position", "geodetic", "yaw_deg", "pose")
# The lists that name the scene's parts, and the parameters of each part that belong to it.
# What a radar is corrected for is found in a recording, and is no part of its scene.
CORRECTIONS = ("range_bias", "range_gain", "azimuth_bias_deg", "time_offset_s")
PARTS: dict[str, tuple[str, ...]] = {
    "sensors": (
        *(each.name for each in RADAR if not each.keys and each.name not in CORRECTIONS),
        *(f"fields.{quantity}" for quantity in QUANTITIES),
    ),
    "classes": ("snr_band_db",),
    "births": ("position",),
}
# Radars whose topic or frame is empty have these by default, so that both forms are equal.
_WITH_DEFAULT = ("topic", "frame")
_ANYWHERE = "detection_births.rates"
_FIELDS = "fields."


def differences(recorded: Mapping[str, Any], given: Mapping[str, Any]) -> list[str]:
    """Return how the scene of a tracker's parameters differs from that of a recording.

    Parameters
    ----------
    recorded : mapping of dotted name to value
        All parameters of the recording's configuration.
    given : mapping of dotted name to value
        Those of the tracker.

    Returns
    -------
    list of str
        A line per parameter: its name, the recorded and the given value. Parameters that `given`
        does not have are not compared, and neither are birth places with births at detections.
    """
    found = [
        f"{name}: {_text(recorded[name])} recorded, {_text(given[name])} given"
        for name in OF_ALL
        if given.get(name, recorded[name]) != recorded[name]
    ]
    for group, members in PARTS.items():
        if group == "births" and given.get(_ANYWHERE):
            continue
        before, now = recorded[group], list(given.get(group, recorded[group]))
        if before != now:
            found.append(f"{group}: {_text(before)} recorded, {_text(now)} given")
        for part in (name for name in before if name in now):
            found += _of_part(recorded, given, part, members)
    return found


def other_places(recorded: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return where the radars of a recording are, of those parameters that are given otherwise.

    Parameters are those of `differences`. A radar that only one of both has is left out.
    """
    radars = [radar for radar in recorded["sensors"] if radar in given["sensors"]]
    names = (*OF_ALL, *(f"{radar}.{member}" for radar in radars for member in PLACE))
    return {name: recorded[name] for name in names if recorded[name] != given[name]}


def _of_part(
    recorded: Mapping[str, Any], given: Mapping[str, Any], part: str, members: tuple[str, ...]
) -> list[str]:
    found = []
    for member in members:
        name = f"{part}.{member}"
        field = member.startswith(_FIELDS)
        # A field that is not given has its usual name; of parameters that are no whole set nothing
        # is known.
        if f"{part}.topic" not in given if field else not (name in given and name in recorded):
            continue
        usual = USUAL_FIELDS.get(member.removeprefix(_FIELDS), "")
        before, now = (
            name_or(values, part, member) if member in _WITH_DEFAULT else values.get(name, usual)
            for values in (recorded, given)
        )
        if before != now:
            found.append(f"{name}: {_text(before)} recorded, {_text(now)} given")
    return found


def _text(value: Any) -> str:
    return f"[{', '.join(map(str, value))}]" if isinstance(value, list) else str(value)
