"""Estimates against truth, scan by scan and over a run."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .metrics import Ospa, assign, ospa
from .types import FloatArray, IntArray

FILTERED, SMOOTHED = SOURCES = ("filtered", "smoothed")


@dataclass(frozen=True)
class PointSet:
    """Classified positions at one stamp.

    Parameters
    ----------
    position : array of shape (T, 2)
        World frame, metres.
    class_id : int array of shape (T,)
    """

    position: FloatArray
    class_id: IntArray

    def __len__(self) -> int:
        return len(self.position)

    def of_class(self, class_id: int) -> PointSet:
        """Return the points of one class."""
        chosen = self.class_id == class_id
        return PointSet(self.position[chosen], self.class_id[chosen])


@dataclass(frozen=True)
class Score:
    """One set of estimates against one set of targets."""

    ospa: Ospa
    n_true: int
    n_est: int


@dataclass(frozen=True)
class ScanScore:
    """How one source did at one stamp.

    Parameters
    ----------
    source : str
        ``filtered`` or ``smoothed``.
    stamp_ns : int
    scores : dict
        Key ``all`` and one ``class_k`` a class.
    pairs : int
        Estimates assigned to a target by position alone, closer than the cutoff.
    right_class : int
        Those among them with the target's class.
    """

    source: str
    stamp_ns: int
    scores: dict[str, Score]
    pairs: int
    right_class: int


@dataclass
class Evaluation:
    """Pairs estimates with truth by stamp, whichever comes first, and keeps the scores.

    Parameters
    ----------
    classes : int
    cutoff : float
        OSPA's c, metres.
    order : float
        OSPA's p.
    """

    classes: int
    cutoff: float
    order: float
    scores: dict[str, dict[int, ScanScore]] = field(init=False)
    _truth: dict[int, PointSet] = field(init=False, default_factory=dict)
    _waiting: dict[tuple[str, int], PointSet] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self.scores = {source: {} for source in SOURCES}

    def add_truth(self, stamp_ns: int, truth: PointSet) -> list[ScanScore]:
        """Take in the targets of a stamp; return the scores that became possible."""
        self._truth[stamp_ns] = truth
        waiting = [(s, self._waiting.pop((s, stamp_ns), None)) for s in SOURCES]
        return [self._score(s, stamp_ns, found) for s, found in waiting if found is not None]

    def add_estimates(self, source: str, stamp_ns: int, estimate: PointSet) -> list[ScanScore]:
        """Take in a source's estimates of a stamp; return the scores that became possible."""
        if stamp_ns not in self._truth:
            self._waiting[source, stamp_ns] = estimate
            return []
        return [self._score(source, stamp_ns, estimate)]

    def _score(self, source: str, stamp_ns: int, estimate: PointSet) -> ScanScore:
        truth = self._truth[stamp_ns]
        sets = {"all": (truth, estimate)}
        for k in range(self.classes):
            sets[f"class_{k}"] = (truth.of_class(k), estimate.of_class(k))
        scores = {
            key: Score(ospa(t.position, e.position, self.cutoff, self.order), len(t), len(e))
            for key, (t, e) in sets.items()
        }
        target, found = assign(truth.position, estimate.position, self.cutoff)
        right = int(np.count_nonzero(truth.class_id[target] == estimate.class_id[found]))
        score = ScanScore(source, stamp_ns, scores, len(target), right)
        self.scores[source][stamp_ns] = score
        return score

    def summary(self) -> dict[str, Any]:
        """Return the run's means, as `metrics.json` holds them.

        Returns
        -------
        dict
            Per source and set the mean OSPA, its localisation and cardinality parts and the mean
            absolute cardinality error; ``reduction`` of the mean OSPA by smoothing;
            ``class_accuracy`` of the smoothed estimates; ``p``, ``c``; ``scans`` that both sources
            have a score for. A figure without data is None.
        """
        result: dict[str, Any] = {}
        keys = ["all", *(f"class_{k}" for k in range(self.classes))]
        for source in SOURCES:
            run = list(self.scores[source].values())
            result[source] = {key: _means([scan.scores[key] for scan in run]) for key in keys}
        before, after = (result[source]["all"]["ospa"] for source in SOURCES)
        result["reduction"] = 1.0 - after / before if before and after is not None else None
        smoothed = self.scores[SMOOTHED].values()
        pairs = sum(scan.pairs for scan in smoothed)
        right = sum(scan.right_class for scan in smoothed)
        result["class_accuracy"] = right / pairs if pairs else None
        result["p"], result["c"] = self.order, self.cutoff
        result["scans"] = len(self.scores[FILTERED].keys() & self.scores[SMOOTHED].keys())
        return result


def _means(scores: list[Score]) -> dict[str, float | None]:
    columns: dict[str, list[float]] = {
        "ospa": [s.ospa.distance for s in scores],
        "localization": [s.ospa.localization for s in scores],
        "cardinality": [s.ospa.cardinality for s in scores],
        "cardinality_abs_error": [abs(s.n_est - s.n_true) for s in scores],
    }
    return {key: float(np.mean(values)) if scores else None for key, values in columns.items()}
