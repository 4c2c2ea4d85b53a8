"""Splits tables of detections into reports of radars."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from phd_jdtc_ros.columns import selection, sent_columns
from phd_jdtc_ros.columns.selection import Report
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.sensors.polar_geometry import MIN_RANGE
from phd_jdtc_ros.core.sensors.sensor import Sensor

from .supposed_radar import POSITION
from .tables import (
    MOST_METRES,
    Columns,
    numbers,
    place_of,
    require_column,
    rows_by_stamp,
    rows_of,
    stamps_ns,
    with_column,
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
    for index, rows in enumerate(_rows_of_radars(columns, config.radars)):
        if not len(rows):
            continue
        radar = config.radars[index]
        sent = _columns_of(rows_of(columns, rows), config, index)
        timed = radar.fields.time == TIME
        stamp_ns = _ends_ns(time_ns[rows], radar) if timed else time_ns[rows]
        parts = {int(stamp_ns[part[0]]): part for part in rows_by_stamp(stamp_ns)}
        if timed:
            empty_ns = _empty_ns([*parts], _step_ns(radar))
            parts |= dict.fromkeys(empty_ns, np.arange(0))
        found += [(index, _report(ns, sent, part, radar)) for ns, part in parts.items()]
    return sorted(found, key=lambda each: (each[1].stamp_ns, each[0]))


def report_of(stamp_ns: int, columns: Columns, config: TrackerConfig, index: int) -> Report:
    """Return one radar's report, by its index; `columns` are empty without detections."""
    count = len(next(iter(columns.values()), ()))
    none: FloatArray = np.zeros(0)
    sent = _columns_of(columns, config, index) if count else {"range": none, "azimuth": none}
    return _report(stamp_ns, sent, np.arange(count), config.radars[index])


def _rows_of_radars(columns: Columns, radars: Sequence[RadarParameters]) -> Iterator[IntArray]:
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


def _step_ns(radar: RadarParameters) -> int:
    return round((radar.rotation_s / PARTS_OF_A_REVOLUTION or DEFAULT_PART_S) * 1e9)


def _ends_ns(time_ns: IntArray, radar: RadarParameters) -> IntArray:
    """Return the end of the part of a revolution of each detection time."""
    return (time_ns // _step_ns(radar) + 1) * _step_ns(radar)


def _empty_ns(ends_ns: Sequence[int], step_ns: int) -> list[int]:
    """Return the ends of the parts without detections, without gaps above a revolution."""
    empty_ns: list[int] = []
    for begin, end in pairwise(ends_ns):
        if end - begin < PARTS_OF_A_REVOLUTION * step_ns:
            empty_ns += range(begin + step_ns, end, step_ns)
    return empty_ns


def _columns_of(columns: Columns, config: TrackerConfig, index: int) -> selection.Columns:
    """Return the columns of one radar by quantity, in the radar's convention."""
    radar = config.radars[index]
    names = sent_columns.names_of(radar.fields)
    if radar.fields.time == TIME:
        # Reports are split by time here, and not by the radar's sectors.
        names.pop("sector", None)
    found = {
        what: stamps_ns(columns) / 1e9 if name == TIME else numbers(columns, name)
        for what, name in names.items()
        if name in columns
    }
    if radar.fields.range not in columns and {*POSITION} <= columns.keys():
        found |= _of_positions(columns, radar, config.model.radars[index])
    elif not {"range", "azimuth"} & found.keys() and {*POSITION} & columns.keys():
        for name in POSITION:
            require_column(columns, name)
    for what in ("range", "azimuth"):
        if what not in found:
            require_column(columns, names[what])
    return found


def _of_positions(columns: Columns, radar: RadarParameters, model: Sensor) -> selection.Columns:
    """Convert positions, whose noise is equal along both axes, to ranges and azimuths."""
    if radar.site is not None:
        raise ValueError(
            f"x, y: given, must be {radar.fields.range} and {radar.fields.azimuth} for "
            f"{radar.name}, because it has geodetic"
        )
    x, y = (
        np.clip(numbers(columns, name), -2.0 * MOST_METRES, 2.0 * MOST_METRES) - zero
        for name, zero in zip(POSITION, model.position, strict=True)
    )
    distance = np.hypot(x, y)
    std = np.full(len(x), float(model.noise_std[0]))
    if POSITION_STD in columns:
        std = numbers(columns, POSITION_STD)
    across = np.clip(std / np.maximum(distance, MIN_RANGE), *selection.AZIMUTH_STDS)
    return {
        "range": distance,
        "azimuth": sent_columns.azimuth(np.arctan2(y, x) - model.yaw, radar),
        "range_std": std,
        "azimuth_std": np.degrees(across) if radar.azimuth_in_degrees else across,
    }


def _report(
    stamp_ns: int, sent: selection.Columns, rows: IntArray, radar: RadarParameters
) -> Report:
    """Return a report of rows; rows without a position mark a scan without detections."""
    seen = rows[~(np.isnan(sent["range"][rows]) & np.isnan(sent["azimuth"][rows]))]
    own = {what: column[seen] for what, column in sent.items()}
    return selection.select(stamp_ns, radar, own)


def without_max_range(config: TrackerConfig, supposed: Collection[str]) -> TrackerConfig:
    """Return a configuration that also reads detections beyond the radars' maximum ranges.

    Those of `supposed` radars are bounds of the positions.
    """
    inputs = tuple(
        radar if radar.name in supposed else replace(radar, max_range=MOST_METRES)
        for radar in config.radars
    )
    return replace(config, inputs=inputs)
