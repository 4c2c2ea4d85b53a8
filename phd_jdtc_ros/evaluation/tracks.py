"""Figures of whole tracks: OSPA(2) of trajectories, gaps, and switches of identity.

OSPA(2) is the distance between estimated and true trajectories over the newest scans. A gap is a
time in which an existing target has no paired estimate. Identity switches count how often targets
and track numbers change partners.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray

from .accumulator import (
    SURVEILLANCE,
    TRACKS,
    Accumulator,
    LabelAccumulator,
    Metric,
    Values,
    if_any,
    ratio,
    share,
)
from .comparison import Comparison, LabelledPoints, PairedScan
from .metrics import assign, distances, ospa_of_distances

# Scans of an OSPA(2) window: one minute of a radar with a revolution of 6 s.
OSPA2_WINDOW = 10


def tracks_of(scans: Iterable[LabelledPoints]) -> FloatArray:
    """Return the positions of N tracks in K scans, (N, K, 2), NaN where a track does not exist.

    The labels of a scan are distinct.
    """
    labels, positions = zip(*scans, strict=True)
    numbers, row = np.unique(np.concatenate(labels), return_inverse=True)
    tracks = np.full((len(numbers), len(labels), 2), np.nan)
    scan = np.repeat(np.arange(len(labels)), [len(label) for label in labels])
    tracks[row, scan] = np.concatenate(positions)
    return tracks


def track_distances(a: FloatArray, b: FloatArray, cutoff: float) -> FloatArray:
    """Return the time-averaged distance of each of N tracks to each of M others, metres, (N, M).

    Short, broken and swapped tracks are far from every target's track, so that an OSPA distance of
    these base distances, OSPA(2), penalises wrong labels as well as wrong positions.

    Both arrays are results of `tracks_of` over the same scans. The mean is over the scans in which
    at least one track exists; it is 0 for two tracks that exist in no scan. The cutoff c, metres,
    is the upper bound of the distance, and its value where only one track exists.

    References
    ----------
    Beard, Vo and Vo, "OSPA(2): Using the OSPA metric to evaluate multi-target tracking
    performance", International Conference on Control, Automation and Information Sciences, 2017;
    Beard, Vo and Vo, "A solution for large-scale multi-object tracking", IEEE Transactions on
    Signal Processing 68, 2020, with the order q, here 1, and windows.
    """
    distance = np.linalg.norm(a[:, None] - b[None, :], axis=-1)
    distance = np.where(np.isnan(distance), cutoff, np.minimum(distance, cutoff))
    either = ~np.isnan(a[:, None, :, 0]) | ~np.isnan(b[None, :, :, 0])
    mean: FloatArray = (distance * either).sum(axis=-1) / np.maximum(either.sum(axis=-1), 1)
    return mean


class Ospa2Accumulator(LabelAccumulator):
    """The OSPA(2) distance over the window; with one scan it is the OSPA distance."""

    names = ("ospa2",)
    metrics = (
        Metric(
            key="ospa2",
            heading="OSPA(2)",
            unit="m",
            figure=if_any("n_est", lambda run: ratio(run.sum("ospa2"), run.scans)),
            definition=(
                "Mean over the scans of the OSPA distance between estimated and true trajectories "
                f"in the last {OSPA2_WINDOW} scans. The distance of two trajectories is the mean "
                "over the scans in which at least one exists, with c if only one does, so that "
                "short, broken and swapped tracks count. It needs track ids of all targets and "
                "estimates."
            ),
            group=TRACKS,
        ),
    )

    def __init__(self, cutoff: float, order: float, window: int = OSPA2_WINDOW) -> None:
        super().__init__(cutoff, order)
        self._scans: deque[tuple[LabelledPoints, LabelledPoints]] = deque(maxlen=window)

    def clear(self) -> None:
        """Remove all scans."""
        self._scans.clear()

    def add(self, truth: LabelledPoints, estimate: LabelledPoints, scan: PairedScan) -> Values:
        """Return the distance over the newest scans."""
        self._scans.append((truth, estimate))
        true, estimated = map(tracks_of, zip(*self._scans, strict=True))
        distance = track_distances(true, estimated, self.cutoff)
        return (ospa_of_distances(distance, self.cutoff, self.order).distance,)


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
            figure=if_any("n_true", lambda run: run.maximum("longest_gap_s")),
            definition="The longest of all gaps. A gap is a time in which an existing target has "
            "no paired estimate. It lasts from the previous estimate, or else the target's first "
            "scan, to the next estimate, or else its last scan.",
            group=SURVEILLANCE,
        ),
        Metric(
            key="long_gap_share",
            heading="long gaps",
            form=".1%",
            # The share is 0 in a run without gaps.
            figure=if_any(
                "n_true", lambda run: run.sum("long_gaps") / np.maximum(run.sum("gaps"), 1)
            ),
            definition=f"Share of the gaps that last longer than {LONG_GAP_S:g} s.",
            group=SURVEILLANCE,
        ),
        Metric(
            key="long_gap_misses",
            heading="missed in them",
            form=".2%",
            figure=share("missed_in_long_gaps", "n_true"),
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


class IdentitySwitches:
    """Counts identity switches, scan by scan.

    A target and a track remain partners while both exist and are closer than the cutoff, metres;
    the others are paired by position. Two tracks near two crossing targets therefore count as a
    switch only when they leave with the wrong targets. A switch is a target with a track number
    other than its last one, or a number that was last on another target: a broken track counts one,
    and two swapped tracks count two. Targets and tracks that no longer exist are removed.

    References
    ----------
    Bernardin and Stiefelhagen, "Evaluating multiple object tracking performance: the CLEAR MOT
    metrics", EURASIP Journal on Image and Video Processing, 2008. There, a number that passes to a
    new target is no mismatch.
    """

    def __init__(self, cutoff: float) -> None:
        self._cutoff = cutoff
        self._track_of: dict[int, int] = {}
        self._target_of: dict[int, int] = {}

    def clear(self) -> None:
        """Remove all partners, as at the start of a run."""
        self._track_of, self._target_of = {}, {}

    def add(
        self, truth: LabelledPoints, estimate: LabelledPoints, coasting: BoolArray | None = None
    ) -> int:
        """Add the next scan; return the number of switches in it.

        `coasting`, shape (T,), says whether each track had no detection; None if no track coasts.
        Coasting tracks keep their partners and get no new ones, since being near another target is
        no evidence of an association: for example, a track whose target has landed may coast past a
        target that appears.
        """
        targets, tracks = truth.label.tolist(), estimate.label.tolist()
        self._track_of = {t: n for t, n in self._track_of.items() if t in set(targets)}
        self._target_of = {n: t for n, t in self._target_of.items() if n in set(tracks)}
        pairs = self._partners(truth, estimate, coasting)
        switches = sum(
            self._track_of.get(target, track) != track
            or self._target_of.get(track, target) != target
            for target, track in pairs
        )
        self._track_of.update(pairs)
        self._target_of.update((track, target) for target, track in pairs)
        return switches

    def _partners(
        self, truth: LabelledPoints, estimate: LabelledPoints, coasting: BoolArray | None
    ) -> list[tuple[int, int]]:
        """Return the pairs (target, track) of a scan: former partners first, then the nearest."""
        targets, tracks = truth.label.tolist(), estimate.label.tolist()
        near = distances(truth.position, estimate.position) < self._cutoff
        column_of = {track: column for column, track in enumerate(tracks)}
        kept = {
            row: column_of[track]
            for row, target in enumerate(targets)
            if (track := self._track_of.get(target, 0)) in column_of
            and self._target_of.get(track) == target
            and near[row, column_of[track]]
        }
        rows = [row for row in range(len(targets)) if row not in kept]
        taken = {*kept.values(), *(() if coasting is None else np.flatnonzero(coasting).tolist())}
        columns = [column for column in range(len(tracks)) if column not in taken]
        found = assign(truth.position[rows], estimate.position[columns], self._cutoff)
        free = [(rows[r], columns[c]) for r, c in zip(*(f.tolist() for f in found), strict=True)]
        return [(targets[row], tracks[column]) for row, column in [*kept.items(), *free]]


class Switches(LabelAccumulator):
    """The identity switches of a scan, with and without new partners of coasting tracks."""

    names = ("identity_switches", "seen_switches")
    metrics = (
        Metric(
            key="identity_switches",
            heading="identity switches",
            form=".0f",
            figure=if_any("n_est", lambda run: run.sum("identity_switches")),
            definition="Number over the run of targets that are paired with another track id than "
            "before, and of track ids that pass to another target: a broken track counts one, two "
            "swapped tracks count two. A target and a track stay a pair while both exist, closer "
            "than c; the others are paired by position. It needs track ids of all targets and "
            "estimates.",
            group=TRACKS,
            headline=True,
        ),
        Metric(
            key="seen_switches",
            heading="identity switches, seen",
            form=".0f",
            figure=if_any("n_est", lambda run: run.sum("seen_switches")),
            definition="The same, except that a coasting track, which had no detection in its last "
            "scan, keeps its target and is paired with no other. A track that coasts for one more "
            "revolution after its target has landed is therefore not paired with an aircraft that "
            "takes off nearby. Tracks of unknown state count as not coasting.",
            group=TRACKS,
        ),
    )

    def __init__(self, cutoff: float, order: float) -> None:
        super().__init__(cutoff, order)
        self._all, self._seen = IdentitySwitches(cutoff), IdentitySwitches(cutoff)

    def clear(self) -> None:
        """Remove all partners."""
        self._all.clear()
        self._seen.clear()

    def add(self, truth: LabelledPoints, estimate: LabelledPoints, scan: PairedScan) -> Values:
        """Return both numbers."""
        seen = self._seen.add(truth, estimate, scan.estimate.coasting)
        return self._all.add(truth, estimate), seen
