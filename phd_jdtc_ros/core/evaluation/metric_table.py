# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every metric in one place: its value of a scan, its figure of a run, how it reads, what it means.

`metrics.json`, the tables, the report's page, the evaluator's diagnostics, the Monte Carlo study
and the page of definitions read these tables. A new metric is a function of a `Comparison` in
`COUNTED` (in `PUBLISHED` if the diagnostics are to have it) and a row in one of the `GROUPS`: the
figure of a run follows from the `Totals` of the scans' values.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ..arrays import FloatArray
from .limits import LONG_GAP_S, OSPA2_WINDOW
from .totals import Totals, ratio

if TYPE_CHECKING:
    # They bring an optimiser with them, which those who only read the tables do without.
    from .scan_scores import Comparison
    from .surveillance import Gap


# None where a scan has no such value.
Value: TypeAlias = "Callable[[Comparison], float | None]"
Figure: TypeAlias = "Callable[[Totals], FloatArray]"

# --- values of a scan -----------------------------------------------------------------------------


def _right_class(scan: Comparison) -> int:
    return int(np.count_nonzero(scan.paired_truth.class_id == scan.paired_estimate.class_id))


def _square_error(scan: Comparison) -> float:
    apart = scan.paired_truth.position - scan.paired_estimate.position
    return float(np.einsum("ij,ij->i", apart, apart).sum())


def _of_gaps(value: Callable[[Sequence[Gap]], float]) -> Value:
    return lambda scan: None if scan.gaps is None else value(scan.gaps)


# What the evaluator publishes of each scan and set.
PUBLISHED: Mapping[str, Value] = {
    "ospa": lambda scan: scan.ospa.distance,
    "localization": lambda scan: scan.ospa.localization,
    "cardinality": lambda scan: scan.ospa.cardinality,
    "gospa": lambda scan: scan.gospa.distance,
    "gospa_localization": lambda scan: scan.gospa.localization,
    "missed": lambda scan: scan.gospa.missed,
    "false": lambda scan: scan.gospa.false,
    "n_true": lambda scan: len(scan.truth),
    "n_est": lambda scan: len(scan.estimate),
}
# What else figures of a run follow from; those of gaps are of the gaps that ended with the scan.
COUNTED: Mapping[str, Value] = {
    "cardinality_abs_error": lambda scan: abs(len(scan.estimate) - len(scan.truth)),
    "pairs": lambda scan: len(scan.paired_truth),
    "right_class": _right_class,
    "square_error": _square_error,
    "gaps": _of_gaps(len),
    "long_gaps": _of_gaps(lambda gaps: sum(gap.is_long for gap in gaps)),
    "missed_in_long_gaps": _of_gaps(lambda gaps: sum(gap.missed for gap in gaps if gap.is_long)),
    "longest_gap_s": _of_gaps(lambda gaps: max((gap.duration_s for gap in gaps), default=0.0)),
}
# What needs labelled estimates.
TRACKED: Mapping[str, Value] = {"ospa2": lambda scan: scan.ospa2}
VALUES: Mapping[str, Value] = {**PUBLISHED, **COUNTED, **TRACKED}


def values_of(scan: Comparison) -> dict[str, float | None]:
    """Return all values of a scan and set, by name."""
    return {name: value(scan) for name, value in VALUES.items()}


# --- figures of a run -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Metric:
    """What a figure of a run is.

    Parameters
    ----------
    key : str
        In `metrics.json` and in a study's summary.
    heading : str
        Over its column.
    unit, form : str
        How it is written: empty without a unit; of Python's format specifications.
    of_run : callable of Totals
        Returns it for each run of the totals, NaN where it has no meaning.
    definition : str
        A sentence or two.
    """

    key: str
    heading: str
    unit: str
    form: str
    of_run: Figure
    definition: str

    def text(self, value: float) -> str:
        """Return a figure as it is written."""
        return f"{value:{self.form}} {self.unit}".rstrip()


def mean(name: str) -> Figure:
    """Return the mean of a value over the scans that have it."""
    return lambda run: run.mean(name)


def share(part: str, whole: str) -> Figure:
    """Return the sum of a value over the run against that of another."""
    return lambda run: ratio(run.sum(part), run.sum(whole))


def root_mean(squares: str, number: str) -> Figure:
    """Return the root of the mean of squares, from their sum and their number in each scan."""
    return lambda run: np.sqrt(share(squares, number)(run))


def if_any(name: str, figure: Figure) -> Figure:
    """Return a figure that has no meaning in a run where a value adds up to nothing."""
    return lambda run: np.where(run.sum(name) > 0, figure(run), np.nan)


OSPA = (
    Metric(
        "ospa",
        "OSPA",
        "m",
        ".1f",
        mean("ospa"),
        "Optimal sub-pattern assignment distance between the estimated and the true positions of "
        "one scan, its mean over the scans. Estimates and targets are paired so that the sum of "
        "the p-th powers of their distances, each cut off at c, is least; a missing or false "
        "target counts as a distance of c; the mean of these powers over the larger set, to the "
        "power 1/p, is the OSPA distance. It is 0 if both sets are empty and c if only one is.",
    ),
    Metric(
        "localization",
        "localisation",
        "m",
        ".1f",
        mean("localization"),
        "The part of the OSPA distance that the paired positions have. The p-th powers of the two "
        "parts add up to that of the distance in every scan; the parts themselves add only for "
        "p = 1.",
    ),
    Metric(
        "cardinality",
        "cardinality",
        "m",
        ".1f",
        mean("cardinality"),
        "The part of the OSPA distance that the wrong number of targets has.",
    ),
    Metric(
        "cardinality_abs_error",
        "number error",
        "",
        ".3f",
        mean("cardinality_abs_error"),
        "Mean over the scans of the absolute difference between the number of estimates and the "
        "number of targets.",
    ),
)
GOSPA = (
    Metric(
        "gospa",
        "GOSPA",
        "m",
        ".1f",
        mean("gospa"),
        "Generalised OSPA distance (alpha = 2) with the same p and c, its mean over the scans: it "
        "is not divided by the number of targets, and every missed and every false target costs "
        "c / 2^(1/p).",
    ),
    Metric(
        "gospa_localization",
        "localisation",
        "m",
        ".1f",
        mean("gospa_localization"),
        "The part of the GOSPA distance that the paired positions have; it is not divided by their "
        "number.",
    ),
    Metric(
        "missed",
        "missed",
        "",
        ".3f",
        mean("missed"),
        "Mean number per scan of targets that GOSPA pairs with no estimate.",
    ),
    Metric(
        "false",
        "false",
        "",
        ".3f",
        mean("false"),
        "Mean number per scan of estimates that GOSPA pairs with no target.",
    ),
)
SURVEILLANCE = (
    Metric(
        "position_rms",
        "position RMS",
        "m",
        ".1f",
        root_mean("square_error", "pairs"),
        "Root mean square, over all pairs of the run, of the distance between a target and the "
        "estimate that it is paired with, by position alone, closer than c.",
    ),
    Metric(
        "position_detection",
        "position detected",
        "",
        ".2%",
        share("pairs", "n_true"),
        "Share of the targets, over all scans, that are paired with an estimate, by position "
        "alone, closer than c.",
    ),
    Metric(
        "longest_gap_s",
        "longest gap",
        "s",
        ".1f",
        if_any("n_true", lambda run: run.maximum("longest_gap_s")),
        "The longest of all gaps. A gap is a time that a living target goes without a paired "
        "estimate: from the estimate before to the one after or, where there is none, from the "
        "target's first scan or to its last.",
    ),
    Metric(
        "long_gap_share",
        "long gaps",
        "",
        ".1%",
        # Without a gap there is no long one.
        if_any("n_true", lambda run: run.sum("long_gaps") / np.maximum(run.sum("gaps"), 1)),
        f"Share of the gaps that last longer than {LONG_GAP_S:g} s.",
    ),
    Metric(
        "long_gap_misses",
        "missed in them",
        "",
        ".2%",
        share("missed_in_long_gaps", "n_true"),
        "Share of the targets, over all scans, that are missed in a long gap.",
    ),
)
OSPA2 = Metric(
    "ospa2",
    "OSPA(2)",
    "m",
    ".1f",
    if_any("n_est", lambda run: ratio(run.sum("ospa2"), run.scans)),
    f"OSPA distance between the tracks and the targets' tracks over the last {OSPA2_WINDOW} scans, "
    "its mean over the scans. The distance of two tracks is the mean over the scans in which "
    "either exists, c where only one does: short, broken and swapped tracks count. Only where all "
    "targets and estimates have track ids.",
)
CLASS_ACCURACY = Metric(
    "class_accuracy",
    "class accuracy",
    "",
    ".1%",
    share("right_class", "pairs"),
    "Estimates, those of the smoother in a report, are paired with targets by position alone, "
    "closer than c; the class accuracy is the share of these pairs with the right class. Missed "
    "and false targets do not enter it.",
)
# In `metrics.json` of every set, and a table each on the terminal.
GROUPS = {"OSPA": OSPA, "GOSPA": GOSPA, "surveillance figures": SURVEILLANCE}
OF_SETS = tuple(metric for group in GROUPS.values() for metric in group)
# Of all targets alone.
OF_ALL = (OSPA2,)
METRICS = (*OF_SETS, *OF_ALL, CLASS_ACCURACY)

# What other words mean that stand beside the figures.
TERMS = (
    (
        "Set",
        "All classes compares positions whatever their class. Class k compares the estimates of "
        "class k with the targets of class k, so a wrong class counts twice: missing in one, false "
        "in the other.",
    ),
    ("OSPA reduction", "1 - mean smoothed OSPA / mean filtered OSPA, of all classes."),
    (
        "Filtered, smoothed",
        "A filtered estimate uses the scans up to its own time, a smoothed one also the scans that "
        "followed within the lag. The last scans of a run are smoothed with those that were left.",
    ),
    ("Step time", "CPU time from the receipt of a scan to the publication of its estimates."),
)


def reduction(before: float | None, after: float | None) -> float | None:
    """Return by which share a figure became less; None where there is none to compare."""
    return 1.0 - after / before if before and after is not None else None
