# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The evaluation of a run: estimates are compared with the truth at their own stamps."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, TypeVar

from ..types import FILTERED, SMOOTHED, SOURCES
from .limits import LONG_GAP_S, OSPA2_WINDOW
from .metric_table import CLASS_ACCURACY, IDENTITY_SWITCHES, reduction
from .run_scores import RunScores
from .scan_scores import ALL, PairedScan, PointSet, ScanScore, class_set
from .true_tracks import TrueTracks

__all__ = ["FILTERED", "SMOOTHED", "SOURCES", "Evaluation", "PointSet", "ScanScore"]

Key = TypeVar("Key")
Value = TypeVar("Value")


@dataclass
class Evaluation:
    """Compares estimates with the truth at their stamps, in any order of arrival; totals scores.

    Between samples the truth is interpolated, see `TrueTracks`. Samples come in the order of their
    stamps.

    Parameters
    ----------
    classes : int
    cutoff : float
        c of OSPA and GOSPA, metres.
    order : float
        p of both.
    keep : int or None
        Number of scans of which truth, unpaired estimates and scores are kept, so that a run may be
        of any length; None keeps all. The summary is always of the whole run.
    class_names : tuple of str
        For readers of the summary; ``class_0`` and so on if empty.

    Attributes
    ----------
    scores : dict
        By source and stamp, the last `keep` of each. A repeated stamp is scored again.
    scored : dict
        Number of scores by source.
    """

    classes: int
    cutoff: float
    order: float
    keep: int | None = None
    class_names: tuple[str, ...] = ()
    scores: dict[str, dict[int, ScanScore]] = field(init=False)
    _runs: dict[str, RunScores] = field(init=False)
    _truth: TrueTracks = field(init=False)
    _waiting: dict[tuple[str, int], PointSet] = field(init=False, default_factory=dict)
    # Stamps for which only one source has a score so far, and that source.
    _half: dict[int, str] = field(init=False, default_factory=dict)
    _scans: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self.scores = {source: {} for source in SOURCES}
        self._truth = TrueTracks(self.keep)
        settings = self.classes, self.cutoff, self.order
        self._runs = {source: RunScores(*settings) for source in SOURCES}

    @property
    def scored(self) -> dict[str, int]:
        """Number of scores by source."""
        return {source: run.scans for source, run in self._runs.items()}

    def add_truth(self, stamp_ns: int, truth: PointSet) -> list[ScanScore]:
        """Add the targets of a stamp; return the scores that became possible."""
        self._truth.add(stamp_ns, truth)
        scores = []
        for source, waiting_ns in sorted(self._waiting, key=_by_stamp):
            targets = self._truth.at(waiting_ns)
            if targets is not None:
                estimate = self._waiting.pop((source, waiting_ns))
                scores.append(self._score(source, waiting_ns, targets, estimate))
        return scores

    def add_estimates(self, source: str, stamp_ns: int, estimate: PointSet) -> list[ScanScore]:
        """Add a source's estimates of a stamp; return the scores that became possible."""
        targets = self._truth.at(stamp_ns)
        if targets is None:
            self._put(self._waiting, (source, stamp_ns), estimate)
            return []
        return [self._score(source, stamp_ns, targets, estimate)]

    def _put(self, store: dict[Key, Value], key: Key, value: Value) -> None:
        """Store as the newest entry, and remove the oldest ones beyond `keep`."""
        store.pop(key, None)
        store[key] = value
        while self.keep is not None and len(store) > self.keep:
            del store[next(iter(store))]

    def _score(
        self, source: str, stamp_ns: int, targets: PointSet, estimate: PointSet
    ) -> ScanScore:
        scan = PairedScan.of(stamp_ns, targets, estimate, self.cutoff)
        score = ScanScore(source, stamp_ns, self._runs[source].add(scan))
        self._put(self.scores[source], stamp_ns, score)
        if self._half.get(stamp_ns, source) == source:
            self._put(self._half, stamp_ns, source)
        else:
            del self._half[stamp_ns]
            self._scans += 1
        return score

    def summary(self) -> dict[str, Any]:
        """Return the run's figures in the form of `metrics.json`.

        Returns
        -------
        dict
            The result of `RunScores.figures` per source; ``reduction`` of the mean OSPA by
            smoothing; ``class_accuracy`` and ``identity_switches`` of the smoothed estimates;
            ``p``, ``c``; ``long_gap_s``, and ``ospa2_window`` in scans; ``scans``, the number of
            stamps with scores of both sources; ``class_names``. A figure without data is None.
        """
        result: dict[str, Any] = {source: run.figures() for source, run in self._runs.items()}
        result["reduction"] = reduction(*(result[source][ALL]["ospa"] for source in SOURCES))
        result["class_accuracy"] = self._runs[SMOOTHED].of_all(CLASS_ACCURACY)
        result["identity_switches"] = result[SMOOTHED][ALL][IDENTITY_SWITCHES.key]
        result["p"], result["c"] = self.order, self.cutoff
        result["long_gap_s"], result["ospa2_window"] = LONG_GAP_S, OSPA2_WINDOW
        result["scans"] = self._scans
        result["class_names"] = list(self.class_names or map(class_set, range(self.classes)))
        return result


def _by_stamp(entry: tuple[str, int]) -> tuple[int, int]:
    """Return the order of a source and a stamp among those that wait."""
    source, stamp_ns = entry
    return stamp_ns, SOURCES.index(source)
