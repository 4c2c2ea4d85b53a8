"""The table of metrics, collected from their accumulators, and the scores of one run.

`metrics.json`, the tables, the report's page, the evaluator's diagnostics, the Monte Carlo study
and the page of definitions read this table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from . import consistency
from .accumulator import Accumulator, Group, Metric, Totals
from .comparison import ALL, Comparison, PairedScan, set_names
from .distances import (
    Classes,
    GospaAccumulator,
    Heights,
    Nearness,
    Numbers,
    OspaAccumulator,
    Pairs,
    Space,
    confusion_matrix,
)
from .tracks import Gaps, Ospa2Accumulator, Switches

# The metrics, each with its accumulator, in the order of tables and keys.
ACCUMULATORS = (
    OspaAccumulator,
    GospaAccumulator,
    Numbers,
    Pairs,
    Gaps,
    consistency.Consistency,
    Ospa2Accumulator,
    Switches,
    Nearness,
    Heights,
    Space,
    Classes,
)
METRICS = tuple(metric for each in ACCUMULATORS for metric in each.metrics)
# Names of all values of a scan.
VALUES = tuple(name for each in ACCUMULATORS for name in each.names)
BY_KEY = {metric.key: metric for metric in METRICS}
# Metrics by group; each group is a table.
GROUPS: dict[Group, tuple[Metric, ...]] = {
    group: tuple(metric for metric in METRICS if metric.group == group)
    for group in dict.fromkeys(metric.group for metric in METRICS)
}
# Metrics of every set in `metrics.json`, and metrics of all targets only.
SET_METRICS = tuple(m for group, metrics in GROUPS.items() if group.of_sets for m in metrics)
GLOBAL_METRICS = tuple(m for group, metrics in GROUPS.items() if not group.of_sets for m in metrics)
# Names of the values that the evaluator publishes per scan and set, and as single numbers.
PUBLISHED = tuple(name for each in ACCUMULATORS for name in each.published)
CURVES = tuple(name for each in ACCUMULATORS for name in each.curves)

# Definitions of further terms that appear with the figures.
TERMS = (
    (
        "Set",
        "The set of all classes compares positions and ignores classes. The set of class k "
        "compares the estimates of class k with the targets of class k, so that a wrong class "
        "counts twice: as missed in one set and as false in the other.",
    ),
    ("OSPA reduction", "1 - mean smoothed OSPA / mean filtered OSPA, of all classes."),
    (
        "Filtered, smoothed",
        "A filtered estimate uses the scans up to its own time, and a smoothed one also the later "
        "scans within the lag. The last scans of a run are smoothed with the fewer scans that "
        "follow them.",
    ),
    ("Step time", "CPU time from the receipt of a scan to the publication of its estimates."),
)


def reduction(before: float | None, after: float | None) -> float | None:
    """Return the relative reduction of a figure; None if a figure is missing or was zero."""
    return 1.0 - after / before if before and after is not None else None


# Values of a scan by set and name; None for a missing value.
ScanValues: TypeAlias = "dict[str, dict[str, float | None]]"


@dataclass(frozen=True)
class ScanScore:
    """The score of one source at one stamp."""

    source: str  # ``filtered`` or ``smoothed``
    stamp_ns: int
    values: ScanValues


class ScanComparer:
    """Compares a source's scans with the truth, in order, by new accumulators."""

    def __init__(self, classes: int, accumulators: Sequence[Accumulator]) -> None:
        self.names = tuple(name for each in accumulators for name in each.names)
        self._classes, self._accumulators = classes, accumulators
        self._newest: dict[str, Comparison] = {}

    def compare(self, scan: PairedScan) -> ScanValues:
        """Return the values of each set at the next scan."""
        for each in self._accumulators:
            each.update(scan)
        self._newest = Comparison.of(scan, self._classes)
        return self._values(last=False)

    def final_values(self) -> ScanValues:
        """Return the values of the newest scan as if the run ended with it."""
        return self._values(last=True)

    def _values(self, last: bool) -> ScanValues:
        found: ScanValues = {}
        for key, newest in self._newest.items():
            part, found[key] = replace(newest, last=last), {}
            for each in self._accumulators:
                found[key].update(zip(each.names, each.values(part), strict=True))
        return found


class RunScores:
    """The figures of one source over a run, from totals of constant size.

    `cutoff` and `order` are c, metres, and p of OSPA and GOSPA.
    """

    def __init__(self, classes: int, cutoff: float, order: float) -> None:
        self.scans = 0
        self._sets = set_names(classes)
        self._comparer = ScanComparer(classes, [each(cutoff, order) for each in ACCUMULATORS])
        # The newest scan is kept apart: if the run ends with it, all open gaps end.
        names = self._comparer.names
        self._before = Totals.of(names, np.zeros((len(self._sets), 0, len(names))))
        self._values: ScanValues = {}
        self._confusion = np.zeros((classes + 1, classes + 1), dtype=np.int64)

    def add(self, scan: PairedScan) -> ScanValues:
        """Add the next scan; return its values by set and name."""
        self.scans += 1
        self._before = self._totals_with(self._values)
        self._values = self._comparer.compare(scan)
        truth, estimate = scan.truth.class_id, scan.estimate.class_id
        self._confusion += confusion_matrix(scan.pairs, truth, estimate, len(self._sets) - 1)
        return self._values

    def figures(self) -> dict[str, dict[str, Any]]:
        """Return the figures of every set in the form of `metrics.json`.

        These are the figures of `SET_METRICS` by set; for all targets also those of
        `GLOBAL_METRICS` and ``confusion``, the `confusion_matrix` of the run. An undefined figure
        is None.
        """
        totals = self._totals()
        of_sets = {metric.key: _by_set(metric, totals) for metric in SET_METRICS}
        result: dict[str, dict[str, Any]] = {
            key: {name: figures[row] for name, figures in of_sets.items()}
            for row, key in enumerate(self._sets)
        }
        result[ALL].update((metric.key, _by_set(metric, totals)[0]) for metric in GLOBAL_METRICS)
        result[ALL]["confusion"] = self._confusion.tolist() if self.scans else None
        return result

    def consistency(self) -> dict[str, Any]:
        """Return the consistency of the covariances, see `consistency.figures`."""
        return consistency.figures(self._totals())

    def headlines(self) -> dict[str, float | None]:
        """Return the figures of all targets at the top level of `metrics.json`."""
        figures = self.figures()[ALL]
        return {key: figures[key] for key, metric in BY_KEY.items() if metric.headline}

    def _totals(self) -> Totals:
        return self._totals_with(self._comparer.final_values())

    def _totals_with(self, newest: ScanValues) -> Totals:
        """Return the totals by set of the earlier scans and of the newest, if any."""
        if not newest:
            return self._before
        rows = [[list(newest[key].values())] for key in self._sets]
        return self._before.plus(Totals.of(self._comparer.names, np.array(rows, dtype=np.float64)))


def _by_set(metric: Metric, totals: Totals) -> list[float | None]:
    """Return a metric of every set, None where undefined."""
    return [None if np.isnan(value) else float(value) for value in metric.of_run(totals)]
