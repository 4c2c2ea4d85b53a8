"""Checks of parameters against each other, beyond the allowed values of each.

A check yields one line per fault.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors import wgs84
from phd_jdtc_ros.core.sensors.site import MAX_SITE_DISTANCE
from phd_jdtc_ros.core.targets import amplitude_density

from .parameters import GROUPS, LABELLED, REFERENCE, TOP, Parts
from .place_forms import FIXED
from .radar_parameters import QUANTITIES, RadarParameters

# Fewer particles do not represent a target.
LEAST_PER_TARGET = 10
# Smallest ambiguity interval of range rates, in standard deviations: within a smaller interval all
# range rates are equally likely.
LEAST_INTERVAL = 4.0
Faults = Iterator[str]


def square(flat: Sequence[float]) -> FloatArray | None:
    """Return a row-major flat list as a square matrix, or None."""
    size = math.isqrt(len(flat))
    return np.array(flat).reshape(size, size) if size**2 == len(flat) else None


def _names(parts: Parts) -> Faults:
    taken = {parameter.name.split(".")[0]: "a parameter" for parameter in TOP}
    for group in GROUPS:
        listed = getattr(parts.tracking, group)
        if not listed and group != "births":
            yield f"{group}: [] given, must name at least one"
        for name in listed:
            if "." in name or name in taken:
                reason = "must not contain a dot" if "." in name else f"is already {taken[name]}"
                yield f"{group}: {name!r} given, {reason}"
            taken[name] = f"one of {group}"


def _classes(parts: Parts) -> Faults:
    for name, own in parts.classes.items():
        low, high = own.snr_band_db
        # The bounds are compared as the likelihood does it: far below 0 dB, 1 + d rounds to 1 for
        # both.
        if not 1.0 + amplitude_density.snr_from_db(low) < 1.0 + amplitude_density.snr_from_db(high):
            yield f"{name}.snr_band_db: [{low}, {high}] given, the second must be larger"
        known = parts.tracking.motions
        if not own.motions or not set(own.motions) <= set(known):
            yield f"{name}.motions: {own.motions} given, must be among motions {known}"
        matrix, size = square(own.mode_transition), len(own.motions)
        key, flat = f"{name}.mode_transition", own.mode_transition
        if matrix is None or len(matrix) != size:
            yield f"{key}: {len(flat)} numbers given, must be {size}x{size}, row by row"
        elif np.abs(matrix.sum(axis=1) - 1.0).max(initial=0.0) > 1e-6:
            yield f"{key}: {flat} given, every row must sum to 1"


def _tracking(parts: Parts) -> Faults:
    top, radars = parts.tracking, parts.radars.values()
    if top.late_reports == "rework" and not top.lag.positive:
        yield "late_reports: 'rework' given with lag 0, needs a lag above 0"
    for radar in radars if top.region is not None else ():
        if radar.clutter_rate.learned:
            yield (
                f"{radar.name}.clutter_rate: auto given with a region, must be a number: the rate "
                "is that of the radar's whole field, of which a part is used"
            )
    if 0 < top.particles_per_target < LEAST_PER_TARGET:
        yield (
            f"particles_per_target: {top.particles_per_target} given, must be 0 or at least "
            f"{LEAST_PER_TARGET}"
        )
    count = top.particles_per_birth
    if count & (count - 1):
        yield f"particles_per_birth: {count} given, must be a power of two"
    confirm, delete = top.confirm_probability, top.delete_probability
    if 0.0 < confirm < delete and top.engine in LABELLED:
        yield (
            f"delete_probability: {delete} given, must be at most confirm_probability, {confirm}, "
            "or 0"
        )
    for code in top.shared_codes:
        if len(code) != 4 or set(code) - set("01234567"):
            yield f"shared_codes: {code[:10]!r} given, must be four octal digits"


def _births(parts: Parts) -> Faults:
    top, count = parts.tracking, len(parts.classes)
    if top.birth_rates and len(top.birth_rates) != count:
        yield (
            f"detection_births.rates: {top.birth_rates} given, must be empty or {count} numbers, "
            "one per class"
        )
    for name, own in parts.births.items():
        if len(own.rates) != count or sum(own.rates) <= 0.0:
            yield (
                f"{name}.rates: {own.rates} given, must be {count} numbers, one per class, not all "
                "0"
            )
        elif top.engine in LABELLED and sum(own.rates) > 1.0:
            yield (
                f"{name}.rates: {own.rates} given, must sum to at most 1: but for engine phd a "
                "birth term is at most one target per scan"
            )


def _addresses(parts: Parts) -> Faults:
    for key in ("topic", "frame"):
        used = [getattr(radar, key) for radar in parts.radars.values()]
        for name, own in zip(parts.radars, used, strict=True):
            if used.count(own) > 1:
                yield f"{name}.{key}: {own!r} given, another radar has it too"


def _visibility(radar: RadarParameters, parts: Parts) -> Faults:
    name, (begin, end), edges = radar.name, radar.fov_deg, radar.blind_sectors_deg
    if begin == end or abs(end - begin) > 360.0:
        yield f"{name}.fov_deg: [{begin}, {end}] given, must be two azimuths at most a turn apart"
    if len(edges) % 2 or any(map(float.__eq__, edges[::2], edges[1::2])):
        yield f"{name}.blind_sectors_deg: {edges} given, must be pairs of two different azimuths"
    near, far = radar.min_range, radar.max_range
    if near >= far:
        yield f"{name}.min_range: {near} given, must be below max_range, {far}"
    if radar.clutter_max_range > far:
        yield (
            f"{name}.clutter_max_range: {radar.clutter_max_range:g} given, must be at most "
            f"max_range, {far:g}, beyond which detections are ignored"
        )


def _turns(radar: RadarParameters, parts: Parts) -> Faults:
    name, engine = radar.name, parts.tracking.engine
    if radar.sectors and not radar.rotation_s:
        yield f"{name}.rotation_s: 0 given, must be above 0 with sectors"
    if radar.fields.sector and not radar.sectors:
        yield f"{name}.sectors: 0 given, must be above 0 with fields.sector"
    if (radar.sectors or (radar.rotation_s and radar.fields.time)) and engine not in LABELLED:
        yield (
            f"engine: {engine} given, must be {' or '.join(LABELLED)} for turns in sectors, as "
            f"those of {name}"
        )


def _engine(radar: RadarParameters, parts: Parts) -> Faults:
    """Yield a fault for each setting that needs the Gaussian engine, without that engine."""
    engine = parts.tracking.engine
    if engine == "gaussian":
        return
    if radar.clutter_map and radar.pose.topic:
        yield (
            f"{radar.name}.clutter_map: true given, must be false for a moving radar with engine "
            f"{engine}"
        )
    if radar.range_std.outliers:
        yield (
            f"{radar.name}.range_std: outliers given with engine {engine}, must be without them: "
            "only engine gaussian uses them"
        )


def _fields(radar: RadarParameters, parts: Parts) -> Faults:
    """Yield a fault for each quantity of a cloud whose field another quantity has too."""
    taken: dict[str, str] = {}
    for quantity in QUANTITIES if radar.named_fields else ():
        key, field = f"{radar.name}.fields.{quantity}", getattr(radar.fields, quantity)
        if field and field in taken:
            yield f"{key}: {field!r} given, {taken[field]} has it too"
        elif field:
            taken[field] = key


def _range_rates(radar: RadarParameters, parts: Parts) -> Faults:
    interval, std = radar.range_rate_ambiguity, radar.range_rate_std.start
    rated = radar.fields.range_rate
    if rated and 0.0 < interval < LEAST_INTERVAL * std:
        yield (
            f"{radar.name}.range_rate_ambiguity: {interval:g} given, must be 0 or at least "
            f"{LEAST_INTERVAL:g} times range_rate_std, {std:g}"
        )
    if radar.fields.range_rate_std and not rated:
        yield f"{radar.name}.fields.range_rate: '' given, must be a name with range_rate_std"


def _pose(radar: RadarParameters, parts: Parts) -> Faults:
    key, (topic, message, _) = f"{radar.name}.pose", radar.pose
    detections = {other.topic: other.name for other in parts.radars.values()}
    first = next((other for other in parts.radars.values() if other.pose.topic), radar)
    if topic and topic in detections:
        yield f"{key}: {topic!r} given, {detections[topic]} has its detections there"
    elif topic and message != first.pose.message:
        yield f"{key}: {message} given, must be {first.pose.message} as that of {first.name}"


def _place(radar: RadarParameters, parts: Parts) -> Faults:
    """Yield the faults of a place on the earth in combination with other parameters."""
    name, place, origin = radar.name, radar.geodetic, parts.tracking.world_origin
    if not place:
        if radar.assumed_height is not None:
            yield f"{name}.assumed_height: given without geodetic, must be empty"
        return
    if not origin:
        yield f"world_origin: [] given, must be a place on the earth, as {name}.geodetic is one"
    else:
        apart = math.dist(wgs84.to_cartesian(*place), wgs84.to_cartesian(*origin))
        if apart > MAX_SITE_DISTANCE:
            yield (
                f"{name}.geodetic: {place} given, is {apart / 1e3:.0f} km from world_origin, must "
                f"be at most {MAX_SITE_DISTANCE / 1e3:.0f} km"
            )
    if radar.position != (*REFERENCE.get(f"{name}.position", [0.0, 0.0]), 0.0):
        yield f"{name}.position: given beside geodetic, must be one of the two"
    if radar.pose.topic:
        yield (
            f"{name}.pose: {radar.pose.topic!r} given, must be {FIXED} with geodetic; a moving "
            "radar is where its platform's poses in world_frame are"
        )


_CHECKS = (_names, _classes, _tracking, _births, _addresses)
_OF_RADARS = (_visibility, _turns, _engine, _fields, _range_rates, _pose, _place)


def faults(parts: Parts) -> list[str]:
    """Return every fault of parameters that do not fit together."""
    found = [fault for check in _CHECKS for fault in check(parts)]
    for check in _OF_RADARS:
        found += [fault for radar in parts.radars.values() for fault in check(radar, parts)]
    return found
