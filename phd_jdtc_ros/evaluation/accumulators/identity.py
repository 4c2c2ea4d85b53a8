"""Identity switches: how often targets and track numbers change partners."""

from __future__ import annotations

import numpy as np

from phd_jdtc_ros.core.arrays import BoolArray

from ..accumulator import TRACKS, LabelAccumulator, Metric, Values, if_any
from ..comparison import LabelledPoints, PairedScan
from ..metrics import assign, distances


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
            unit="",
            form=".0f",
            of_run=if_any("n_est", lambda run: run.sum("identity_switches")),
            definition=(
                "Number over the run of targets that are paired with another track id than before, "
                "and of track ids that pass to another target: a broken track counts one, two "
                "swapped tracks count two. A target and a track stay a pair while both exist, "
                "closer than c; the others are paired by position. It needs track ids of all "
                "targets and estimates."
            ),
            group=TRACKS,
            headline=True,
        ),
        Metric(
            key="seen_switches",
            heading="identity switches, seen",
            unit="",
            form=".0f",
            of_run=if_any("n_est", lambda run: run.sum("seen_switches")),
            definition=(
                "The same, except that a coasting track, which had no detection in its last scan, "
                "keeps its target and is paired with no other. A track that coasts for one more "
                "revolution after its target has landed is therefore not paired with an aircraft "
                "that takes off nearby. Tracks of unknown state count as not coasting."
            ),
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
