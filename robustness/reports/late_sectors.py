"""Out-of-sequence sectors, a lost one, and a burst of late ones, with reprocessing."""

from __future__ import annotations

import copy

import numpy as np
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import stamps

from ..harness import scans
from ..harness.figures import Found, measures
from ..harness.radars import Radars
from ..harness.rig import Rig, options
from .turning import NEAR_M, PARAMETERS, ROTATION_S, SECTORS, Antenna, how_far, send

WARM_UP, REVOLUTIONS = 4, 8
# Every 11th sector, which is prime to the sectors of a revolution, is late by 5 sectors.
EVERY, LATE_BY = 11, 5
LOST = 6 * SECTORS + 6
# Number of late clouds in a burst, with stamps between those of sectors.
BURST = 150
# Diagnostics in which a late cloud is counted; in a burst the queue overflows.
COUNTED = ("late_reworked", "dropped_late_burst", "gaps")
# Largest number of reprocessed clouds of a burst: the budget of two windows of 32 sectors.
MOST = 2 * (2 * SECTORS + 1)
ROTATION_NS = round(ROTATION_S * 1e9)
# Longest time from a burst to the estimates of the next sector.
ANSWER_S = 5.0


@measures(
    "late sectors: 5 sectors late, lost, in a burst",
    "0 exits, 0 NaN; every one worked in and counted, a burst bounded; the target tracked",
)
def measure() -> Found:
    """Send sectors late, leave one out, send a burst of late ones, and count what happens."""
    given = {**PARAMETERS, "late_reports": "rework", "lag_s": 2.0 * ROTATION_S}
    with Rig() as rig:
        tracker, radars = rig.tracking(*options(given), radars=1)
        antenna = Antenna(np.random.default_rng(2))
        late, lost, apart = _send_all(radars, antenna)
        before = _counts(radars)
        answered = _burst(radars, antenna)
        after = _counts(radars)
        alive, not_finite = tracker.alive, radars.not_finite
    worked_in = before["late_reworked"]
    tracked = float(np.mean(np.array(apart) < NEAR_M))
    in_burst = {key: after[key] - before[key] for key in COUNTED}
    text = (
        f"{'0' if alive else '1'} exits, {not_finite} with NaN; {worked_in} of {late} late sectors "
        f"worked in, {lost} without an answer; the target is within {NEAR_M:g} m in "
        f"{100.0 * tracked:.1f} % of the estimates; of a burst of {BURST} {in_burst} and the next "
        f"sector {'is' if answered else 'is not'} answered within {ANSWER_S:g} s"
    )
    bounded = answered and sum(in_burst.values()) == BURST and in_burst["late_reworked"] < MOST
    reached = alive and not not_finite and worked_in == late and not lost and bounded
    reached = reached and tracked > 0.98
    details = {"late": late, "worked_in": worked_in, "tracked": tracked, "burst": in_burst}
    return text, reached, details


def _send_all(radars: Radars, antenna: Antenna) -> tuple[int, int, list[float]]:
    """Send all sectors; return how many were late and not answered, and how far the target was."""
    held: dict[int, PointCloud2] = {}
    late = lost = 0
    apart = []
    for sector in range(REVOLUTIONS * SECTORS):
        cloud = antenna.next()
        if sector == LOST:
            continue
        if sector > WARM_UP * SECTORS and sector % EVERY == 0:
            held[sector + LATE_BY] = cloud
            continue
        if sector in held:
            radars.outputs[0].publish(held.pop(sector))
            late += 1
        lost += not send(radars, cloud)
        if sector > WARM_UP * SECTORS:
            apart.append(how_far(radars, antenna.time_s))
    return late, lost, apart


def _burst(radars: Radars, antenna: Antenna) -> bool:
    """Send many late clouds at once, and a sector; return whether it is answered in time."""
    cloud = antenna.next()
    stamp_ns = scans.START_NS + round(antenna.time_s * 1e9)
    for index in range(BURST):
        old = copy.deepcopy(cloud)
        old.header.stamp = stamps.from_ns(stamp_ns - ROTATION_NS - 1000 * (index + 1))
        radars.outputs[0].publish(old)
    before = len(radars.filtered)
    radars.outputs[0].publish(cloud)
    return radars.wait_for_more(before, ANSWER_S)


def _counts(radars: Radars) -> dict[str, int]:
    values = radars.values("radar_1")
    return {key: int(values.get(key, 0)) for key in COUNTED}
