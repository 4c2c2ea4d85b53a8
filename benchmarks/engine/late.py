"""The cost of out-of-sequence reports: of readiness for them, and of reprocessing."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.pipeline import REPROCESSED, Stepped
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.types import Detections
from phd_jdtc_ros.parameter_files import from_arguments
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

from ..timing import peak_bytes, spread

NOT_READY, READY = "late reports are dropped", "late reports are reprocessed, none is late"
# Number of later scans that are closed before the late report comes.
LATE_BY = {"one is a scan late": 1, "one is three scans late": 3}
# Period of the late reports, in scans.
EVERY = 8
SCANS, QUICK = 80, 24

Report = tuple[int, int, Detections]


def measure(quick: bool) -> dict[str, Any]:
    """Return the cost of a step by delay, and the memory of a run."""
    count = QUICK if quick else SCANS
    known = from_arguments.scenario_parameters(None)
    dropping, working = resolve(known), resolve({**known, "late_reports": "rework"})
    scene = replace(paper_scenario(polar_radars(dropping.model.radars)), scans=count)
    reports = [
        (radar, scan.stamp_ns, found)
        for _, scan in simulate(scene, seed=0)
        for radar, found in enumerate(scan.detections)
        if found is not None
    ]
    cases: dict[str, tuple[TrackerConfig, list[Report]]] = {
        NOT_READY: (dropping, reports),
        READY: (working, reports),
        **{name: (working, delayed(reports, by)) for name, by in LATE_BY.items()},
    }
    list(_steps(working, reports[:QUICK]))  # Fills caches
    memory = {
        name: peak_bytes(partial(list, _steps(config, reports[:QUICK]))) / 1e6
        for name, config in ((NOT_READY, dropping), (READY, working))
    }
    # They take turns, scan by scan.
    rounds = zip(*(_steps(*case) for case in cases.values()), strict=True)
    steps = dict(zip(cases, zip(*rounds, strict=True), strict=True))
    settling = dropping.lag.scans
    return {
        "steps": {name: _median(of_case, settling) for name, of_case in steps.items()},
        "peak_MB": memory,
    }


def delayed(reports: Sequence[Report], by: int) -> list[Report]:
    """Return reports of two radars, some of them delayed by a number of scans."""
    ordered: list[tuple[float, Report]] = []
    for index, report in enumerate(reports):
        late = index % 2 == 1 and index // 2 % EVERY == EVERY // 2
        # Behind both reports of the last of those scans.
        ordered.append((index + 2.0 * by + 0.5 if late else index, report))
    return [report for _, report in sorted(ordered, key=lambda entry: entry[0])]


def _steps(config: TrackerConfig, reports: Sequence[Report]) -> Iterator[tuple[float, bool]]:
    """Yield the CPU milliseconds of each step, and whether it worked a late report in."""
    pipeline, waiting = new_pipeline(config), False
    for radar, stamp_ns, found in reports:
        begin = time.process_time()
        events = pipeline.add(radar, stamp_ns, found)
        if isinstance(events, Rejection):
            raise RuntimeError(f"a report at {stamp_ns} ns was not used: {events.value}")
        stepped = sum(isinstance(event, Stepped) for event in events) > 0  # All of them
        taken = 1e3 * (time.process_time() - begin)
        if stepped:
            yield taken, waiting
            waiting = False
        waiting |= pipeline.take_anomalies(radar)[REPROCESSED] > 0


def _median(steps: Sequence[tuple[float, bool]], settling: int) -> dict[str, float]:
    """Return the times of the steps that worked reports in; of all if none did."""
    worked = [taken for taken, late in steps[settling:] if late]
    return spread(worked or [taken for taken, _ in steps[settling:]])


def ratio(found: Mapping[str, Any], name: str) -> float:
    """Return the step with late reports as a multiple of that where they are dropped."""
    steps = found["steps"]
    value: float = steps[name]["median_ms"] / steps[NOT_READY]["median_ms"]
    return value
