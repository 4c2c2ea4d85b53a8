"""The results of a study: all runs of each variant, means over runs, and goals."""

from __future__ import annotations

import contextlib
import gzip
import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import special

from phd_jdtc_ros.configuration import build as tracker_config
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.evaluation.accumulator import Totals, ratio
from phd_jdtc_ros.evaluation.comparison import ALL

from .definition import METRICS, ORDER, REDUCTION, Goal, Study, Variant, merge_layers
from .metrics import VALUES
from .tasks import HEADER, Outcome, Scores, Store, Task


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
        """Return one of `FIGURES` for a lag, a value per run; None if it is not defined."""
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


class Mean(NamedTuple):
    """A mean over runs and half the width of its 95 % confidence interval; NaN if unknown."""

    mean: float
    half_width: float

    @staticmethod
    def of(runs: FloatArray | None) -> Mean:
        """Return the mean of independent runs with Student's t interval; NaNs are left out."""
        known = np.zeros(0) if runs is None else runs[np.isfinite(runs)]
        count = len(known)
        if count < 2:
            return Mean(float(known[0]) if count else math.nan, math.nan)
        error = known.std(ddof=1) / math.sqrt(count)
        return Mean(float(known.mean()), _quantile(count - 1) * float(error))

    def as_json(self) -> dict[str, Any] | None:
        """Return the mean and its interval for JSON; None for unknown values."""
        if math.isnan(self.mean):
            return None
        low, high = self.mean - self.half_width, self.mean + self.half_width
        interval = None if math.isnan(self.half_width) else [low, high]
        return {"mean": self.mean, "interval_95": interval}


@cache
def _quantile(degrees: int) -> float:
    """Return the 97.5 % quantile of Student's t."""
    return float(special.stdtrit(degrees, 0.975))


def collect(tasks: Iterable[Task], store: Store) -> list[Result]:
    """Return all stored results of a plan's tasks, ordered by case and variant."""
    results = []
    for (case, _), entries in _tasks_by_variant(tasks).items():
        runs = [(task.seed, store.read(task, variant)) for task, variant in entries]
        known = [(seed, scores) for seed, scores in runs if scores is not None]
        if known:
            values = np.stack([scores.values for _, scores in known])
            taken = [s.taken_for for _, s in known if s.taken_for is not None]
            taken_for = np.stack(taken) if taken else None
            scores = known[0][1]._replace(values=values, taken_for=taken_for)
            seeds = tuple(seed for seed, _ in known)
            results.append(Result(case, entries[0][1], seeds, scores))
    return results


def write_csv(path: Path, tasks: Iterable[Task], store: Store) -> None:
    """Write all stored rows of a plan's tasks to one file, ordered by case, variant and seed."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    with temporary.open("wb") as file:
        file.write((",".join(HEADER) + "\n").encode())
        for entries in _tasks_by_variant(tasks).values():
            for task, variant in entries:
                with contextlib.suppress(FileNotFoundError):
                    rows = gzip.decompress(store.path(task, variant).read_bytes())
                    file.write(rows.partition(b"\n")[2])
    os.replace(temporary, path)


def _tasks_by_variant(tasks: Iterable[Task]) -> dict[tuple[str, str], list[tuple[Task, Variant]]]:
    """Return the tasks and variants of a plan, by the names of case and variant."""
    entries: dict[tuple[str, str], list[tuple[Task, Variant]]] = {}
    for task in tasks:
        for variant in task.variants:
            entries.setdefault((task.case, variant.name), []).append((task, variant))
    return entries


def summarise(
    study: Study, results: Sequence[Result], notes: Sequence[str], failures: Sequence[Outcome]
) -> dict[str, Any]:
    """Return a study's figures in the form of `summary.json`.

    `notes` are the omitted variants, with the reasons, and `failures` the failed tasks.

    ``cases`` has by case and variant: its kind, engine (None for other trackers), number of runs,
    seeds and, by lag and set, the mean over runs of each of `FIGURES` with its 95 % interval, None
    if undefined. ``reduction`` is the reduction of the mean OSPA against lag 0 of the same variant
    and seed. ``confusion`` of a class has the shares of its targets estimated as each class or
    missed; ``confusion`` of all targets is the mean over runs of the confusion matrix, summed over
    the scans. ``c_of_case`` has the cut-off, metres, of each case with its own.
    """
    cases: dict[str, Any] = {}
    for result in results:
        cases.setdefault(result.case, {})[result.variant.name] = {
            "kind": result.variant.kind.name,
            "engine": _engine(study, result),
            "runs": len(result.seeds),
            "seeds": list(result.seeds),
            "lags": {
                str(lag): {key: _figures(result, lag, key) for key in result.scores.sets}
                for lag in result.scores.lags
            },
        }
    return {
        "p": ORDER,
        "c": study.cutoff,
        "c_of_case": {c.name: c.cutoff for c in study.cases if c.cutoff is not None},
        "cases": cases,
        "goals": [_goal_with_value(goal, results) for goal in study.goals],
        "notes": list(notes),
        "failed": [
            {
                "case": outcome.task.case,
                "variants": [variant.name for variant in outcome.task.variants],
                "seed": outcome.task.seed,
                "error": outcome.error.strip().splitlines()[-1],
            }
            for outcome in failures
        ],
    }


def _engine(study: Study, result: Result) -> str | None:
    if not result.variant.kind.ours:
        return None
    of_case = {case.name: case.parameters for case in study.cases}.get(result.case, {})
    given = merge_layers(of_case, result.variant.parameters, study.assigned)
    return tracker_config.resolve(given).engine


def _figures(result: Result, lag: int, of_set: str) -> dict[str, Any]:
    figures = result.figures(lag, of_set).items()
    means = {name: Mean.of(runs).as_json() for name, runs in figures}
    return {**means, "confusion": _confusion(result, lag, of_set)}


def _confusion(result: Result, lag: int, of_set: str) -> Any:
    """Return a class's row of the confusion matrix as shares, or the whole matrix for all."""
    matrix = result.confusion(lag)
    if matrix is None:
        return None
    if of_set == ALL:
        return matrix.mean(axis=0).tolist()
    row = matrix[:, int(of_set.removeprefix("class_"))]
    names = [*result.scores.sets[1:], "missed"]
    shares = {name: ratio(row[:, k], row.sum(axis=1)) for k, name in enumerate(names)}
    return {name: Mean.of(share).as_json() for name, share in shares.items()}


def _goal_with_value(goal: Goal, results: Sequence[Result]) -> dict[str, Any]:
    """Return a goal with its value, None if the study has no such figure."""
    own = _runs(goal, goal.case, goal.variant, results)
    bound = goal.bound
    if goal.relative_to is not None:
        # The numbers of runs may differ between both variants.
        other = _runs(goal, goal.relative_case, goal.relative_to, results)
        common = own.keys() & other.keys()
        own, other = ({seed: runs[seed] for seed in sorted(common)} for runs in (own, other))
        bound *= _mean(other)
    value = _mean(own)
    reached = value <= bound if goal.at_most else value >= bound
    known = math.isfinite(value) and math.isfinite(bound)
    return {
        "name": goal.name,
        "value": value if math.isfinite(value) else None,
        "goal": bound if math.isfinite(bound) else None,
        "at_most": goal.at_most,
        "reached": reached if known else None,
    }


def _runs(goal: Goal, case: str, variant: str, results: Sequence[Result]) -> dict[int, float]:
    """Return the goal's figure of every run, by seed, without runs in which it is undefined."""
    for result in results:
        matches = (result.case, result.variant.name) == (case, variant)
        if matches and goal.lag in result.scores.lags:
            figure = result.figure(goal.figure, goal.lag)
            if figure is not None:
                return dict(zip(result.seeds, figure.tolist(), strict=True))
    return {}


def _mean(runs: dict[int, float]) -> float:
    return Mean.of(np.array([*runs.values()])).mean
