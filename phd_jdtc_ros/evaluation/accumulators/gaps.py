"""Gaps: times in which an existing target has no paired estimate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import BoolArray, IntArray

from ..accumulator import SURVEILLANCE, Accumulator, Metric, Values, if_any, share
from ..comparison import Comparison, PairedScan

# ED-142, en route, as in the evaluation tool COMPASS: two updates of 8 s with a margin.
LONG_GAP_S = 16.4


class Gap(NamedTuple):
    """A time in which a target had no estimate."""

    class_id: int  # Class of the target
    # Time from the previous estimate, or else the target's first stamp, to the next estimate, or
    # else its last stamp.
    duration_s: float
    missed: int  # Number of scans without an estimate


@dataclass
class _Continuity:
    """Stamp of an existing target's last pairing, and the number of missed scans since."""

    class_id: int
    paired_ns: int
    newest_ns: int
    missed: int = 0

    def gap(self, end_ns: int) -> Gap:
        return Gap(self.class_id, (end_ns - self.paired_ns) * 1e-9, self.missed)


class GapFinder:
    """Finds the gaps of targets, scan by scan; removes targets that no longer exist.

    References
    ----------
    The detection requirements of the evaluation tool COMPASS (github.com/hpuhr/COMPASS) are also
    based on the time between updates, with the ends of the reference in place of missing updates.
    """

    def __init__(self) -> None:
        self._targets: dict[int, _Continuity] = {}
        self._newest_ns: int | None = None

    def add(
        self, stamp_ns: int, track_id: IntArray, class_id: IntArray, found: BoolArray
    ) -> list[Gap]:
        """Add the next scan; return the gaps that ended with an estimate or with their target.

        `found`, shape (T,), says whether each existing target is paired with an estimate; the
        track_ids are distinct. All targets end if the stamp is earlier than the previous scan's.
        """
        back = self._newest_ns is not None and stamp_ns < self._newest_ns
        self._newest_ns = stamp_ns
        existing = set() if back else set(track_id.tolist())
        gone = [self._targets.pop(label) for label in list(self._targets) if label not in existing]
        ended = [target.gap(target.newest_ns) for target in gone if target.missed]
        rows = zip(track_id.tolist(), class_id.tolist(), found.tolist(), strict=True)
        for label, number, paired in rows:
            target = self._targets.setdefault(label, _Continuity(number, stamp_ns, stamp_ns))
            target.newest_ns = stamp_ns
            if not paired:
                target.missed += 1
                continue
            if target.missed:
                ended.append(target.gap(stamp_ns))
            target.paired_ns, target.missed = stamp_ns, 0
        return ended

    def under_way(self) -> list[Gap]:
        """Return the open gaps, as if all targets ended with the newest scan."""
        return [target.gap(target.newest_ns) for target in self._targets.values() if target.missed]


class Gaps(Accumulator):
    """The gaps that ended in each scan; open gaps end with the run."""

    names = ("gaps", "long_gaps", "missed_in_long_gaps", "longest_gap_s")
    metrics = (
        Metric(
            key="longest_gap_s",
            heading="longest gap",
            unit="s",
            form=".1f",
            of_run=if_any("n_true", lambda run: run.maximum("longest_gap_s")),
            definition=(
                "The longest of all gaps. A gap is a time in which an existing target has no "
                "paired estimate. It lasts from the previous estimate, or else the target's first "
                "scan, to the next estimate, or else its last scan."
            ),
            group=SURVEILLANCE,
        ),
        Metric(
            key="long_gap_share",
            heading="long gaps",
            unit="",
            form=".1%",
            # The share is 0 in a run without gaps.
            of_run=if_any(
                "n_true", lambda run: run.sum("long_gaps") / np.maximum(run.sum("gaps"), 1)
            ),
            definition=f"Share of the gaps that last longer than {LONG_GAP_S:g} s.",
            group=SURVEILLANCE,
        ),
        Metric(
            key="long_gap_misses",
            heading="missed in them",
            unit="",
            form=".2%",
            of_run=share("missed_in_long_gaps", "n_true"),
            definition="Share of the targets, over all scans, that are missed in long gaps.",
            group=SURVEILLANCE,
        ),
    )

    def __init__(self, cutoff: float, order: float) -> None:
        super().__init__(cutoff, order)
        self._finder = GapFinder()
        self._ended: list[Gap] | None = None

    def update(self, scan: PairedScan) -> None:
        """Add the next scan; it has no gaps unless all its targets have labels."""
        points = scan.truth.with_labels()
        self._ended = None
        if points is not None:
            paired = np.zeros(len(scan.truth), dtype=np.bool_)
            paired[scan.pairs[0]] = True
            self._ended = self._finder.add(scan.stamp_ns, points.label, scan.truth.class_id, paired)

    def values(self, part: Comparison) -> Values:
        """Return the numbers of gaps, of long gaps and of their missed scans; the longest gap."""
        if self._ended is None:
            return (None,) * len(self.names)
        ended = [*self._ended, *(self._finder.under_way() if part.last else ())]
        gaps = [gap for gap in ended if part.whole or gap.class_id == part.class_id]
        long = [gap for gap in gaps if gap.duration_s > LONG_GAP_S]
        longest_s = max((gap.duration_s for gap in gaps), default=0.0)
        return len(gaps), len(long), sum(gap.missed for gap in long), longest_s
