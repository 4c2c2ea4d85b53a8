"""Storage of what a filter has learned of clutter in a snapshot, and its restoration.

`snapshot` says why every value is checked.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from ..clutter.amplitude_law import CELLS, MEMORY, Learned
from ..clutter.grid import MOST_AZIMUTHS, Grid, GroundGrid, PolarGrid
from ..clutter.map import MEMORY_TURNS, MOST_CELLS, ClutterMap
from ..clutter.rate import MEMORY_TURNS as COUNTED_TURNS
from ..clutter.rate import ClutterCount
from ..models.clutter_learning import ClutterMemory
from ..sensors.sensor import Sensor
from ..snapshot import MOST_INDEX, Snapshot, require_numbers, require_whole, whole

NAME, MAP, RATE = "clutter", "clutter_map", "clutter_rate"
# Rounding may leave a little more than all of the memory.
MOST_COUNT, MOST_TURNS = 1.001 * MEMORY, 1.001 * MEMORY_TURNS
# Of a rate: detections of all remembered turns, and these.
MOST_IN_ALL, LEAST_TURNS, MOST_COUNTED_TURNS = 1e9, 0.5, 2.0 * COUNTED_TURNS
# Of a map: detections of one report in one cell add up.
MOST_IN_CELL = 1e9


def put_clutter(snapshot: Snapshot, memory: ClutterMemory, radars: Sequence[Sensor]) -> None:
    """Store what has been learned of these radars; nothing if none of them learns."""
    if memory.laws:
        snapshot.facts[NAME] = sorted(memory.laws)
    for radar, law in memory.laws.items():
        snapshot.arrays[f"{NAME}.{radar}"] = law.count
    learning = [radar.name for radar in radars if radar.clutter_count is not None]
    counts = {name: memory.counts[name] for name in learning if name in memory.counts}
    if counts:
        snapshot.facts[RATE] = {name: [own.count, own.turns] for name, own in counts.items()}
    if memory.maps:
        pose = {radar.name: [*radar.position, radar.yaw] for radar in radars}
        snapshot.facts[MAP] = {
            radar: {
                "pose": pose[radar],
                **_grid_facts(places.grid),
                "turns": places.turns,
                "recent_turns": places.recent_turns,
            }
            for radar, places in memory.maps.items()
        }
    for radar, places in memory.maps.items():
        snapshot.arrays[f"{MAP}.{radar}.cell"] = places.cell
        snapshot.arrays[f"{MAP}.{radar}.count"] = places.count
        snapshot.arrays[f"{MAP}.{radar}.recent"] = places.recent


def take_clutter(snapshot: Snapshot, radars: Sequence[Sensor]) -> ClutterMemory:
    """Return what a snapshot has of the clutter of these radars.

    Raises
    ------
    ValueError
        If it is that of another radar or place, or none that a tracker could have stored.
    """
    learning = {
        radar.name: radar.threshold
        for radar in radars
        if isinstance(radar.clutter_amplitude, Learned)
    }
    names: Any = snapshot.facts.get(NAME, [])
    if not isinstance(names, list):
        raise ValueError(f"{NAME}: {str(names)[:40]} given, must be a list of radars")
    _require_radars(NAME, names, learning, "clutter_amplitude is learned")
    laws = {name: Learned(learning[name], _take_count(snapshot, name)) for name in names}
    mapping = {radar.name: radar for radar in radars if radar.clutter_map is not None}
    facts: Any = snapshot.facts.get(MAP, {})
    if not isinstance(facts, dict):
        raise ValueError(f"{MAP}: {str(facts)[:40]} given, must be a mapping by radar")
    _require_radars(MAP, facts, mapping, "clutter_map is true")
    maps = {name: _take_map(snapshot, mapping[name], facts[name]) for name in facts}
    return ClutterMemory(laws, maps, _take_counts(snapshot, radars))


def _take_counts(snapshot: Snapshot, radars: Sequence[Sensor]) -> dict[str, ClutterCount]:
    """Return the numbers that clutter rates are learned from.

    Those of a radar whose rate is given now are left out: it may change at any time.
    """
    facts: Any = snapshot.facts.get(RATE, {})
    if not isinstance(facts, dict):
        raise ValueError(f"{RATE}: {str(facts)[:40]} given, must be a mapping by radar")
    known = {radar.name: radar.clutter_count is not None for radar in radars}
    counts = {}
    for name, fact in facts.items():
        if name not in known:
            raise ValueError(
                f"{RATE}: that of {str(name)[:40]} given, must be of one of {', '.join(known)}"
            )
        if not (isinstance(fact, list) and len(fact) == 2):
            raise ValueError(f"{RATE}.{name}: {str(fact)[:40]} given, must be a count and turns")
        numbers = np.array([each if isinstance(each, float) else np.nan for each in fact])
        require_numbers(f"{RATE}.{name}.count", numbers[:1], 0.0, MOST_IN_ALL)
        # No turns are remembered of a radar whose rate was never learned.
        require_numbers(f"{RATE}.{name}.turns", numbers[1:], LEAST_TURNS, MOST_COUNTED_TURNS)
        if known[name]:
            counts[name] = ClutterCount(*numbers.tolist())
    return counts


def _require_radars(fact: str, names: Collection[Any], known: Collection[str], which: str) -> None:
    for name in names:
        if name not in known:
            raise ValueError(
                f"{fact}: that of {str(name)[:40]} given, must be of a radar whose {which}: "
                f"{', '.join(known) or 'there is none'}"
            )


def _take_count(snapshot: Snapshot, radar: str) -> Any:
    """Return the counts of a learned law."""
    count = snapshot.array(f"{NAME}.{radar}")
    if count.shape != (CELLS,):
        raise ValueError(f"{NAME}.{radar}: shape {count.shape}, expected ({CELLS},)")
    require_numbers(f"{NAME}.{radar}", count, 0.0, MOST_COUNT)
    if count.sum() > MOST_COUNT:
        raise ValueError(f"{NAME}.{radar}: {count.sum():.4g} detections given, at most {MEMORY:g}")
    return count


def _take_map(snapshot: Snapshot, radar: Sensor, facts: Mapping[str, Any]) -> ClutterMap:
    """Return the map of a radar at this place."""
    name = f"{MAP}.{radar.name}"
    pose = [*radar.position, radar.yaw]
    if facts["pose"] != pose:
        raise ValueError(
            f"{name}: of a radar at {str(facts['pose'])[:80]} (x, y in m, yaw in rad), expected "
            f"{pose}"
        )
    size = np.array([facts["size"], facts["turns"], facts["recent_turns"]], dtype=np.float64)
    require_numbers(f"{name}.size", size[:1], 1e-9, 1e12)
    require_numbers(f"{name}.turns", size[1:2], 0.0, MOST_TURNS)
    require_numbers(f"{name}.recent_turns", size[2:], 0.0, MOST_TURNS)
    polar = radar.clutter_map is not None and isinstance(radar.clutter_map.grid, PolarGrid)
    if polar != ("azimuths" in facts):
        raise ValueError(f"{name}: that of a radar that {'moves' if polar else 'stands'} given")
    grid: Grid = GroundGrid(float(size[0]))
    if polar:
        azimuths = whole(f"{name}.azimuths", facts["azimuths"], 3, MOST_AZIMUTHS)
        grid = PolarGrid(float(size[0]), azimuths)
    cell, counts = snapshot.array(f"{name}.cell"), []
    require_whole(f"{name}.cell", cell, 0, MOST_INDEX)
    for part in ("count", "recent"):
        counts.append(count := snapshot.array(f"{name}.{part}"))
        require_numbers(f"{name}.{part}", count, 0.0, MOST_IN_CELL)
        if cell.ndim != 1 or cell.shape != count.shape or len(cell) > MOST_CELLS:
            raise ValueError(
                f"{name}.{part}: {cell.shape} cells and {count.shape} counts, expected as many, at "
                f"most {MOST_CELLS}"
            )
    if (np.diff(cell) <= 0).any():
        raise ValueError(f"{name}.cell: must increase")
    return ClutterMap(grid, cell, counts[0], float(size[1]), counts[1], float(size[2]))


def _grid_facts(grid: Grid) -> dict[str, float]:
    """Return the size of a map's cells in metres and, if they are polar, the cells of a turn."""
    if isinstance(grid, PolarGrid):
        return {"size": grid.range_cell, "azimuths": grid.columns}
    if isinstance(grid, GroundGrid):
        return {"size": grid.cell}
    raise TypeError(f"{type(grid).__name__}: a grid that cannot be stored")
