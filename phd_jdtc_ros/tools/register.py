"""Finds the systematic errors of radars in a recording: range, azimuth and time.

It links each radar's detections to tracks, finds the targets that several radars see, or that
report themselves to a receiver beside a radar, and prints each error with its standard deviation.
With --out it writes a parameter file with which the tracker corrects them, and a picture of the
residuals before and after.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from msg_adapters.encoding import RejectedMessageError
from msg_adapters.incoming import self_reports
from phd_jdtc_ros import output_files, resources
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.calibration.registration.common import (
    KINDS,
    RegistrationError,
    tracked_radar,
    tracked_reports,
)
from phd_jdtc_ros.calibration.registration.solution import RadarEstimate, Registration, register
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.reports import ReportsParameters
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.sensors.bias import SensorBias
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.types import SelfReports
from phd_jdtc_ros.exit_status import OK, ArgumentParser, fail
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments
from phd_jdtc_ros.quoting import counts_text
from phd_jdtc_ros.report import residuals, style
from phd_jdtc_ros.report.load import Intact

from . import command, recorded_plots
from .recorded_plots import RecordedPlots

# The entries of the parameter `biases`: their names, digits, and scales (degrees in radians).
NAMES = dict(zip(KINDS, ("range, m", "range gain, m/m", "azimuth, deg", "time, s"), strict=True))
DIGITS, SCALES = (1, 6, 4, 4), (1.0, 1.0, math.degrees(1.0), 1.0)
WORDS = {
    "range_bias": "a range bias",
    "range_gain": "a range gain",
    "azimuth": "a turn of the azimuths",
    "time_offset_s": "a time offset",
}


class Row(NamedTuple):
    """An entry of a radar's parameter `biases`."""

    radar: str
    name: str
    digits: int  # Decimals of the value
    value: float | None  # The correction; None if the bias is unobservable
    std: float
    source: str  # Number of tracks and plots used, or why it is unobservable
    now: float  # The configured value


def corrections(
    found: RadarEstimate, biases: Sequence[float], now: Sequence[float]
) -> list[float] | None:
    """Return the rounded `biases` of a radar; the configured ones if they are unobservable.

    It is None if all of them are unobservable.
    """
    observable = np.isfinite(found.std)
    entries = zip(observable, biases, now, DIGITS, strict=True)
    chosen = [
        round(bias, digits) + 0.0 if is_observable else old
        for is_observable, bias, old, digits in entries
    ]
    return chosen if observable.any() else None


def rows(
    found: Registration, parameters: Mapping[str, Sequence[float]], now: TrackerConfig
) -> list[Row]:
    """Return a row for each entry of each radar's `biases`."""
    result = []
    for each in found.radars:
        name = f"{each.name}.biases"
        biases, before = parameters.get(name, now.values[name]), now.values[name]
        entries = zip(KINDS, each.std, SCALES, DIGITS, biases, before, strict=True)
        for kind, std, scale, digits, value, old in entries:
            source = f"{each.tracks} common tracks, {each.plots} plots"
            if not np.isfinite(std):
                hidden = (each.name, kind) in found.hidden
                source = "not observable" if hidden else "the reference: taken to be right"
            result.append(
                Row(
                    each.name,
                    NAMES[kind],
                    digits,
                    value if np.isfinite(std) else None,
                    float(std) * scale,
                    source,
                    old,
                )
            )
    return result


def table(every: Sequence[Row]) -> Table:
    """Return the errors as a table."""
    shown = Table(title="systematic errors", title_justify="left")
    for name in ("radar", "bias", "found", "+-", "source", "now"):
        shown.add_column(name, no_wrap=name == "bias")
    before = ""
    for row in every:
        if before and row.radar != before:
            shown.add_section()
        shown.add_row(
            row.radar if row.radar != before else "",
            row.name,
            "-" if row.value is None else f"{row.value:.{row.digits}f}",
            "" if math.isnan(row.std) else f"{row.std:.2g}",
            row.source,
            f"{row.now:g}",
        )
        before = row.radar
    return shown


def residual_table(found: Registration) -> Table:
    """Return the residuals of each radar's plots against the common tracks, before and after."""
    shown = Table(title="residuals of plots, root mean square", title_justify="left")
    for name in ("radar", "range before, m", "after, m", "azimuth before, deg", "after, deg"):
        shown.add_column(name, justify="left" if name == "radar" else "right")
    for each in found.radars:
        cells = []
        for axis, digits, scale in ((0, 1, 1.0), (1, 3, math.degrees(1.0))):
            for error in (each.residuals.before, each.residuals.after):
                cells.append(f"{scale * np.sqrt(np.mean(error[:, axis] ** 2)):.{digits}f}")
        shown.add_row(each.name, *cells)
    return shown


def remarks(found: Registration) -> Iterator[str]:
    """Yield which errors are not observable, and why."""
    words = ", ".join(WORDS[kind] for kind in found.common)
    yield (
        f"{found.tracks} common tracks. Not observable where common to all radars: {words}; "
        f"{found.reference} is taken to be right there (--reference)."
    )
    for radar in dict.fromkeys(radar for radar, _ in found.hidden):
        kinds = [kind for name, kind in found.hidden if name == radar]
        names = " and ".join(NAMES[kind] for kind in kinds)
        yield (
            f"{radar}: {names} not observable: {found.hidden[radar, kinds[0]]}. The current values "
            "are taken to be right, and the other errors depend on them."
        )


def comments(every: Sequence[Row]) -> dict[str, str]:
    """Return the comments of the corrections in a parameter file, by dotted name."""
    found = {}
    for radar in dict.fromkeys(row.radar for row in every if row.value is not None):
        own = [row for row in every if row.radar == radar]
        stds = ", ".join("-" if row.value is None else f"{row.std:.2g}" for row in own)
        known = next(row.source for row in own if row.value is not None)
        before = f"; was {[row.now for row in own]}" if any(row.now for row in own) else ""
        found[f"{radar}.biases"] = f"+-[{stds}]; {known}{before}"
    return found


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
        BagReader(source)  # What is no bag has no parameters either
        raise BagError(
            f"{source}: has no {bag_parameters.NAME} beside it with the positions of its "
            "radars: give a parameter file as --params"
        )
    given, where = recorded
    found, parameters, damage = estimate(source, given, arguments.reference, arguments.seconds)
    now = from_arguments.config_of(given)
    console = Console()
    # Smallest width of the tables, characters, at which each error fits a line.
    console.width = max(console.width, 110)
    corrected = rows(found, parameters, now)
    console.print(table(corrected))
    console.print(residual_table(found))
    print(*remarks(found), sep="\n")
    if drawn is not None:
        style.save(residuals.draw(found), drawn)
        print(f"{drawn}: residuals before and after")
    status = OK if damage is None else fail("register", damage)
    head = f"Registered from {source}\nand {where}.\nA comment gives the basis of each correction."
    basis = comments(corrected)
    command.write_proposal(out, head, {**given, **parameters}, basis)
    return status


def estimate(
    source: Path, given: Mapping[str, Any], reference: str | None, seconds: float
) -> tuple[Registration, dict[str, list[float]], BagError | None]:
    """Return the errors found, the corrections for the tracker, and the damage of a recording.

    Raise `BagError` if the recording does not show them.
    """
    config = from_arguments.config_of(given)
    config.require_plane("register, which estimates no biases of elevations")
    receivers = [own.name for own in config.receivers]
    names = [*receivers, *(radar.name for radar in config.radars)]
    if reference is not None and reference not in names:
        raise ConfigError(f"--reference: {reference} given, must be one of {', '.join(names)}")
    if len(names) < 2:
        raise BagError(
            f"{source}: radars: {names[0]} alone given, must be at least two to compare, or one "
            "with a receiver of self-reports"
        )
    found, recorded = _register(source, config, reference or names[0], seconds)
    parameters = _parameters(config, found)
    if any(r.fields.elevation or r.fields.height or r.site is not None for r in config.radars):
        # Errors are of slant ranges, so the residuals over ground need a second reading.
        config, first = from_arguments.config_of({**given, **parameters}), found
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
        radars = len(sensors)
        for own in config.receivers:
            told = _told(bag, own, seconds)
            std = own.receiver([]).habits.usual_std
            sensors.append(tracked_reports(own.name, told, std, bag.start_ns))
        found = register(sensors, reference)
        return replace(found, radars=found.radars[:radars]), recorded
    except RegistrationError as error:
        raise BagError(f"{source}: {error}") from error


def _told(bag: BagReader, own: ReportsParameters, seconds: float) -> SelfReports:
    """Return the self-reports of a receiver in the first seconds of a bag."""
    until_ns = bag.start_ns + round(seconds * 1e9)
    parts = []
    for entry in Intact(bag).messages([own.topic], until_ns):
        try:
            parts.append(self_reports.from_cdr(entry.data, own).reports)
        except RejectedMessageError as error:
            raise BagError(f"{bag.path}: {own.topic}: {error}") from error
    if not parts:
        raise RegistrationError(f"{own.name}: silent, no reports on {own.topic}")
    return SelfReports.concatenate(parts)


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
            chosen = corrections(each, biases, config.values[name])
            if chosen is not None:
                parameters[name] = chosen
    return parameters
