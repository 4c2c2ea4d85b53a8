"""Splits tables of detections into reports of radars."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from msg_adapters import selection, sent_columns
from msg_adapters.selection import Report
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.radar_parameters import RadarParameters
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.sensors.polar_geometry import MIN_RANGE

from .tables import Columns, numbers, require_column, rows_by_stamp, stamps_ns

# Columns of positions, and of their standard deviation, which replace ranges and azimuths.
POSITION, POSITION_STD = ("x", "y"), "position_std"
TIME = "time"
# Detections with individual times are reported in parts of a turn, as the tracker splits turns, or
# in parts of USUAL_S seconds if the time of a turn is unknown.
PARTS_OF_A_TURN, USUAL_S = 8, 1.0


class RadarReport(NamedTuple):
    """A report of one radar.

    Parameters
    ----------
    radar : int
        Index in the configured order.
    """

    radar: int
    report: Report


def reports_of(columns: Columns, config: TrackerConfig) -> list[RadarReport]:
    """Return the reports of a table, by ascending stamp and then by radar.

    Parameters
    ----------
    columns : dict of name to array
        See `Tracker.track`.

    Raises
    ------
    ValueError
        If a required column is missing or has an invalid value.
    """
    time_ns = stamps_ns(columns)
    found = []
    for index, rows in enumerate(_rows_of_radars(columns, config.inputs)):
        radar, model = config.inputs[index], config.model.radars[index]
        stamp_ns = _ends_ns(time_ns[rows], radar) if radar.fields.time == TIME else time_ns[rows]
        own = {name: column[rows] for name, column in columns.items()}
        if not len(rows):
            continue
        read = _Reader(radar, model.position, model.yaw, float(model.noise_std[0]))
        sent = read.columns(own)
        parts = {int(stamp_ns[part[0]]): part for part in rows_by_stamp(stamp_ns)}
        found += [RadarReport(index, read.report(ns, sent, part)) for ns, part in parts.items()]
        if radar.fields.time == TIME:
            quiet = _quiet_ns([*parts], _step_ns(radar))
            none = np.arange(0)
            found += [RadarReport(index, read.report(each, sent, none)) for each in quiet]
    return sorted(found, key=lambda each: (each.report.stamp_ns, each.radar))


def report_of(stamp_ns: int, columns: Columns, config: TrackerConfig, index: int) -> Report:
    """Return one radar's report.

    Parameters
    ----------
    columns : dict of name to array
        Columns of the report; empty if there are no detections.
    index : int
        Index of the radar in the configured order.
    """
    radar, model = config.inputs[index], config.model.radars[index]
    count = len(next(iter(columns.values()), ()))
    read = _Reader(radar, model.position, model.yaw, float(model.noise_std[0]))
    if not count:
        none = np.zeros(0)
        return read.report(stamp_ns, selection.Columns(none, none), np.arange(0))
    return read.report(stamp_ns, read.columns(columns), np.arange(count))


def _rows_of_radars(columns: Columns, radars: Sequence[RadarParameters]) -> Iterator[IntArray]:
    """Yield the rows of each radar's detections."""
    count = len(columns[TIME])
    if len(radars) == 1 and "radar" not in columns:
        yield np.arange(count)
        return
    name = require_column(columns, "radar").astype(np.str_)
    known = [radar.name for radar in radars]
    unknown = ~np.isin(name, known)
    if unknown.any():
        row = int(np.argmax(unknown))
        raise ValueError(
            f"radar: {str(name[row])!r} in row {row + 1}, must be one of {', '.join(known)}"
        )
    for each in known:
        yield np.flatnonzero(name == each)


def _step_ns(radar: RadarParameters) -> int:
    """Return the duration of a part of a turn, ns."""
    return round((radar.rotation_s / PARTS_OF_A_TURN or USUAL_S) * 1e9)


def _ends_ns(time_ns: IntArray, radar: RadarParameters) -> IntArray:
    """Return the end of the part of a turn of each detection time."""
    ends: IntArray = (time_ns // _step_ns(radar) + 1) * _step_ns(radar)
    return ends


def _quiet_ns(ends_ns: Sequence[int], step_ns: int) -> list[int]:
    """Return the ends of the parts without detections; gaps longer than a turn are left out."""
    quiet: list[int] = []
    for begin, end in pairwise(ends_ns):
        if end - begin < PARTS_OF_A_TURN * step_ns:
            quiet += range(begin + step_ns, end, step_ns)
    return quiet


class _Reader:
    """Reads the columns of one radar.

    Parameters
    ----------
    position : tuple of two floats
        World frame, metres.
    yaw : float
        Radians counter-clockwise.
    range_std : float
        Standard deviation of positions without a column of it, metres.
    """

    def __init__(
        self, radar: RadarParameters, position: tuple[float, float], yaw: float, range_std: float
    ) -> None:
        self._radar, self._range_std = radar, range_std
        self._position, self._yaw = position, yaw

    def columns(self, columns: Columns) -> selection.Columns:
        """Return the columns in the radar's convention."""
        radar = self._radar
        names = sent_columns.names_of(radar)
        if radar.fields.time == TIME:
            # Reports are split by time here, and not by the radar's sectors.
            names.pop("sector", None)
        found = {
            what: stamps_ns(columns) / 1e9 if name == TIME else numbers(columns, name)
            for what, name in names.items()
            if name in columns
        }
        if radar.fields.range not in columns and {*POSITION} <= columns.keys():
            found |= self._of_positions(columns)
        for what in ("distance", "azimuth"):
            if what not in found:
                require_column(columns, names[what])
        return selection.Columns(**found)

    def _of_positions(self, columns: Columns) -> dict[str, FloatArray]:
        """Convert positions, whose noise is equal along both axes, to ranges and azimuths."""
        radar = self._radar
        if radar.site is not None:
            raise ValueError(
                f"x, y: given, must be {radar.fields.range} and {radar.fields.azimuth} for "
                f"{radar.name}, because it has geodetic"
            )
        x, y = (
            numbers(columns, name) - zero
            for name, zero in zip(POSITION, self._position, strict=True)
        )
        distance = np.hypot(x, y)
        std = np.full(len(x), self._range_std)
        if POSITION_STD in columns:
            std = numbers(columns, POSITION_STD)
        across = np.minimum(std / np.maximum(distance, MIN_RANGE), np.pi)
        return {
            "distance": distance,
            "azimuth": sent_columns.azimuth(np.arctan2(y, x) - self._yaw, radar),
            "range_std": std,
            "azimuth_std": np.degrees(across) if radar.azimuth_in_degrees else across,
        }

    def report(self, stamp_ns: int, sent: selection.Columns, rows: IntArray) -> Report:
        """Return a report of rows; rows without a position mark a scan without detections."""
        seen = rows[~(np.isnan(sent.distance[rows]) & np.isnan(sent.azimuth[rows]))]
        own = {what: column[seen] for what, column in vars(sent).items() if column is not None}
        return selection.select(stamp_ns, self._radar, selection.Columns(**own))


def beyond_any_range(config: TrackerConfig) -> TrackerConfig:
    """Return a configuration that also reads detections beyond the radars' maximum ranges."""
    inputs = tuple(replace(radar, max_range=math.inf) for radar in config.inputs)
    return replace(config, inputs=inputs)
