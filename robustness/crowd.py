# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""One scan of very many detections, with births from detections: its cost, and what comes after.

The run is a process of its own (``python -m robustness.crowd DETECTIONS``), so that its memory is
that of the tracker alone.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from msg_adapters.detections import OWN_LAYOUT, from_msg, to_msg
from phd_jdtc_ros.core.engines import new_engine
from phd_jdtc_ros.core.evaluation.metrics import ospa
from phd_jdtc_ros.core.models.radar import RadarModel
from phd_jdtc_ros.core.types import Detections, Scan
from phd_jdtc_ros.tools import params_file, tracker_params

from . import scans
from .figures import Figure, in_own_process, measured_or_why

NAME = "a scan of very many detections"
GOAL = "100,000: at most 5 s and 1 GB; OSPA of the scans from the second after it within 10 %"
DETECTIONS = 100_000
PROFILE = Path(__file__).parents[1] / "config" / "surveillance.yaml"
CROWDED, LAST = 30, 45
CUTOFF, ORDER = 1000.0, 2.0


def measure(detections: int = DETECTIONS) -> Figure:
    """Track the reference scenario with a crowded scan of both radars in its middle."""
    return measured_or_why(NAME, GOAL, lambda: _measure(detections))


def _measure(detections: int) -> tuple[str, bool, Mapping[str, Any]]:
    found = in_own_process("robustness.crowd", str(detections))
    ratio = found["ospa_after"] / found["ospa_without"]
    text = (
        f"{detections:,} of both radars: {found['step_s']:.1f} s, {found['peak_mb']:.0f} MB; OSPA "
        f"after it {found['ospa_after']:.0f} m, without it {found['ospa_without']:.0f} m"
    )
    good = found["step_s"] <= 5.0 and found["peak_mb"] <= 1000.0 and ratio <= 1.1
    return text, good, found


def crowd(radar: RadarModel, count: int, rng: np.random.Generator) -> Detections:
    """Return noise above the threshold, anywhere in a radar's field."""
    measurement = np.stack(
        [rng.uniform(0.0, radar.max_range, count), rng.uniform(-np.pi, np.pi, count)], axis=1
    )
    amplitude = np.sqrt(radar.threshold**2 + 2.0 * rng.standard_exponential(count))
    return Detections(measurement, amplitude)


def _run(detections: int) -> dict[str, float]:
    """Return the cost of the crowded scan, and the mean OSPA of the scans after it."""
    config = tracker_params.config(params_file.load(PROFILE))
    engine, rng = new_engine(config), np.random.default_rng(0)
    step_s, scores = 0.0, []
    for index, (scan, truth) in enumerate(zip(scans.reference(), scans.truth(), strict=True)):
        reports = list(scan.detections)
        if index == CROWDED and detections:
            for place, radar in enumerate(config.model.radars):
                given, more = reports[place], crowd(radar, detections, rng)
                joined = Detections(
                    np.concatenate([given.measurement, more.measurement])[:detections],
                    np.concatenate([given.amplitude, more.amplitude])[:detections],
                )
                message = to_msg(joined, scan.stamp_ns, "")
                reports[place] = from_msg(message, OWN_LAYOUT).detections
        begin = time.perf_counter()
        (found,) = engine.step(Scan(scan.stamp_ns, tuple(reports))).filtered
        if index == CROWDED:
            step_s = time.perf_counter() - begin
        if index >= CROWDED + 2:
            scores.append(ospa(truth.position, found.position, CUTOFF, ORDER).distance)
        if index == LAST:
            break
    return {"step_s": step_s, "ospa": float(np.mean(scores))}


def main(argv: Sequence[str]) -> int:
    """Print the figures of a run with the crowded scan and of one without it, as JSON."""
    crowded = _run(int(argv[0]))
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    without = _run(0)
    figures = {
        "step_s": crowded["step_s"],
        "peak_mb": peak_mb,
        "ospa_after": crowded["ospa"],
        "ospa_without": without["ospa"],
    }
    print(json.dumps(figures))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
