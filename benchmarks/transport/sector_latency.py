"""Latency of a turning radar's detections over DDS, in real time, with a cloud for every sector.

The tracker node runs in a process of its own. The first revolutions are sent as fast as the tracker
answers, until it tracks all aircraft. After them a cloud is published when the antenna has passed
its sector.
"""

from __future__ import annotations

import contextlib
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from phd_jdtc_ros import resources
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import Scan
from phd_jdtc_ros.simulation.turning_antenna import SimulatedReport, simulate_reports

from .. import traffic
from ..timing import percentiles
from . import live, messages
from .radars import Radars, Reply

# Time from the last cloud in haste to the first in real time.
PAUSE_S = 0.5


def measure(revolutions: int) -> dict[str, Any]:
    """Return the latency of detections in seconds, and the step's CPU time in milliseconds.

    The latency is from the time at which the antenna passed the detection to the receipt of the
    filtered estimates of its sector.
    """
    messages.environment()
    config = traffic.configuration(traffic.AT_EVERY_SECTOR)
    new_engine(config)  # Compiles what no earlier run has stored, which takes longer than a start
    scene = traffic.scene(traffic.SETTLING + revolutions, config, seed=0)
    reports = simulate_reports(scene, config.radars, seed=0)
    settling = traffic.SETTLING * traffic.SECTORS
    sector_ns = round(1e9 * config.radars[0].rotation_s / traffic.SECTORS)
    with tempfile.TemporaryDirectory() as directory, contextlib.ExitStack() as stack:
        log = Path(directory) / "tracker.log"
        stack.enter_context(live.node("tracker", log, *_arguments()))
        radars = stack.enter_context(contextlib.closing(Radars(config.radars)))
        if not radars.connected(live.START_S):
            return {"value": None, "reason": f"no tracker was found: {log.read_text()[-500:]}"}
        if not _settle(radars, reports[:settling], sector_ns):
            return {"value": None, "reason": "a sector of the first revolutions was not answered"}
        return _in_real_time(radars, reports[settling:], sector_ns)


def _arguments() -> list[str]:
    """Return the tracker's arguments for the profile by sectors."""
    changes = [("-p", f"{name}:={value}") for name, value in traffic.AT_EVERY_SECTOR.items()]
    file = str(resources.find(traffic.PROFILE))
    return ["--ros-args", "--params-file", file, *(word for pair in changes for word in pair)]


def _settle(radars: Radars, reports: Sequence[SimulatedReport], sector_ns: int) -> bool:
    """Send sectors, each when the one before has been answered; return whether all have been."""
    for report in reports:
        radars.send(_scan(report))
        if radars.wait_for(report.stamp_ns, live.REPLY_S, sector_ns) is None:
            return False
    return True


def _in_real_time(
    radars: Radars, reports: Sequence[SimulatedReport], sector_ns: int
) -> dict[str, Any]:
    """Send every sector when it has been passed, and return the figures."""
    zero_s = time.monotonic() + PAUSE_S - 1e-9 * (reports[0].stamp_ns - sector_ns)
    for report in reports:
        radars.spin(zero_s + 1e-9 * report.stamp_ns - time.monotonic())
        radars.send(_scan(report))
    radars.wait_for(reports[-1].stamp_ns, live.REPLY_S, sector_ns)
    replies = [radars.reply_to(report.stamp_ns, sector_ns) for report in reports]
    answered = [reply for reply in replies if reply is not None]
    if len(answered) < len(reports):
        lost = len(reports) - len(answered)
        return {"value": None, "reason": f"{lost} of {len(reports)} sectors were not answered"}
    late_s = latencies(reports, answered, zero_s)
    return {
        "sectors": len(reports),
        "detections": len(late_s),
        "targets": float(np.median([reply.targets for reply in answered])),
        "latency_s": percentiles(late_s),
        "step_ms": percentiles([reply.step_ms for reply in answered]),
    }


def latencies(
    reports: Sequence[SimulatedReport], replies: Sequence[Reply], zero_s: float
) -> FloatArray:
    """Return the latency of every detection, seconds, shape (M,).

    There is a reply to each report; `zero_s` is the monotonic time of the stamp 0.
    """
    late = []
    for report, reply in zip(reports, replies, strict=True):
        own_s = report.detections.time_s
        if own_s is not None:
            late.append(reply.estimate_s - (zero_s + 1e-9 * report.stamp_ns + own_s))
    return np.concatenate([np.zeros(0), *late])


def _scan(report: SimulatedReport) -> Scan:
    return Scan(report.stamp_ns, (report.detections,))
