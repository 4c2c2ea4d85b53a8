# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Joins the estimates of trackers that part an area, with numbers that stay at the seams.

The bags are those of `track_bag`, each with its tracker's region in the parameters beside it.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console

from msg_adapters import estimates, interfaces, names
from phd_jdtc_ros import resources
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.bags.writer import BagWriter, Topic
from phd_jdtc_ros.core.configuration.build import TrackerConfig
from phd_jdtc_ros.core.configuration.schema import ConfigError
from phd_jdtc_ros.core.handover import Handover, Track
from phd_jdtc_ros.core.region import Region
from phd_jdtc_ros.core.reporting import chosen
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, Estimates
from phd_jdtc_ros.exit_status import OK, ArgumentParser
from phd_jdtc_ros.nodes.common import bag_parameters
from phd_jdtc_ros.report import load
from phd_jdtc_ros.report.record import Record

from . import command, tracker_params

# How far beyond a seam a target changes over, in margins.
HYSTERESIS = 0.2
_NO_ROWS = np.zeros(0, dtype=np.int64)


def at_common_stamps(runs: Sequence[Sequence[Estimates]]) -> list[list[Estimates]]:
    """Return the estimates of every stamp, one set per tracker; empty ones where it has none."""
    known = [{found.stamp_ns: found for found in run} for run in runs]
    nothing = next((chosen(found, _NO_ROWS) for run in runs for found in run), None)
    stamps = sorted({stamp_ns for run in known for stamp_ns in run})
    if nothing is None:
        return []
    return [
        [run.get(stamp_ns, replace(nothing, stamp_ns=stamp_ns)) for run in known]
        for stamp_ns in stamps
    ]


def joined(
    runs: Sequence[Record], regions: Sequence[Region], hysteresis: float
) -> dict[str, list[Estimates]]:
    """Return the joint estimates by source; both have the same numbers.

    Parameters
    ----------
    runs : sequence of Record
        One per tracker.
    regions : sequence of Region
    hysteresis : float
        See `Handover`.
    """
    handover, filtered = Handover(regions, hysteresis), []
    given: dict[Track, list[tuple[int, int]]] = {}
    for found in at_common_stamps([run.filtered for run in runs]):
        filtered.append(handover.add(found))
        for track, number in handover.numbers.items():
            given.setdefault(track, []).append((found[0].stamp_ns, number))
    smoothed = [
        handover.numbered(found, _numbers_at(given, found[0].stamp_ns))
        for found in at_common_stamps([run.smoothed for run in runs])
    ]
    return {FILTERED: filtered, SMOOTHED: smoothed}


def _numbers_at(
    given: Mapping[Track, Sequence[tuple[int, int]]], stamp_ns: int
) -> dict[Track, int]:
    """Return the number of each track at a stamp, or else the next one that it has."""
    numbers = {}
    for track, known in given.items():
        place = bisect_left(known, (stamp_ns, 0))
        numbers[track] = known[min(place, len(known) - 1)][1]
    return numbers


def _of_bag(given: str) -> tuple[Path, TrackerConfig, Region]:
    path = resources.bag(given)
    recorded = bag_parameters.read(path)
    config = None if recorded is None else tracker_params.config(recorded)
    if config is None or config.region is None:
        raise ConfigError([f"region: not set in {bag_parameters.path_of(path)}, must be"])
    return path, config, config.region


def _write(
    out: Path, found: Mapping[str, Sequence[Estimates]], config: TrackerConfig, first: Path
) -> None:
    """Write joint estimates, with the truth of a bag, and the parameters of no region."""
    source = BagReader(first)
    with BagWriter(out) as bag:
        for kind in found:
            bag.add_topic(Topic(names.estimates(kind), names.CLOUD))
        if names.TRUTH in source.types:
            bag.add_topic(source.topic(names.TRUTH, depth=50))
            for entry in source.messages([names.TRUTH]):
                bag.write(entry.topic, entry.data, entry.stamp_ns)
        for kind, by_stamp in found.items():
            for own in by_stamp:
                message = estimates.to_msg(own, config.world_frame)
                bag.write(names.estimates(kind), interfaces.encode(message), own.stamp_ns)
    values = {**config.values, "region": [], "region_margin": 0.0}
    bag_parameters.write(out / bag_parameters.NAME, values)


def main(argv: Sequence[str]) -> int:
    """Run the hand-over."""
    parser = ArgumentParser("hand_over", description=__doc__)
    parser.add_argument("bags", nargs="+", metavar="BAG", help=f"{command.BAG}; one per tracker")
    parser.add_argument("--out", type=Path, required=True, help="directory of the new bag")
    parser.add_argument(
        "--hysteresis",
        type=float,
        metavar="METRES",
        help="how far beyond a seam a target changes over; a fifth of the smallest margin",
    )
    arguments = parser.parse_args(argv)

    def work() -> int:
        if len(arguments.bags) < 2:
            raise ConfigError(["BAG: one given, must be two or more"])
        paths, configs, regions = zip(*map(_of_bag, arguments.bags), strict=True)
        margin = min(region.margin for region in regions)
        hysteresis = HYSTERESIS * margin if arguments.hysteresis is None else arguments.hysteresis
        if not 0.0 <= hysteresis <= margin:
            raise ConfigError(
                [f"--hysteresis: {hysteresis} given, must be from 0 to the margin, {margin:g}"]
            )
        if arguments.out.exists():
            raise BagError(f"{arguments.out}: already exists, a bag is not overwritten")
        runs = [load.record(path, config) for path, config in zip(paths, configs, strict=True)]
        found = joined(runs, regions, hysteresis)
        _write(arguments.out, found, configs[0], paths[0])
        tracks = {n for own in found[FILTERED] for n in own.track_id.tolist()}
        Console().print(
            f"{arguments.out}: {len(found[FILTERED])} filtered and {len(found[SMOOTHED])} "
            f"smoothed stamps of {len(runs)} trackers, {len(tracks)} tracks",
            soft_wrap=True,
            markup=False,
            highlight=False,
        )
        return OK

    return command.guarded("hand_over", work)
