# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The runs of one variant at one case, and the figures of each run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray

from .definition import Variant
from .scores import ALL, CUTOFF, ORDER, VALUES, Scores


@dataclass(frozen=True)
class Result:
    """All runs of a variant at a case.

    Parameters
    ----------
    case : str
    variant : Variant
    seeds : tuple of int
    scores : Scores
        With the runs as the first axis of its arrays.
    """

    case: str
    variant: Variant
    seeds: tuple[int, ...]
    scores: Scores

    def value(self, name: str, lag: int, of_set: str = ALL) -> FloatArray:
        """Return one of `VALUES`, shape (runs, scans)."""
        row, column = self.scores.lags.index(lag), self.scores.sets.index(of_set)
        found: FloatArray = self.scores.values[:, row, :, column, VALUES.index(name)]
        return found

    def figure(self, name: str, lag: int, of_set: str = ALL) -> FloatArray | None:
        """Return one of `FIGURES` of every run, shape (runs,); None if it has no meaning."""

        def value(column: str) -> FloatArray:
            return self.value(column, lag, of_set)

        if name in RATIOS:
            over, under = (value(column).sum(axis=1) for column in RATIOS[name])
            return ratio(over, under)
        if name == "long_gap_share":
            # Without a gap there is no long one.
            return value("long_gaps").sum(axis=1) / np.maximum(value("gaps").sum(axis=1), 1.0)
        if name == "longest_gap_s":
            return value(name).max(axis=1)
        if name == "position_rms":
            pairs = value("pairs")
            square = np.where(pairs > 0, value("position_rms") ** 2 * pairs, 0.0)
            return np.sqrt(ratio(square.sum(axis=1), pairs.sum(axis=1)))
        if name == "ospa_after_5":
            known = np.isfinite(value(name))
            return ratio(np.where(known, value(name), 0.0).sum(axis=1), known.sum(axis=1))
        if name == "reduction":
            if lag == 0 or 0 not in self.scores.lags:
                return None
            after, before = (self.value("ospa", k, of_set).mean(axis=1) for k in (lag, 0))
            return 1.0 - ratio(after, before)
        return self._over_time(name, value).mean(axis=1)

    def _over_time(self, name: str, value: Callable[[str], FloatArray]) -> FloatArray:
        """Return a figure that is a mean over scans, shape (runs, scans)."""
        if name == "cardinality_abs_error":
            return np.abs(value("n_est") - value("n_true"))
        if name == "false":
            return value("missed") + value("n_est") - value("n_true")
        return _gospa(value, name) if name in ("gospa", "gospa_localization") else value(name)

    def confusion(self, lag: int) -> FloatArray | None:
        """Return the confusion matrices of the runs, see `surveillance.confusion_matrix`.

        Returns
        -------
        array of shape (runs, C + 1, C + 1) or None
            Counts over all scans; None for trackers that do not tell classes.
        """
        if self.scores.taken_for is None:
            return None
        row = self.scores.lags.index(lag)
        taken = self.scores.taken_for[:, row].sum(axis=1)
        runs, classes = taken.shape[:2]
        matrix = np.zeros((runs, classes + 1, classes + 1))
        matrix[:, :classes, :classes] = taken
        for k in range(classes):
            true, found = (
                self.value(n, lag, f"class_{k}").sum(axis=1) for n in ("n_true", "n_est")
            )
            matrix[:, k, classes] = true - taken[:, k].sum(axis=1)
            matrix[:, classes, k] = found - taken[:, :, k].sum(axis=1)
        return matrix


# Figures that are one sum over a run against another.
RATIOS = {
    "class_accuracy": ("right_class", "pairs"),
    "position_detection": ("pairs", "n_true"),
    "long_gap_misses": ("missed_in_long_gaps", "n_true"),
}


def _gospa(value: Callable[[str], FloatArray], name: str) -> FloatArray:
    """Return GOSPA or its localisation part from stored values, shape (runs, scans).

    Notes
    -----
    OSPA assigns by the same costs; it has as many pairs as the smaller set has members, and those
    at the cutoff or beyond are GOSPA's missed and false ones.
    """
    true, found, missed = value("n_true"), value("n_est"), value("missed")
    assigned = true - missed
    beyond = np.minimum(true, found) - assigned
    together = value("localization") ** ORDER * np.maximum(true, found) - CUTOFF**ORDER * beyond
    # The difference of rounded values is not quite zero where nothing is assigned.
    matched = np.where(assigned > 0, np.maximum(together, 0.0), 0.0)
    alone = 0.5 * CUTOFF**ORDER * (missed + found - assigned) if name == "gospa" else 0.0
    distance: FloatArray = (matched + alone) ** (1.0 / ORDER)
    return distance


def ratio(over: FloatArray, under: FloatArray) -> FloatArray:
    """Return the ratios, NaN where there is none."""
    return np.divide(over, under, out=np.full(len(under), np.nan), where=under > 0.0)
