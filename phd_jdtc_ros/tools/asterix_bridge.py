# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings of ASTERIX to bags. Without arguments: the node, UDP to clouds."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path

from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.exit_status import OK, ArgumentParser
from phd_jdtc_ros.nodes.asterix import settings

from . import asterix_in, command, params_file

NAME = "asterix_bridge"


def main(argv: Sequence[str]) -> int:
    """Run the offline bridge."""
    arguments = _parser().parse_args(argv)

    def work() -> int:
        source: Path = arguments.source
        if arguments.out.exists():
            raise BagError(f"{arguments.out}: already exists, is not overwritten")
        given = params_file.from_arguments(arguments.params_file, arguments.assignments, NAME)
        bridge = settings.resolve(given)
        done = asterix_in.convert(source, arguments.out, bridge, arguments.date, arguments.port)
        print(f"{arguments.out}: {done.clouds} clouds, {done.plots} plots")
        for line in done.lines():
            print(line)
        if not done.clouds:
            print(f"{NAME}: {source}: no sector of any radar is complete", file=sys.stderr)
        return OK

    return command.guarded(NAME, work)


def _parser() -> ArgumentParser:
    parser = ArgumentParser(NAME, description=__doc__)
    parser.add_argument("source", type=Path, help="recording: ASTERIX, final, pcap or pcapng")
    parser.add_argument("--out", type=Path, required=True, help="directory of the new bag")
    parser.add_argument(
        "--date",
        type=_midnight,
        metavar="YYYY-MM-DD",
        help="day of the recording, which ASTERIX does not say; that of a capture, or 1970-01-01",
    )
    parser.add_argument(
        "--port",
        type=int,
        action="append",
        default=[],
        help="of captures: only what was sent to this UDP port; may be repeated",
    )
    parser.add_argument(
        "--params-file", type=Path, action="append", default=[], help="ROS parameter file"
    )
    parser.add_argument(
        "-p", dest="assignments", action="append", default=[], metavar="NAME:=VALUE"
    )
    return parser


def _midnight(text: str) -> int:
    """Return when a day begins, nanoseconds since the epoch."""
    try:
        day = datetime.strptime(text, "%Y-%m-%d").replace(tzinfo=timezone.utc)
    except ValueError:
        day = None
    if day is None or day.year < 1970 or day.year > 2200:
        raise argparse.ArgumentTypeError(f"{text} given, must be a date such as 2026-11-22")
    return int(day.timestamp()) * 10**9
