"""Runs a Monte Carlo study: many seeded runs in parallel, with tables, figures and a summary."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from phd_jdtc_ros import output_files, resources
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.exit_status import FAILED, OK, ArgumentParser
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.study import document, results, tasks
from phd_jdtc_ros.study.definition import KINDS, Kind, Study
from phd_jdtc_ros.study.document import REFERENCE, Scene
from phd_jdtc_ros.study.tasks import Outcome, Plan, Store

from . import command

PUBLISHED = Path("config/studies/published.yaml")
Kinds: TypeAlias = "Mapping[str, Kind]"


def load_study(path: Path, assigned: Mapping[str, Any], kinds: Kinds = KINDS) -> Study:
    """Return a checked study; paths of scenario files are relative to the study's file."""
    load_scene = partial(_load_scene, path.parent)
    return document.resolve(yaml_files.load(path), load_scene, assigned, kinds)


def _load_scene(directory: Path, name: str) -> Scene:
    if name == REFERENCE:
        return from_arguments.scenario_parameters(None), paper_scenario
    document = yaml_files.load(directory / name)
    return from_arguments.scenario_parameters(document), partial(scenario_file.resolve, document)


def run(study: Study, plan: Plan, out: Path, backend: Callable[..., None]) -> int:
    """Run the tasks that are not stored yet, write and print the results; return the exit status.

    `out` gets ``parts``, ``results.csv``, ``summary.json``, ``table.md`` and ``figures``; `backend`
    is a function of tasks and of the callback for outcomes.
    """
    command.require_directory(out / "parts")
    console = Console()
    store = Store(out / "parts")
    left = tasks.remaining(plan.tasks, store)
    for note in plan.notes:
        console.print(note, style="yellow", markup=False, highlight=False)
    failures: list[Outcome] = []
    if left:
        console.print(
            f"{len(plan.tasks)} tasks, {len(plan.tasks) - len(left)} of them already done"
        )
        with _progress(console, len(left), store, failures) as report:
            backend(left, report=report)
    write_results(study, plan, out, failures, console)
    for outcome in failures:
        console.print(f"failed: {outcome.task.label}\n{outcome.error}", style="red", markup=False)
    return FAILED if failures else OK


@contextlib.contextmanager
def _progress(
    console: Console, total: int, store: Store, failures: list[Outcome]
) -> Iterator[tasks.Report]:
    """Yield the callback for outcomes, which stores scores at once and advances the bar."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    with Progress(*columns, console=console) as progress:
        bar = progress.add_task("runs", total=total)

        def report(outcome: Outcome) -> None:
            for variant in outcome.task.variants:
                if variant.name in outcome.scores:
                    store.write(outcome.task, variant, outcome.scores[variant.name])
            if outcome.error:
                failures.append(outcome)
                console.print(f"failed: {outcome.task.label}", style="red", markup=False)
            progress.advance(bar)

        yield report


def write_results(
    study: Study, plan: Plan, out: Path, failures: Sequence[Outcome], console: Console
) -> None:
    """Write the results of the stored scores, and print the tables."""
    # The drawing library takes 40 MB, which a study that is refused does not need.
    from phd_jdtc_ros.study import figures

    store = Store(out / "parts")
    found = results.collect(plan.tasks, store)
    ordered = sorted(failures, key=lambda outcome: outcome.task.label)
    summary = results.summarise(study, found, plan.notes, ordered)
    out.mkdir(parents=True, exist_ok=True)
    results.write_csv(out / "results.csv", plan.tasks, store)
    text = json.dumps(summary, indent=2, allow_nan=False) + "\n"
    output_files.write(out / "summary.json", text)
    output_files.write(out / "table.md", figures.markdown(summary))
    figures.write_all(found, out / "figures")
    for table in figures.tables(summary):
        console.print(table)
    print(f"results: {out}")


def _plan(arguments: argparse.Namespace, kinds: Kinds) -> tuple[Study, Plan]:
    command.require_least(arguments, {"runs": 1, "first_seed": 0, "workers": 1})
    assigned = from_arguments.from_arguments([], arguments.assignments)
    study = load_study(arguments.study, assigned, kinds)
    study = study.select(arguments.case, arguments.variant)
    study = replace(study.in_full if arguments.in_full else study, cutoff=arguments.cutoff)
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.runs)
    plan = tasks.plan(study, seeds)
    if plan.notes and not plan.tasks:
        raise ConfigError(*plan.notes)
    return study, plan


def main(argv: Sequence[str], busy: Callable[[], int] = lambda: 0, kinds: Kinds = KINDS) -> int:
    """Run the study tool; `busy` returns how many processors have other work."""
    parser = ArgumentParser("monte_carlo", description=__doc__)
    parser.add_argument(
        "--study", type=Path, default=resources.find(PUBLISHED), help="study file (%(default)s)"
    )
    parser.add_argument("--runs", type=int, default=50, help="seeds per case (%(default)s)")
    parser.add_argument(
        "--in-full",
        action="store_true",
        help="do all runs of every case and variant, whatever its run_share",
    )
    parser.add_argument(
        "--first-seed",
        type=int,
        # First seed of the published tables; the tracker's parameters were tuned on other seeds.
        default=1000,
        help="%(default)s, as in the published tables; others are for tuning",
    )
    parser.add_argument("--out", type=Path, default=Path("out/study"), help="%(default)s")
    place = parser.add_mutually_exclusive_group()
    cpus = len(os.sched_getaffinity(0))
    place.add_argument("--workers", type=int, default=cpus, help="local processes (%(default)s)")
    place.add_argument("--dask", metavar="ADDRESS", help="scheduler of a Dask cluster")
    parser.add_argument(
        "--case", action="append", default=[], help="run only this case; may be repeated"
    )
    parser.add_argument(
        "--variant", action="append", default=[], help="run only this variant; may be repeated"
    )
    command.add_assignments_argument(parser)
    command.add_cutoff_argument(parser)

    def work(arguments: argparse.Namespace) -> int:
        study, plan = _plan(arguments, kinds)
        if arguments.dask:
            backend = partial(tasks.run_on_dask, address=arguments.dask)
        else:
            workers = arguments.workers
            backend = partial(tasks.run_on_processes, workers=workers, busy=busy)
        return run(study, plan, arguments.out, backend)

    return command.run(parser, argv, work)
