# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The input and output of a study's trackers: simulated runs, and estimates by lag."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from phd_jdtc_ros.core.arrays import IntArray
from phd_jdtc_ros.core.evaluation.scan_scores import PointSet
from phd_jdtc_ros.core.simulation.scenario import Scenario
from phd_jdtc_ros.core.simulation.simulate import simulate_with_sources
from phd_jdtc_ros.core.types import Scan, Truth


@dataclass(frozen=True)
class SimulatedRun:
    """One seeded run of a scenario.

    Parameters
    ----------
    scenario : Scenario
    seed : int
    truth : tuple of Truth, one per scan
    scans : tuple of Scan
    sources : tuple of tuples of int arrays
        Per scan and radar, the track_id of the target of every detection, 0 for clutter. Only
        references with known association may use it.
    """

    scenario: Scenario
    seed: int
    truth: tuple[Truth, ...]
    scans: tuple[Scan, ...]
    sources: tuple[tuple[IntArray, ...], ...]


def simulated_run(scenario: Scenario, seed: int) -> SimulatedRun:
    """Return a simulated run, which depends on scenario and seed only."""
    truth, scans, sources = zip(*simulate_with_sources(scenario, seed), strict=True)
    return SimulatedRun(scenario, seed, truth, scans, sources)


# Estimates of every scan, by lag in scans; 0 is the filter.
Tracks: TypeAlias = Mapping[int, list[PointSet]]
