"""Times in which targets are hidden from all radars; the block ``gaps`` of a scenario.

Causes are hills, the cone of silence, or a transponder that is switched off. The target continues
its flight and keeps its identity.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.configuration.schema import SMALL, ConfigError, parameter
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray

from ..checked import mapping, read
from .flight import Flight

# Least time in sight before and after a gap, seconds.
APART_S = 60.0


@dataclass(frozen=True)
class Gaps:
    """The block ``gaps``."""

    count: int = parameter(0, "Number of gaps in the run.", (0, 10**5))
    shortest_s: float = parameter(10.0, "Shortest duration of a gap, s.", (SMALL, 1e6))
    longest_s: float = parameter(120.0, "Longest duration of a gap, s.", (SMALL, 1e6))
    slowest: float = parameter(20.0, "Least initial speed of a target with a gap, m/s.", (0.0, 1e4))
    seed: int = parameter(0, "Seed of the choice of targets and times.", (0, 2**31 - 1))

    def __post_init__(self) -> None:
        if self.longest_s < self.shortest_s:
            raise ConfigError(
                f"longest_s: {self.longest_s:g} given, must be at least shortest_s, "
                f"{self.shortest_s:g}"
            )


class Gap(NamedTuple):
    """A time in which a target is out of sight."""

    number: int  # Number of the target, from 1
    start_s: float  # Seconds after scan 0
    end_s: float  # Seconds after scan 0


def in_gap(gaps: Sequence[Gap], number: int, time_s: FloatArray) -> BoolArray:
    """Return whether a target, by number from 1, is in a gap; same shape."""
    out = np.zeros(np.shape(time_s), dtype=np.bool_)
    for gap in gaps:
        if gap.number == number:
            out |= (time_s >= gap.start_s) & (time_s < gap.end_s)
    return out


def of_targets(
    document: Mapping[str, object], flights: Sequence[Flight], faults: list[str]
) -> tuple[Gap, ...]:
    """Return the gaps of a document's ``gaps`` block, if any, in the flights of all its targets."""
    if "gaps" not in document:
        return ()
    found = read(Gaps, mapping(document, "gaps", faults), "gaps.", faults)
    return _draw(found, flights) if found else ()


def _draw(drawn: Gaps, flights: Sequence[Flight]) -> tuple[Gap, ...]:
    """Return gaps of random targets, drawn in proportion to the time that a gap can begin in."""
    rng = np.random.default_rng(drawn.seed)
    speed = np.array([np.hypot(*flight.velocity) for flight in flights])
    life_s = np.array([flight.end_s - flight.start_s for flight in flights])
    free = speed >= drawn.slowest
    gaps: list[Gap] = []
    for _ in range(drawn.count):
        length_s = float(rng.uniform(drawn.shortest_s, drawn.longest_s))
        # Time in which a gap can begin; a target has at most one gap.
        spare = np.where(free, np.maximum(life_s - length_s - 2.0 * APART_S, 0.0), 0.0)
        if not spare.any():
            break
        row = int(rng.choice(len(flights), p=spare / spare.sum()))
        start_s = flights[row].start_s + APART_S + float(rng.uniform(0.0, spare[row]))
        gaps.append(Gap(row + 1, start_s, start_s + length_s))
        free[row] = False
    return tuple(gaps)
