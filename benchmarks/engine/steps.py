"""The cost of a step and its parts: the reference scenario and crowds."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.types import Scan
from phd_jdtc_ros.parameter_files import from_arguments
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

from .. import scenes
from ..timing import peak_bytes, spread
from .recursion import FAST, FORMS, GAUSSIAN, SETTLING, TimedEngine, tracking

PAPER = "4 targets"


class Crowd(NamedTuple):
    """A scene."""

    targets: int
    forms: tuple[str, ...]
    clutter: float | None = None  # See `scenes.configuration`


CROWDS = {
    "20 targets": Crowd(20, (GAUSSIAN,)),
    "200 targets": Crowd(200, (GAUSSIAN, FAST)),
    # The clutter completes a radar's report to 1000 detections.
    "1000 targets": Crowd(1000, (GAUSSIAN, FAST), 11.0),
}
# Number of measured steps.
STEPS = 12


def measure(quick: bool) -> dict[str, Any]:
    """Return the cost of the step and its parts, by scene and form."""
    found = {PAPER: _reference(20 if quick else None)}
    for name, crowd in CROWDS.items():
        if not quick or crowd.targets <= 20:
            found[name] = _crowd(crowd)
    return found


def _reference(count: int | None) -> dict[str, Any]:
    """Return the figures of the reference scenario, or of its first `count` scans."""
    config = resolve(from_arguments.scenario_parameters(None))
    scene = paper_scenario(polar_radars(config.model.radars))
    scans = [scan for _, scan in simulate(replace(scene, scans=count or scene.scans), seed=0)]
    return _measure({GAUSSIAN: TimedEngine(config)}, scans, config.lag.scans)


def _crowd(crowd: Crowd) -> dict[str, Any]:
    configs = {
        form: scenes.configuration(crowd.targets, FORMS[form], crowd.clutter)
        for form in crowd.forms
    }
    config = configs[crowd.forms[0]]
    settling = SETTLING + config.lag.scans
    scene = scenes.crowd(crowd.targets, settling + STEPS, config, seed=2)
    scans = [scan for _, scan in simulate(scene, seed=0)]
    runs = {form: tracking(configs[form], scene) for form in crowd.forms}
    return _measure(runs, scans, settling)


def _measure(
    runs: Mapping[str, TimedEngine], scans: Sequence[Scan], settling: int
) -> dict[str, Any]:
    """Return the figures of a scene, without its first `settling` steps."""
    costs: dict[str, list[dict[str, float]]] = {form: [] for form in runs}
    for scan in scans[:-1]:
        # The forms alternate scan by scan.
        for form, run in runs.items():
            costs[form].append(_timed_step(run, scan))
    sizes = [len(found) for scan in scans for found in scan.detections if found is not None]
    found: dict[str, Any] = {"detections_a_radar": float(np.mean(sizes)), "forms": {}}
    for form, run in runs.items():
        measured = costs[form][settling:]
        found["forms"][form] = {
            "counts": _counts(measured),
            "times": {
                part: spread([cost[part] for cost in measured]) for part in ("step", *run.parts_ms)
            },
            "peak_MB": peak_bytes(partial(run.step, scans[-1])) / 1e6,
        }
    return found


def _timed_step(run: TimedEngine, scan: Scan) -> dict[str, float]:
    begin = time.process_time()
    step = run.step(scan)
    whole = 1e3 * (time.process_time() - begin)
    counts = {
        "expected targets": float(step.class_mass.sum()),
        "hypotheses": float(run.hypotheses),
        "approximate clusters": float(step.figures["approximate_clusters"]),
    }
    return {"step": whole, **run.parts_ms, **counts}


def _counts(steps: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return the medians of the counts."""
    names = ("expected targets", "hypotheses", "approximate clusters")
    return {name: float(np.median([step[name] for step in steps])) for name in names}
