"""Proposes a configuration from a recording: how the radars turn, their noise, detections, clutter.

It reads some minutes of a bag, links detections to tracks, and prints what it found beside what is
set now. With --out it writes a parameter file that the tracker takes as it is.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from phd_jdtc_ros import resources
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.calibration.tuning import proposal, unspecified
from phd_jdtc_ros.calibration.tuning.findings import Findings
from phd_jdtc_ros.calibration.tuning.proposal import Row
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters import schema
from phd_jdtc_ros.exit_status import OK, ArgumentParser, fail
from phd_jdtc_ros.parameter_files import (
    bag_parameters,
    from_arguments,
    proposed_file,
    tracker_params,
)

from . import command, recorded_plots
from .recorded_plots import Recorded

# Seconds of a recording that are read unless told otherwise.
SECONDS, LEAST_SECONDS = 600.0, 1.0


def main(argv: Sequence[str]) -> int:
    """Run the tool."""
    parser = ArgumentParser("tune", description=__doc__)
    parser.add_argument("bag", help=command.BAG)
    parser.add_argument(
        "--params-file",
        "--params",
        type=Path,
        help="parameter file that names radars, topics and fields; without one that beside the "
        "bag, or else what topics and fields are is recognised by their names",
    )
    parser.add_argument("--out", type=Path, help="parameter file to write; it must not exist")
    parser.add_argument(
        "--seconds",
        type=seconds_of,
        default=SECONDS,
        help=f"how much of the recording is read, from its beginning ({SECONDS:g})",
    )
    arguments = parser.parse_args(argv)
    return command.guarded("tune", lambda: _work(arguments))


def seconds_of(text: str) -> float:
    """Return a number of seconds that was given as an argument."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not (math.isfinite(seconds) and seconds >= LEAST_SECONDS):
        raise argparse.ArgumentTypeError(f"{text} given, must be at least {LEAST_SECONDS:g} s")
    return seconds


def _work(arguments: argparse.Namespace) -> int:
    path: Path | None = arguments.out
    if path is not None and path.exists():
        raise BagError(f"{path}: already exists, a file is not overwritten")
    source = resources.bag(arguments.bag)
    bag = BagReader(source)
    given, where = _given(bag, source, arguments.params_file)
    config = tracker_params.config(given)
    recorded = recorded_plots.read(bag, config, arguments.seconds)
    found = recorded_plots.findings_of(source, recorded)
    now = config.values if where else _not_set(config)
    rows = {radar: proposal.rows(each, now, radar) for radar, each in found.items()}
    console = Console()
    for radar, each in found.items():
        topic = next(entry.topic for entry in config.inputs if entry.name == radar)
        console.print(_table(radar, topic, each, rows[radar], recorded))
    proposed = _proposed(given, found, rows, recorded, where is not None)
    tracker_params.config(proposed)
    status = OK if recorded.damage is None else fail("tune", recorded.damage)
    if path is None:
        print("nothing is written without --out FILE")
        return status
    proposed_file.write(path, _head(source, where), proposed, _comments(rows, where is None))
    # What is written is what a tracker reads.
    tracker_params.config(from_arguments.load(path))
    print(f"{path}: written; the tracker takes it as its --params-file")
    return status


def _given(bag: BagReader, source: Path, path: Path | None) -> tuple[dict[str, Any], Path | None]:
    """Return the parameters that radars are read with, and the file that they are from."""
    if path is not None:
        return from_arguments.load(path), path
    beside = bag_parameters.read(source)
    if beside is not None:
        return beside, bag_parameters.path_of(source)
    return {**recorded_plots.recognised_radars(bag), "births": []}, None


def _not_set(config: TrackerConfig) -> dict[str, Any]:
    """Return those values that say how radars are read, where no file sets any."""
    names = [f"{radar.name}.azimuth_convention" for radar in config.inputs]
    return {name: config.values[name] for name in names}


def _table(
    radar: str, topic: str, found: Findings, rows: Sequence[Row], recorded: Recorded
) -> Table:
    """Return what was found of a radar as a table."""
    when = found.timing
    turns = "turns" if when.rotation_s else "looks"
    table = Table(
        title=f"{radar}, {topic}: {found.plots} detections, {found.looks:.0f} {turns} in "
        f"{found.duration_s:.0f} s, a cloud every {when.cloud_interval_s:.4g} s",
        title_justify="left",
        caption="in brackets: seen, and nothing is set to it",
        caption_justify="left",
    )
    for name in ("parameter", "proposed", "+-", "known from", "now"):
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
    return f"{value:g}" if isinstance(value, float) else str(value).strip("[]")


def _proposed(
    given: Mapping[str, Any],
    found: Mapping[str, Findings],
    rows: Mapping[str, Sequence[Row]],
    recorded: Recorded,
    specified: bool,
) -> dict[str, Any]:
    """Return a configuration with all that is proposed."""
    timed = {radar: plots is not None and plots.timed for radar, plots in recorded.plots.items()}
    values = dict(given)
    if not specified:
        values.update(unspecified.parameters(found, timed))
    values["interval_s"] = proposal.interval_s(found)
    for radar, own in rows.items():
        values.update({f"{radar}.{row.name}": row.value for row in own if row.proposed})
        # Antennas turn clockwise; azimuths that rise meanwhile count clockwise too. It is written
        # where it is the default as well: what is wrong mirrors the world.
        convention = f"{radar}.azimuth_convention"
        when = found[radar].timing
        if not specified and convention not in values:
            compass = when.rotation_s and not when.clockwise
            values[convention] = "compass_cw" if compass else schema(values)[convention].default
    return values


def _head(source: Path, where: Path | None) -> str:
    said = f"and {where}" if where else "alone: topics and fields are recognised by their names"
    return (
        f"Proposed by tune from {source}\n{said}.\n"
        "A comment says what a value is known from, and what it was."
    )


def _comments(rows: Mapping[str, Sequence[Row]], unknown_place: bool) -> dict[str, str]:
    """Return the comments of the values that are proposed, by dotted name."""
    comments = {"interval_s": "the shortest time between two looks"}
    for radar, own in rows.items():
        if unknown_place:
            comments[radar] = "add its position and yaw_deg, which no recording tells"
            comments[f"{radar}.azimuth_convention"] = "check it; compass_cw if north is 0"
        for row in own:
            if not row.proposed:
                continue
            std = f", +-{row.std:.2g}" if math.isfinite(row.std) else ""
            now = "" if row.now is None or row.now == row.value else f"; was {_text(row.now)}"
            comments[f"{radar}.{row.name}"] = f"{row.source}{std}{now}"
    return comments
