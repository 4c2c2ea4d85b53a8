"""The figures of one source over a run, in bounded memory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from . import consistency
from .metric_table import OF_ALL, OF_SETS, VALUES, Metric, values_of
from .scan_scores import ALL, Comparison, PairedScan, ScanComparer, set_names
from .surveillance import confusion_matrix
from .totals import Totals

NAMES = tuple(VALUES)
# Values of a scan, by set and name.
ScanValues = dict[str, dict[str, float | None]]


class RunScores:
    """The figures of one source over a run, from totals of constant size.

    Parameters
    ----------
    classes : int
    cutoff, order : float
        c, metres, and p.
    """

    def __init__(self, classes: int, cutoff: float, order: float) -> None:
        self.scans = 0
        self._sets = set_names(classes)
        self._comparer = ScanComparer(classes, cutoff, order)
        # The newest scan is kept apart, because all open gaps end with it if the run does.
        self._before = Totals.of(NAMES, np.zeros((len(self._sets), 0, len(NAMES))))
        self._newest: dict[str, Comparison] = {}
        self._values: ScanValues = {}
        self._confusion = np.zeros((classes + 1, classes + 1), dtype=np.int64)

    def add(self, scan: PairedScan) -> ScanValues:
        """Add the next scan; return its values by set and name."""
        self.scans += 1
        self._before = self._totals_with(self._values)
        self._newest = self._comparer.compare(scan)
        self._values = _values(self._newest)
        truth, estimate = scan.truth.class_id, scan.estimate.class_id
        self._confusion += confusion_matrix(scan.pairs, truth, estimate, len(self._sets) - 1)
        return self._values

    def figures(self) -> dict[str, dict[str, Any]]:
        """Return the figures of every set in the form of `metrics.json`.

        Returns
        -------
        dict
            By set, the figures of `OF_SETS`; for all targets also those of `OF_ALL` and
            ``confusion``, the `confusion_matrix` of the run. None where a figure has no meaning.
        """
        totals = self._totals()
        of_sets = {metric.key: _by_set(metric, totals) for metric in OF_SETS}
        result: dict[str, dict[str, Any]] = {
            key: {name: figures[row] for name, figures in of_sets.items()}
            for row, key in enumerate(self._sets)
        }
        result[ALL].update((metric.key, _by_set(metric, totals)[0]) for metric in OF_ALL)
        result[ALL]["confusion"] = self._confusion.tolist() if self.scans else None
        return result

    def consistency(self) -> dict[str, Any]:
        """Return the consistency of the covariances, see `consistency.figures`."""
        return consistency.figures(self._totals())

    def of_all(self, metric: Metric) -> float | None:
        """Return a figure of all targets."""
        return _by_set(metric, self._totals())[0]

    def _totals(self) -> Totals:
        return self._totals_with(_values(self._comparer.ended(self._newest)))

    def _totals_with(self, newest: ScanValues) -> Totals:
        """Return the totals, by set, of the earlier scans and of the newest if there is one."""
        if not newest:
            return self._before
        rows = [[list(newest[key].values())] for key in self._sets]
        return self._before.plus(Totals.of(NAMES, np.array(rows, dtype=np.float64)))


def _values(scan: Mapping[str, Comparison]) -> ScanValues:
    return {key: values_of(comparison) for key, comparison in scan.items()}


def _by_set(metric: Metric, totals: Totals) -> list[float | None]:
    """Return a metric of every set, None where it has no meaning."""
    return [None if np.isnan(value) else float(value) for value in metric.of_run(totals)]
