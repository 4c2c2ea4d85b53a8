"""The positions of the page's slider, and the estimates as columns of integers, track by track."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from msg_adapters.targets import geodetic, vertical
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.types import SOURCES, Estimates

from ..record import Record, concatenate_rows
from .packing import Columns

# Largest number of frames of a page, which shows every second or third set of a longer run.
MOST = 3600

NO_LEVEL = -9999
# Ellipses' semi-axes are stored as logarithms: steps per factor of 2, and the least axis, metres.
AXIS_STEPS, LEAST_AXIS = 16, 0.01


@dataclass(frozen=True)
class Frames:
    """The stamps that the page can show, ascending."""

    stamp_ns: IntArray  # (F,)

    @staticmethod
    def of(record: Record) -> Frames:
        """Return the stamps of the estimates; without any, of detections and truth."""
        estimates = [entry.stamp_ns for source in SOURCES for entry in record.of_source(source)]
        others = [entry.stamp_ns for part in (record.plots, record.truth) for entry in part]
        stamps = np.unique(np.array(estimates or others, dtype=np.int64))
        return Frames(stamps[:: -(-len(stamps) // MOST) or 1])

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def at(self, stamp_ns: Sequence[int]) -> IntArray:
        """Return the frame of each stamp: the first frame not before it, or else the last."""
        found = np.searchsorted(self.stamp_ns, np.array(stamp_ns, dtype=np.int64))
        return np.minimum(found, max(len(self) - 1, 0)).astype(np.int64)

    def first_shown(self, record: Record) -> int:
        """Return the last of the frames with the most targets, counting true ones if known."""
        estimates = max((record.of_source(source) for source in SOURCES), key=len)
        counted = record.truth or estimates
        most = np.zeros(len(self), dtype=np.int64)
        np.maximum.at(
            most, self.at([e.stamp_ns for e in counted]), [len(e.class_id) for e in counted]
        )
        return int(np.flatnonzero(most == most.max())[-1]) if len(most) else 0


@dataclass(frozen=True)
class Grid:
    """The integer grid of positions."""

    corner: FloatArray  # Origin of the grid, metres, (2,)
    quantum: float  # Spacing of the grid, metres
    columns: Columns

    def add(self, name: str, places: FloatArray) -> None:
        """Add the columns of positions of shape (N, 2), metres."""
        whole = np.rint((places - self.corner) / self.quantum)
        for axis, values in zip("xy", whole.T, strict=True):
            self.columns.add(f"{name}.{axis}", values)

    def begin(self, name: str, number: IntArray, frame: IntArray) -> IntArray:
        """Add the columns of number and frame; return the rows' order, by target."""
        order: IntArray = np.lexsort((frame, number))
        numbers, starts = np.unique(number[order], return_index=True)
        self.columns.add(f"{name}.number", numbers)
        self.columns.add(f"{name}.start", starts)
        self.columns.add(f"{name}.frame", frame[order])
        return order


def add_estimates(
    grid: Grid, record: Record, frames: Frames, source: str, known: list[list[str]], flying: bool
) -> int:
    """Add the shown estimates of a source as columns, and new identities to `known`.

    Return the number of frames for which a set of estimates remains the newest.
    """
    found = record.of_source(source)
    at = frames.at([entry.stamp_ns for entry in found])
    shown = [
        (frame, entry)
        for frame, entry in zip(at.tolist(), found, strict=True)
        if frames.stamp_ns[frame] == entry.stamp_ns
    ]
    sets, plane = [entry for _, entry in shown], record.plane
    frame = np.repeat([frame for frame, _ in shown], [len(entry) for entry in sets])

    def of(name: str, *shape: int) -> FloatArray:
        return concatenate_rows(map(attrgetter(name), sets), *shape)

    order = grid.begin(source, of("track_id").astype(np.int64), frame)
    grid.add(source, of("position", 2)[order])
    datum = plane.origin[2] if plane is not None else 0.0
    unit = vertical.FLIGHT_LEVEL if flying else 1.0
    upward, velocity = of("known_attributes.height", 2), of("velocity", 2)
    known_level = np.isfinite(upward[:, 0])
    variance, axes = np.linalg.eigh(of("position_covariance", 2, 2))
    semi = np.sqrt(np.maximum(variance, LEAST_AXIS**2))
    share = concatenate_rows(e.class_probability[np.arange(len(e)), e.class_id] for e in sets)
    columns = {
        "vx": 10.0 * velocity[:, 0],
        "vy": 10.0 * velocity[:, 1],
        "course": concatenate_rows(_course(entry, plane) for entry in sets),
        "level": np.where(known_level, (upward[:, 0] + datum) / unit, NO_LEVEL),
        "climb": 10.0 * np.nan_to_num(upward[:, 1]),
        "class": of("class_id"),
        "share": 100.0 * share,
        "weight": 100.0 * of("weight"),
        "state": of("track_state"),
        "identity": _identity(sets, known),
        "minor": AXIS_STEPS * np.log2(semi[:, 0] / LEAST_AXIS),
        "major": AXIS_STEPS * np.log2(semi[:, 1] / LEAST_AXIS),
        "angle": np.degrees(np.arctan2(axes[:, 1, 1], axes[:, 0, 1])) % 180.0,
    }
    for name, values in columns.items():
        grid.columns.add(f"{source}.{name}", np.rint(values[order]))
    apart = np.diff([frame for frame, _ in shown])
    return int(np.median(apart)) if len(apart) else 1


def _course(entry: Estimates, plane: Plane | None) -> FloatArray:
    """Return courses, degrees clockwise from y, or from true north on the earth; 0 at rest."""
    if plane is not None:
        return np.nan_to_num(geodetic.of(entry, plane).course)
    course: FloatArray = np.degrees(np.arctan2(*entry.velocity.T)) % 360.0
    return course


def _identity(sets: Sequence[Estimates], known: list[list[str]]) -> IntArray:
    """Return the index of each estimate's code and address in `known`."""
    places = {tuple(entry): k for k, entry in enumerate(known)}
    found = [places.setdefault(pair, len(places)) for e in sets for pair in vertical.identities(e)]
    known[:] = map(list, places)
    return np.array(found, dtype=np.int64)


def known_heights(record: Record) -> FloatArray:
    """Return all known heights of estimates, metres above the world's zero."""
    found = concatenate_rows(
        entry.known_attributes.height[:, 0]
        for source in SOURCES
        for entry in record.of_source(source)
    )
    return found[np.isfinite(found)]
