"""The runner of all studies: seeds, goals, tables and files."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from phd_jdtc_ros import output_files
from phd_jdtc_ros.exit_status import FAILED, OK, ArgumentParser
from phd_jdtc_ros.report.table import simple_table
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.study.results import Mean
from phd_jdtc_ros.tools import command

OUT = Path("out/study")
# Name of the Monte Carlo study's summary, to which figures and goals of other studies are added.
SUMMARY = "summary.json"
# Least width of the printed tables, so that no cell is cut.
WIDTH = 116

# Values that JSON can represent.
Figures: TypeAlias = "dict[str, Any]"
Goal: TypeAlias = "dict[str, Any]"


class StudyError(Exception):
    """A study cannot be completed; the message has the reason."""


@dataclass(frozen=True)
class Study:
    """One question with its measurement, tables and goals."""

    name: str
    purpose: str  # One sentence for the command's help
    measure: Callable[[argparse.Namespace, int], Figures]  # Computes the figures of a seed
    tables: Callable[[Figures], Sequence[Table | str]]  # Returns tables and lines that show figures
    # Returns the goals, given the figures of one seed.
    goals: Callable[[Figures], list[Goal]] = lambda _: []
    # Returns whether all figures are available; the exit status is a failure otherwise.
    complete: Callable[[Figures], bool] = lambda _: True
    # `seed`, `runs`: default first seed and number of seeds; 0 runs if the study is not random.
    seed: int = 0
    runs: int = 1
    # Shortest part of the scenario that has figures; None if it cannot be shortened.
    least_minutes: float | None = None
    has_parameters: bool = False  # True if the command takes parameters of the tracker
    # Name of its figures in the Monte Carlo study's summary, which has its goals too; empty if they
    # are not added to it.
    in_summary: str = ""
    # Adds the study's own arguments.
    add_arguments: Callable[[ArgumentParser], None] = lambda _: None
    # Combines the figures of all seeds, for tables and for goals that single seeds cannot have.
    # None for means of figures and of the seeds' goals; the figures of several seeds then have
    # half the widths of their 95 % intervals, in the same form, in `half_width`.
    combined: Callable[[Sequence[Figures]], Figures] | None = None
    # Returns pictures by file name.
    pictures: Callable[[Figures], Mapping[str, Figure]] = lambda _: {}


def goal(name: str, value: float | None, bound: float, at_most: bool = True) -> Goal:
    """Return a goal in the form of a summary; without a value it is neither reached nor missed."""
    reached = None if value is None else bool(value <= bound if at_most else value >= bound)
    known = None if value is None else float(value)
    return {"name": name, "value": known, "goal": bound, "at_most": at_most, "reached": reached}


def run(study: Study, argv: Sequence[str]) -> int:
    """Run a study; return its exit status."""
    return command.run(_parser(study), argv, partial(_work, study))


def _parser(study: Study) -> ArgumentParser:
    parser = ArgumentParser(f"studies {study.name}", description=study.purpose)
    study.add_arguments(parser)
    if study.runs:
        parser.add_argument("--runs", type=int, default=study.runs, help="seeds (%(default)s)")
        parser.add_argument("--seed", type=int, default=study.seed, help="first one (%(default)s)")
    if study.least_minutes is not None:
        parser.add_argument("--minutes", type=float, help="the first of the scenario only")
    if study.has_parameters:
        command.add_params_file_argument(parser)
        command.add_assignments_argument(parser)
    parser.add_argument("--out", type=Path, default=OUT, help="%(default)s")
    return parser


def _work(study: Study, arguments: argparse.Namespace) -> int:
    lowest = {"seed": 0, "runs": 1, "minutes": study.least_minutes or 0.0}
    command.require_least(arguments, lowest)
    arguments.out.mkdir(parents=True, exist_ok=True)
    seeds = range(arguments.seed, arguments.seed + arguments.runs) if study.runs else range(1)
    console = Console()
    console.width = max(console.width, WIDTH)
    try:
        found = [study.measure(arguments, seed) for seed in seeds]
    except StudyError as error:
        console.print(f"{study.name}: {error}", style="red", markup=False)
        return FAILED
    if study.combined is None:
        figures, goals = mean(found), _mean_goals([study.goals(each) for each in found])
        if len(found) > 1:
            figures["half_width"] = half_width(found)
    else:
        figures = study.combined(found)
        goals = study.goals(figures)
    path = arguments.out / f"{study.name}.json"
    document = {**({"seeds": list(seeds)} if study.runs else {}), **figures, "goals": goals}
    _write(path, document)
    for name, picture in study.pictures(figures).items():
        FigureCanvasAgg(picture).print_png(arguments.out / name)
    join(arguments.out, study, document)
    for shown in [*study.tables(figures), *([goals_table(goals)] if goals else [])]:
        console.print(shown, markup=False, highlight=False)
    console.print(f"results: {path}", soft_wrap=True, markup=False, highlight=False)
    return OK if all(map(study.complete, found)) else FAILED


def mean(found: Sequence[Any]) -> Any:
    """Return the means of figures over seeds; entries other than numbers are the first seed's."""
    return found[0] if len(found) == 1 else _over_seeds(found, lambda runs: float(np.mean(runs)))


def half_width(found: Sequence[Any]) -> Any:
    """Return half the widths of the 95 % intervals of the figures' means over several seeds."""
    return _over_seeds(found, lambda runs: Mean.of(np.array(runs, dtype=float)).half_width)


def _over_seeds(found: Sequence[Any], value: Callable[[Sequence[float]], float]) -> Any:
    first = found[0]
    if any(each is None for each in found):
        return None
    if isinstance(first, Mapping):
        return {key: _over_seeds([each.get(key) for each in found], value) for key in first}
    if isinstance(first, list):
        return [_over_seeds(each, value) for each in zip(*found, strict=True)]
    return value(found) if isinstance(first, (int, float)) else first


def _mean_goals(found: Sequence[list[Goal]]) -> list[Goal]:
    """Return the goals that all seeds have, with the mean of their values."""
    if len(found) == 1:
        return found[0]
    by_name = [{each["name"]: each for each in goals} for goals in found]
    shared = [name for name in by_name[0] if all(name in each for each in by_name)]
    means = [mean([each[name] for each in by_name]) for name in shared]
    return [goal(each["name"], each["value"], each["goal"], each["at_most"] > 0) for each in means]


def join(out: Path, study: Study, document: Figures) -> None:
    """Write a study's figures and goals into the summary in a directory, if it belongs there.

    They replace figures and goals of the same names.
    """
    if not study.in_summary:
        return
    path, figures = out / SUMMARY, dict(document)
    goals = figures.pop("goals")
    summary: Figures = {"cases": {}, "goals": []}
    if path.exists():
        summary = json.loads(path.read_text(encoding="utf-8"))
    names = {each["name"] for each in goals}
    kept = [each for each in summary.get("goals", []) if each["name"] not in names]
    _write(path, {**summary, "goals": [*kept, *goals], study.in_summary: figures})


def _write(path: Path, summary: Figures) -> None:
    output_files.write(path, json.dumps(summary, indent=2, allow_nan=False) + "\n")


def table(title: str, headings: Sequence[str], rows: Iterable[Sequence[str]] = ()) -> Table:
    """Return a table with its title on the left and a first column that is not wrapped."""
    found = simple_table(title, headings, rows)
    found.title_justify, found.columns[0].no_wrap = "left", True
    return found


def figures_table(
    title: str,
    first: str,
    figures: Figures,
    columns: Mapping[str, Sequence[str]],
    rows: Mapping[str, Sequence[str]],
) -> Table:
    """Return a table of figures with the heading `first` over the names of its rows.

    A row has the path to its figures, and a column by their key the heading, the form and
    optionally the unit; see `cell`.
    """
    cells = [
        (name, *(cell(figures, [*path, key], *form) for key, (_, *form) in columns.items()))
        for name, path in rows.items()
    ]
    return table(title, (first, *(heading for heading, *_ in columns.values())), cells)


def cell(figures: Figures, path: Sequence[str], form: str, unit: str = "") -> str:
    """Return a figure, with half the width of its interval if it has one.

    The path has the keys that lead to it; a form that ends with % gives percentages. Without the
    figure it is "-".
    """
    value: Any = figures
    width = figures.get("half_width")
    for key in path:
        value, width = value[key] if value else None, width and width.get(key)
    if value is None:
        return "-"
    texts = [f"{each:{form}}".rstrip("%") for each in (value, width) if each is not None]
    return f"{' ± '.join(texts)} {'%' if form.endswith('%') else unit}".rstrip()


def goals_table(goals: Sequence[Goal]) -> Table:
    """Return the table of goals; a goal without a value may have a ``reason`` for that."""
    found = table("goals", ("name", "value", "goal", "reached"))
    # In a narrow terminal names and reasons are wrapped, so that the other columns stay.
    for column, wraps in zip(found.columns, (True, True, False, False), strict=True):
        column.no_wrap = not wraps
    for each in goals:
        value = each.get("reason", "-") if each["value"] is None else f"{each['value']:.4g}"
        bound = f"{'at most' if each['at_most'] else 'at least'} {each['goal']:.4g}"
        reached = {True: "yes", False: "no", None: "-"}[each["reached"]]
        style = "red" if reached == "no" else None
        found.add_row(escape(each["name"]), escape(value), bound, reached, style=style)
    return found


def until(scenario: Scenario, elapsed_s: float) -> Scenario:
    """Return a scenario cut at a time after scan 0, seconds."""
    started = [row for row, flight in enumerate(scenario.flights) if flight.start_s <= elapsed_s]
    number = {row + 1: own for own, row in enumerate(started, start=1)}
    return replace(
        scenario,
        scans=min(scenario.scans, int(elapsed_s / scenario.interval_s) + 1),
        targets=tuple(scenario.targets[row] for row in started),
        gaps=tuple(
            gap._replace(number=number[gap.number]) for gap in scenario.gaps if gap.number in number
        ),
    )
