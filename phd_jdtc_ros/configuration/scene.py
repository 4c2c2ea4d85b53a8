"""Comparison of the scene of two configurations: radars, classes and birth places.

A tracker with another lag or another number of particles tracks the same recording differently;
with another scene it tracks something else.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .parameters import position, radar
from .tables import GROUPS, TABLES, parameters_of, topic_or_frame

# Scene parameters of the whole tracker, and the parameters that place a radar.
OF_ALL = ("world_origin",)
PLACE = ("position", "geodetic", "yaw_deg", "pose", "pose_message", "pose_yaw")
# The entries of a sensor's mappings, of any kind.
_ENTRIES = tuple(
    dict.fromkeys(
        f"{each.name}.{key}" for own in TABLES.values() for each in own for key in each.keys
    )
)
# The lists that name the scene's parts, and the scene parameters of each part. What a tracker finds
# out about a radar is not part of the scene: what it learns, and the biases, which are estimated
# from a recording.
PARTS: dict[str, tuple[str, ...]] = {
    "sensors": (
        *(
            own.name
            for own in GROUPS["sensors"]
            if not (own.keys or own.name in ("learn", "biases"))
        ),
        *_ENTRIES,
    ),
    "classes": ("snr_band_db",),
    "births": ("position",),
}


def differences(recorded: Mapping[str, Any], given: Mapping[str, Any]) -> list[str]:
    """Return a line per parameter that differs between the scenes of a recording and a tracker.

    All parameters of the recording's configuration are `recorded`. Parameters that `given` lacks
    are not compared; nor are values that the tracker learns, nor birth places if there are births
    at detections.
    """
    pairs = [(name, recorded[name], given.get(name, recorded[name])) for name in OF_ALL]
    for group, members in PARTS.items():
        if group == "births" and given.get("detection_births.rates"):
            continue
        names, now = recorded[group], given.get(group, recorded[group])
        pairs.append((group, names, list(now)))
        for name in (name for name in names if name in now):
            pairs += [
                (f"{name}.{own}", _value(recorded, name, own), _value(given, name, own))
                for own in members
                if own not in _learned(given, name)
                and _has_value(given, name, own)
                and _has_value(recorded, name, own)
            ]
    return [
        f"{name}: {_text(before)} recorded, {_text(now)} given"
        for name, before, now in pairs
        if before != now
    ]


def other_places(recorded: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the recorded places of common radars whose given places differ from them."""
    radars = [radar for radar in recorded["sensors"] if radar in given["sensors"]]
    names = (*OF_ALL, *(f"{radar}.{member}" for radar in radars for member in PLACE))
    known = (name for name in names if name in recorded and name in given)
    return {name: recorded[name] for name in known if recorded[name] != given[name]}


def _has_value(values: Mapping[str, Any], part: str, member: str) -> bool:
    """Return whether a parameter has a value; a field that is not given has its usual name."""
    whole = member in _ENTRIES and f"{part}.topic" in values
    return whole or f"{part}.{member}" in values


def _value(values: Mapping[str, Any], part: str, member: str) -> Any:
    """Return a parameter's value; an empty topic or frame equals its default."""
    if member in ("topic", "frame"):
        return topic_or_frame(values, part, member)
    name, _, key = member.partition(".")
    own = parameters_of(values.get(f"{part}.kind"))
    usual = next((getattr(each.default, key, "") for each in own if each.name == name), "")
    return values.get(f"{part}.{member}", usual)


def _learned(values: Mapping[str, Any], sensor: str) -> set[str]:
    """Return the parameters whose values a sensor's tracker learns."""
    return {
        own
        for word in values.get(f"{sensor}.learn", ())
        for kind in (radar, position)
        for own in kind.LEARNED.get(word, ())
    }


def _text(value: Any) -> str:
    return f"[{', '.join(map(str, value))}]" if isinstance(value, list) else str(value)
