"""A bag with estimates to one self-contained HTML page and pictures."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from phd_jdtc_ros.core.config import TrackerConfig
from phd_jdtc_ros.exits import OK
from phd_jdtc_ros.study import figures, html, load
from phd_jdtc_ros.study.table import metrics, ospa_table

from . import command


def write(
    bag: Path, out: Path, config: TrackerConfig, title: str, summary: dict[str, Any] | None
) -> None:
    """Write a bag's report into a directory and print its table.

    Parameters
    ----------
    bag : Path
    out : Path
        Gets ``report.html`` and the PNGs.
    config : TrackerConfig
        Names the radars of the bag.
    title : str
    summary : dict or None
        The run's figures where they are known; otherwise they are computed from the bag.
    """
    run = load.record(bag, config)
    evaluation = run.evaluate(command.CUTOFF, command.ORDER)
    if summary is None:
        summary = metrics(evaluation, run.step_ms)
    out.mkdir(parents=True, exist_ok=True)
    pictures = figures.write_all(run, evaluation, out)
    html.write_report(out / "report.html", title, summary, pictures)
    console = Console()
    if summary["scans"]:
        console.print(ospa_table(summary))
    console.print(f"report: {out / 'report.html'}")


def main(argv: Sequence[str]) -> int:
    """Run the report tool."""
    parser = argparse.ArgumentParser("report", description=__doc__)
    parser.add_argument("bag", type=Path, help="rosbag2 directory or MCAP file with estimates")
    parser.add_argument("--out", type=Path, required=True, help="directory of the report")
    parser.add_argument("--title", help="of the page; the bag's name if absent")
    command.add_parameter_arguments(parser)
    arguments = parser.parse_args(argv)

    def work() -> int:
        config = command.tracker_config(arguments)
        write(arguments.bag, arguments.out, config, arguments.title or arguments.bag.name, None)
        return OK

    return command.guarded("report", work)
