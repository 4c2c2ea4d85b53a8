"""Code that the offline executables share: common arguments, error reports, exit status."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.configuration import scene
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.schema import SMALL, ConfigError
from phd_jdtc_ros.exit_status import INTERRUPTED, USAGE, fail
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments, tracker_params, yaml_files
from phd_jdtc_ros.quoting import short

# Default cut-off c (metres) and order p of OSPA.
CUTOFF, ORDER = 1000.0, 2.0
# What a scenario file is for, where a bag is read.
SCENARIO = (
    "scenario file, whose parameters are used; without one and without --params-file those beside "
    "the bag, or else the reference scenario's"
)
# What a bag may be given as.
BAG = "rosbag2 directory, MCAP file, or the name of a shipped bag"


def guarded(name: str, work: Callable[[], int]) -> int:
    """Run `work`; report errors that users can cause in a line, and return the exit status."""
    try:
        return work()
    except (ConfigError, BagError) as error:
        return fail(name, error)
    except OSError as error:  # a path that cannot be written, a full disk
        where = f"{error.filename}: " if error.filename else ""
        print(f"{name}: {short(where)}{error.strerror or error}", file=sys.stderr)
        return USAGE
    except KeyboardInterrupt:
        print(f"{name}: interrupted", file=sys.stderr)
        return INTERRUPTED


def add_parameter_arguments(parser: argparse.ArgumentParser, scenario: str = SCENARIO) -> None:
    """Add the arguments that set tracker parameters; `scenario` is the help of scenario files."""
    parser.add_argument("--scenario", type=Path, help=scenario)
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
        type=_cutoff,
        default=CUTOFF,
        metavar="METRES",
        help=f"c of OSPA and GOSPA ({CUTOFF:g}): about the distance at which an estimate is no "
        "longer of a target",
    )


def _cutoff(text: str) -> float:
    try:
        cutoff = float(text)
    except ValueError:
        cutoff = math.nan
    if not (math.isfinite(cutoff) and cutoff >= SMALL):
        raise argparse.ArgumentTypeError(f"{text} given, must be a number of at least {SMALL:g} m")
    return cutoff


def tracker_config(arguments: argparse.Namespace, bag: Path | None = None) -> TrackerConfig:
    """Return the configuration that the parameter arguments describe.

    Parameters
    ----------
    bag : Path or None
        The bag that is read. The parameters beside it are those used if neither a scenario nor a
        file is given; if others are given that do not fit its scene, warnings say so.

    Raises
    ------
    ConfigError
        With every fault.
    """
    recorded = None if bag is None else bag_parameters.read(bag)
    given: dict[str, Any] = {}
    if arguments.scenario is not None:
        given = from_arguments.scenario_parameters(yaml_files.load(arguments.scenario))
    elif recorded is not None and not arguments.params_file:
        given = dict(recorded)
    paths: Sequence[Path] = arguments.params_file
    given |= from_arguments.from_arguments(paths, arguments.assignments)
    # The file may be a live tracker's, with the node's own parameters.
    config = tracker_params.config(given)
    if bag is not None and recorded is not None:
        for line in scene.differences(tracker_params.config(recorded).values, config.values):
            print(f"{bag_parameters.path_of(bag)}: {line}", file=sys.stderr)
    return config
