# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Storage of what a filter has learned of clutter in a snapshot, and its restoration.

`snapshot` says why every value is checked.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .models.clutter_amplitude import CELLS, MEMORY, Learned
from .models.clutter_memory import ClutterMemory
from .models.radar import RadarModel
from .snapshot import Snapshot, require_numbers

NAME = "clutter"
# Rounding may leave a little more than all of the memory.
MOST_COUNT = 1.001 * MEMORY


def put_clutter(snapshot: Snapshot, memory: ClutterMemory) -> None:
    """Store what has been learned; nothing if no radar learns."""
    if memory.laws:
        snapshot.facts[NAME] = sorted(memory.laws)
    for radar, law in memory.laws.items():
        snapshot.arrays[f"{NAME}.{radar}"] = law.count


def take_clutter(snapshot: Snapshot, radars: Sequence[RadarModel]) -> ClutterMemory:
    """Return what a snapshot has of the clutter of these radars.

    Raises
    ------
    ValueError
        If it is that of another radar, or none that a tracker could have stored.
    """
    names: Any = snapshot.facts.get(NAME, [])
    if not isinstance(names, list):
        raise ValueError(f"{NAME}: {str(names)[:40]} given, must be a list of radars")
    learning = {
        radar.name: radar.threshold
        for radar in radars
        if isinstance(radar.clutter_amplitude, Learned)
    }
    for name in names:
        if name not in learning:
            raise ValueError(
                f"{NAME}: amplitudes of {str(name)[:40]} given, must be of a radar whose "
                f"clutter_amplitude is learned: {', '.join(learning) or 'there is none'}"
            )
    count = {name: snapshot.array(f"{NAME}.{name}") for name in names}
    for name, cells in count.items():
        if cells.shape != (CELLS,):
            raise ValueError(f"{NAME}.{name}: shape {cells.shape}, expected ({CELLS},)")
        require_numbers(f"{NAME}.{name}", cells, 0.0, MOST_COUNT)
        if cells.sum() > MOST_COUNT:
            raise ValueError(
                f"{NAME}.{name}: {cells.sum():.4g} detections given, at most {MEMORY:g}"
            )
    return ClutterMemory({name: Learned(learning[name], cells) for name, cells in count.items()})
