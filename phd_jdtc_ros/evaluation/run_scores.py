"""The table of metrics, collected from their accumulators, and the scores of a run.

`metrics.json`, the tables, the report's page, the evaluator's diagnostics, the Monte Carlo study
and the page of definitions read this table. An `Evaluation` compares estimates with the truth at
the estimates' stamps.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias, TypeVar

import numpy as np

from phd_jdtc_ros.core.types import SMOOTHED, SOURCES

from . import consistency, distances
from .accumulator import Accumulator, Group, Metric, Totals
from .comparison import (
    ALL,
    Comparison,
    PairedScan,
    PointSet,
    TrueTracks,
    class_set,
    set_names,
    without_slow,
)
from .tracks import LONG_GAP_S, OSPA2_WINDOW, Gaps, Ospa2Accumulator, Switches

# The metrics, each with its accumulator, in the order of tables and keys.
ACCUMULATORS = (
    distances.OspaAccumulator,
    distances.GospaAccumulator,
    distances.Numbers,
    distances.Pairs,
    Gaps,
    consistency.Consistency,
    Ospa2Accumulator,
    Switches,
    distances.Nearness,
    distances.Heights,
    distances.Space,
    distances.Classes,
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
        self._confusion += distances.confusion_matrix(
            scan.pairs, truth, estimate, len(self._sets) - 1
        )
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


# Order p of OSPA and GOSPA.
ORDER = 2.0
Key = TypeVar("Key")
Value = TypeVar("Value")
# Source, filtered or smoothed, and stamp.
ScoreKey = tuple[str, int]


@dataclass
class Evaluation:
    """Compares estimates with the truth at their stamps, in any order of arrival, and sums scores.

    Truth is interpolated between samples, see `TrueTracks`; samples must arrive in order. `scores`
    has the last `keep` scores by source and stamp. A stamp is scored once per pass; `repeated` sets
    of a repeated stamp are not scored. A jump back of the truth's stamps, of which there were
    `truth_scans`, begins a new pass, as when a bag is replayed in a loop.
    """

    classes: int
    cutoff: float  # The cutoff c of OSPA and GOSPA, metres
    order: float  # The order p of OSPA and GOSPA
    # Number of scans whose truth, unpaired estimates and scores are kept, which bounds the memory;
    # None keeps all. The summary always covers the whole run.
    keep: int | None = None
    class_names: tuple[str, ...] = ()  # Names in the summary; ``class_0`` and so on if empty
    least_speed: float = 0.0  # Slower targets and their estimates are not scored, metres per second
    scores: dict[str, dict[int, ScanScore]] = field(init=False)
    truth_scans: int = field(init=False, default=0)
    repeated: int = field(init=False, default=0)
    _between: bool = field(init=False, default=False)  # True if estimates came between samples
    _runs: dict[str, RunScores] = field(init=False)
    _truth: TrueTracks = field(init=False)
    _waiting: dict[tuple[str, int], PointSet] = field(init=False, default_factory=dict)
    # The only source with a score so far, by stamp.
    _half: dict[int, str] = field(init=False, default_factory=dict)
    _passes: Passes = field(init=False)
    _scans: int = field(init=False, default=0)
    # Number of slow targets, summed over all scores.
    _slow: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self.scores = {source: {} for source in SOURCES}
        self._truth, self._passes = TrueTracks(self.keep), Passes(self.keep)
        settings = self.classes, self.cutoff, self.order
        self._runs = {source: RunScores(*settings) for source in SOURCES}

    @property
    def scored(self) -> dict[str, int]:
        """Number of scores by source."""
        return {source: run.scans for source, run in self._runs.items()}

    @property
    def own_stamps(self) -> bool:
        """Whether the estimates have their own stamps instead of the stamps of the truth.

        This is so if estimates come between samples, as with turning radars, or if half of the
        samples or more have no estimates, as with a longer period of output.
        """
        apart = max(_interval_ns(scores) for scores in self.scores.values())
        return self._between or apart >= 2.0 * _interval_ns(self._passes.stamps) > 0.0

    def add_truth(self, stamp_ns: int, truth: PointSet) -> list[ScanScore]:
        """Add the targets of a stamp; return the scores that became possible."""
        if not self._passes.add_truth(stamp_ns):
            self.repeated += 1
            return []
        self.truth_scans += 1
        self._truth.add(stamp_ns, truth)
        scores = []
        for source, waiting_ns in sorted(self._waiting, key=_by_stamp):
            targets = self._truth.at(waiting_ns)
            if targets is not None:
                estimate = self._waiting.pop((source, waiting_ns))
                scores.append(self._score(source, waiting_ns, targets, estimate))
        return scores

    def add_estimates(self, source: str, stamp_ns: int, estimate: PointSet) -> list[ScanScore]:
        """Add a source's estimates of a stamp; return the scores that became possible."""
        key = source, stamp_ns
        repeated = self._passes.is_scored(key) or key in self._waiting
        if not self._passes.take_due(key) and repeated:
            self.repeated += 1
            return []
        targets = self._truth.at(stamp_ns)
        if targets is None:
            put(self._waiting, key, estimate, self.keep)
            return []
        return [self._score(source, stamp_ns, targets, estimate)]

    def _score(
        self, source: str, stamp_ns: int, targets: PointSet, estimate: PointSet
    ) -> ScanScore:
        fast, found = without_slow(targets, estimate, self.least_speed, self.cutoff)
        self._slow += len(targets) - len(fast)
        scan = PairedScan.of(stamp_ns, fast, found, self.cutoff)
        score = ScanScore(source, stamp_ns, self._runs[source].add(scan))
        put(self.scores[source], stamp_ns, score, self.keep)
        self._passes.record((source, stamp_ns))
        self._between |= stamp_ns not in self._truth
        if self._half.get(stamp_ns, source) == source:
            put(self._half, stamp_ns, source, self.keep)
        else:
            del self._half[stamp_ns]
            self._scans += 1
        return score

    def summary(self) -> dict[str, Any]:
        """Return the run's figures in the form of `metrics.json`.

        It has the `RunScores.figures` per source; ``reduction`` of the mean OSPA by smoothing; the
        headlines, such as ``class_accuracy``, of the smoothed estimates; ``consistency``, the
        `RunScores.consistency` per source; ``p``, ``c``; ``long_gap_s``; ``ospa2_window`` in scans;
        ``scans``, the number of stamps with scores of both sources; ``truth_scans``, the number of
        stamps of the truth, None if estimates have stamps of their own; ``class_names``;
        ``least_speed``; ``slow_targets``, the mean number of slower targets per score. A figure
        without data is None.
        """
        result: dict[str, Any] = {source: run.figures() for source, run in self._runs.items()}
        result["reduction"] = reduction(*(result[source][ALL]["ospa"] for source in SOURCES))
        result |= self._runs[SMOOTHED].headlines()
        result["consistency"] = {source: run.consistency() for source, run in self._runs.items()}
        result["p"], result["c"] = self.order, self.cutoff
        result["long_gap_s"], result["ospa2_window"] = LONG_GAP_S, OSPA2_WINDOW
        result["scans"] = self._scans
        result["truth_scans"] = None if self.own_stamps else self.truth_scans
        result["least_speed"] = self.least_speed
        result["slow_targets"] = self._slow / max(sum(self.scored.values()), 1)
        result["class_names"] = list(self.class_names or map(class_set, range(self.classes)))
        return result


def _interval_ns(stamps: Iterable[int]) -> float:
    """Return the median interval between stamps; 0 for less than two."""
    intervals = np.diff(sorted(stamps))
    return float(np.median(intervals)) if len(intervals) else 0.0


def _by_stamp(entry: tuple[str, int]) -> tuple[int, int]:
    """Return the sort key of a source and a stamp: by stamp, then by source."""
    source, stamp_ns = entry
    return stamp_ns, SOURCES.index(source)


class Passes:
    """The stamps and scores of the present pass, and the scores due from the previous one.

    The newest `keep` stamps are stored; all of them if it is None.
    """

    # A repeated stamp of the truth begins a new pass if more known stamps than this are
    # later; otherwise it is ignored as a duplicate. RESET_THRESHOLD_SCANS is the tracker's
    # counterpart.
    JUMP_SCANS = 3

    def __init__(self, keep: int | None) -> None:
        self._keep = keep
        self._scored: dict[ScoreKey, None] = {}
        self._due: set[ScoreKey] = set()
        self.stamps: dict[int, None] = {}

    def add_truth(self, stamp_ns: int) -> bool:
        """Add a stamp of the truth; return whether it is new in its pass."""
        if stamp_ns in self.stamps:
            if sum(other > stamp_ns for other in self.stamps) <= self.JUMP_SCANS:
                return False
            self._begin()
        put(self.stamps, stamp_ns, None, self._keep)
        return True

    def take_due(self, key: ScoreKey) -> bool:
        """Return whether a score was due from the previous pass, and expect it no longer."""
        due = key in self._due
        self._due.discard(key)
        return due

    def is_scored(self, key: ScoreKey) -> bool:
        """Return whether a score is recorded in this pass."""
        return key in self._scored

    def record(self, key: ScoreKey) -> None:
        """Record a score."""
        put(self._scored, key, None, None if self._keep is None else len(SOURCES) * self._keep)

    def _begin(self) -> None:
        """Begin a pass; the last estimates of the previous one arrive after its end."""
        stamps = {*self.stamps, *(stamp for _, stamp in self._scored)}
        self._due = {(source, stamp) for source in SOURCES for stamp in stamps}
        self._due.difference_update(self._scored)
        self._scored.clear()
        self.stamps.clear()


def put(store: dict[Key, Value], key: Key, value: Value, most: int | None) -> None:
    """Store the newest entry, and remove the oldest ones beyond `most`."""
    store.pop(key, None)
    store[key] = value
    while most is not None and len(store) > most:
        del store[next(iter(store))]
