"""The table of metrics: value per scan, figure per run, heading, format and definition.

`metrics.json`, the tables, the report's page, the evaluator's diagnostics, the Monte Carlo study
and the page of definitions read this table. A new metric is a function of a `Comparison` in
`COUNTED`, or in `PUBLISHED` if the diagnostics shall have it, and a row in one of the `GROUPS`. The
figure of a run is computed from the `Totals` of the scans' values.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray

from . import consistency
from .limits import LONG_GAP_S, NEAR, OSPA2_WINDOW
from .totals import Totals, ratio

if TYPE_CHECKING:
    # These modules import scipy's optimiser, which readers of the table alone do not need.
    from .scan_scores import Comparison
    from .surveillance import Gap


# Returns None for a scan without such a value.
Value: TypeAlias = "Callable[[Comparison], float | None]"
Figure: TypeAlias = "Callable[[Totals], FloatArray]"
Group: TypeAlias = "tuple[Metric, ...]"

# --- values per scan ------------------------------------------------------------------------------


def _right_class(scan: Comparison) -> int:
    return int(np.count_nonzero(scan.paired_truth.class_id == scan.paired_estimate.class_id))


def _square_error(scan: Comparison) -> float:
    error = scan.paired_truth.position - scan.paired_estimate.position
    return float(np.einsum("ij,ij->i", error, error).sum())


def _near(scan: Comparison) -> int:
    error = scan.paired_truth.position - scan.paired_estimate.position
    return int(np.count_nonzero(np.einsum("ij,ij->i", error, error) < NEAR**2))


def _beyond(scan: Comparison) -> int:
    apart = scan.estimate.position[:, None] - scan.truth.position
    nearest = np.hypot(apart[..., 0], apart[..., 1]).min(axis=1, initial=np.inf)
    return int(np.count_nonzero(nearest > scan.cutoff))


def _of_gaps(value: Callable[[Sequence[Gap]], float]) -> Value:
    return lambda scan: None if scan.gaps is None else value(scan.gaps)


# Values that the evaluator publishes per scan and set.
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
# Those among them that the evaluator publishes as single numbers too, for plots.
PLOTTED = ("ospa", "localization", "n_true", "n_est")
# Further values that figures of a run need; those of gaps are of the gaps that ended in the scan.
COUNTED: Mapping[str, Value] = {
    "cardinality_abs_error": lambda scan: abs(len(scan.estimate) - len(scan.truth)),
    "pairs": lambda scan: len(scan.paired_truth),
    "right_class": _right_class,
    "square_error": _square_error,
    "near": _near,
    "heights": lambda scan: len(scan.height_error),
    "height_square_error": lambda scan: float((scan.height_error**2).sum()),
    "beyond": _beyond,
    "gaps": _of_gaps(len),
    "long_gaps": _of_gaps(lambda gaps: sum(gap.is_long for gap in gaps)),
    "missed_in_long_gaps": _of_gaps(lambda gaps: sum(gap.missed for gap in gaps if gap.is_long)),
    "longest_gap_s": _of_gaps(lambda gaps: max((gap.duration_s for gap in gaps), default=0.0)),
    **{
        name: value
        for ages in consistency.AGE_GROUPS
        for name, value in consistency.values(ages).items()
    },
}
# Values that need labelled estimates.
TRACKED: Mapping[str, Value] = {
    "ospa2": lambda scan: scan.ospa2,
    "identity_switches": lambda scan: scan.identity_switches,
    "seen_switches": lambda scan: scan.seen_switches,
}
VALUES: Mapping[str, Value] = {**PUBLISHED, **COUNTED, **TRACKED}


def values_of(scan: Comparison) -> dict[str, float | None]:
    """Return all values of a scan and set, by name."""
    return {name: value(scan) for name, value in VALUES.items()}


# --- figures per run ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Metric:
    """A figure of a run.

    Parameters
    ----------
    key : str
        Its key in `metrics.json` and in a study's summary.
    heading : str
        Heading of its column.
    unit, form : str
        Unit, empty if there is none, and Python format specification.
    of_run : callable of Totals
        Returns the figure of each run of the totals, NaN where it has no meaning.
    definition : str
        One or two sentences.
    """

    key: str
    heading: str
    unit: str
    form: str
    of_run: Figure
    definition: str

    def text(self, value: float) -> str:
        """Return a figure as text, with its unit; lengths below a metre have two digits."""
        form = "#.2g" if self.unit == "m" and 5e-4 <= abs(value) < 0.995 else self.form
        return f"{value:{form}} {self.unit}".rstrip()


def mean(name: str) -> Figure:
    """Return the figure that is the mean of a value over the scans that have it."""
    return lambda run: run.mean(name)


def share(part: str, whole: str) -> Figure:
    """Return the figure that is the ratio of two values' sums over the run."""
    return lambda run: ratio(run.sum(part), run.sum(whole))


def root_mean(squares: str, number: str) -> Figure:
    """Return the figure that is a root mean square, from the squares' sum and number per scan."""
    return lambda run: np.sqrt(share(squares, number)(run))


def if_any(name: str, figure: Figure) -> Figure:
    """Return a figure that has no meaning in runs in which the sum of a value is zero."""
    return lambda run: np.where(run.sum(name) > 0, figure(run), np.nan)


OSPA = (
    Metric(
        "ospa",
        "OSPA",
        "m",
        ".1f",
        mean("ospa"),
        "Mean over the scans of the optimal sub-pattern assignment distance between the estimated "
        "and the true positions of a scan. Estimates and targets are paired so that the sum of "
        "the p-th powers of their distances, each cut off at c, is least. A missed or false "
        "target counts as a distance of c. The OSPA distance is the mean of these powers over the "
        "larger set, to the power 1/p. It is 0 if both sets are empty and c if only one is.",
    ),
    Metric(
        "localization",
        "localisation",
        "m",
        ".1f",
        mean("localization"),
        "The part of the OSPA distance due to the position errors of the pairs. The p-th powers of "
        "the two parts add up to that of the distance in every scan; the parts themselves add only "
        "for p = 1.",
    ),
    Metric(
        "cardinality",
        "cardinality",
        "m",
        ".1f",
        mean("cardinality"),
        "The part of the OSPA distance due to the wrong number of targets.",
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
        "Mean over the scans of the generalised OSPA distance (alpha = 2) with the same p and c. "
        "It is not divided by the number of targets, and every missed and every false target "
        "costs c / 2^(1/p).",
    ),
    Metric(
        "gospa_localization",
        "localisation",
        "m",
        ".1f",
        mean("gospa_localization"),
        "The part of the GOSPA distance due to the position errors of the pairs; it is not divided "
        "by their number.",
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
        "The longest of all gaps. A gap is a time in which an existing target has no paired "
        "estimate. It lasts from the previous estimate, or else the target's first scan, to the "
        "next estimate, or else its last scan.",
    ),
    Metric(
        "long_gap_share",
        "long gaps",
        "",
        ".1%",
        # The share is 0 in a run without gaps.
        if_any("n_true", lambda run: run.sum("long_gaps") / np.maximum(run.sum("gaps"), 1)),
        f"Share of the gaps that last longer than {LONG_GAP_S:g} s.",
    ),
    Metric(
        "long_gap_misses",
        "missed in them",
        "",
        ".2%",
        share("missed_in_long_gaps", "n_true"),
        "Share of the targets, over all scans, that are missed in long gaps.",
    ),
)


def _by_age(heading: str, short: str, definition: str, key: str, part: str, form: str) -> Group:
    """Return a share of the judged pairs: of all ages, and of each group of ages."""
    texts = [
        (heading, definition),
        *((f"{short} age {ages.text}", _of_ages(heading, ages)) for ages in consistency.AGES),
    ]
    return tuple(
        Metric(ages.key(key), head, "", form, share(ages.key(part), ages.key(JUDGED)), text)
        for ages, (head, text) in zip(consistency.AGE_GROUPS, texts, strict=True)
    )


def _of_ages(heading: str, ages: consistency.Ages) -> str:
    last = "or more" if ages.last == consistency.OLDEST else f"to {ages.last}"
    return (
        f"{heading[0].upper()}{heading[1:]} of the estimates whose track number was first reported "
        f"{ages.first} {last} scans before."
    )


JUDGED = consistency.PAIRS
NEES = _by_age(
    "NEES",
    "NEES",
    "Normalised estimation error squared of the position, divided by 2: the mean over the pairs of "
    "half the squared Mahalanobis distance of the true position from the estimate. It is 1 if the "
    "covariances are right, and larger if they are too small. Estimates without a positive "
    "definite covariance are left out.",
    "nees",
    consistency.NEES,
    "#.3g",
)
OUTSIDE = _by_age(
    "outside 3 sigma",
    "outside",
    "Share of the pairs with a covariance in which the Mahalanobis distance of the position is "
    f"above {consistency.BOUND:g}. It is {consistency.EXPECTED_OUTSIDE:.1%} if the covariances are "
    "right and the errors are normal.",
    "outside_3_sigma",
    consistency.OUTSIDE,
    ".1%",
)
OSPA2 = Metric(
    "ospa2",
    "OSPA(2)",
    "m",
    ".1f",
    if_any("n_est", lambda run: ratio(run.sum("ospa2"), run.scans)),
    f"OSPA distance between the tracks and the targets' tracks over the last {OSPA2_WINDOW} scans, "
    "its mean over the scans. The distance of two tracks is the mean over the scans in which at "
    "least one exists, with c if only one does, so that short, broken and swapped tracks count. It "
    "needs track ids of all targets and estimates.",
)
POSITION_NEAR = Metric(
    "position_near",
    f"within {NEAR:g} m",
    "",
    ".2%",
    share("near", "n_true"),
    f"Share of the targets, over all scans, that are paired with an estimate closer than {NEAR:g} "
    "m, and than c.",
)
IDENTITY_SWITCHES = Metric(
    "identity_switches",
    "identity switches",
    "",
    ".0f",
    if_any("n_est", lambda run: run.sum("identity_switches")),
    "Number over the run of targets that are paired with another track id than before, and of "
    "track ids that pass to another target: a broken track counts one, two swapped tracks count "
    "two. A target and a track stay a pair while both exist, closer than c; the others are paired "
    "by position. It needs track ids of all targets and estimates.",
)
SEEN_SWITCHES = Metric(
    "seen_switches",
    "identity switches, seen",
    "",
    ".0f",
    if_any("n_est", lambda run: run.sum("seen_switches")),
    "The same without new pairs of tracks that coast: they had no detection, keep their targets, "
    "and get no others. A track that coasts on for a turn after its target has landed is so no "
    "track of one that takes off beside it. Tracks whose state is not known do not coast.",
)
HEIGHT_RMS = Metric(
    "height_rms",
    "height RMS",
    "m",
    ".1f",
    root_mean("height_square_error", "heights"),
    "Root mean square, over all pairs of the run whose true and estimated heights are known, of "
    "the difference of the two.",
)
FALSE_PER_SCAN = Metric(
    "false_per_scan",
    "false per scan",
    "",
    ".3f",
    mean("beyond"),
    "Mean number per scan of estimates that are farther than c from every target. A second "
    "estimate of a target is none of them; `false` counts it too.",
)
CLASS_ACCURACY = Metric(
    "class_accuracy",
    "class accuracy",
    "",
    ".1%",
    share("right_class", "pairs"),
    "Share of the pairs with the right class. Pairs are of an estimate and a target, by position "
    "alone, closer than c; in a report the estimates are those of the smoother. Missed and false "
    "targets are left out.",
)
# Figures of every set in `metrics.json`; each group is a table on the terminal.
GROUPS = {
    "OSPA": OSPA,
    "GOSPA": GOSPA,
    "surveillance figures": SURVEILLANCE,
    "NEES / 2 of positions, by age in scans": NEES,
    "positions outside 3 sigma, by age in scans": OUTSIDE,
}
OF_SETS = tuple(metric for group in GROUPS.values() for metric in group)
# Figures of all targets only.
OF_ALL = (OSPA2, IDENTITY_SWITCHES, SEEN_SWITCHES, FALSE_PER_SCAN, POSITION_NEAR, HEIGHT_RMS)
METRICS = (*OF_SETS, *OF_ALL, CLASS_ACCURACY)

# Definitions of other terms that are shown with the figures.
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
