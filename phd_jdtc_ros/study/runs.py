"""The input and output of a study's trackers: simulated runs, and estimates by lag."""

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


class Ignored(NamedTuple):
    """Which targets of a radar that turns are not scored, nor the estimates of them.

    Parameters
    ----------
    below : float
        Those slower than this, metres per second.
    near : float
        An estimate nearer than this to such a target is its, metres.
    """

    below: float = 40.0
    near: float = 1000.0


# Aircraft that taxi.
TAXIING = Ignored()


@dataclass(frozen=True)
class SimulatedRun:
    """One seeded run of a scenario.

    Parameters
    ----------
    scenario : Scenario
    seed : int
    truth : tuple of Truth
        At every scan, or where antennas turn at every turn.
    scans : tuple of Scan
        Empty where antennas turn.
    sources : tuple of tuples of int arrays
        Per scan and radar, the track_id of the target of every detection, 0 for clutter. Only
        references with known association may use it.
    ignored : Ignored
        Where antennas turn.
    """

    scenario: Scenario
    seed: int
    truth: tuple[Truth, ...]
    scans: tuple[Scan, ...]
    sources: tuple[tuple[IntArray, ...], ...]
    ignored: Ignored = TAXIING


def simulated_run(scenario: Scenario, seed: int) -> SimulatedRun:
    """Return a simulated run, which depends on scenario and seed only."""
    truth, scans, sources = zip(*simulate_with_sources(scenario, seed), strict=True)
    return SimulatedRun(scenario, seed, truth, scans, sources)


# Estimates of every scan or turn, by lag in scans or turns; 0 is the filter.
Tracks: TypeAlias = Mapping[int, list[PointSet]]


class Tracked(NamedTuple):
    """What a tracker makes of a run.

    Parameters
    ----------
    tracks : Tracks
    cpu_ms : float
        CPU time per turn, milliseconds; NaN if it was not measured.
    """

    tracks: Tracks
    cpu_ms: float = math.nan
