# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""One source's figures over a run of any length."""

from __future__ import annotations

from typing import Any

import numpy as np

from .scan_scores import ALL, Pairs, PointSet, ScanScore, Score
from .surveillance import GapFinder, Gaps, TrackWindow, confusion_matrix

# Scans of an OSPA(2) window: a minute of a radar that turns in 6 s.
OSPA2_WINDOW = 10
# The means over scans in a summary.
MEANS = (
    "ospa",
    "localization",
    "cardinality",
    "cardinality_abs_error",
    "gospa",
    "gospa_localization",
    "missed",
    "false",
)


def _scan_values(score: Score) -> list[float]:
    """Return the values whose means are `MEANS`."""
    return [
        score.ospa.distance,
        score.ospa.localization,
        score.ospa.cardinality,
        abs(score.n_est - score.n_true),
        score.gospa.distance,
        score.gospa.localization,
        score.gospa.missed,
        score.gospa.false,
    ]


class _SetTotals:
    """One set's sums over the scans of a run."""

    def __init__(self) -> None:
        self._scans = self._targets = self._pairs = 0
        self._sums = np.zeros(len(MEANS))
        self._square_error = 0.0
        self.gaps = Gaps()

    def add(self, score: Score) -> None:
        self._scans += 1
        self._sums += _scan_values(score)
        self._targets += score.n_true
        self._pairs += score.pairs
        self._square_error += score.square_error

    def figures(self, gaps: Gaps | None) -> dict[str, Any]:
        """Return the set's figures; `gaps` are those of its targets if they are known."""
        means = self._sums / self._scans if self._scans else [None] * len(MEANS)
        known = gaps if self._targets else None
        return {
            **{key: None if v is None else float(v) for key, v in zip(MEANS, means, strict=True)},
            "position_rms": (self._square_error / self._pairs) ** 0.5 if self._pairs else None,
            "position_detection": self._pairs / self._targets if self._targets else None,
            "longest_gap_s": known.longest_s if known else None,
            "long_gap_share": known.long / max(known.number, 1) if known else None,
            "long_gap_misses": known.missed_in_long / self._targets if known else None,
        }


class RunScores:
    """One source's figures of a run, from sums that do not grow with it.

    Parameters
    ----------
    keys : tuple of str
        ``all`` and one ``class_k`` a class.
    cutoff, order : float
    """

    def __init__(self, keys: tuple[str, ...], cutoff: float, order: float) -> None:
        self.scans = 0
        self._cutoff, self._order = cutoff, order
        self._classes = len(keys) - 1
        self._sets = {key: _SetTotals() for key in keys}
        self._pairs = self._right = 0
        self._confusion = np.zeros((len(keys), len(keys)), dtype=np.int64)
        # None once a target had no label of its own.
        self._finder: GapFinder | None = GapFinder()
        # None once a target or an estimate had none.
        self._window: TrackWindow | None = TrackWindow(OSPA2_WINDOW)
        self._labels = 0
        self._ospa2 = 0.0
        self._newest_ns: int | None = None

    def add(self, score: ScanScore, truth: PointSet, estimate: PointSet, pairs: Pairs) -> None:
        """Take in a scan."""
        self.scans += 1
        for key, totals in self._sets.items():
            totals.add(score.scores[key])
        self._pairs += score.pairs
        self._right += score.right_class
        self._confusion += confusion_matrix(pairs, truth.class_id, estimate.class_id, self._classes)
        self._add_to_gaps(score.stamp_ns, truth, pairs)
        self._add_to_window(score.stamp_ns, truth, estimate)

    def _add_to_gaps(self, stamp_ns: int, truth: PointSet, pairs: Pairs) -> None:
        points = truth.labelled()
        if points is None:
            self._finder = None
        if self._finder is None or points is None:
            return
        found = np.zeros(len(truth), dtype=np.bool_)
        found[pairs[0]] = True
        ended = self._finder.add(stamp_ns, points.label, truth.class_id, found)
        for key, totals in self._sets.items():
            totals.gaps = totals.gaps.plus(gap for gap in ended if _belongs(gap.class_id, key))

    def _add_to_window(self, stamp_ns: int, truth: PointSet, estimate: PointSet) -> None:
        true, found = truth.labelled(), estimate.labelled()
        if true is None or found is None:
            self._window = None
        if self._window is None or true is None or found is None:
            return
        if self._newest_ns is not None and stamp_ns < self._newest_ns:
            self._window.clear()
        self._newest_ns = stamp_ns
        self._window.add(true, found)
        self._labels += len(found.label)
        self._ospa2 += self._window.ospa2(self._cutoff, self._order).distance

    def class_accuracy(self) -> float | None:
        """Return the share of all pairs that have the target's class."""
        return self._right / self._pairs if self._pairs else None

    def figures(self) -> dict[str, dict[str, Any]]:
        """Return the figures of every set.

        Returns
        -------
        dict
            By set the means over scans of OSPA, its localisation and cardinality parts, the
            absolute cardinality error, GOSPA, its localisation part and its numbers of missed and
            false targets; ``position_rms`` in metres and ``position_detection``, the share of
            targets with an estimate, of the pairs by position alone; the ``longest_gap_s``, the
            share of gaps longer than `LONG_GAP_S` and the share of the targets' scans missed in
            those (``long_gap_misses``). Of all targets also ``confusion``, see
            `confusion_matrix`, over the run, and ``ospa2``, the mean OSPA(2) over windows of
            `OSPA2_WINDOW` scans, None unless every target and estimate has a label.
        """
        result = {}
        for key, totals in self._sets.items():
            gaps = None
            if self._finder is not None:
                own = (g for g in self._finder.under_way() if _belongs(g.class_id, key))
                gaps = totals.gaps.plus(own)
            result[key] = totals.figures(gaps)
        tracked = self._window is not None and self._labels > 0
        result[ALL]["ospa2"] = self._ospa2 / self.scans if tracked else None
        result[ALL]["confusion"] = self._confusion.tolist() if self.scans else None
        return result


def _belongs(class_id: int, key: str) -> bool:
    """Return whether a target of a class is in a set."""
    return key in (ALL, f"class_{class_id}")
