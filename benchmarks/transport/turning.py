"""A radar that turns: latency by sectors over DDS, and the cost of a revolution in two forms."""

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
# Numbers of measured revolutions: of the cost, and of the latency.
REVOLUTIONS, LIVE_REVOLUTIONS, QUICK_LIVE_REVOLUTIONS = 20, 10, 3


def measure(quick: bool) -> dict[str, Any]:
    """Return the latency of detections, and the cost of a revolution by the form of its reports."""
    revolutions = QUICK_LIVE_REVOLUTIONS if quick else LIVE_REVOLUTIONS
    return {
        "latency": sector_latency.measure(revolutions),
        "cost": cost(2 if quick else REVOLUTIONS),
    }


def cost(revolutions: int, settling: int = traffic.SETTLING) -> dict[str, Any]:
    """Return the CPU time of a revolution by form, after the first `settling`.

    All of them get the same plots and take turns, turn by turn.
    """
    configs = {form: traffic.configuration(changes) for form, changes in FORMS.items()}
    pipelines = {form: new_pipeline(config) for form, config in configs.items()}
    sent = {form: list(_by_revolution(configs[form], settling + revolutions)) for form in FORMS}
    spent: dict[str, list[float]] = {form: [] for form in FORMS}
    targets = dict.fromkeys(FORMS, 0.0)
    for revolution in range(settling + revolutions):
        for form, pipeline in pipelines.items():
            begin = time.process_time()
            targets[form] = _take(pipeline, sent[form][revolution])
            spent[form].append(1e3 * (time.process_time() - begin))
    return {form: {**spread(spent[form][settling:]), "targets": targets[form]} for form in FORMS}


def _by_revolution(config: TrackerConfig, revolutions: int) -> Iterator[Sequence[SimulatedReport]]:
    """Yield the reports of one revolution after the other."""
    scene = traffic.scene(revolutions, config, seed=0)
    reports = iter(simulate_reports(scene, config.radars, seed=0))
    for _ in range(revolutions):
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
