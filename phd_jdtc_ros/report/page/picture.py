"""The page's picture of the traffic: tracks with labels, trails, detections and truth by time.

The page's script draws it. Data that vary with time are columns of integers, track by track; see
`Columns`. Positions are multiples of a quantum, relative to a corner of the picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from msg_adapters.targets.palette import class_colour
from msg_adapters.targets.vertical import FLIGHT_LEVEL
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import SOURCES
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.true_tracks import TrueTracks

from ..record import RadarPlots, Record, concatenate_rows
from ..style import RADIUS_95
from ..units import places_of
from .estimate_rows import (
    AXIS_STEPS,
    LEAST_AXIS,
    NO_LEVEL,
    Frames,
    Grid,
    add_estimates,
    known_heights,
)
from .layers import clutter_levels, earth_grid, graticule, rings, shades_of
from .packing import Columns

# Number of position steps across the picture, and least extent of the picture, metres.
STEPS, LEAST_EXTENT = 1e5, 100.0
# The targets count as aircraft, with flight levels and knots, if any height exceeds `FLYING`,
# metres, or most of the fastest tracks exceed `FLIGHT`, metres per second.
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
    aircraft = _aircraft(record, height)
    header: dict[str, Any] = {
        "first": frames.first_shown(record),
        "corner": corner.tolist(),
        "extent": (far - corner).tolist(),
        "quantum": float(quantum),
        "levels": ("FL" if aircraft else "m") if len(height) else "",
        "ground": _ground(record, height) if aircraft else None,
        "no_level": NO_LEVEL,
        "axis": [AXIS_STEPS, LEAST_AXIS * RADIUS_95],
        "classes": _classes(record, aircraft),
        "sources": [source for source in SOURCES if record.of_source(source)],
        "hold": {},
        "radars": _radars(record),
        "sites": [[site.name, *site.position] for site in record.radars],
        "known": {"truth": bool(record.truth), "plots": bool(record.plots)},
        "rings": rings(record.radars, corner, far),
        "identities": [],
        "place_unknown": record.plane is not None and not record.place_known,
    }
    for source in header["sources"]:
        known = header["identities"]
        header["hold"][source] = add_estimates(grid, record, frames, source, known, aircraft)
    for identity in header["identities"]:
        identity.append(record.call_sign_of(identity[1]))
    _add_truth(record, frames, grid)
    header["amplitudes"] = _add_plots(record, frames, grid)
    _add_carriers(record, frames, grid)
    if record.clutter is not None:
        header["clutter"] = clutter_levels(record.clutter, columns)
    if record.plane is not None and record.place_known:
        header["earth"] = earth_grid(record.plane, corner, far, columns)
        header["graticule"] = graticule(record.plane, corner, far, columns)
    return Picture({**header, "columns": columns.index}, columns, frames)


def _radars(record: Record) -> list[str]:
    return sorted({plot.radar for plot in record.plots})


def _aircraft(record: Record, height: FloatArray) -> bool:
    """Return whether the targets are aircraft, by the heights and speeds of all estimates."""
    speeds = concatenate_rows(
        np.hypot(*entry.velocity.T)
        for part in ((record.truth,) if not record.filtered else (record.filtered,))
        for entry in part
    )
    fast = len(speeds) > 0 and float(np.percentile(speeds, 95.0)) > FLIGHT
    return fast or bool((height > FLYING).any())


def _ground(record: Record, height: FloatArray) -> dict[str, float]:
    """Return the speed, m/s, and the level up to which aircraft are on the ground."""
    datum = 0.0 if record.plane is None else record.plane.origin[2]
    top = float(np.percentile(height, 1.0)) + datum + APRON if len(height) else 0.0
    return {"speed": TAXI, "level": round(top / FLIGHT_LEVEL)}


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


def _add_carriers(record: Record, frames: Frames, grid: Grid) -> None:
    """Add the positions of moving radars, by the radar's index."""
    names = _radars(record)
    carried: list[RadarPlots] = [plot for plot in record.plots if plot.sensor is not None]
    number = np.array([names.index(plot.radar) for plot in carried], dtype=np.int64)
    order = grid.begin("carriers", number, frames.at([plot.stamp_ns for plot in carried]))
    grid.add("carriers", concatenate_rows([np.array([p.sensor]) for p in carried], 2)[order])
