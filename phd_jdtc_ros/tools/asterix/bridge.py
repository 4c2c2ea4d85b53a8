"""Converts recordings of ASTERIX to bags and back; without arguments it is the node, with UDP."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from msg_adapters.encoding import names
from phd_jdtc_ros import output_files, resources
from phd_jdtc_ros.asterix_bridge import settings
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.parts import is_mcap
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.types import FILTERED, SOURCES
from phd_jdtc_ros.exit_status import CORRUPT, OK, ArgumentParser
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments
from phd_jdtc_ros.quoting import counts_text, short

from .. import command, recorded_clouds
from . import reading, writing

NAME = "asterix_bridge"


def main(argv: Sequence[str]) -> int:
    """Run the offline bridge."""
    return command.run(_parser(), argv, _work)


def _work(arguments: argparse.Namespace) -> int:
    if arguments.csv is None:
        command.require_new("it", arguments.out)
    else:
        output_files.require_new({"--csv": arguments.csv})
    given = from_arguments.from_arguments(arguments.params_file, arguments.assignments, NAME)
    path = Path(arguments.source)
    if path.suffix not in ("", ".mcap") and not path.exists():
        raise BagError(f"{path}: no such recording or bag")
    if path.is_file() and not is_mcap(path):
        return _from_recording(path, arguments, settings.resolve(given))
    if arguments.csv is not None:
        raise ConfigError(
            f"--csv: given with {path}, which must be a recording of ASTERIX; the tracks of a bag "
            "are written by track_bag --csv"
        )
    return _to_asterix(resources.bag(arguments.source), arguments, given)


def _from_recording(path: Path, arguments: argparse.Namespace, bridge: settings.Bridge) -> int:
    read, out = reading.convert, arguments.out
    if arguments.csv is not None:
        read, out = reading.tabulate, arguments.csv
    done = read(path, out, bridge, arguments.date, arguments.port)
    print(f"{out}: {done.clouds} clouds, {done.plots} plots")
    for line in done.lines():
        print(line)
    faults = list(done.faults())
    for fault in faults:
        print(f"{NAME}: {path}: {short(fault)}", file=sys.stderr)
    return CORRUPT if faults else OK


def _to_asterix(path: Path, arguments: argparse.Namespace, given: dict[str, object]) -> int:
    bag = BagReader(path)
    recorded = bag_parameters.read(path) or {}
    config = from_arguments.config_of(recorded)
    if arguments.plots:
        bridge = settings.resolve(given)
        done = writing.write_plots(bag, arguments.out, config, bridge)
    else:
        # The map's place on the earth is taken from the tracker's parameters.
        known = config.known_plane is not None and "world_origin" in recorded
        origin = {"world_origin": recorded["world_origin"]} if known else {}
        if config.plane is not None and not known:
            print("the position of the radar is unknown: tracks have no latitudes and longitudes")
        bridge = settings.resolve({**origin, **given})
        topic = names.estimates(arguments.estimates)
        done = writing.write_tracks(bag, arguments.out, bridge, topic, config)
    dropped = counts_text(done.dropped)
    nothing = not done.clouds and not dropped
    print(
        f"{arguments.out}: {done.records} {done.what} in {done.blocks} data blocks, of "
        f"{done.clouds} clouds; dropped: {dropped or 'none'}"
    )
    if done.out_of_range:
        print(f"plots beyond the largest range of CAT048: {done.out_of_range}")
    if done.used >= reading.LEAST_USED and not nothing:
        return OK
    used = f"{done.used:.0%} of its clouds could be used; dropped: {dropped}"
    fault = f"has no clouds, so there are no {done.what}" if nothing else used
    print(f"{NAME}: {path}: {fault}", file=sys.stderr)
    return CORRUPT


def _parser() -> ArgumentParser:
    parser = ArgumentParser(NAME, description=__doc__)
    parser.add_argument(
        "source", help=f"recording: ASTERIX, final, pcap or pcapng; or a {command.BAG}"
    )
    written = parser.add_mutually_exclusive_group(required=True)
    written.add_argument(
        "--out", type=Path, help="directory of the new bag, or file of the new data blocks"
    )
    written.add_argument(
        "--csv",
        type=Path,
        metavar="FILE",
        help="for a recording: write its decoded plots as a table, and no bag",
    )
    parser.add_argument(
        "--plots",
        action="store_true",
        help="for a bag: write its detections as CAT048 and CAT034, not its estimates as CAT062",
    )
    parser.add_argument(
        "--estimates",
        choices=SOURCES,
        default=FILTERED,
        help="for a bag: the estimates to write as CAT062 (%(default)s)",
    )
    parser.add_argument(
        "--date",
        type=recorded_clouds.day,
        metavar="YYYY-MM-DD",
        help="day of the recording, which ASTERIX does not contain; default: the capture's day, or "
        "1970-01-01",
    )
    recorded_clouds.add_port_argument(parser)
    command.add_params_file_argument(parser)
    command.add_assignments_argument(parser)
    return parser
