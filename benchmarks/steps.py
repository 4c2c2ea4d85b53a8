# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The cost of a step and its parts, with the reference scenario and with 20 and 200 targets."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from phd_jdtc_ros.core.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.core.simulation.scenario import Scenario, paper_scenario
from phd_jdtc_ros.core.simulation.simulate import simulate
from phd_jdtc_ros.core.smc.particle_set import ParticleSet
from phd_jdtc_ros.core.types import Scan

from . import backends, scenes
from .recursion import PARTS, SETTLING, TimedEngine
from .smoothing import PER_TARGET
from .timing import peak_bytes, spread

PAPER = "4 targets"
CROWDS = {"20 targets": 20, "200 targets": 200}
# Number of measured steps.
STEPS = 12


def measure(quick: bool) -> dict[str, Any]:
    """Return the cost of the step and its parts, by scene and backend."""
    config = resolve({})
    scene = paper_scenario(config.model.radars)
    if quick:
        scene = replace(scene, scans=20)
    empty = ParticleSet.empty(len(config.model.modes.space))
    found = {PAPER: _measure(config, scene, empty, config.lag.scans)}
    for name, targets in CROWDS.items():
        if quick and targets > 20:
            continue
        config = scenes.configuration(targets, PER_TARGET)
        settling = SETTLING + config.lag.scans
        crowd = scenes.crowd(targets, settling + STEPS, config, seed=2)
        start = scenes.clouds(crowd, config, np.random.default_rng(2))
        found[name] = _measure(config, crowd, start, settling)
    return found


def _measure(
    config: TrackerConfig, scene: Scenario, start: ParticleSet, settling: int
) -> dict[str, Any]:
    """Return the figures of a scene, without its first `settling` steps."""
    scans = [scan for _, scan in simulate(scene, seed=0)]
    names = backends.available()
    runs = {name: TimedEngine(config, start) for name in names}
    costs: dict[str, list[dict[str, float]]] = {name: [] for name in names}
    for scan in scans[:-1]:
        # The backends alternate scan by scan.
        for name in names:
            costs[name].append(_timed_step(runs[name], scan, name))
    return {
        "particles": _median_of("particles", costs[names[0]][settling:]),
        "unique_particles": _median_of("unique_particles", costs[names[0]][settling:]),
        "detections_a_radar": _mean_detections(scans),
        "backends": {
            name: {
                part: spread([cost[part] for cost in costs[name][settling:]])
                for part in ("step", *PARTS)
            }
            for name in names
        },
        "peak_MB": {name: _peak(runs[name], scans[-1], name) / 1e6 for name in names},
    }


def _timed_step(run: TimedEngine, scan: Scan, backend: str) -> dict[str, float]:
    with backends.using(backend):
        begin = time.process_time()
        run.step(scan)
        whole = 1e3 * (time.process_time() - begin)
    counts = {
        "particles": float(run.stored.multiplicity.sum()),
        "unique_particles": float(len(run.stored)),
    }
    return {"step": whole, **run.parts_ms, **counts}


def _peak(run: TimedEngine, scan: Scan, backend: str) -> int:
    with backends.using(backend):
        return peak_bytes(lambda: run.step(scan))


def _median_of(name: str, steps: Sequence[dict[str, float]]) -> float:
    return float(np.median([step[name] for step in steps]))


def _mean_detections(scans: Sequence[Scan]) -> float:
    return float(np.mean([len(d) for scan in scans for d in scan.detections if d is not None]))
