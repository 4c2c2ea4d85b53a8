"""The table of metrics, collected from their accumulators.

`metrics.json`, the tables, the report's page, the evaluator's diagnostics, the Monte Carlo study
and the page of definitions read this table.
"""

from __future__ import annotations

from .accumulator import Group, Metric
from .accumulators import ACCUMULATORS

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
