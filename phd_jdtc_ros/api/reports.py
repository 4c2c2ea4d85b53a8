"""Splits tables of detections into reports of sensors, and reads their places on the earth."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from phd_jdtc_ros.columns import position_selection, report_selection, selection, sent_columns
from phd_jdtc_ros.columns.position_selection import unlimited
from phd_jdtc_ros.columns.report_selection import Told
from phd_jdtc_ros.columns.selection import Report
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.position import PositionParameters
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.configuration.parameters.sensor import SensorParameters
from phd_jdtc_ros.core.arrays import UNKNOWN, FloatArray, IntArray
from phd_jdtc_ros.core.types import SelfReports
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.quoting import short

from .tables import (
    Columns,
    numbers,
    place_of,
    require_column,
    rows_by_stamp,
    rows_of,
    stamps_ns,
    with_column,
)

# Columns of positions.
POSITION = ("x", "y")
# Columns in degrees, with the largest magnitude of each.
NAMES = (("lat", "lon"), ("latitude", "longitude"))
MOST_DEG = (90.0, 360.0)
# Places nearer to latitude and longitude 0 are on the open sea south of Ghana.
LEAST_DEG = 1.0
# Places farther from a given origin than this, metres, seem wrong if another reading of their
# columns is nearer by this factor.
ELSEWHERE, NEARER = 1e6, 10.0
# Columns x and y seem to be in degrees if they span less than this, this many times farther from 0.
SPAN, AWAY = 1.5, 30.0


def names(columns: Collection[str]) -> tuple[str, str] | None:
    """Return the columns of latitudes and longitudes; None without them, or beside others."""
    if {"range", *POSITION} & {*columns}:
        return None
    return next((pair for pair in NAMES if {*pair} <= {*columns}), None)


def middle(columns: Columns) -> list[float] | None:
    """Return the median place with the height 0, as ``world_origin``; None without places."""
    pair = names(columns)
    places = [] if pair is None else [numbers(columns, name) for name in pair]
    if not places or not np.isfinite(places).all(axis=0).any():
        return None
    return [*np.round(np.nanmedian(places, axis=1), 3).tolist(), 0.0]


def in_plane(columns: Columns, origin: Sequence[float]) -> Columns:
    """Return columns with x to the east and y to the north of a place, metres.

    Raise `ValueError` if there is no origin, or a value is no latitude or longitude.
    """
    pair = names(columns)
    if pair is None:
        return columns
    if not origin:
        raise ValueError(
            f"{', '.join(pair)}: given, needs world_origin, the latitude, longitude and height of "
            "x = y = 0, which fit takes from the table; or give x and y in metres"
        )
    degrees = [numbers(columns, name) for name in pair]
    for name, column, most in zip(pair, degrees, MOST_DEG, strict=True):
        if (bad := np.abs(column) > most).any():  # False for NaN
            row = int(np.argmax(bad))
            raise ValueError(
                f"{name}: {column[row]:g} in {place_of(columns, row)}, must be from {-most:g} to "
                f"{most:g} degrees{_probably(pair, degrees)}"
            )
    unknown = np.isnan(degrees).any(axis=0)
    plane = SystemPlane(origin).to_plane(
        *np.where(unknown, np.asarray(origin[:2])[:, None], degrees)
    )
    for name, column in zip(POSITION, plane, strict=True):
        columns = with_column(columns, name, np.where(unknown, np.nan, column))
    return columns


def _probably(pair: tuple[str, str], degrees: Sequence[FloatArray]) -> str:
    """Return the words for what explains places that are not on the earth; empty if nothing.

    A reading counts if it puts all of them on the earth, and not about its zero, where any number
    would be that is divided by enough.
    """
    # Other units of both, of which a degree has so many.
    units = {6e5: "1/10000 minutes", 1e7: "1e-7 degrees"}
    sizes = np.abs(degrees)
    sizes = sizes[:, np.isfinite(sizes).all(axis=0)]
    largest, which = sizes.max(axis=1, initial=0.0), " and ".join(pair)
    beyond = (sizes > np.array(MOST_DEG)[:, None]).any(axis=0)
    if not beyond.all() and (np.ptp(sizes[:, beyond], axis=1) == 0.0).all():
        return f"; if it stands for an unknown place, leave {which} empty there"
    if _are_on_earth(largest[::-1]):
        return f"; are {which} swapped?"
    whole, minutes = np.divmod(sizes, 100.0)
    if (minutes < 60.0).all() and _are_on_earth(whole.max(axis=1, initial=0.0)):
        return "; probably these are degrees and minutes in one number: add minutes / 60 to degrees"
    for factor, unit in units.items():
        reading = largest / factor
        if _are_on_earth(reading) and reading.max() >= LEAST_DEG:
            return f"; probably these are {unit}: divide both columns by {factor:.0f}"
    return ""


def _are_on_earth(degrees: Sequence[float] | FloatArray) -> bool:
    return all(abs(size) <= most for size, most in zip(degrees, MOST_DEG, strict=True))


def seem_wrong(columns: Columns, origin: Sequence[float]) -> str:
    """Return the sentence about places of a table that seem to be wrong; empty if they do not.

    `origin` is the given ``world_origin``, or empty without one.
    """
    found, pair = middle(columns), names(columns)
    if pair is None or found is None:
        return _seem_degrees(columns)
    which, place = " and ".join(pair), found[:2]
    if origin:
        readings = {"swapped": place[::-1], "in radians": np.degrees(place).tolist()}
        plane = SystemPlane(origin)
        far = float(np.hypot(*plane.to_plane(*place)))
        for what, reading in readings.items():
            if far > ELSEWHERE and _are_on_earth(reading):
                near = float(np.hypot(*plane.to_plane(*reading)))
                if far > NEARER * near:
                    return (
                        f"the middle of {which} is {far / 1e3:.0f} km from world_origin, and "
                        f"{near / 1e3:.0f} km if they are {what}; are they?"
                    )
        return ""
    largest = [float(np.nanmax(np.abs(numbers(columns, name)))) for name in pair]
    if largest[0] > 0.5 * np.pi or largest[1] > np.pi:
        return ""
    return (
        f"{which} are within {largest[0]:.2g} and {largest[1]:.2g} degrees of 0, on the open sea "
        "south of Ghana; if they are in radians, convert them to degrees"
    )


def _seem_degrees(columns: Columns) -> str:
    """Return the sentence about x and y that seem to be in degrees; empty if they do not."""
    if not {*POSITION} <= {*columns}:
        return ""
    x, y = (numbers(columns, name) for name in POSITION)
    low, mid, high = (
        np.nanquantile([x, y], [0.05, 0.5, 0.95], axis=1) if len(x) else np.zeros((3, 2))
    )
    span = float((high - low).max())
    degrees = abs(mid[0]) <= 180.0 and abs(mid[1]) <= 90.0
    if not (degrees and 0.0 < span < SPAN and np.hypot(*mid) > AWAY * span):
        return ""
    return (
        f"x and y are within {span:.2g} of ({mid[0]:.6g}, {mid[1]:.6g}): they must be metres; if "
        "they are degrees, name them lon and lat"
    )


# Column of the standard deviation of positions along both axes.
POSITION_STD = "position_std"
TIME = "time"
# Detections with individual times are reported in parts of a revolution, as the tracker splits
# revolutions, or in parts of DEFAULT_PART_S seconds if the time of a revolution is unknown.
PARTS_OF_A_REVOLUTION, DEFAULT_PART_S = 8, 1.0


def reports_of(columns: Columns, config: TrackerConfig) -> list[tuple[int, Report]]:
    """Return the reports of a table, each with its radar's index, by stamp and then by radar.

    Raise `ValueError` if a required column is missing or has an invalid value.
    """
    time_ns = stamps_ns(columns)
    columns = with_column(columns, TIME, time_ns / 1e9)
    found = []
    for index, rows in enumerate(_rows_of_radars(columns, config.inputs)):
        if not len(rows):
            continue
        radar = config.inputs[index]
        own = rows_of(columns, rows)
        if text := _of_clock(time_ns[rows], own):
            warnings.warn(f"{TIME}: {text}", stacklevel=3)
        sent = _columns_of(own, radar)
        timed = radar.fields.time == TIME
        stamp_ns = _ends_ns(time_ns[rows], radar) if timed else time_ns[rows]
        parts = {int(stamp_ns[part[0]]): part for part in rows_by_stamp(stamp_ns)}
        if timed:
            empty_ns = _empty_ns([*parts], _step_ns(radar))
            parts |= dict.fromkeys(empty_ns, np.arange(0))
        found += [(index, _report(ns, sent, part, radar)) for ns, part in parts.items()]
    return sorted(found, key=lambda each: (each[1].stamp_ns, each[0]))


def _of_clock(time_ns: IntArray, columns: Columns) -> str:
    """Return the sentence about a clock that was set back, or stopped; empty if neither shows."""
    times, count = np.unique(time_ns, return_counts=True)
    if len(times) > 1 and count.max() > max(0.2 * len(time_ns), 10.0 * np.median(count)):
        row = int(np.argmax(time_ns == times[np.argmax(count)]))
        return (
            f"{count.max()} of {len(time_ns)} rows have the time of {place_of(columns, row)}, and "
            "are one scan; if a clock stopped there, leave them out"
        )
    steps = np.diff(time_ns)
    back, ahead = np.flatnonzero(steps < 0) + 1, steps[steps > 0]
    # Tables by target have more such steps, and each begins and ends with the others.
    if len(ahead) and 1 <= len(back) <= 2 and -steps[back[0] - 1] > 2.0 * np.median(ahead):
        before, after, where = *np.split(time_ns, back[:1]), place_of(columns, int(back[0]))
        if before.min() < after.min() and before.max() < after.max():
            return (
                f"steps back by {-steps[back[0] - 1] / 1e9:g} s in {where}, and otherwise ascends; "
                "rows of equal times on both sides are one scan. If a clock was set back there, or "
                "two recordings are joined, track the parts one by one"
            )
    return ""


def report_of(stamp_ns: int, columns: Columns, config: TrackerConfig, index: int) -> Report:
    """Return one radar's report, by its index; `columns` are empty without detections."""
    count = len(next(iter(columns.values()), ()))
    sensor = config.inputs[index]
    nothing = dict.fromkeys(_place_of(sensor), np.zeros(0))
    sent = _columns_of(columns, sensor) if count else nothing
    return _report(stamp_ns, sent, np.arange(count), sensor)


def told_of(columns: Columns, config: TrackerConfig) -> list[tuple[int, Told]]:
    """Return the self-reports of a table, each set with the index of its receiver.

    Raise `ValueError` if no receiver is configured, or a column is missing or invalid.
    """
    names, time_ns = [own.name for own in config.receivers], stamps_ns(columns)
    if not names:
        raise ValueError("reports: given, but none of the sensors has kind: reports")
    for short_name, name in zip(*NAMES, strict=True):
        if short_name in columns and name not in columns:
            columns = with_column(columns, name, columns[short_name])
    sent: dict[str, Any] = {
        name: numbers(columns, name) for name in report_selection.QUANTITIES if name in columns
    }
    if not any(set(place) <= set(sent) for place in report_selection.PLACES):
        given = short(", ".join(columns))
        raise ValueError(f"reports: no columns lat and lon, or x and y; the columns are {given}")
    sent["time"] = time_ns * 1e-9
    if "name" in columns:
        sent["name"] = columns["name"]
    whose = np.full(len(time_ns), names[0], dtype=object)
    if len(names) > 1 or "receiver" in columns:
        whose = require_column(columns, "receiver").astype(np.str_)
    found = []
    for index, own in enumerate(config.receivers):
        rows = np.flatnonzero(whose == own.name)
        mine = {name: column[rows] for name, column in sent.items()}
        told = report_selection.select(None, own, mine)
        for text in filter(None, (_of_stopped_clock(told.reports), *_of_units(mine, told))):
            warnings.warn(f"reports: {text}", stacklevel=3)
        found.append((index, told))
    unknown = set(whose.tolist()) - set(names)
    if unknown:
        raise ValueError(f"receiver: {min(unknown)!r} given, must be one of {', '.join(names)}")
    return found


def _of_stopped_clock(reports: SelfReports) -> str:
    """Return the sentence about a transmitter whose time stands still; empty without one."""
    own = reports.take(np.flatnonzero(reports.address != UNKNOWN))
    # What several stations have heard is one place, and times in whole seconds have few.
    places = np.unique(np.column_stack([own.address, own.time_ns, own.position]), axis=0)
    (address, _), count = np.unique(places[:, :2].T, axis=1, return_counts=True)
    if not len(count) or count.max() <= 5:
        return ""
    which = address[np.argmax(count)]
    return (
        f"{count.max()} places of address {which:.0f} have the same time; if its clock stopped "
        "there, the target counts as silent from then on"
    )


def _of_units(sent: Columns, told: Told) -> Iterator[str]:
    """Yield a sentence about each column of self-reports that seems to be in another unit."""
    degrees = [sent[name] for name in NAMES[1] if name in sent]
    if degrees and told.dropped["place"] > len(told.reports):
        yield f"most places are not on the earth{_probably(NAMES[1], degrees)}"
    for name in ("course", "heading"):
        own = sent.get(name, np.zeros(0))
        tenths = (own > 360.0) & (own != 511.0)  # AIS has 511 for an unknown one
        if tenths.any():
            yield (
                f"{np.count_nonzero(tenths)} of {len(tenths)} values of {name} are beyond 360 "
                "degrees, and not used; if they are tenths, divide the column by 10"
            )
    unknown = np.isin(sent.get("speed", np.zeros(0)), (102.3, 1023.0))
    if unknown.any():
        yield (
            f"speed is 102.3 or 1023 in {np.count_nonzero(unknown)} of {len(unknown)} rows, as AIS "
            "has it for an unknown one; leave it empty there"
        )
    # Of the units of speeds that others use, how many make one metre per second.
    units = {1.944: "knots", 19.44: "tenths of a knot", 3.6: "km/h", 100.0: "cm/s"}
    ratio = _ratio_of_speeds(told.reports)
    for factor, unit in units.items():
        if abs(np.log(ratio / factor)) < 0.1:
            yield (
                f"speeds are {ratio:.3g} times those between the places, and must be in m/s; if "
                f"they are {unit}, divide them by {factor:g}"
            )


def _ratio_of_speeds(reports: SelfReports) -> float:
    """Return the median of reported speeds over those between the places; NaN if it is unknown."""
    order = np.lexsort((reports.time_ns, reports.address))
    own = reports.take(order[reports.address[order] != UNKNOWN])
    passed_s = np.diff(own.time_ns) * 1e-9
    moved = np.hypot(*np.diff(own.position, axis=0).T)
    said = np.hypot(*own.velocity.T)
    # What turns, has moved little, or has been silent for long shows nothing.
    shows = (np.diff(own.address) == 0) & (moved > 20.0) & (passed_s > 0.0) & (passed_s < 120.0)
    shows &= np.abs(np.diff(said)) < 0.1 * said[1:]
    return (
        float(np.median(said[1:][shows] * passed_s[shows] / moved[shows]))
        if shows.any()
        else np.nan
    )


def _rows_of_radars(columns: Columns, radars: Sequence[SensorParameters]) -> Iterator[IntArray]:
    count = len(columns[TIME])
    if len(radars) == 1 and "radar" not in columns:
        yield np.arange(count)
        return
    column = require_column(columns, "radar")
    if column.dtype.kind == "f" and (column % 1 == 0).all():
        column = column.astype(np.int64)  # Data frames make whole numbers floats.
    name = column.astype(np.str_)
    known = [radar.name for radar in radars]
    unknown = ~np.isin(name, known)
    if unknown.any():
        row = int(np.argmax(unknown))
        raise ValueError(
            f"radar: {str(name[row])!r} in {place_of(columns, row)}, must be one of "
            f"{', '.join(known)}"
        )
    for each in known:
        yield np.flatnonzero(name == each)


def _step_ns(radar: SensorParameters) -> int:
    return round((radar.rotation_s / PARTS_OF_A_REVOLUTION or DEFAULT_PART_S) * 1e9)


def _ends_ns(time_ns: IntArray, radar: SensorParameters) -> IntArray:
    """Return the end of the part of a revolution of each detection time."""
    return (time_ns // _step_ns(radar) + 1) * _step_ns(radar)


def _empty_ns(ends_ns: Sequence[int], step_ns: int) -> list[int]:
    """Return the ends of the parts without detections, without gaps above a revolution."""
    empty_ns: list[int] = []
    for begin, end in pairwise(ends_ns):
        if end - begin < PARTS_OF_A_REVOLUTION * step_ns:
            empty_ns += range(begin + step_ns, end, step_ns)
    return empty_ns


def _place_of(sensor: SensorParameters) -> tuple[str, str]:
    """Return the quantities of the place of a sensor's detections."""
    return POSITION if isinstance(sensor, PositionParameters) else ("range", "azimuth")


def _columns_of(columns: Columns, sensor: SensorParameters) -> selection.Columns:
    """Return the columns of one sensor by quantity, in the sensor's convention."""
    names, place = sent_columns.names_of(sensor.fields), _place_of(sensor)
    if sensor.fields.time == TIME:
        # Reports are split by time here, and not by the radar's sectors.
        names.pop("sector", None)
    found = {
        what: stamps_ns(columns) / 1e9 if name == TIME else numbers(columns, name)
        for what, name in names.items()
        if name in columns
    }
    if place == POSITION and POSITION_STD in columns:
        std = numbers(columns, POSITION_STD)
        found = {"x_std": std, "y_std": std, **found}
    elif not {*place} & found.keys() and {*POSITION} & columns.keys():
        for name in POSITION:
            require_column(columns, name)
    for what in place:
        if what not in found:
            require_column(columns, names[what], f"; fields.{what} names another one")
    # The quantities of the place come first.
    return {**{what: found[what] for what in place}, **found}


def _report(
    stamp_ns: int, sent: selection.Columns, rows: IntArray, sensor: SensorParameters
) -> Report:
    """Return a report of rows; rows without a position mark a scan without detections."""
    one, other = (sent[what][rows] for what in _place_of(sensor))
    seen = rows[~(np.isnan(one) & np.isnan(other))]
    own = {what: column[seen] for what, column in sent.items()}
    if isinstance(sensor, PositionParameters):
        return position_selection.select(stamp_ns, sensor, own)
    if not isinstance(sensor, RadarParameters):
        raise TypeError(f"{sensor.name}: {sensor.kind} given, tables have radars and positions")
    return selection.select(stamp_ns, sensor, own)


def everywhere(config: TrackerConfig) -> TrackerConfig:
    """Return a configuration that also reads detections beyond the sensors' limits."""
    return replace(config, inputs=tuple(map(unlimited, config.inputs)))
