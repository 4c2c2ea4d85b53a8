"""Storage of learned clutter in a snapshot, and its restoration."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..clutter.amplitude_law import CELLS, MAX_COUNT, MEMORY, Learned
from ..clutter.grid import Grid, GroundGrid, PolarGrid
from ..clutter.map import MAX_CELLS, ClutterMap
from ..clutter.rate import ClutterCount
from ..models.clutter_learning import ClutterMemory
from ..sensors.sensor import Sensor
from ..snapshot import MAX_STATE, Snapshot, floats, from_snapshot, to_snapshot

NAME, MAP, RATE, USUAL = "clutter", "clutter_map", "clutter_rate", "usual_detections"


class Place(NamedTuple):
    """The location of a radar with learned clutter."""

    # World x and y in metres, and yaw in radians, (3,).
    pose: Annotated[FloatArray, floats("X", -MAX_STATE, MAX_STATE)]


def clutter_to_snapshot(
    memory: ClutterMemory, radars: Sequence[Sensor], snapshot: Snapshot
) -> None:
    """Store the learned clutter of these radars, and their usual numbers of detections."""
    for name, law in memory.laws.items():
        to_snapshot(law, snapshot, f"{NAME}.{name}")
    for name, usual in memory.usual.items():
        to_snapshot(usual, snapshot, f"{USUAL}.{name}")
    for radar in radars:
        if radar.clutter_count is not None and radar.name in memory.counts:
            to_snapshot(memory.counts[radar.name], snapshot, f"{RATE}.{radar.name}")
        if radar.name in memory.maps:
            own, name = memory.maps[radar.name], f"{MAP}.{radar.name}"
            to_snapshot(own, snapshot, name)
            to_snapshot(own.grid, snapshot, f"{name}.grid")
            to_snapshot(_place_of(radar), snapshot, name)


def clutter_from_snapshot(snapshot: Snapshot, radars: Sequence[Sensor]) -> ClutterMemory:
    """Return the stored clutter of these radars.

    Raises
    ------
    ValueError
        If it belongs to another radar or place, or a tracker could not have stored it.
    """
    known = {radar.name: radar for radar in radars}
    learning = [n for n, radar in known.items() if isinstance(radar.clutter_amplitude, Learned)]
    mapping = [name for name, radar in known.items() if radar.clutter_map is not None]
    laws = {
        name: _law(snapshot, known[name])
        for name in _radars(snapshot, NAME, learning, "whose clutter_amplitude is learned")
    }
    maps = {
        name: _map(snapshot, known[name])
        for name in _radars(snapshot, MAP, mapping, "whose clutter_map is true")
    }
    counts = {
        name: from_snapshot(ClutterCount, snapshot, f"{RATE}.{name}", {})
        for name in _radars(snapshot, RATE, known, "of this tracker")
    }
    # A rate learned before the snapshot is dropped if the configuration sets it now.
    counts = {name: own for name, own in counts.items() if known[name].clutter_count is not None}
    usual = {
        name: from_snapshot(ClutterCount, snapshot, f"{USUAL}.{name}", {})
        for name in _radars(snapshot, USUAL, known, "of this tracker")
    }
    return ClutterMemory(laws, maps, counts, usual)


def _radars(snapshot: Snapshot, part: str, allowed: Collection[str], which: str) -> list[str]:
    """Return the radars named in a part of a snapshot; raises ValueError for unknown ones."""
    names = snapshot.names_below(part)
    for name in names.difference(allowed):
        raise ValueError(
            f"{part}: clutter of {name[:40]} given, must be of a radar {which}: "
            f"{', '.join(allowed) or 'there is none'}"
        )
    return sorted(names)


def _place_of(radar: Sensor) -> Place:
    return Place(np.array([*radar.position, radar.yaw], dtype=np.float64))


def _law(snapshot: Snapshot, radar: Sensor) -> Learned:
    name = f"{NAME}.{radar.name}"
    law = from_snapshot(Learned, snapshot, name, {"K": CELLS}, threshold=radar.threshold)
    if law.count.sum() > MAX_COUNT:
        raise ValueError(f"{name}.count: {law.count.sum():.4g} detections, at most {MEMORY:g}")
    return law


def _map(snapshot: Snapshot, radar: Sensor) -> ClutterMap:
    """Return the stored clutter map of a radar; raises ValueError for one of another place."""
    name, place = f"{MAP}.{radar.name}", _place_of(radar).pose.tolist()
    stored = from_snapshot(Place, snapshot, name, {"X": 3}).pose.tolist()
    if stored != place:
        raise ValueError(
            f"{name}: map of a radar at {stored} (x, y in m, yaw in rad), expected {place}"
        )
    polar = radar.clutter_map is not None and isinstance(radar.clutter_map.grid, PolarGrid)
    if polar != (f"{name}.grid.columns" in snapshot.arrays):
        given, own = ("moving", "fixed") if polar else ("fixed", "moving")
        raise ValueError(f"{name}: map of a {given} radar given, but this radar is {own}")
    kind: type[Grid] = PolarGrid if polar else GroundGrid
    grid = from_snapshot(kind, snapshot, f"{name}.grid", {})
    learned = from_snapshot(ClutterMap, snapshot, name, {}, grid=grid)
    if len(learned.cell) > MAX_CELLS:
        raise ValueError(f"{name}.cell: {len(learned.cell)} cells, at most {MAX_CELLS}")
    return learned
