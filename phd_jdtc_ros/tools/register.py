"""Finds the systematic errors of radars in a recording: range, azimuth and time.

It links each radar's detections to tracks, finds the targets that several radars see, and prints
each error with its deviation. With --out it writes a parameter file with which the tracker removes
them, and a picture of what was left before and after.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.backends.backend_agg import FigureCanvasAgg
from rich.console import Console

from phd_jdtc_ros import resources
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.calibration.registration.result import Registration
from phd_jdtc_ros.calibration.registration.sensors import RegistrationError, sensor
from phd_jdtc_ros.calibration.registration.solution import registered
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.radar_build import bias_parameters
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.sensors.bias import RadarBias
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.exit_status import OK, ArgumentParser, fail
from phd_jdtc_ros.parameter_files import (
    bag_parameters,
    from_arguments,
    proposed_file,
    tracker_params,
)
from phd_jdtc_ros.report.pictures import registration as picture

from . import command, recorded_plots, registered_table
from .recorded_plots import Recorded
from .tune import SECONDS as TUNED_SECONDS
from .tune import seconds_of

# Seconds of a recording that are read unless told otherwise, and detections of each radar at most.
SECONDS, MOST_PLOTS = 2.0 * TUNED_SECONDS, 60_000


class Outcome(NamedTuple):
    """What a recording says.

    Parameters
    ----------
    found : Registration
        Beside what is removed already.
    parameters : dict
        Of the corrections, by dotted name; those that are told.
    damage : BagError or None
        What of the bag is damaged; all intact messages were used.
    """

    found: Registration
    parameters: dict[str, float]
    damage: BagError | None


def main(argv: Sequence[str]) -> int:
    """Run the tool."""
    parser = ArgumentParser("register", description=__doc__)
    parser.add_argument("bag", help=command.BAG)
    parser.add_argument(
        "--params",
        "--params-file",
        type=Path,
        help="parameter file that says where the radars are and how they are read; without one "
        "that beside the bag",
    )
    parser.add_argument("--out", type=Path, help="parameter file to write; it must not exist")
    parser.add_argument(
        "--picture", type=Path, help="PNG of the residuals; by default beside --out, as NAME.png"
    )
    parser.add_argument(
        "--reference",
        metavar="RADAR",
        help="the radar that is right where a recording tells differences only, such as that of "
        "two clocks; by default the first one",
    )
    parser.add_argument(
        "--seconds",
        type=seconds_of,
        default=SECONDS,
        help=f"how much of the recording is read, from its beginning ({SECONDS:g})",
    )
    arguments = parser.parse_args(argv)
    return command.guarded("register", lambda: _work(arguments))


def _work(arguments: argparse.Namespace) -> int:
    out: Path | None = arguments.out
    drawn: Path | None = arguments.picture or (out.with_suffix(".png") if out else None)
    for path in (out, drawn):
        if path is not None and path.exists():
            raise BagError(f"{path}: already exists, a file is not overwritten")
    source = resources.bag(arguments.bag)
    given, where = _given(source, arguments.params)
    outcome = outcome_of(source, given, arguments.reference, arguments.seconds)
    now = tracker_params.config(given)
    console = Console()
    console.width = max(console.width, registered_table.WIDTH)
    rows = registered_table.rows(outcome.found, outcome.parameters, now)
    console.print(registered_table.table(rows))
    console.print(registered_table.residuals(outcome.found))
    for line in registered_table.remarks(outcome.found):
        console.print(line, soft_wrap=True, markup=False, highlight=False)
    if drawn is not None:
        FigureCanvasAgg(picture.residuals(outcome.found)).print_png(drawn)
        print(f"{drawn}: residuals before and after")
    status = OK if outcome.damage is None else fail("register", outcome.damage)
    if out is None:
        print("nothing is written without --out FILE")
        return status
    proposed = {**given, **outcome.parameters}
    head = f"Registered from {source}\nand {where}.\nA comment says what a correction rests on."
    proposed_file.write(out, head, proposed, registered_table.comments(rows))
    # What is written is what a tracker reads.
    tracker_params.config(from_arguments.load(out))
    print(f"{out}: written; the tracker takes it as its --params-file")
    return status


def _given(source: Path, path: Path | None) -> tuple[dict[str, Any], Path]:
    """Return the parameters that radars are read with, and the file that they are from."""
    if path is not None:
        return from_arguments.load(path), path
    beside = bag_parameters.read(source)
    if beside is None:
        raise BagError(
            f"{source}: has no {bag_parameters.NAME} beside it that says where its radars are: "
            "give a parameter file as --params"
        )
    return beside, bag_parameters.path_of(source)


def outcome_of(
    source: Path, given: Mapping[str, Any], reference: str | None, seconds: float
) -> Outcome:
    """Return what a recording says of the systematic errors of its radars.

    Parameters
    ----------
    source : Path
        The bag.
    given : mapping of dotted name to value
        The tracker's parameters.
    reference : str or None
        Name of the reference radar; None for the first.
    seconds : float
        How much of the bag is read.

    Raises
    ------
    BagError
        If the bag cannot be read, or tells nothing, and why.
    ConfigError
        If the parameters, or the reference, are wrong.
    """
    config = tracker_params.config(given)
    names = [radar.name for radar in config.inputs]
    if reference is not None and reference not in names:
        raise ConfigError([f"--reference: {reference} given, must be one of {', '.join(names)}"])
    if len(names) < 2:
        raise BagError(f"{source}: radars: {names[0]} alone given, must be at least two to compare")
    found, recorded = _found(source, config, reference or names[0], seconds)
    parameters = _parameters(config, found)
    if any(r.elevation_field or r.height_field or r.site is not None for r in config.inputs):
        # Errors are those of slant ranges: what is left over ground is found in a second reading.
        config, first = tracker_params.config({**given, **parameters}), found
        found, recorded = _found(source, config, reference or names[0], seconds)
        parameters = {**parameters, **_parameters(config, found)}
        found = _seen_from(first, found)
    return Outcome(found, parameters, recorded.damage)


def _found(
    source: Path, config: TrackerConfig, reference: str, seconds: float
) -> tuple[Registration, Recorded]:
    bag = BagReader(source)
    recorded = recorded_plots.read(bag, config, seconds, MOST_PLOTS)
    try:
        sensors = []
        for radar, layout in zip(polar_radars(config.model.radars), config.inputs, strict=True):
            plots = recorded.plots[radar.name]
            if plots is None or not len(plots):
                dropped = recorded.dropped[radar.name]
                said = ", ".join(f"{reason} {count}" for reason, count in dropped.items())
                raise RegistrationError(
                    f"{radar.name}: silent, no detections on {layout.topic}"
                    f"{f' (dropped: {said})' if said else ''}; must have some, or be left out of "
                    "radars"
                )
            sensors.append(sensor(plots, radar, bag.start_ns, bool(layout.pose_topic)))
        return registered(sensors, reference), recorded
    except RegistrationError as error:
        raise BagError(f"{source}: {error}") from error


def _seen_from(first: Registration, second: Registration) -> Registration:
    """Return what a second reading found, with the residuals before the first."""
    pairs = zip(second.radars, first.radars, strict=True)
    return replace(
        second, radars=tuple(replace(own, residuals=before.residuals) for own, before in pairs)
    )


def _parameters(config: TrackerConfig, found: Registration) -> dict[str, float]:
    """Return the parameters of the corrections that are told, with those that are set already."""
    parameters: dict[str, float] = {}
    for layout, each in zip(config.inputs, found.radars, strict=True):
        bias: RadarBias = layout.bias.followed_by(each.bias)
        told = registered_table.told(each)
        own = bias_parameters(layout, bias)
        parameters |= {
            name: round(value, registered_table.DIGITS[name.partition(".")[2]]) + 0.0
            for name, value in own.items()
            if name.partition(".")[2] in told
        }
    return parameters
