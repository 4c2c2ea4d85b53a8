"""Proposes a configuration from a recording: rotation, noise, detection probability and clutter.

It reads a bag, links detections to tracks, and prints proposed and current values side by side.
With a receiver of self-reports in it, biases of radars are proposed too, as `register` finds them.
With --out it writes a parameter file for the tracker.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from phd_jdtc_ros import output_files, resources
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.calibration.tuning import proposal
from phd_jdtc_ros.calibration.tuning.findings import Findings
from phd_jdtc_ros.calibration.tuning.proposal import Row
from phd_jdtc_ros.calibration.tuning.remarks import remarks
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.exit_status import OK, ArgumentParser, fail
from phd_jdtc_ros.parameter_files import from_arguments

from . import command, recorded_plots, register
from .recorded_plots import RecordedPlots


def main(argv: Sequence[str]) -> int:
    """Run the tool."""
    parser = ArgumentParser("tune", description=__doc__)
    files = (
        "parameter file that names radars, topics and fields; without one, the file beside the "
        "bag is used, or else topics and fields are recognised by their names"
    )
    command.add_proposal_arguments(parser, files)
    command.add_clock_argument(parser)
    return command.run(parser, argv, _work)


def _work(arguments: argparse.Namespace) -> int:
    output_files.require_new({"--out": arguments.out})
    begin = time.perf_counter()
    source = resources.bag(arguments.bag)
    bag = BagReader(source)
    given, where = command.recorded_parameters(source, arguments.params_file) or (
        {**recorded_plots.recognised_radars(bag), "births": []},
        None,
    )
    config = from_arguments.config_of(given)
    command.use_clock(bag, config, arguments.clock)
    _note(f"reading {source}")
    recorded = recorded_plots.read(bag, config, arguments.seconds)
    console = Console()
    for radar, plots in recorded.plots.items():
        if plots is not None and len(plots) < recorded.offered[radar]:
            console.print(
                f"{radar}: the first {len(plots)} of {recorded.offered[radar]} detections are "
                "used, because more hardly sharpen the estimates",
                soft_wrap=True,
                markup=False,
                highlight=False,
            )
    found = recorded_plots.findings_of(source, recorded, _note)
    _note(f"done in {time.perf_counter() - begin:.1f} s")
    # Without a parameter file, these are the only settings that were assumed.
    assumed = [
        f"{radar.name}.{what}"
        for radar in config.inputs
        if radar.may_turn
        for what in ("units.azimuth_convention", "learn")
        if f"{radar.name}.{what}" in config.values
    ]
    now = config.values if where else {name: config.values[name] for name in assumed}
    rows = {radar: proposal.rows(each, now, radar) for radar, each in found.items()}
    proposed = recorded_plots.proposed(given, found, rows, recorded, where is not None)
    if config.receivers:
        try:
            for radar, row in _biases(source, proposed, arguments.seconds).items():
                rows[radar].append(row)
                proposed[f"{radar}.{row.name}"] = row.value
        except (BagError, ConfigError) as error:
            _note(f"no biases from reports: {error}")
    for radar, each in found.items():
        topic = next(entry.topic for entry in config.inputs if entry.name == radar)
        console.print(_table(radar, topic, each, rows[radar], recorded))
        for text in (*recorded.warnings[radar], *remarks(each, given, radar)):
            console.print(f"{radar}: {text}", soft_wrap=True, markup=False, highlight=False)
    from_arguments.config_of(proposed)
    status = OK if recorded.damage is None else fail("tune", recorded.damage)
    comments = _comments(rows, where is None)
    command.write_proposal(arguments.out, _head(source, where), proposed, comments)
    return status


def _biases(source: Path, given: Mapping[str, Any], seconds: float | None) -> dict[str, Row]:
    """Return the biases of radars that the reports of targets show, as `register` finds them."""
    found, parameters, _ = register.estimate(source, given, None, seconds or register.SECONDS)
    now = from_arguments.config_of(given)
    basis = register.comments(register.rows(found, parameters, now))
    return {
        name.removesuffix(".biases"): Row("biases", value, basis[name], now.values[name])
        for name, value in parameters.items()
    }


def _note(text: str) -> None:
    """Print what is being done, beside the proposals."""
    print(f"tune: {text}", file=sys.stderr)


def _table(
    radar: str, topic: str, found: Findings, rows: Sequence[Row], recorded: RecordedPlots
) -> Table:
    timing = found.timing
    revolutions = "revolutions" if timing.rotation_s else "looks"
    table = Table(
        title=f"{escape(radar)}, {escape(topic)}: {found.plots} detections, {found.looks:.0f} "
        f"{revolutions} in {found.duration_s:.0f} s, a cloud every {timing.cloud_interval_s:.4g} s",
        title_justify="left",
        caption="in brackets: observed, but not proposed",
        caption_justify="left",
    )
    for name in ("parameter", "proposed", "+-", "source", "now"):
        table.add_column(name, no_wrap=name == "parameter")
    for row in rows:
        table.add_row(
            row.name,
            _text(row.value) if row.proposed else f"({_text(row.value)})",
            f"{row.std:.2g}" if math.isfinite(row.std) else "",
            row.source,
            "" if row.now is None else _text(row.now),
        )
    for reason, count in recorded.dropped[radar].items():
        table.add_row(f"dropped: {reason}", str(count), "", "", "")
    return table


def _text(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _head(source: Path, where: Path | None) -> str:
    basis = f"and {where}" if where else "alone: topics and fields are recognised by their names"
    return (
        f"Proposed by tune from {source}\n{basis}.\n"
        "A comment gives the source of each value, and its earlier value."
    )


def _comments(rows: Mapping[str, Sequence[Row]], unknown_place: bool) -> dict[str, str]:
    """Return the comments of the proposed values, by dotted name."""
    comments = {"interval_s": "the shortest time between two looks"}
    for radar, own in rows.items():
        if unknown_place:
            comments[radar] = "add its position and yaw_deg, which no recording contains"
            comments[f"{radar}.units.azimuth_convention"] = "check it; compass_cw if north is 0"
        for row in own:
            if not row.proposed:
                continue
            std = f", +-{row.std:.2g}" if math.isfinite(row.std) else ""
            now = "" if row.now is None or row.now == row.value else f"; was {_text(row.now)}"
            comments[f"{radar}.{row.name}"] = f"{row.source}{std}{now}"
    return comments
