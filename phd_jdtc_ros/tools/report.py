# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""A bag with estimates to one self-contained HTML page and pictures."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from phd_jdtc_ros.core.config import TrackerConfig
from phd_jdtc_ros.core.evaluation import Evaluation
from phd_jdtc_ros.exits import FAILED, OK
from phd_jdtc_ros.study import figures, load
from phd_jdtc_ros.study.record import Record
from phd_jdtc_ros.study.table import metrics, score_tables

from . import command

PAGE = "report.html"


def write(
    bag: Path, out: Path, config: TrackerConfig, title: str, summary: dict[str, Any] | None
) -> int:
    """Write a bag's report into a directory, print its table and return the exit status.

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
    out.mkdir(parents=True, exist_ok=True)
    evaluation = run.evaluate(command.CUTOFF, command.ORDER)
    if summary is None:
        summary = metrics(evaluation, run.step_ms)
    figures.write_all(run, evaluation, out)
    console = Console()
    if summary["scans"]:
        console.print(score_tables(summary))
    page = out / PAGE
    if not _write_page(page, title, summary, run, evaluation):
        print("report: no page without plotly; to have it: pip install plotly", file=sys.stderr)
        return FAILED
    console.print(f"report: {page}", soft_wrap=True, markup=False, highlight=False)
    return OK


def _write_page(
    page: Path, title: str, summary: dict[str, Any], run: Record, evaluation: Evaluation
) -> bool:
    """Write the page; return False where plotly, which no rosdep key brings, is missing."""
    try:
        from phd_jdtc_ros.study import charts, html
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != "plotly":
            raise
        return False
    drawn, notes = charts.of_record(run, evaluation), charts.missing(run, evaluation)
    html.write_report(page, title, summary, run, drawn, notes)
    return True


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
        title = arguments.title or arguments.bag.name
        return write(arguments.bag, arguments.out, config, title, None)

    return command.guarded("report", work)
