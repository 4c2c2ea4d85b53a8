"""Recordings of the Autoferry dataset: a radar and a lidar on a ferry, and two vessels' positions.

The files give detections as north and east of the ferry. They are converted to polar coordinates
about the ferry, with axes along the map's (x east, y north), so that the platform's yaw is 0.

References
----------
Helgesen, Vasstein, Brekke and Stahl, "Heterogeneous multi-sensor tracking for an autonomous surface
vehicle in a littoral environment", Ocean Engineering 252, 2022. The dataset (repository
Autoferry/sensor_fusion_dataset) is in the public domain (CC0 1.0).
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.state_space import PLANAR
from phd_jdtc_ros.core.types import Detections, Pose, Truth

SENSORS = ("radar", "lidar")
# Truth is interpolated only between positions at most this far apart, seconds.
LONGEST_GAP_S = 5.0
_DETECTIONS, _TRUTH = "scenario{}_detections.csv", "scenario{}_truth.csv"
_COLUMNS = {
    _DETECTIONS: ("scan", "sensor", "time", "own_north", "own_east", "north", "east"),
    _TRUTH: ("time", "target", "north", "east"),
}


class RecordingError(ValueError):
    """A file that does not match the dataset's format; the message names file and fault."""


@dataclass(frozen=True)
class Look:
    """One scan of one sensor."""

    sensor: str  # One of `SENSORS`
    stamp_ns: int
    own: Pose  # Pose of the ferry, with yaw 0
    relative: FloatArray  # Detections east and north of the ferry, metres, (M, 2)

    @property
    def detections(self) -> Detections:
        """The polar detections, without the sensor's pose."""
        east, north = self.relative.T
        measurement = np.stack([np.hypot(east, north), np.arctan2(north, east)], axis=1)
        return Detections(measurement, None)


@dataclass(frozen=True)
class Recording:
    """One scenario of the dataset."""

    scenario: int
    looks: tuple[Look, ...]  # By ascending stamp
    # Dict of int to array of shape (N, 3). Time (s), east and north (m) of each target, by
    # ascending time.
    targets: dict[int, FloatArray]

    def of(self, sensor: str) -> tuple[Look, ...]:
        """Return the looks of one sensor, by its name, in the order of time."""
        return tuple(look for look in self.looks if look.sensor == sensor)

    def truth(self, stamp_ns: int) -> Truth:
        """Return the targets at a stamp, interpolated; targets unknown near it are left out.

        A target is extrapolated up to a second before its first and after its last position.
        """
        time_s, rows, numbers = stamp_ns * 1e-9, [], []
        for number, track in self.targets.items():
            last = int(np.clip(np.searchsorted(track[:, 0], time_s), 1, len(track) - 1))
            before, after = track[last - 1], track[last]
            beyond = max(track[0, 0] - time_s, time_s - track[-1, 0])
            if after[0] - before[0] > LONGEST_GAP_S or beyond > 1.0:
                continue
            velocity = (after[1:] - before[1:]) / (after[0] - before[0])
            position = before[1:] + (time_s - before[0]) * velocity
            rows.append(PLANAR.state(position, velocity, 0.0))
            numbers.append(number)
        state = np.reshape(rows, (-1, len(PLANAR)))
        return Truth(stamp_ns, state, np.array(numbers), np.zeros(len(numbers), dtype=np.int64))


def scenarios_in(directory: Path) -> list[int]:
    """Return the numbers of the scenarios in a directory, ascending, or raise `RecordingError`."""
    names = [path.name for path in directory.glob(_DETECTIONS.format("*"))]
    found = [re.fullmatch(r"scenario(\d+)_detections\.csv", name) for name in names]
    numbers = sorted(int(match[1]) for match in found if match)
    if not numbers:
        raise RecordingError(f"{directory}: no {_DETECTIONS.format('NUMBER')} in it")
    return numbers


def read(directory: Path, scenario: int) -> Recording:
    """Return a scenario of the dataset.

    Raise `RecordingError` if a file is missing, or a row does not match the dataset's format.
    """
    found = _looks(directory / _DETECTIONS.format(scenario))
    looks = tuple(sorted(found, key=lambda look: look.stamp_ns))
    if not looks:
        raise RecordingError(f"{directory / _DETECTIONS.format(scenario)}: has no scan")
    targets = _targets(directory / _TRUTH.format(scenario))
    return Recording(scenario, looks, targets)


def _rows(path: Path, columns: Sequence[str]) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield the rows of a file with their line numbers."""
    try:
        with path.open(newline="") as stream:
            table = csv.DictReader(stream)
            missing = [name for name in columns if name not in (table.fieldnames or ())]
            if missing:
                raise RecordingError(f"{path}: column {missing[0]} is missing")
            for row in table:
                yield table.line_num, row
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f"{path}: cannot be read: {error}") from error


def _number(path: Path, line: int, row: dict[str, str], name: str) -> float:
    try:
        value = float(row[name])
    except (TypeError, ValueError):
        value = np.nan
    if not np.isfinite(value):
        raise RecordingError(f"{path}:{line}: {name} {row[name]!r}, must be a finite number")
    return value


def _looks(path: Path) -> Iterator[Look]:
    key: tuple[str, str] | None = None
    opened: tuple[str, int, Pose] = "", 0, Pose((0.0, 0.0), 0.0)
    found: list[tuple[float, float]] = []
    latest: dict[str, int] = {}
    for line, row in _rows(path, _COLUMNS[_DETECTIONS]):
        if row["sensor"] not in SENSORS:
            allowed = " or ".join(SENSORS)
            raise RecordingError(f"{path}:{line}: sensor {row['sensor']!r}, must be {allowed}")
        if (row["scan"], row["sensor"]) != key:
            if key is not None:
                yield Look(*opened, np.reshape(found, (-1, 2)))
            key, found = (row["scan"], row["sensor"]), []
            time_s, north, east = (
                _number(path, line, row, name) for name in ("time", "own_north", "own_east")
            )
            stamp_ns = round(time_s * 1e3) * 1_000_000
            if stamp_ns <= latest.get(row["sensor"], -1):
                raise RecordingError(f"{path}:{line}: time {time_s}, must rise from scan to scan")
            latest[row["sensor"]] = stamp_ns
            opened = row["sensor"], stamp_ns, Pose((east, north), 0.0)
        if row["north"] or row["east"]:
            east, north = (_number(path, line, row, name) for name in ("east", "north"))
            found.append((east, north))
    if key is not None:
        yield Look(*opened, np.reshape(found, (-1, 2)))


def _targets(path: Path) -> dict[int, FloatArray]:
    found: dict[int, dict[float, tuple[float, float]]] = {}
    for line, row in _rows(path, _COLUMNS[_TRUTH]):
        time_s, target, north, east = (
            _number(path, line, row, name) for name in ("time", "target", "north", "east")
        )
        # Close scans may name the same position twice.
        found.setdefault(int(target), {})[time_s] = east, north
    few = [target for target, rows in found.items() if len(rows) < 2]
    if few or not found:
        raise RecordingError(f"{path}: target {few[0] if few else 1} has fewer than 2 positions")
    return {
        target: np.array([(time_s, *rows[time_s]) for time_s in sorted(rows)])
        for target, rows in sorted(found.items())
    }
