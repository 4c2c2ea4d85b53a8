"""Checks of parameters against each other, beyond the allowed values of each.

A check is a function of all values by dotted name that returns one line per fault.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors import wgs84
from phd_jdtc_ros.core.sensors.site import MOST_FROM_ORIGIN
from phd_jdtc_ros.core.targets import amplitude_density

from .forms import FIXED, MOST_PROBABILITY, lag_of, pose_of
from .parameters import GROUPS, LABELLED, REFERENCE, TOP
from .radar_parameters import QUANTITIES, USUAL_FIELDS

# Fewer particles do not represent a target.
LEAST_PER_TARGET = 10
# In deviations; in a smaller ambiguity interval range rates tell nothing.
LEAST_INTERVAL = 4.0


def square(flat: list[float]) -> FloatArray | None:
    """Return a row-major flat list as a square matrix, or None."""
    size = math.isqrt(len(flat))
    return np.array(flat).reshape(size, size) if size**2 == len(flat) else None


def _matrix_faults(name: str, flat: list[float], size: int) -> list[str]:
    matrix = square(flat)
    if matrix is None or len(matrix) != size:
        return [f"{name}: {len(flat)} numbers given, must be {size}x{size}, row by row"]
    if np.abs(matrix.sum(axis=1) - 1.0).max(initial=0.0) > 1e-6:
        return [f"{name}: {flat} given, every row must sum to 1"]
    return []


def _check_names(values: Mapping[str, Any]) -> list[str]:
    taken = {parameter.name.split(".")[0]: "a parameter" for parameter in TOP}
    faults = []
    for group in GROUPS:
        if not values[group] and group != "births":
            faults.append(f"{group}: [] given, must name at least one")
        for name in values[group]:
            if "." in name or name in taken:
                reason = "must not contain a dot" if "." in name else f"is already {taken[name]}"
                faults.append(f"{group}: {name!r} given, {reason}")
            taken[name] = f"one of {group}"
    return faults


def _check_classes(values: Mapping[str, Any]) -> list[str]:
    faults = []
    for name in values["classes"]:
        low, high = values[f"{name}.snr_band_db"]
        # Compared as the likelihood does: far below 0 dB, 1 + d rounds to 1 for both.
        if not 1.0 + amplitude_density.snr_from_db(low) < 1.0 + amplitude_density.snr_from_db(high):
            faults.append(f"{name}.snr_band_db: [{low}, {high}] given, the second must be larger")
        motions = values[f"{name}.motions"]
        unknown = [motion for motion in motions if motion not in values["motions"]]
        if unknown or not motions:
            faults.append(
                f"{name}.motions: {motions} given, must be some of motions {values['motions']}"
            )
        key = f"{name}.mode_transition"
        faults += _matrix_faults(key, values[key], len(motions))
    return faults


def is_region(region: Sequence[float]) -> bool:
    """Return whether these are two corners of a rectangle, with or without a margin."""
    return (
        len(region) in (4, 5)
        and region[0] < region[2]
        and region[1] < region[3]
        and all(margin >= 0.0 for margin in region[4:])
    )


def _region_faults(values: Mapping[str, Any]) -> list[str]:
    region = values["region"]
    if not region:
        return []
    if not is_region(region):
        return [
            f"region: {region} given, must be empty or [x_min, y_min, x_max, y_max], and a margin "
            "of at least 0, with the third above the first and the fourth above the second"
        ]
    return [
        f"{name}.clutter_rate: {values[f'{name}.clutter_rate']} given with a region, must be a "
        "number: the rate is that of the radar's whole field, of which a part is taken in"
        for name in values["sensors"]
        if isinstance(values[f"{name}.clutter_rate"], str)
    ]


def _check_rest(values: Mapping[str, Any]) -> list[str]:
    faults = []
    if values["late_reports"] == "rework" and lag_of(values["lag"]) == (0, None):
        faults.append("late_reports: 'rework' given with lag 0, needs a lag above 0")
    faults += _region_faults(values)
    if 0 < values["particles_per_target"] < LEAST_PER_TARGET:
        faults.append(
            f"particles_per_target: {values['particles_per_target']} given, must be 0 or at least "
            f"{LEAST_PER_TARGET}"
        )
    for name in ("particles_per_birth", "detection_births.particles"):
        count = values[name]
        if count & (count - 1):
            faults.append(f"{name}: {count} given, must be a power of two")
    appearing = values["detection_births.rates"]
    if appearing and len(appearing) != len(values["classes"]):
        faults.append(
            f"detection_births.rates: {appearing} given, must be empty or "
            f"{len(values['classes'])} numbers, one per class"
        )
    for name in values["births"]:
        rates = values[f"{name}.rates"]
        if len(rates) != len(values["classes"]) or sum(rates) <= 0.0:
            faults.append(
                f"{name}.rates: {rates} given, must be {len(values['classes'])} numbers, one per "
                "class, not all 0"
            )
        elif values["engine"] in LABELLED and sum(rates) > 1.0:
            faults.append(
                f"{name}.rates: {rates} given, must sum to at most 1: but for engine phd a birth "
                "term is at most one target per scan"
            )
    for group in ("topic", "frame"):
        used = [name_or(values, radar, group) for radar in values["sensors"]]
        faults += [
            f"{radar}.{group}: {name!r} given, another radar has it too"
            for radar, name in zip(values["sensors"], used, strict=True)
            if used.count(name) > 1
        ]
    return faults


def _check_reporting(values: Mapping[str, Any]) -> list[str]:
    confirm, delete = values["confirm_probability"], values["delete_probability"]
    if 0.0 < confirm < delete and values["engine"] in LABELLED:
        return [
            f"delete_probability: {delete} given, must be at most confirm_probability, {confirm}, "
            "or 0"
        ]
    return []


def _check_visibility(values: Mapping[str, Any]) -> list[str]:
    faults = []
    for name in values["sensors"]:
        key = f"{name}.fov_deg"
        begin, end = values[key]
        if begin == end or abs(end - begin) > 360.0:
            faults.append(
                f"{key}: [{begin}, {end}] given, must be two azimuths at most a turn apart"
            )
        key = f"{name}.blind_sectors_deg"
        edges = np.array(values[key])
        if len(edges) % 2 or (edges[::2] == edges[1::2]).any():
            faults.append(f"{key}: {values[key]} given, must be pairs of two different azimuths")
        nearest, farthest = values[f"{name}.min_range"], values[f"{name}.max_range"]
        if nearest >= farthest:
            faults.append(f"{name}.min_range: {nearest} given, must be below max_range, {farthest}")
        faults += _table_faults(values, name)
    return faults


def _table_faults(values: Mapping[str, Any], radar: str) -> list[str]:
    key = f"{radar}.detection_probability"
    table = np.array(values[key] if isinstance(values[key], list) else [])
    if len(table) % 2:
        return [f"{key}: {len(table)} numbers given, must be pairs of range and probability"]
    ranges, probabilities = table[::2], table[1::2]
    if (np.diff(ranges) <= 0.0).any():
        return [f"{key}: ranges {ranges.tolist()} given, must rise"]
    if not ((probabilities > 0.0) & (probabilities <= MOST_PROBABILITY)).all():
        return [
            f"{key}: probabilities {probabilities.tolist()} given, must be above 0 and at most "
            f"{MOST_PROBABILITY}"
        ]
    return []


def _check_turns(values: Mapping[str, Any]) -> list[str]:
    faults = []
    for name in values["sensors"]:
        rotation_s, sectors = values[f"{name}.rotation_s"], values[f"{name}.sectors"]
        if sectors and not rotation_s:
            faults.append(f"{name}.rotation_s: 0 given, must be above 0 with sectors")
        if values.get(f"{name}.fields.sector") and not sectors:
            faults.append(f"{name}.sectors: 0 given, must be above 0 with fields.sector")
        timed = rotation_s and values.get(f"{name}.fields.time")
        if (sectors or timed) and values["engine"] not in LABELLED:
            faults.append(
                f"engine: {values['engine']} given, must be {' or '.join(LABELLED)} where turns "
                f"are taken in by sectors, as those of {name} are"
            )
    return faults


def _check_radars(values: Mapping[str, Any]) -> list[str]:
    faults = []
    for radar in values["sensors"]:
        moves = values[f"{radar}.pose"] != FIXED
        if values[f"{radar}.clutter_map"] and moves and values["engine"] != "gaussian":
            faults.append(
                f"{radar}.clutter_map: true given, must be false with engine {values['engine']} "
                "where the radar moves"
            )
        clutter, limit = values[f"{radar}.clutter_max_range"], values[f"{radar}.max_range"]
        if clutter > limit:
            faults.append(
                f"{radar}.clutter_max_range: {clutter:g} given, must be at most max_range, "
                f"{limit:g}, beyond which detections are ignored"
            )
        if values[f"{radar}.message"] == "point_cloud":
            faults += _field_faults(values, radar)
    return faults


def _check_poses(values: Mapping[str, Any]) -> list[str]:
    faults = []
    kinds: dict[str, str] = {}
    topics = {name_or(values, radar, "topic"): radar for radar in values["sensors"]}
    for radar in values["sensors"]:
        key = f"{radar}.pose"
        pose, kind, _ = pose_of(values[key])
        if values[key] == FIXED:
            continue
        if pose == "tf":
            faults.append(
                f"{key}: 'tf' given, transforms are not read; must be {FIXED} or the topic of the "
                "platform's poses in the world frame, nav_msgs/Odometry or "
                "geometry_msgs/PoseStamped, which localisation publishes beside its transforms"
            )
        elif not pose or pose.lower() in (FIXED, "tf"):
            faults.append(f"{key}: {pose!r} given, must be {FIXED} or a topic's name")
        elif pose in topics:
            faults.append(f"{key}: {pose!r} given, {topics[pose]} has its detections there")
        elif kinds and kind not in kinds.values():
            other = next(iter(kinds))
            faults.append(f"{key}: {kind} given, must be {kinds[other]} as that of {other}")
        else:
            kinds[radar] = kind
    return faults


def _field_faults(values: Mapping[str, Any], radar: str) -> list[str]:
    """Return a fault for each quantity of a cloud whose field another quantity has too."""
    faults: list[str] = []
    taken: dict[str, str] = {}
    for quantity in QUANTITIES:
        key = f"{radar}.fields.{quantity}"
        field = values.get(key, USUAL_FIELDS.get(quantity))
        if field and field in taken:
            faults.append(f"{key}: {field!r} given, {taken[field]} has it too")
        elif field:
            taken[field] = key
    return faults


def _check_range_rates(values: Mapping[str, Any]) -> list[str]:
    faults = []
    for name in values["sensors"]:
        key = f"{name}.range_rate_ambiguity"
        interval, std = values[key], values[f"{name}.range_rate_std"]
        rated = values.get(f"{name}.fields.range_rate")
        if rated and 0.0 < interval < LEAST_INTERVAL * std:
            faults.append(
                f"{key}: {interval:g} given, must be 0 or at least {LEAST_INTERVAL:g} times "
                f"range_rate_std, {std:g}"
            )
        if values.get(f"{name}.fields.range_rate_std") and not rated:
            faults.append(f"{name}.fields.range_rate: '' given, must be a name with range_rate_std")
    return faults


def _check_places(values: Mapping[str, Any]) -> list[str]:
    """Return a fault for each place on the earth that is none, or that does not go with others."""
    origin = values["world_origin"]
    faults = _place_faults("world_origin", origin)
    for radar in values["sensors"]:
        key, place = f"{radar}.geodetic", values[f"{radar}.geodetic"]
        wrong = _place_faults(key, place)
        if values[f"{radar}.assumed_height"][1:]:
            wrong.append(
                f"{radar}.assumed_height: {values[f'{radar}.assumed_height']} given, must be empty "
                "or one height"
            )
        elif values[f"{radar}.assumed_height"] and not place:
            wrong.append(f"{radar}.assumed_height: given without geodetic, must be empty")
        faults += wrong
        if not place or wrong:
            continue
        if not origin:
            faults.append(f"world_origin: [] given, must be a place on the earth, as {key} is one")
        elif not faults:
            faults += _distance_faults(key, place, origin)
        default = REFERENCE.get(f"{radar}.position", [0.0, 0.0])
        if values[f"{radar}.position"] != default:
            faults.append(f"{radar}.position: given beside geodetic, must be one of the two")
        if values[f"{radar}.pose"] != FIXED:
            faults.append(
                f"{radar}.pose: {values[f'{radar}.pose']!r} given, must be {FIXED} with geodetic; "
                "a radar that moves is where its platform's poses in world_frame are"
            )
    return faults


def _place_faults(key: str, place: list[float]) -> list[str]:
    """Return the fault of a latitude, a longitude and a height, if they have one."""
    if not place or (len(place) == 3 and abs(place[0]) <= 90.0 and abs(place[1]) <= 360.0):
        return []
    return [
        f"{key}: {place} given, must be empty or a latitude from -90 to 90 degrees, a longitude "
        "from -360 to 360 degrees and a height in metres"
    ]


def _distance_faults(key: str, place: list[float], origin: list[float]) -> list[str]:
    """Return the fault of a radar too far from the origin, if it is."""
    apart = wgs84.to_cartesian(*place) - wgs84.to_cartesian(*origin)
    distance = float(np.sqrt((apart**2).sum()))
    if distance <= MOST_FROM_ORIGIN:
        return []
    return [
        f"{key}: {place} given, is {distance / 1e3:.0f} km from world_origin, must be at most "
        f"{MOST_FROM_ORIGIN / 1e3:.0f} km"
    ]


def _check_identities(values: Mapping[str, Any]) -> list[str]:
    return [
        f"shared_codes: {code[:10]!r} given, must be four octal digits"
        for code in values["shared_codes"]
        if len(code) != 4 or set(code) - set("01234567")
    ]


CHECKS: tuple[Callable[[Mapping[str, Any]], list[str]], ...] = (
    _check_names,
    _check_classes,
    _check_rest,
    _check_reporting,
    _check_visibility,
    _check_turns,
    _check_radars,
    _check_range_rates,
    _check_poses,
    _check_places,
    _check_identities,
)


def name_or(values: Mapping[str, Any], radar: str, key: str) -> str:
    """Return a radar's topic or frame, or its default if it is empty."""
    fallback = f"/{radar}/detections" if key == "topic" else radar
    return str(values[f"{radar}.{key}"] or fallback)
