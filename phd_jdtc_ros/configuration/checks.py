"""Checks of parameters against each other, beyond the allowed values of each.

A check yields one line per fault.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from phd_jdtc_ros.core.targets import amplitude_density

from .parameters.tracker import LABELLED, PHD, Parts, Tracking
from .sensor_kinds import KINDS
from .tables import GROUPS, TOP

# Fewer particles do not represent a target.
LEAST_PER_TARGET = 10
Faults = Iterator[str]


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
        size, key, flat = len(own.motions), f"{name}.mode_transition", own.mode_transition
        if len(flat) != size**2:
            yield f"{key}: {len(flat)} numbers given, must be {size}x{size}, row by row"
        elif np.abs(np.reshape(flat, (size, size)).sum(axis=1) - 1.0).max(initial=0.0) > 1e-6:
            yield f"{key}: {flat} given, every row must sum to 1"


def _tracking(parts: Parts) -> Faults:
    top = parts.tracking
    if top.late_reports == "rework" and not top.lag.positive:
        yield "late_reports: 'rework' given with lag 0, needs a lag above 0"
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
    if top.engine in PHD:
        yield from _beyond_the_paper(top)
    for code in top.shared_codes:
        if len(code) != 4 or set(code) - set("01234567"):
            yield f"shared_codes: {code[:10]!r} given, must be four octal digits"


def _beyond_the_paper(top: Tracking) -> Faults:
    """Yield a fault for each setting that the paper's PHD filters do not have."""
    for name, given, allowed in (
        ("late_reports", top.late_reports, ("drop",)),
        ("estimates_period_s", top.estimates_period_s, (0.0,)),
        ("detection_births.rates", top.birth_rates, ([],)),
        ("amplitude", top.amplitude, ("auto", "band", "none")),
        ("state", top.state, ("plane",)),
        ("conflicts.distance", [*filter(None, top.conflicts_distance)], ([],)),
        ("zones", top.zones, ("",)),
    ):
        if given not in allowed:
            words = " or ".join(map(str, allowed))
            yield f"{name}: {given} given, must be {words} with engine {top.engine}"


def _births(parts: Parts) -> Faults:
    top, count = parts.tracking, len(parts.classes)
    if len(top.birth_rates) not in (0, 1, count):
        yield (
            f"detection_births.rates: {top.birth_rates} given, must be empty, one number for all "
            f"classes, or {count} numbers, one per class"
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
        used = [getattr(sensor, key) for sensor in parts.sensors.values()]
        for name, own in zip(parts.sensors, used, strict=True):
            if used.count(own) > 1:
                yield f"{name}.{key}: {own!r} given, another sensor has it too"


_CHECKS = (_names, _classes, _tracking, _births, _addresses)


def faults(parts: Parts) -> list[str]:
    """Return every fault of parameters that do not fit together."""
    found = [fault for check in _CHECKS for fault in check(parts)]
    for kind, own in KINDS.items():
        sensors = [sensor for sensor in parts.sensors.values() if sensor.kind == kind]
        found += [fault for check in own.checks for each in sensors for fault in check(each, parts)]
    return found
