"""Input and output of a study's trackers: simulated runs and estimates by lag."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from phd_jdtc_ros.core.arrays import IntArray
from phd_jdtc_ros.core.types import Scan, Truth
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.simulate import simulate_with_sources


class IgnoredTargets(NamedTuple):
    """Criteria of the targets of turning radars that are not scored, with their estimates."""

    below: float = 40.0  # Targets slower than this are not scored, metres per second
    near: float = 1000.0  # Gate of the assignment of estimates to these targets, metres


# The default leaves out taxiing aircraft.
TAXIING = IgnoredTargets()


@dataclass(frozen=True)
class SimulatedRun:
    """One seeded run of a scenario."""

    scenario: Scenario
    seed: int
    truth: tuple[Truth, ...]  # Truth at every scan, or at every revolution if antennas turn
    scans: tuple[Scan, ...]  # Empty if antennas turn
    # The track_id of every detection's target by scan and radar, 0 for clutter. Only references
    # with known association may use it.
    sources: tuple[tuple[IntArray, ...], ...]
    ignored: IgnoredTargets = TAXIING  # Unscored targets if antennas turn


def simulated_run(scenario: Scenario, seed: int) -> SimulatedRun:
    """Return the simulated run of a scenario and a seed."""
    truth, scans, sources = zip(*simulate_with_sources(scenario, seed), strict=True)
    return SimulatedRun(scenario, seed, truth, scans, sources)


# Estimates of every scan or revolution, by lag in scans or revolutions; 0 is the filter.
Tracks: TypeAlias = Mapping[int, list[PointSet]]


class TrackingResult(NamedTuple):
    """A tracker's estimates of a run, with its CPU time."""

    tracks: Tracks
    cpu_ms: float = math.nan  # CPU time per revolution, milliseconds; NaN if not measured
