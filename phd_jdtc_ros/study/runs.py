# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What the trackers of a study are given, and what they give back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from phd_jdtc_ros.core.evaluation import PointSet
from phd_jdtc_ros.core.simulation import Scenario, Truth, simulate_with_sources
from phd_jdtc_ros.core.types import IntArray, Scan


@dataclass(frozen=True)
class SimulatedRun:
    """One seeded run of a scenario.

    Parameters
    ----------
    scenario : Scenario
    seed : int
    truth : tuple of Truth, one a scan
    scans : tuple of Scan
    sources : tuple of tuples of int arrays
        Per scan and radar the track_id of every detection, 0 for clutter. Only references that
        are told the association may look at it.
    """

    scenario: Scenario
    seed: int
    truth: tuple[Truth, ...]
    scans: tuple[Scan, ...]
    sources: tuple[tuple[IntArray, ...], ...]


def simulated_run(scenario: Scenario, seed: int) -> SimulatedRun:
    """Return a run; the same for the same seed."""
    truth, scans, sources = zip(*simulate_with_sources(scenario, seed), strict=True)
    return SimulatedRun(scenario, seed, truth, scans, sources)


# Estimates of every scan, by lag in scans: 0 is the filter.
Tracks: TypeAlias = Mapping[int, list[PointSet]]
