"""The evaluation of a run: compares estimates with the truth at the estimates' stamps."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from phd_jdtc_ros.core.types import SMOOTHED, SOURCES

from .comparison import ALL, PairedScan, PointSet, TrueTracks, class_set, without_slow
from .run_scores import RunScores, ScanScore, reduction
from .tracks import LONG_GAP_S, OSPA2_WINDOW

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
    cutoff: float  # c of OSPA and GOSPA, metres
    order: float  # p of OSPA and GOSPA
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
