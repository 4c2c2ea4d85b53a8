"""The rate of the replay's ``/clock``, by the wall clock at its receiver."""

from __future__ import annotations

import itertools
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.utilities import try_shutdown
from rosgraph_msgs.msg import Clock

from . import live, messages

# The part of the reference scenario's bag that is played, seconds, and at which speed.
DURATION_S, SPEED = 600.0, 60.0
# Nobody subscribes to the detections.
NO_WAIT = "subscriber_timeout_s:=0.0"


def measure(quick: bool) -> dict[str, Any]:
    """Return the rate: the median of the intervals between ticks, as a frequency, Hz."""
    messages.environment()
    seconds = DURATION_S / 5.0 if quick else DURATION_S
    ticks_s: list[float] = []
    rclpy.init()
    try:
        node = rclpy.create_node("clock_receiver")
        qos = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
        node.create_subscription(Clock, "/clock", lambda _: ticks_s.append(time.monotonic()), qos)
        with tempfile.TemporaryDirectory() as directory:
            log = Path(directory) / "replay.log"
            flags = ("paper_scenario", "--rate", f"{SPEED}", "--duration", f"{seconds}")
            with live.node("sensor_replay", log, *flags, "--ros-args", "-p", NO_WAIT):
                end_s = time.monotonic() + live.START_S
                while time.monotonic() < end_s:
                    rclpy.spin_once(node, timeout_sec=0.1)
                    if len(ticks_s) == 1:
                        end_s = time.monotonic() + seconds / SPEED
            if len(ticks_s) < 2:
                return {"value": None, "reason": f"no clock: {log.read_text()[-500:]}"}
    finally:
        try_shutdown()
    pauses_s = [after - before for before, after in itertools.pairwise(ticks_s)]
    return {"ticks": len(ticks_s), "rate_hz": 1.0 / median(pauses_s)}
