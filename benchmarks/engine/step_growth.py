"""Growth of the whole step's cost with the targets, of each form, and the memory it holds.

The targets are as dense in every scene, see `scenes.configuration`.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.core.types import Scan
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.simulate import simulate

from .. import scenes
from ..timing import exponent, peak_bytes, spread
from .recursion import FORMS, SETTLING, tracking

LADDER, QUICK_LADDER = (200, 500, 1000, 2000, 5000), (10, 20, 40)
STEPS = 6
MEMORY_TARGETS, QUICK_MEMORY_TARGETS = 1000, 20


def measure(quick: bool) -> dict[str, Any]:
    """Return the cost of a step by form and size, and the memory of each form."""
    ladder = QUICK_LADDER if quick else LADDER
    forms = {form: _growth(form, ladder) for form in FORMS}
    targets = QUICK_MEMORY_TARGETS if quick else MEMORY_TARGETS
    memory = {form: memory_of(form, targets) / 1e6 for form in FORMS}
    return {
        "forms": forms,
        "memory": {"targets": targets, "MB": memory},
    }


def _growth(form: str, sizes: Sequence[int]) -> dict[str, Any]:
    times = [spread(step_times_ms(form, size)) for size in sizes]
    medians = [each["median_ms"] for each in times]
    return {"size": list(sizes), "times": times, "exponent": exponent(list(sizes), medians)}


def _scene(form: str, targets: int) -> tuple[TrackerConfig, Scenario, list[Scan]]:
    config = scenes.configuration(targets, FORMS[form])
    scene = scenes.crowd(targets, SETTLING + config.lag.scans + STEPS, config, seed=3)
    return config, scene, [scan for _, scan in simulate(scene, seed=3)]


def step_times_ms(form: str, targets: int) -> list[float]:
    """Return the CPU milliseconds of each measured step."""
    config, scene, scans = _scene(form, targets)
    run = tracking(config, scene)
    times = []
    for scan in scans:
        begin = time.process_time()
        run.step(scan)
        times.append(1e3 * (time.process_time() - begin))
    return times[-STEPS:]


def memory_of(form: str, targets: int) -> int:
    """Return the most bytes that a tracker has held, its start and its window included."""
    config, scene, scans = _scene(form, targets)

    def run() -> None:
        tracker = tracking(config, scene)
        for scan in scans:
            tracker.step(scan)

    return peak_bytes(run)
