"""Makes a self-contained HTML page and pictures of a bag with estimates."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from phd_jdtc_ros import resources
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.evaluation.run_scores import ORDER, Evaluation
from phd_jdtc_ros.exit_status import FAILED, OK, ArgumentParser, fail
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments
from phd_jdtc_ros.report import figures, load
from phd_jdtc_ros.report.record import Record
from phd_jdtc_ros.report.table import metrics, score_tables

from . import command

PAGE = "report.html"


def write(
    bag: Path,
    out: Path,
    config: TrackerConfig,
    title: str,
    summary: dict[str, Any] | None,
    cutoff: float = command.CUTOFF,
) -> int:
    """Write a bag's report into a directory, print its table and return the exit status.

    The report of a damaged bag shows the intact part. Without a `summary`, the figures of the run,
    it is computed from the bag. `cutoff` is c of OSPA, metres.
    """
    command.require_directory(out)
    run = load.record(bag, config)
    if run.class_fault:
        print(f"report: {run.class_fault}", file=sys.stderr)
    out.mkdir(parents=True, exist_ok=True)
    evaluation = run.evaluate(cutoff, ORDER)
    if summary is None:
        recorded = bag_parameters.read(bag)
        engine = None if recorded is None else from_arguments.config_of(recorded).engine
        summary = metrics(evaluation, run.step_ms, engine)
    # The figures may be those of a node without class names.
    summary = {**summary, "class_names": list(run.sets.class_names)}
    figures.write_all(run, evaluation, out)
    if summary["scans"]:
        Console().print(score_tables(summary))
    page = out / PAGE
    if not _write_page(page, title, summary, run, evaluation):
        print("report: the page needs plotly: pip install plotly", file=sys.stderr)
        return FAILED
    print(f"report: {page}")
    return OK if run.damage is None else fail("report", run.damage)


def _write_page(
    page: Path, title: str, summary: dict[str, Any], run: Record, evaluation: Evaluation
) -> bool:
    """Write the page; return False if plotly is missing, because rosdep has no key for it."""
    try:
        from phd_jdtc_ros.report.page import html
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != "plotly":
            raise
        return False
    shown, notes = html.charts_of(run, evaluation), html.notes_of(run, evaluation)
    html.write_report(page, title, summary, run, shown, notes)
    return True


def main(argv: Sequence[str]) -> int:
    """Run the report tool."""
    parser = ArgumentParser("report", description=__doc__)
    parser.add_argument("bag", help=command.BAG)
    parser.add_argument("--out", type=Path, required=True, help="directory of the report")
    parser.add_argument("--title", help="title of the page; the bag's name if absent")
    command.add_cutoff_argument(parser)
    command.add_parameter_arguments(parser)

    def work(arguments: argparse.Namespace) -> int:
        bag = resources.bag(arguments.bag)
        config = command.tracker_config(arguments, bag)
        title = arguments.title or bag.name
        present = BagReader(bag).types
        status = write(bag, arguments.out, config, title, None, arguments.cutoff)
        for radar in config.inputs:
            if radar.topic not in present:
                print(
                    f"report: {bag}: {radar.topic} is missing, so the detections of {radar.name} "
                    "are not shown",
                    file=sys.stderr,
                )
        return status

    return command.run(parser, argv, work)
