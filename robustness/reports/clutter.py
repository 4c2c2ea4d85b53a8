"""A burst of false detections with births at detections: its cost and its effect on accuracy."""

from __future__ import annotations

import time

import numpy as np

from ..harness import scans
from ..harness.figures import Found, measures
from ..harness.rig import Rig

FALSE_DETECTIONS = 1000  # Per radar and scan, where 20 are expected
MOST_RATIO = 1.1
# The burst is in the middle of the targets' lives.
FIRST, SCANS = 24, 8
SETTLING, COUNTED = 3, 10
BORN_ANYWHERE = ("-p", "detection_births.rates:=[0.01, 0.01]")
PATIENCE_S = 60.0


@measures(
    "burst of false detections",
    "every scan answered within its interval; OSPA within 10 % of a quiet run's after 3 scans",
)
def measure(false_detections: int = FALSE_DETECTIONS, count: int = SCANS) -> Found:
    """Track through a burst, and the same scans without one."""
    quiet, _, _ = _run(0, count)
    after, slowest, growth = _run(false_detections, count)
    ratio, interval_s = after / quiet, scans.interval_ns() * 1e-9
    text = (
        f"{false_detections} per radar in {count} scans: at most {slowest:.2f} s of "
        f"{interval_s:g} s per scan, memory +{growth / 1024:.0f} MiB; afterwards {ratio:.3f} times "
        f"the quiet run's {quiet:.1f} m"
    )
    details = {"slowest_s": slowest, "memory_kib": growth, "quiet_m": quiet, "after_m": after}
    return text, ratio <= MOST_RATIO and slowest <= interval_s, details


def _run(false_detections: int, count: int) -> tuple[float, float, int]:
    """Return the mean OSPA afterwards (m), the longest delay (s) and the memory growth (KiB)."""
    burst = range(FIRST, FIRST + count if false_detections else FIRST)
    counted = range(FIRST + count + SETTLING, FIRST + count + SETTLING + COUNTED)
    with Rig() as rig:
        tracker, radars = rig.tracking(*BORN_ANYWHERE)
        slowest = 0.0
        for index in range(counted.stop):
            if index == FIRST:
                before = tracker.status("VmHWM")
            sent = time.monotonic()
            if index in burst:
                for output, cloud in zip(
                    radars.outputs, scans.with_clutter(false_detections)[index], strict=True
                ):
                    output.publish(cloud)
            else:
                radars.send(index)
            if not radars.wait_for({scans.stamp_of_scan(index)}, PATIENCE_S):
                raise RuntimeError(f"scan {index} was not answered in {PATIENCE_S:g} s")
            slowest = max(slowest, radars.filtered[-1][1] - sent)
        growth = tracker.status("VmHWM") - before
        return float(np.mean([radars.ospa(index) for index in counted])), slowest, growth
