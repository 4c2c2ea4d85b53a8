"""End to end over DDS: the reference scenario, with the tracker node in a separate process."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.types import Scan
from phd_jdtc_ros.parameter_files import from_arguments
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate
from robustness.harness.rig import Node

from ..timing import percentiles
from . import messages
from .radars import Radars

START_S = 30.0
# A scan without an estimate after this time is lost.
REPLY_S = 5.0
# Pause between a reply and the next scan, in which both processes come to rest.
PAUSE_S = 0.01
RATE_STEP = 1.15
# Longest duration of the search for the rate.
SEARCH_S = 80.0


def measure(quick: bool) -> dict[str, Any]:
    """Return latencies and the highest rate, in milliseconds and hertz.

    ``estimate`` is the time from the publication of a scan's last detections to the receipt of its
    filtered estimates. ``beyond_step`` is the time to the receipt of the scan's last message, minus
    the step's CPU time as reported by the tracker, from decoding to publishing. The rest is spent
    on transport, waiting and the operating system.
    """
    messages.environment()
    scans = _scans(20 if quick else 60)
    with tempfile.TemporaryDirectory() as directory, contextlib.ExitStack() as stack:
        log = Path(directory) / "tracker.log"
        stack.enter_context(node("tracker", log))
        radars = stack.enter_context(
            contextlib.closing(Radars(resolve(from_arguments.scenario_parameters(None)).radars))
        )
        if not radars.connected(START_S):
            return {"value": None, "reason": f"no tracker was found: {log.read_text()[-500:]}"}
        latency = _latency(radars, scans, repeats=1 if quick else 6)
        if latency is None:
            return {"value": None, "reason": "a scan was not answered"}
        step_s = 1e-3 * latency["step_ms"]["p50"]
        rate = {"value": None, "reason": "left out of the quick run"}
        if not quick:
            rate = _highest_rate(radars, scans, 0.4 / step_s)
        return {**latency, "highest_rate_hz": rate}


def _scans(count: int) -> list[Scan]:
    scene = replace(
        paper_scenario(
            polar_radars(resolve(from_arguments.scenario_parameters(None)).model.radars)
        ),
        scans=count,
    )
    return [scan for _, scan in simulate(scene, seed=0)]


@contextlib.contextmanager
def node(name: str, log: Path, *arguments: str) -> Iterator[None]:
    """Run one of the package's nodes with these arguments within the context."""
    command = [sys.executable, "-m", "phd_jdtc_ros", name, *arguments]
    process = Node(command, log, int(os.environ["ROS_DOMAIN_ID"]), {})
    try:
        yield
    finally:
        process.stop(signal.SIGINT)


def _latency(radars: Radars, scans: list[Scan], repeats: int) -> dict[str, Any] | None:
    """Send scans one after the other, each when the previous one has been answered."""
    estimate, beyond, steps = [], [], []
    for _ in range(repeats):
        radars.reset()
        for scan in scans:
            sent = radars.send(scan)
            reply = radars.wait_for(scan.stamp_ns, REPLY_S)
            if reply is None:
                return None
            estimate.append(1e3 * (reply.estimate_s - sent))
            beyond.append(1e3 * (reply.last_s - sent) - reply.step_ms)
            steps.append(reply.step_ms)
            radars.spin(PAUSE_S)
    return {
        "scans": len(steps),
        "estimate_ms": percentiles(estimate),
        "beyond_step_ms": percentiles(beyond),
        "step_ms": percentiles(steps),
    }


def _highest_rate(radars: Radars, scans: list[Scan], rate_hz: float) -> dict[str, Any]:
    """Raise the rate in steps while it is sustained, or lower it until it is.

    A rate that is not sustained is tried again, because the machine may have been busy.
    """
    tried: list[dict[str, Any]] = []
    deadline = time.monotonic() + SEARCH_S
    highest, too_high = 0.0, math.inf
    while time.monotonic() < deadline:
        if _sustained(radars, scans, rate_hz, tried) or _sustained(radars, scans, rate_hz, tried):
            highest, rate_hz = rate_hz, RATE_STEP * rate_hz
        else:
            too_high, rate_hz = rate_hz, rate_hz / RATE_STEP
        # Rates are powers of the step, up to rounding.
        if highest and too_high < 1.01 * RATE_STEP * highest:
            return {"value": highest, "tried": tried}
    reason = f"time was up; {highest:.1f} Hz were sustained" if highest else "none was sustained"
    return {"value": None, "reason": reason, "tried": tried}


def _sustained(
    radars: Radars, scans: list[Scan], rate_hz: float, tried: list[dict[str, Any]]
) -> bool:
    """Return whether no scan was lost and the tracker did not fall behind; add the try to `tried`.

    The tracker falls behind if the last scan's estimate is delayed by more than two periods more
    than an early one's.
    """
    lost, behind = _at_rate(radars, scans, rate_hz)
    tried.append({"rate_hz": rate_hz, "lost": lost, "behind_periods": behind})
    return not lost and behind <= 2.0


def _at_rate(radars: Radars, scans: list[Scan], rate_hz: float) -> tuple[int, float]:
    """Send scans at a rate; return the number lost, and the last one's delay in periods."""
    radars.reset()
    begin, sent = time.monotonic(), []
    for index, scan in enumerate(scans):
        radars.spin(begin + index / rate_hz - time.monotonic())
        sent.append(radars.send(scan))
    radars.wait_for(scans[-1].stamp_ns, REPLY_S)
    replies = [radars.replies.get(scan.stamp_ns) for scan in scans]
    late = [r.estimate_s - s for r, s in zip(replies, sent, strict=True) if r and r.whole]
    lost = len(scans) - len(late)
    # The first scans after a reset have fewer targets, so the tenth's delay is taken as usual.
    return lost, (late[-1] - late[min(10, len(late) - 1)]) * rate_hz if late else 0.0
