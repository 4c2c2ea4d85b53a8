"""The runs of one variant at one case, and the figures of each run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.evaluation.comparison import ALL
from phd_jdtc_ros.evaluation.totals import Totals, ratio

from .definition import METRICS, REDUCTION, Variant
from .metrics import VALUES
from .scores import Scores


@dataclass(frozen=True)
class Result:
    """All runs of a variant at a case."""

    case: str
    variant: Variant
    seeds: tuple[int, ...]
    scores: Scores  # The first axis of its arrays is the run

    def value(self, name: str, lag: int, of_set: str = ALL) -> FloatArray:
        """Return one of `VALUES`, shape (runs, scans)."""
        return self._values(lag, of_set)[..., VALUES.index(name)]

    def figures(self, lag: int, of_set: str = ALL) -> dict[str, FloatArray | None]:
        """Return each of `FIGURES` for every run, shape (runs,); None if undefined."""
        totals = Totals.of(VALUES, self._values(lag, of_set))
        figures = {name: metric.of_run(totals) for name, metric in METRICS.items()}
        return {**figures, REDUCTION: self._reduction(lag, of_set)}

    def figure(self, name: str, lag: int, of_set: str = ALL) -> FloatArray | None:
        """Return one of `FIGURES`."""
        return self.figures(lag, of_set)[name]

    def over_time(self, name: str, lag: int, of_set: str = ALL) -> FloatArray:
        """Return one of `METRICS` per scan, shape (runs, scans)."""
        each_scan = self._values(lag, of_set)[..., None, :]
        return METRICS[name].of_run(Totals.of(VALUES, each_scan))

    def _values(self, lag: int, of_set: str) -> FloatArray:
        """Return all values, shape (runs, scans, VALUES)."""
        row, column = self.scores.lags.index(lag), self.scores.sets.index(of_set)
        values: FloatArray = self.scores.values[:, row, :, column]
        return values

    def _reduction(self, lag: int, of_set: str) -> FloatArray | None:
        if lag == 0 or 0 not in self.scores.lags:
            return None
        after, before = (self.value("ospa", k, of_set).mean(axis=1) for k in (lag, 0))
        return 1.0 - ratio(after, before)

    def confusion(self, lag: int) -> FloatArray | None:
        """Return the runs' `pairs.confusion_matrix`, summed over the scans, (runs, C + 1, C + 1).

        It is None for trackers without classes.
        """
        if self.scores.taken_for is None:
            return None
        row = self.scores.lags.index(lag)
        taken = self.scores.taken_for[:, row].sum(axis=1)
        runs, classes = taken.shape[:2]
        matrix = np.zeros((runs, classes + 1, classes + 1))
        matrix[:, :classes, :classes] = taken
        for k in range(classes):
            true, estimated = (
                self.value(n, lag, f"class_{k}").sum(axis=1) for n in ("n_true", "n_est")
            )
            matrix[:, k, classes] = true - taken[:, k].sum(axis=1)
            matrix[:, classes, k] = estimated - taken[:, :, k].sum(axis=1)
        return matrix
