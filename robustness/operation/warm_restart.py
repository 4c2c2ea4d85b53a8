"""A tracker that is killed and restarted from its checkpoint, against an uninterrupted one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..harness.figures import Found, measures
from ..harness.radars import Radars
from ..harness.rig import Rig, options

MOST_RATIO = 1.1
# The last scans before the kills, in the middle of the targets' lives.
LAST_BEFORE = (21, 38, 53)
# A restart takes less than the six seconds to the next scan, but one scan is taken as lost.
LOST = 1
# Numbers of scans after a restart: first those not counted, then those counted.
SETTLING, COUNTED = 2, 8


@measures("warm restart", "OSPA within 10 % of an uninterrupted run's after 2 scans")
def measure(last_before: tuple[int, ...] = LAST_BEFORE, compare_cold: bool = True) -> Found:
    """Kill a tracker several times in a run; restart it with a checkpoint and, if asked, without.

    Restarts without a checkpoint have no goal; they show the benefit of one.
    """
    first_after = [last + 1 + LOST + SETTLING for last in last_before]
    counted = [index for first in first_after for index in range(first, first + COUNTED)]
    whole = _run((), counted, checkpoints=False)
    warm = _run(last_before, counted, checkpoints=True)
    ratio = warm / whole
    text = (
        f"{ratio:.3f} times the uninterrupted run's {whole:.1f} m, over {len(last_before)} kills "
        f"with a checkpoint, and {LOST} scan lost at each"
    )
    details = {"whole_m": whole, "warm_m": warm}
    if compare_cold:
        details["cold_m"] = _run(last_before, counted, checkpoints=False)
        text += f"; {details['cold_m'] / whole:.2f} times without one"
    return text, ratio <= MOST_RATIO, details


def _run(kills: Sequence[int], counted: Sequence[int], checkpoints: bool) -> float:
    """Track, with kills after some scans; return the filter's mean OSPA over `counted`, metres."""
    with Rig() as rig:
        path = rig.directory / "tracker.checkpoint"
        given = options({"checkpoint.path": path} if checkpoints else {})
        (tracker, radars), index = rig.tracking(*given), 0
        while index <= counted[-1]:
            if not _track(radars, index):
                raise RuntimeError(f"scan {index} was not answered:\n{tracker.text[-2000:]}")
            if index in kills:
                tracker.kill()
                tracker, _ = rig.tracking(*given)
                index += LOST
            index += 1
        return float(np.mean([radars.ospa(index) for index in counted]))


def _track(radars: Radars, index: int) -> bool:
    """Send a scan until it is answered, because a restarted tracker is not connected at once."""
    return any(radars.track(index, timeout_s=2.0) for _ in range(10))
