"""Stone Soup's trackers on the reference scenario's scans, compared with the tracker's step.

They are the study's: tuned, gated, and with known birth places. They only filter, while the
tracker's step also classifies and smooths.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.parameter_files import from_arguments
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.study.tracker import SimulatedRun, simulated_run
from studies import peers

from .recursion import GAUSSIAN


def measure(quick: bool) -> dict[str, Any]:
    """Return the mean CPU milliseconds per scan of each tracker, by run."""
    config = resolve(from_arguments.scenario_parameters(None))
    scene = paper_scenario(polar_radars(config.model.radars))
    if quick:
        scene = replace(scene, scans=15)
    trackers: dict[str, Callable[[SimulatedRun], object]] = {
        GAUSSIAN: partial(_own, config),
        "GM-PHD": partial(peers.gm_phd, model=config.model),
        "GNN": partial(peers.gnn, model=config.model),
        "JPDA": partial(peers.jpda, model=config.model),
    }
    cost: dict[str, list[float]] = {name: [] for name in trackers}
    for seed in range(1 if quick else 3):
        run = simulated_run(scene, seed)
        for name, track in trackers.items():
            begin = time.process_time()
            track(run)
            cost[name].append(1e3 * (time.process_time() - begin) / len(run.scans))
    return {
        name: {"median_ms": float(np.median(each)), "runs_ms": each} for name, each in cost.items()
    }


def _own(config: TrackerConfig, run: SimulatedRun) -> None:
    engine = new_engine(config)
    for scan in run.scans:
        engine.step(scan)
