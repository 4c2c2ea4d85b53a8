"""Publishers on a radar's topic: two at once, or a driver that is killed and restarted."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import names
from msg_adapters.outgoing import diagnostics

from ..harness import scans
from ..harness.figures import Found, measures
from ..harness.radars import TOPICS
from ..harness.rig import LIGHT, Rig

MOST_SCANS = 6
PERIOD_S = 0.5
RESTARTS = 4
# Multiple of the bag's rate: five scans per second, which a tracker sustains on a busy machine.
RATE = 30
# Time between restarts; a killed publisher stays in the graph for 20 s.
RUN_S = 8.0


@measures(
    "second publisher on a radar's topic",
    "ERROR within 6 scans; never one for a driver restarted after kill -9; no gaps",
)
def measure(restarts: int = RESTARTS, run_s: float = RUN_S) -> Found:
    """Publish on one topic from two publishers, then kill and restart a driver repeatedly."""
    needed, gaps = _side_by_side()
    levels, listed, gaps_of_restarted = _restart_driver(restarts, run_s)
    gaps += gaps_of_restarted
    errors = levels.count(DiagnosticStatus.ERROR)
    noticed = f"ERROR after {needed} scans" if needed else f"no ERROR within {MOST_SCANS} scans"
    text = (
        f"{noticed}; {errors} in {len(levels)} reports over {restarts} restarts, up to {listed} "
        f"publishers listed; {gaps} gaps counted"
    )
    # Unless both publishers were listed, the restarts prove nothing.
    reached = needed is not None and errors == 0 and listed > 1 and gaps == 0
    details = {"scans": needed, "reports": len(levels), "errors": errors}
    return text, reached, {**details, "publishers_listed": listed, "gaps": gaps}


def _side_by_side() -> tuple[int | None, int]:
    """Return the number of scans until two publishers are an ERROR, and the gaps counted."""
    with Rig() as rig:
        _, radars = rig.tracking(*LIGHT)
        for index in range(MOST_SCANS):
            radars.track(index)
        other = radars.node.create_publisher(PointCloud2, TOPICS[0], 50)
        radars.spin_until(lambda: other.get_subscription_count() > 0, 20.0)
        needed = None
        for index in range(MOST_SCANS, 2 * MOST_SCANS):
            radars.send(index)
            other.publish(scans.cloud(index, 0))
            radars.spin(PERIOD_S)
            levels = [lines[names.health("radar_1")].level for _, lines in radars.health]
            if DiagnosticStatus.ERROR in levels:
                needed = index - MOST_SCANS + 1
                break
        return needed, int(radars.values("radar_1")["gaps"])


def _restart_driver(restarts: int, run_s: float) -> tuple[list[bytes], int, int]:
    """Return both radars' levels, the largest number of publishers listed, and the gaps counted."""
    with Rig() as rig:
        rig.tracker(*LIGHT)
        radars = rig.radars
        radars.keep(0)
        for _ in range(restarts + 1):
            driver = rig.start("sensor_replay", scans.BAG, "--rate", RATE, "--loop")
            before = len(radars.filtered)
            if not radars.wait_for_more(before, 30.0):
                raise RuntimeError(f"no estimate of the driver's scans:\n{driver.text[-2000:]}")
            radars.spin(run_s)
            driver.kill()
            # Receive the reports of the state after the kill before the next publisher starts.
            radars.spin(1.0)
        lines = [
            found[names.health(radar)]
            for _, found in radars.health
            for radar in ("radar_1", "radar_2")
        ]
        values = [diagnostics.values_of(line) for line in lines]
        return (
            [line.level for line in lines],
            max(int(value["publishers"]) for value in values),
            sum(int(value["gaps"]) for value in values[-2:]),
        )
