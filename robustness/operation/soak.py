"""A day of scans through a live tracker, as fast as it processes them."""

from __future__ import annotations

import os
import time
from functools import partial

import numpy as np

from ..harness.figures import Found, measures
from ..harness.radars import Radars
from ..harness.rig import Rig

SCANS = 14_400
MOST_KIB = 2048
LIMIT_S = 600.0
# Largest number of unanswered scans; the tracker's queue is ten deep.
OUTSTANDING = 4
SAMPLES = 400
PATIENCE_S = 20.0


def goal(count: int = SCANS) -> str:
    """Return the goal in words."""
    return (
        f"{count:,} scans, both radars: memory at most +{MOST_KIB / 1024:g} MiB over the 2nd half, "
        f"fds and threads +0, in {LIMIT_S:g} s"
    )


@measures("24 h soak", goal)
def measure(count: int = SCANS) -> Found:
    """Send `count` scans, each when the fourth one before it has been answered."""
    samples = []
    with Rig() as rig:
        tracker, radars = rig.tracking()
        begin = time.monotonic()
        every = max(1, count // SAMPLES)
        for index in range(count):
            radars.send(index)
            kept_up = radars.spin_until(partial(_keeps_up, radars, index + 1), PATIENCE_S)
            if not kept_up or not tracker.alive or time.monotonic() - begin > 2.0 * LIMIT_S:
                break
            if index % every == 0:
                resident, threads = tracker.status("VmRSS"), tracker.status("Threads")
                samples.append((index, resident, tracker.descriptors, threads))
        radars.spin_until(lambda: len(radars.answered) >= count, PATIENCE_S)
        seconds = time.monotonic() - begin
        answered, alive = len(radars.answered), tracker.alive
        status = tracker.stop()
        not_finite, load = radars.not_finite, os.getloadavg()[0]
    if not samples:
        raise RuntimeError(f"no scan was answered; the tracker's exit status is {status}")
    half = np.array(samples[len(samples) // 2 :])
    slope = np.polyfit(half[:, 0], half[:, 1], 1)[0] if len(half) > 1 else float("nan")
    growth = float(slope * (count - count / 2))
    descriptors, threads = (int(half[-1, column] - half[0, column]) for column in (2, 3))
    text = (
        f"{answered:,} scans in {seconds:.0f} s; memory {growth:+.0f} KiB over the 2nd half, "
        f"fds {descriptors:+d}, threads {threads:+d}"
    )
    reached = (
        alive
        and status == 0
        and answered == count
        and not not_finite
        and growth <= MOST_KIB
        and descriptors <= 0
        and threads <= 0
        and seconds <= LIMIT_S
    )
    details = {"scans": answered, "seconds": seconds, "growth_kib": growth, "threads": threads}
    memory = {str(index): resident for index, resident, *_ in samples}
    more = {"descriptors": descriptors, "not_finite": not_finite, "resident_kib": memory}
    return text, reached, {**details, **more, "load_average": load}


def _keeps_up(radars: Radars, sent: int) -> bool:
    return len(radars.answered) > sent - OUTSTANDING
