"""Code that the offline executables share: common arguments, error reports, exit status."""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from phd_jdtc_ros import interruption, output_files, resources
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration import scene
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.place_forms import TRANSFORM_TOPICS
from phd_jdtc_ros.configuration.schema import SMALL, ConfigError
from phd_jdtc_ros.exit_status import INTERRUPTED, USAGE, fail
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments, yaml_files
from phd_jdtc_ros.quoting import short

# Default cut-off c of OSPA, metres.
CUTOFF = 1000.0
# Help of `--scenario` for tools that read a bag.
SCENARIO = (
    "scenario file or shipped name, whose parameters are used; without one and without "
    "--params-file those beside the bag, or else the defaults"
)
# Help of arguments that name a bag.
BAG = "rosbag2 directory, MCAP file, or the name of a shipped bag"


def run(
    parser: argparse.ArgumentParser,
    argv: Sequence[str],
    work: Callable[[argparse.Namespace], int],
) -> int:
    """Run `work` with the parsed arguments; return the exit status, and print users' errors."""
    arguments, name = parser.parse_args(argv), parser.prog.split()[-1]
    try:
        with interruption.accepted():
            return work(arguments)
    except (ConfigError, BagError) as error:
        return fail(name, error)
    except OSError as error:  # The path cannot be written, or the disk is full.
        where = f"{error.filename}: " if error.filename else ""
        print(f"{name}: {short(where)}{error.strerror or error}", file=sys.stderr)
        return USAGE
    except KeyboardInterrupt:
        print(f"{name}: interrupted", file=sys.stderr)
        return INTERRUPTED


def add_parameter_arguments(parser: argparse.ArgumentParser, scenario: str = SCENARIO) -> None:
    """Add the arguments that set tracker parameters; `scenario` is the help of scenario files."""
    parser.add_argument("--scenario", type=resources.scenario, metavar="FILE", help=scenario)
    add_params_file_argument(parser)
    add_assignments_argument(parser)


def add_params_file_argument(parser: argparse.ArgumentParser) -> None:
    """Add the argument that names parameter files."""
    parser.add_argument(
        "--params-file",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="ROS parameter file; may be repeated, later ones override",
    )


def add_assignments_argument(parser: argparse.ArgumentParser) -> None:
    """Add the argument that sets single parameters."""
    parser.add_argument(
        "-p",
        dest="assignments",
        action="append",
        default=[],
        metavar="NAME:=VALUE",
        help="a parameter, which overrides those of files; may be repeated",
    )


def add_cutoff_argument(parser: argparse.ArgumentParser) -> None:
    """Add the argument that sets OSPA's cut-off."""
    parser.add_argument(
        "--cutoff",
        type=at_least(SMALL, "m"),
        default=CUTOFF,
        metavar="METRES",
        help=f"c of OSPA and GOSPA ({CUTOFF:g}): the distance at which an estimate no longer "
        "belongs to a target",
    )


def add_clock_argument(parser: argparse.ArgumentParser) -> None:
    """Add the argument that chooses the clock of recorded messages; see `use_clock`."""
    parser.add_argument(
        "--clock",
        choices=("stamps", "arrival"),
        default="stamps",
        help="times of detections and poses: the stamps of their messages, or when these were "
        "recorded, for drivers that stamp nothing (%(default)s)",
    )


def use_clock(bag: BagReader, config: TrackerConfig, clock: str) -> None:
    """Let a bag's detections and poses have the stamps of a clock; transforms keep theirs."""
    if clock == "arrival":
        topics = {topic for each in config.inputs for topic in (each.topic, *each.pose.topics)}
        bag.restamped = frozenset(topics - set(TRANSFORM_TOPICS))


def at_least(least: float, unit: str) -> Callable[[str], float]:
    """Return the type of an argument that is a finite number with a lower bound."""

    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and value >= least):
            bound = f"must be a number of at least {least:g} {unit}"
            raise argparse.ArgumentTypeError(f"{text} given, {bound}")
        return value

    return number


def add_proposal_arguments(
    parser: argparse.ArgumentParser, files: str, seconds: float | None = None
) -> None:
    """Add the arguments of a tool that proposes parameters from a recording.

    `files` is the help of the parameter file that describes the radars. By default `seconds` of the
    recording are read, or all of it.
    """
    parser.add_argument("bag", help=BAG)
    parser.add_argument("--params-file", "--params", type=Path, help=files)
    parser.add_argument("--out", type=Path, help="parameter file to write; it must not exist")
    parser.add_argument(
        "--seconds",
        type=at_least(1.0, "s"),
        default=seconds,
        help="how much of the recording is read, from its beginning "
        f"({'all' if seconds is None else f'{seconds:g}'})",
    )


def require_least(arguments: argparse.Namespace, lowest: Mapping[str, float]) -> None:
    """Raise `ConfigError` with every given argument, by its attribute, that is below its bound."""
    given = {name: getattr(arguments, name, None) for name in lowest}
    faults = [
        f"--{name.replace('_', '-')}: {value} given, must be at least {lowest[name]:g}"
        for name, value in given.items()
        if value is not None and not value >= lowest[name]
    ]
    if faults:
        raise ConfigError(*faults)


def require_new(what: str, path: Path) -> None:
    """Raise `BagError` if a bag, or what else is to be written, exists or cannot be made."""
    if os.path.lexists(path):
        raise BagError(f"{path}: already exists, {what} is not overwritten")
    require_directory(path, path.parent)


def require_directory(path: Path, above: Path | None = None) -> None:
    """Raise `BagError` if no files can be made in a directory, or in the one `above` it."""
    if lack := output_files.why_closed(above or path, parents=True):
        own = lack.removeprefix(f"{path} ")
        raise BagError(f"{path}: {own if own != lack else f'cannot be made, {lack}'}")


def recorded_parameters(
    source: Path, params_file: Path | None
) -> tuple[dict[str, Any], Path] | None:
    """Return the parameters in a file, or else beside a bag, and where they are; None without."""
    if params_file is not None:
        return from_arguments.load(params_file), params_file
    beside = bag_parameters.read(source)
    return None if beside is None else (beside, bag_parameters.path_of(source))


def write_proposal(
    path: Path | None, head: str, values: Mapping[str, Any], comments: Mapping[str, str]
) -> None:
    """Write a proposed parameter file if a path is given, and check that a tracker accepts it."""
    if path is None:
        print("nothing is written without --out FILE")
        return
    yaml_files.write(path, head, values, comments)
    from_arguments.config_of(from_arguments.load(path))
    print(f"{path}: written; the tracker takes it as its --params-file")


def tracker_config(arguments: argparse.Namespace, bag: Path | None = None) -> TrackerConfig:
    """Return the configuration that the parameter arguments describe.

    The parameters beside the bag that is read are used if neither a scenario nor a file is given.
    A warning is printed for each given parameter that does not fit its scene.
    """
    recorded = None if bag is None else bag_parameters.read(bag)
    given: dict[str, Any] = {}
    if arguments.scenario is not None:
        given = from_arguments.scenario_parameters(yaml_files.load(arguments.scenario))
    elif recorded is not None and not arguments.params_file:
        given = dict(recorded)
    given |= from_arguments.from_arguments(arguments.params_file, arguments.assignments)
    # The file may be a live tracker's, with the node's own parameters.
    config = from_arguments.config_of(given)
    if bag is not None and recorded is not None:
        for line in scene.differences(from_arguments.config_of(recorded).values, config.values):
            print(f"{bag_parameters.path_of(bag)}: {line}", file=sys.stderr)
    return config
