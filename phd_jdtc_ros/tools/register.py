"""Finds the systematic errors of radars in a recording: range, azimuth and time.

It links each radar's detections to tracks, finds the targets that several radars see, and prints
each error with its standard deviation. With --out it writes a parameter file with which the tracker
corrects them, and a picture of the residuals before and after.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console

from phd_jdtc_ros import output_files, resources
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.calibration.registration.solution import Registration, register
from phd_jdtc_ros.calibration.registration.tracked_radars import RegistrationError, tracked_radar
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.sensors.bias import SensorBias
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.exit_status import OK, ArgumentParser, fail
from phd_jdtc_ros.parameter_files import bag_parameters, tracker_params
from phd_jdtc_ros.quoting import counts_text
from phd_jdtc_ros.report import style
from phd_jdtc_ros.report.pictures import registration as picture

from . import command, recorded_plots, registered_table
from .recorded_plots import RecordedPlots

# Length of the part of a recording that is read by default, seconds, and the largest number of
# detections of a radar.
SECONDS, MOST_PLOTS = 1200.0, 60_000


def main(argv: Sequence[str]) -> int:
    """Run the tool."""
    parser = ArgumentParser("register", description=__doc__)
    files = "parameter file with the radars' places and fields; by default the one beside the bag"
    command.add_proposal_arguments(parser, files, SECONDS)
    parser.add_argument(
        "--picture", type=Path, help="PNG of the residuals; by default beside --out, as NAME.png"
    )
    parser.add_argument(
        "--reference",
        metavar="RADAR",
        help="the radar that is taken to be right where only differences are observable, such as "
        "the difference of two clocks; by default the first one",
    )
    return command.run(parser, argv, _work)


def _work(arguments: argparse.Namespace) -> int:
    out: Path | None = arguments.out
    drawn: Path | None = arguments.picture or (out.with_suffix(".png") if out else None)
    output_files.require_new({"--out": out, "--picture": drawn})
    source = resources.bag(arguments.bag)
    recorded = command.recorded_parameters(source, arguments.params_file)
    if recorded is None:
        BagReader(source)  # what is no bag has no parameters either
        raise BagError(
            f"{source}: has no {bag_parameters.NAME} beside it with the positions of its "
            "radars: give a parameter file as --params"
        )
    given, where = recorded
    found, parameters, damage = _estimate(source, given, arguments.reference, arguments.seconds)
    now = tracker_params.config(given)
    console = Console()
    console.width = max(console.width, registered_table.WIDTH)
    rows = registered_table.rows(found, parameters, now)
    console.print(registered_table.table(rows))
    console.print(registered_table.residuals(found))
    print(*registered_table.remarks(found), sep="\n")
    if drawn is not None:
        style.save(picture.residuals(found), drawn)
        print(f"{drawn}: residuals before and after")
    status = OK if damage is None else fail("register", damage)
    head = f"Registered from {source}\nand {where}.\nA comment gives the basis of each correction."
    comments = registered_table.comments(rows)
    command.write_proposal(out, head, {**given, **parameters}, comments)
    return status


def _estimate(
    source: Path, given: Mapping[str, Any], reference: str | None, seconds: float
) -> tuple[Registration, dict[str, list[float]], BagError | None]:
    """Return the errors found, the corrections for the tracker, and the damage of a recording."""
    config = tracker_params.config(given)
    names = [radar.name for radar in config.radars]
    if reference is not None and reference not in names:
        raise ConfigError(f"--reference: {reference} given, must be one of {', '.join(names)}")
    if len(names) < 2:
        raise BagError(f"{source}: radars: {names[0]} alone given, must be at least two to compare")
    found, recorded = _register(source, config, reference or names[0], seconds)
    parameters = _parameters(config, found)
    if any(r.fields.elevation or r.fields.height or r.site is not None for r in config.radars):
        # Errors are of slant ranges, so the residuals over ground need a second reading.
        config, first = tracker_params.config({**given, **parameters}), found
        found, recorded = _register(source, config, reference or names[0], seconds)
        parameters = {**parameters, **_parameters(config, found)}
        found = _join(first, found)
    return found, parameters, recorded.damage


def _register(
    source: Path, config: TrackerConfig, reference: str, seconds: float
) -> tuple[Registration, RecordedPlots]:
    bag = BagReader(source)
    recorded = recorded_plots.read(bag, config, seconds, MOST_PLOTS)
    try:
        sensors = []
        for radar, layout in zip(polar_radars(config.model.radars), config.radars, strict=True):
            plots = recorded.plots[radar.name]
            if plots is None or not len(plots):
                reasons = counts_text(recorded.dropped[radar.name])
                dropped = f" (dropped: {reasons})" if reasons else ""
                raise RegistrationError(
                    f"{radar.name}: silent, no detections on {layout.topic}{dropped}; must have "
                    "some, or be left out of radars"
                )
            sensors.append(tracked_radar(plots, radar, bag.start_ns, bool(layout.pose.topic)))
        return register(sensors, reference), recorded
    except RegistrationError as error:
        raise BagError(f"{source}: {error}") from error


def _join(first: Registration, second: Registration) -> Registration:
    """Return the registration of a second reading, with the residuals before the first."""
    pairs = zip(second.radars, first.radars, strict=True)
    return replace(
        second, radars=tuple(replace(own, residuals=before.residuals) for own, before in pairs)
    )


def _parameters(config: TrackerConfig, found: Registration) -> dict[str, list[float]]:
    """Return the corrections of radars with observable biases, with those that are set already."""
    parameters: dict[str, list[float]] = {}
    for layout, each in zip(config.radars, found.radars, strict=True):
        bias: SensorBias = layout.bias.followed_by(each.bias)
        for name, biases in layout.bias_parameters(bias).items():
            chosen = registered_table.corrections(each, biases, config.values[name])
            if chosen is not None:
                parameters[name] = chosen
    return parameters
