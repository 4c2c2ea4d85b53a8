"""Whether said probabilities and covariances are right, on truth drawn from the tracker's model.

Targets, their classes, SNR, motion and deaths, and all detections are drawn from the model of the
reference scenario without spawned targets. Existence probabilities are scored for all targets above
one percent, reported or not, classes and covariances for the likely ones.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.engines import gaussian_engine
from phd_jdtc_ros.core.arrays import BoolArray
from phd_jdtc_ros.core.gaussian.entries import Entry
from phd_jdtc_ros.core.gaussian.extraction import extract
from phd_jdtc_ros.core.gaussian.smoothing.smoother import backward_pass
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, Estimates, Scan, Truth
from phd_jdtc_ros.exit_status import ArgumentParser
from phd_jdtc_ros.parameter_files import from_arguments

from ..runner import Figures, Goal, Study, goal, table
from .diagram import ENOUGH, TOLERANCE, draw
from .drawn_truth import drawn_run
from .scores import CLASS_EDGES, EXISTENCE_EDGES, LEAST, Bins, Errors, Reliability, of_run, pooled

GIVEN: Mapping[str, Any] = {**from_arguments.profile(from_arguments.REFERENCE), "spawn.rate": 0.0}
# Every target keeps an SNR of its own, and the truth has it whatever a tracker assumes.
TRUE: Mapping[str, Any] = {**GIVEN, "amplitude": "memory"}
LAGS = {FILTERED: 0, SMOOTHED: 5}
KINDS = {"existence": EXISTENCE_EDGES, "class": CLASS_EDGES}
# Largest share of covered targets outside 3 sigma; 1.1 % if errors are normal.
MOST_OUTSIDE = 0.02
# Separates the streams of truth from others of the same seed.
STREAM = 7


def measure(arguments: argparse.Namespace, seed: int) -> Figures:
    """Return the sums of a run, by source."""
    truth_of = resolve(TRUE)
    run = drawn_run(truth_of.model, arguments.scans, np.random.default_rng([seed, STREAM]))
    truths, scans = [truth for truth, _ in run], [scan for _, scan in run]
    covered = [_covered(truth, truth_of) for truth in truths]
    estimates = posteriors(scans, resolve(GIVEN), tuple(LAGS.values()), LEAST)
    found: Figures = {}
    for source, lag in LAGS.items():
        last = len(scans) - lag
        scores = of_run(truths[:last], covered[:last], estimates[lag])
        found[source] = {
            "existence": _stored(scores.existence),
            "class": _stored(scores.target_class),
            "errors": _stored(scores.errors),
        }
    return found


def _stored(sums: Reliability | Errors) -> dict[str, list[float]]:
    return {name: column.tolist() for name, column in sums._asdict().items()}


def posteriors(
    scans: Sequence[Scan], config: TrackerConfig, lags: Sequence[int], least: float
) -> dict[int, list[Estimates]]:
    """Return every target whose existence probability is above `least`, by lag, confirmed or not.

    The list of lag l has the estimates at the scans 0, 1 and so on, except at the last l ones.
    """
    forward, window = gaussian_engine(config).forward, list[Entry]()
    found: dict[int, list[Estimates]] = {lag: [] for lag in lags}
    for index, scan in enumerate(scans):
        window = [*window, forward.step(scan, linked=max(lags) > 0)][-(max(lags) + 1) :]
        for lag, stored in enumerate(backward_pass(window)):
            if lag in found:
                stamp_ns = scans[index - lag].stamp_ns
                found[lag].append(extract(stored, forward.dynamics, stamp_ns, lag, least))
    return found


def _covered(truth: Truth, config: TrackerConfig) -> BoolArray:
    """Return whether any radar can see each target."""
    radars = polar_radars(config.model.radars)
    sees = [
        radar.visibility.probability_in_view(radar.measure(truth.state)) > 0.0 for radar in radars
    ]
    covered: BoolArray = np.any(sees, axis=0)
    return covered


def combined(found: Sequence[Figures]) -> Figures:
    """Return the reliability in bins and the errors over all runs, by source."""
    return {"gaussian": {source: _over_runs([run[source] for run in found]) for source in LAGS}}


def _over_runs(runs: Sequence[Mapping[str, Any]]) -> Figures:
    result: Figures = {}
    for kind in KINDS:
        columns = [np.array([run[kind][name] for run in runs]) for name in Reliability._fields]
        bins = pooled(Reliability(*columns))
        result[kind] = {
            name: [None if np.isnan(value) else value for value in column.tolist()]
            for name, column in bins._asdict().items()
        }
    sums = Errors(
        *(np.sum([run["errors"][name] for run in runs], axis=0) for name in Errors._fields)
    )
    for row, name in enumerate(("covered", "uncovered")):
        pairs = float(sums.pairs[row])
        result[name] = {
            "pairs": pairs,
            "nees": float(sums.nees[row]) / pairs if pairs else None,
            "outside_3_sigma": float(sums.outside[row]) / pairs if pairs else None,
        }
    return result


def _bins(stored: Mapping[str, Sequence[float | None]]) -> Bins:
    return Bins(*(np.array(stored[name], dtype=float) for name in Bins._fields))


def tables(figures: Figures) -> list[Table]:
    """Return the table of covariances, and those of probabilities."""
    rows = [
        (
            f"gaussian, {source}",
            *(
                _cell(of_source[where][name], text)
                for where in ("covered", "uncovered")
                for name, text in (("nees", "{:.2f}"), ("outside_3_sigma", "{:.1%}"))
            ),
            *(_cell(_worst(of_source[kind]), "{:.3f}") for kind in KINDS),
        )
        for source, of_source in figures["gaussian"].items()
    ]
    headings = ("estimates", "NEES", "outside 3 sigma", "NEES, no coverage", "outside, no coverage")
    worst = (f"largest error of {kind}" for kind in KINDS)
    found = [table("covariances and probabilities", (*headings, *worst), rows)]
    return found + [_reliability(kind, edges, figures["gaussian"]) for kind, edges in KINDS.items()]


def _cell(value: float | None, text: str) -> str:
    return "-" if value is None else text.format(value)


def _worst(stored: Mapping[str, Sequence[float | None]]) -> float | None:
    """Return the largest error of a bin with enough statements; None without any."""
    bins = _bins(stored)
    apart = np.abs(bins.right - bins.said)[bins.number >= ENOUGH]
    return float(apart.max()) if len(apart) else None


def _reliability(kind: str, edges: Sequence[float], figures: Mapping[str, Any]) -> Table:
    rows = []
    for index, (low, high) in enumerate(pairwise(edges)):
        cells = [f"{low:.2f} to {high:.2f}"]
        for of_source in figures.values():
            bins = _bins(of_source[kind])
            number, said, right, least, most = (column[index] for column in bins)
            known = f"{said:.3f}: {right:.3f} ({least:.2f} to {most:.2f})" if number else "-"
            cells += [f"{number:.0f}", known]
        rows.append(cells)
    headings = [f"{source}, {what}" for source in figures for what in ("number", "said: right")]
    return table(f"{kind} probability", ("bin", *headings), rows)


def goals(figures: Figures) -> list[Goal]:
    """Return the goals: shares of full bins, and errors of targets in coverage."""
    found = []
    for source, of_source in figures["gaussian"].items():
        name = f"calibration, gaussian, {source}"
        for kind in KINDS:
            worst = _worst(of_source[kind])
            found.append(goal(f"{name}, {kind} probability", worst, TOLERANCE))
        outside = of_source["covered"]["outside_3_sigma"]
        found.append(goal(f"{name}, outside 3 sigma", outside, MOST_OUTSIDE))
    return found


def pictures(figures: Figures) -> dict[str, Figure]:
    """Return the reliability diagram."""
    sources = figures["gaussian"]
    return {
        "reliability.png": draw(
            {
                kind: {source: _bins(of_source[kind]) for source, of_source in sources.items()}
                for kind in KINDS
            },
            KINDS,
        )
    }


def _add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("--scans", type=int, default=100, help="scans per run (%(default)s)")


STUDY = Study(
    name="calibration",
    purpose=__doc__.split("\n", 1)[0],
    measure=measure,
    tables=tables,
    goals=goals,
    seed=62000,
    runs=400,
    in_summary="reliability",
    add_arguments=_add_arguments,
    combined=combined,
    pictures=pictures,
)
