"""A radar that turns: latency by sectors over DDS, and the cost of a turn in two forms."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.pipeline import Pipeline, RunEnded
from phd_jdtc_ros.simulation.turning_antenna import SimulatedReport, simulate_reports

from .. import traffic
from ..timing import spread
from . import sector_latency

ONE_CLOUD = "one cloud"
BY_SECTORS = f"{traffic.SECTORS} sectors"
AT_EVERY_SECTOR = f"{traffic.SECTORS} sectors, estimates at each"
FORMS: Mapping[str, Mapping[str, Any]] = {
    ONE_CLOUD: {},
    BY_SECTORS: traffic.BY_SECTORS,
    AT_EVERY_SECTOR: traffic.AT_EVERY_SECTOR,
}
# Numbers of measured turns: of the cost, and of the latency.
TURNS, LIVE_TURNS, QUICK_LIVE_TURNS = 20, 10, 3


def measure(quick: bool) -> dict[str, Any]:
    """Return the latency of detections, and the cost of a turn by the form of its reports."""
    turns = QUICK_LIVE_TURNS if quick else LIVE_TURNS
    return {"latency": sector_latency.measure(turns), "cost": cost(2 if quick else TURNS)}


def cost(turns: int, settling: int = traffic.SETTLING) -> dict[str, Any]:
    """Return the CPU time of a turn by form, after the first `settling`.

    All of them get the same plots and take turns, turn by turn.
    """
    configs = {form: traffic.configuration(changes) for form, changes in FORMS.items()}
    pipelines = {form: new_pipeline(config) for form, config in configs.items()}
    sent = {form: list(_by_turn(configs[form], settling + turns)) for form in FORMS}
    spent: dict[str, list[float]] = {form: [] for form in FORMS}
    targets = dict.fromkeys(FORMS, 0.0)
    for turn in range(settling + turns):
        for form, pipeline in pipelines.items():
            begin = time.process_time()
            targets[form] = _take(pipeline, sent[form][turn])
            spent[form].append(1e3 * (time.process_time() - begin))
    return {form: {**spread(spent[form][settling:]), "targets": targets[form]} for form in FORMS}


def _by_turn(config: TrackerConfig, turns: int) -> Iterator[Sequence[SimulatedReport]]:
    """Yield the reports of one turn after the other."""
    scene = traffic.scene(turns, config, seed=0)
    reports = iter(simulate_reports(scene, config.radars, seed=0))
    for _ in range(turns):
        yield list(itertools.islice(reports, max(config.radars[0].sectors, 1)))


def _take(pipeline: Pipeline, reports: Sequence[SimulatedReport]) -> float:
    """Take in reports; return the expected number of targets after the last."""
    mass = 0.0
    for report in reports:
        events = pipeline.add(report.radar, report.stamp_ns, report.detections)
        if isinstance(events, Rejection):
            raise RuntimeError(f"a report at {report.stamp_ns} ns was rejected: {events.value}")
        for event in events:
            if isinstance(event, RunEnded):
                raise RuntimeError(f"a report at {report.stamp_ns} ns ended the run")
            mass = float(event.step.class_mass.sum())
    return mass
