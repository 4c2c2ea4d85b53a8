"""The page's picture of the traffic: tracks with labels, trails, detections and truth by time.

The page's script draws it. Data that vary with time are columns of integers, track by track; see
`Columns`. Positions are multiples of a quantum, relative to a corner of the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np

from msg_adapters.targets import geodetic, vertical
from msg_adapters.targets.markers import class_colour
from msg_adapters.targets.vertical import FLIGHT_LEVEL
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.models.zones import Zone
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.types import SOURCES, Estimates, Reported
from phd_jdtc_ros.core.types.reports import LEFT
from phd_jdtc_ros.evaluation.comparison import PointSet, TrueTracks
from phd_jdtc_ros.report.style import places_of

from ..record import RadarPlots, Record, concatenate_rows
from ..style import RADIUS_95
from .layers import Columns, clutter_levels, earth_grid, graticule, rings, shades_of

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
    grid: Grid, record: Record, frames: Frames, source: str, header: dict[str, Any], flying: bool
) -> int:
    """Add the shown estimates of a source as columns, and new identities to the header's.

    Return the number of frames for which a set of estimates remains the newest.
    """
    known: list[list[str]] = header["identities"]
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
    columns |= said_of(sets, header["told"])
    for name, values in columns.items():
        grid.columns.add(f"{source}.{name}", np.rint(values[order]))
    apart = np.diff([frame for frame, _ in shown])
    return int(np.median(apart)) if len(apart) else 1


# What self-reports say of a track, most urgent last, in words; a track of no receiver has none.
MARKS = ("", "no report", "reports", "left by", "dark", "doubtful")


def said_of(sets: Sequence[Estimates], told: list[str]) -> dict[str, FloatArray | IntArray]:
    """Return columns of what self-reports say, and add new names of sources to `told`.

    ``mark`` is an index in `MARKS`, ``chance`` its probability in percent, ``since`` for how long
    it has been so, seconds, -1 if unknown, and ``source`` an index in `told`. There are none
    without a receiver.
    """
    if not any(entry.reports is not None for entry in sets):
        return {}
    places = {text: k for k, text in enumerate(told)}
    rows = []
    for entry in sets:
        said = entry.reports or Reported.unknown(len(entry))
        doubt = np.nan_to_num(said.doubtful)
        cases = [doubt > 0.5, said.dark > 0.5, said.reason == LEFT, said.owned > 0.5]
        cases.append((said.alone == 1) | np.isfinite(said.silent))
        mark = np.select(cases, [5, 4, 3, 2, 1 + said.alone], 0)
        chance = np.select(cases[:4], [doubt, said.dark, 1.0 - said.owned, said.owned], 0.0)
        begin_ns = np.where((mark == 4) | (mark == 2), said.heard_ns, said.since_ns)
        since = np.where(begin_ns > 0, (entry.stamp_ns - begin_ns) * 1e-9, -1.0)
        names = [places.setdefault(said.source_text(k), len(places)) for k in range(len(entry))]
        rows.append(np.column_stack([mark, 100.0 * chance, since, names]).reshape(-1, 4))
    told[:] = places
    columns = concatenate_rows(rows, 4).T
    return dict(zip(("mark", "chance", "since", "source"), columns, strict=True))


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


# Number of position steps across the picture, and least extent of the picture, metres.
STEPS, LEAST_EXTENT = 1e5, 100.0
# The targets count as aircraft, with flight levels and knots, if most of the fastest tracks exceed
# `FLIGHT`, metres per second, or if any reported height exceeds `FLYING`, metres. A measured one
# may be a drone's, which hovers there.
FLYING, FLIGHT = 300.0, 80.0
# Aircraft are on the ground if slower than `TAXI`, metres per second, and at most `APRON` above the
# lowest one, metres.
TAXI, APRON = 25.0, 300.0


@dataclass(frozen=True)
class Picture:
    """The data that the page's script draws."""

    header: dict[str, Any]  # Data that do not vary with time, as JSON
    columns: Columns
    frames: Frames


def picture_of(record: Record) -> Picture | None:
    """Return the picture of a record; None if it is empty."""
    frames = Frames.of(record)
    if not len(frames):
        return None
    columns = Columns()
    corner, far = _view(record)
    quantum = 10.0 ** np.floor(np.log10(max((far - corner).max(), LEAST_EXTENT) / STEPS))
    grid = Grid(corner, float(quantum), columns)
    height = known_heights(record)
    every = (each for source in SOURCES for each in record.of_source(source))
    in_space = any(each.space.vertical for each in every)
    aircraft = _are_fast(record) or (not in_space and bool((height > FLYING).any()))
    # Flight levels are pressure altitudes, which states in space do not have.
    by_level = aircraft and not in_space
    header: dict[str, Any] = {
        "first": frames.first_shown(record),
        "corner": corner.tolist(),
        "extent": (far - corner).tolist(),
        "quantum": float(quantum),
        "levels": ("FL" if by_level else "m") if len(height) else "",
        "ground": _ground(record, height, FLIGHT_LEVEL if by_level else 1.0) if aircraft else None,
        "no_level": NO_LEVEL,
        "axis": [AXIS_STEPS, LEAST_AXIS * RADIUS_95],
        "classes": _classes(record, aircraft),
        "sources": [source for source in SOURCES if record.of_source(source)],
        "hold": {},
        "radars": _radars(record),
        "sites": [[site.name, *site.position] for site in record.radars],
        "known": {
            "truth": bool(record.truth),
            "plots": bool(record.plots),
            "alarms": bool(record.conflicts or record.zones),
        },
        "rings": rings(record.radars, corner, far),
        "identities": [],
        "told": [""],
        "marks": MARKS,
        "place_unknown": record.plane is not None and not record.place_known,
    }
    for source in header["sources"]:
        header["hold"][source] = add_estimates(grid, record, frames, source, header, by_level)
    for identity in header["identities"]:
        identity.append(record.call_sign_of(identity[1]))
    _add_truth(record, frames, grid)
    header["amplitudes"] = _add_plots(record, frames, grid)
    _add_carriers(record, frames, grid)
    _add_alarms(record, frames, grid)
    header["zones"] = zone_lines(record.zones)
    if record.clutter is not None:
        header["clutter"] = clutter_levels(record.clutter, columns)
    if record.plane is not None and record.place_known:
        header["earth"] = earth_grid(record.plane, corner, far, columns)
        header["graticule"] = graticule(record.plane, corner, far, columns)
    return Picture({**header, "columns": columns.index}, columns, frames)


def _radars(record: Record) -> list[str]:
    return sorted({plot.radar for plot in record.plots})


def _are_fast(record: Record) -> bool:
    """Return whether the targets are as fast as aircraft, by the speeds of all estimates."""
    speeds = concatenate_rows(
        np.hypot(*entry.velocity.T)
        for part in ((record.truth,) if not record.filtered else (record.filtered,))
        for entry in part
    )
    return len(speeds) > 0 and float(np.percentile(speeds, 95.0)) > FLIGHT


def _ground(record: Record, height: FloatArray, unit: float) -> dict[str, float]:
    """Return the speed, m/s, and the level up to which aircraft are on the ground.

    `unit` is that of levels, metres.
    """
    datum = 0.0 if record.plane is None else record.plane.origin[2]
    top = float(np.percentile(height, 1.0)) + datum + APRON if len(height) else 0.0
    return {"speed": TAXI, "level": round(top / unit)}


def _classes(record: Record, aircraft: bool) -> list[dict[str, Any]]:
    """Return title and colour of each class of the tracker, and of further ones of the truth."""
    fastest: dict[int, float] = {}
    for entry in record.truth:
        for kind, speed in zip(
            entry.class_id.tolist(), np.hypot(*entry.velocity.T).tolist(), strict=True
        ):
            fastest[kind] = max(speed, fastest.get(kind, 0.0))
    titles = [record.sets.class_title(kind) for kind in range(record.classes)]
    for kind in range(record.classes, max(fastest, default=-1) + 1):
        grounded = aircraft and fastest.get(kind, 0.0) < TAXI
        titles.append(
            "ground traffic" if grounded else f"{record.sets.class_title(kind)}, untracked"
        )
    return [{"title": title, "colour": class_colour(k)} for k, title in enumerate(titles)]


def _view(record: Record) -> tuple[FloatArray, FloatArray]:
    """Return the corners of a square around the targets, or around the detections without any."""
    places = places_of(record)
    if not len(places):
        places = np.zeros((1, 2))
    low, high = places.min(axis=0), places.max(axis=0)
    half = 0.53 * max(float(np.max(high - low)), LEAST_EXTENT)
    middle = 0.5 * (low + high)
    return middle - half, middle + half


def _add_truth(record: Record, frames: Frames, grid: Grid) -> None:
    """Add the true targets at the frames, interpolated between stamps of the truth."""
    tracks = TrueTracks()
    for entry in record.truth:
        tracks.add(entry.stamp_ns, PointSet.of(entry))
    known = [(k, tracks.at(stamp)) for k, stamp in enumerate(frames.stamp_ns.tolist())]
    found = [(k, points) for k, points in known if points is not None]
    frame = np.repeat([k for k, _ in found], [len(points) for _, points in found])
    number = [p.track_id if p.track_id is not None else np.zeros(len(p)) for _, p in found]
    order = grid.begin("truth", concatenate_rows(number).astype(np.int64), frame)
    grid.add("truth", concatenate_rows([p.position for _, p in found], 2)[order])
    speed = [
        np.hypot(*p.velocity.T) if p.velocity is not None else [np.nan] * len(p) for _, p in found
    ]
    grid.columns.add(
        "truth.speed", np.rint(10.0 * np.nan_to_num(concatenate_rows(speed), nan=1e3))[order]
    )
    grid.columns.add("truth.class", concatenate_rows([p.class_id for _, p in found])[order])


def _add_plots(record: Record, frames: Frames, grid: Grid) -> list[float]:
    """Add the detections ordered by frame; return the range of their amplitudes."""
    at = frames.at([plot.stamp_ns for plot in record.plots])
    counts = [len(plot.position) for plot in record.plots]
    frame = np.repeat(at, counts).astype(np.int64)
    order = np.argsort(frame, kind="stable")
    radars = {name: k for k, name in enumerate(_radars(record))}
    radar = np.repeat([radars[plot.radar] for plot in record.plots], counts)
    grid.columns.add("plots.frame", frame[order])
    grid.add("plots", record.all_plots.position[order])
    grid.columns.add("plots.radar", radar[order])
    grid.columns.add("plots.shade", shades_of(record.all_plots)[order])
    known = record.all_plots.amplitude[record.all_plots.known]
    return [float(f"{end:.3g}") for end in (known.min(), known.max())] if len(known) else []


def zone_lines(zones: Sequence[Zone]) -> list[dict[str, Any]]:
    """Return the zones with the ends of their sides: x and y of one, x and y of the other."""
    return [
        {"name": zone.name, "kind": zone.kind, "sides": np.rint(zone.sides).ravel().tolist()}
        for zone in zones
    ]


def _add_alarms(record: Record, frames: Frames, grid: Grid) -> None:
    """Add the alarms of conflicts, and the frames at which conflicts were looked for."""
    at = frames.at([found.stamp_ns for found in record.conflicts])
    raised = [np.flatnonzero(found.alarm) for found in record.conflicts]
    grid.columns.add("alarms.looked", at)
    grid.columns.add("alarms.frame", np.repeat(at, list(map(len, raised))))

    def of(name: str, *shape: int) -> FloatArray:
        shown = zip(record.conflicts, raised, strict=True)
        return concatenate_rows([getattr(found, name)[rows] for found, rows in shown], *shape)

    grid.add("alarms", of("place", 2))
    for name in ("kind", "first", "second", "alarm"):
        grid.columns.add(f"alarms.{name}", of(name))
    grid.columns.add("alarms.chance", np.rint(100.0 * of("probability")))


def _add_carriers(record: Record, frames: Frames, grid: Grid) -> None:
    """Add the positions of moving radars, by the radar's index."""
    names = _radars(record)
    carried: list[RadarPlots] = [plot for plot in record.plots if plot.sensor is not None]
    number = np.array([names.index(plot.radar) for plot in carried], dtype=np.int64)
    order = grid.begin("carriers", number, frames.at([plot.stamp_ns for plot in carried]))
    grid.add("carriers", concatenate_rows([np.array([p.sensor]) for p in carried], 2)[order])
