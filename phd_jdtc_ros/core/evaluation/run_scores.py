# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""One source's figures over a run of any length."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .metric_table import OF_ALL, OF_SETS, VALUES, Metric, values_of
from .scan_scores import ALL, Comparison, PairedScan, ScanComparer, set_names
from .surveillance import confusion_matrix
from .totals import Totals

NAMES = tuple(VALUES)
# Of a scan, by set and name.
ScanValues = dict[str, dict[str, float | None]]


class RunScores:
    """One source's figures of a run, from totals that do not grow with it.

    Parameters
    ----------
    classes : int
    cutoff, order : float
        c, metres, and p.
    """

    def __init__(self, classes: int, cutoff: float, order: float) -> None:
        self.scans = 0
        self._classes = classes
        self._comparer = ScanComparer(classes, cutoff, order)
        # The newest scan is kept apart: if the run ends with it, gaps end that are still under way.
        nothing = Totals.of(NAMES, np.zeros((0, len(NAMES))))
        self._before = dict.fromkeys(set_names(classes), nothing)
        self._newest: dict[str, Comparison] = {}
        self._confusion = np.zeros((classes + 1, classes + 1), dtype=np.int64)

    def add(self, scan: PairedScan) -> ScanValues:
        """Take in the next scan; return its values by set and name."""
        self.scans += 1
        self._before = self._totals_with(self._newest)
        self._newest = self._comparer.compare(scan)
        truth, estimate = scan.truth.class_id, scan.estimate.class_id
        self._confusion += confusion_matrix(scan.pairs, truth, estimate, self._classes)
        return {key: values_of(comparison) for key, comparison in self._newest.items()}

    def figures(self) -> dict[str, dict[str, Any]]:
        """Return the figures of every set, as `metrics.json` holds them.

        Returns
        -------
        dict
            By set those of `OF_SETS`; of all targets also those of `OF_ALL` and ``confusion``, see
            `confusion_matrix`, over the run. None where a figure has no meaning.
        """
        totals = self._totals()
        result = {key: _figures(OF_SETS, run) for key, run in totals.items()}
        confusion = self._confusion.tolist() if self.scans else None
        result[ALL] = {**result[ALL], **_figures(OF_ALL, totals[ALL]), "confusion": confusion}
        return result

    def of_all(self, metric: Metric) -> float | None:
        """Return a figure of all targets."""
        return _figure(metric, self._totals()[ALL])

    def _totals(self) -> dict[str, Totals]:
        return self._totals_with(self._comparer.ended(self._newest))

    def _totals_with(self, newest: Mapping[str, Comparison]) -> dict[str, Totals]:
        """Return the totals of the scans before and of the newest, if there is one, by set."""
        if not newest:
            return self._before
        return {key: run.plus(_of_scan(newest[key])) for key, run in self._before.items()}


def _of_scan(comparison: Comparison) -> Totals:
    values = list(values_of(comparison).values())
    return Totals.of(NAMES, np.array([values], dtype=np.float64))


def _figures(metrics: Sequence[Metric], run: Totals) -> dict[str, Any]:
    return {metric.key: _figure(metric, run) for metric in metrics}


def _figure(metric: Metric, run: Totals) -> float | None:
    """Return a metric of one run, None where it has no meaning."""
    value = float(metric.of_run(run))
    return None if np.isnan(value) else value
