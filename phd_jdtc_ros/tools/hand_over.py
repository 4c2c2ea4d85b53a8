"""Joins the estimates of trackers that divide an area; tracks keep their numbers at the seams.

The bags are from `track_bag`, each with its tracker's region in the parameters beside it.
Without arguments, this is the node, which does the same live.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from msg_adapters.encoding import names
from msg_adapters.targets import estimates
from phd_jdtc_ros import resources
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.bags.writer import BagWriter, Topic
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.tracks.region import Region
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, SOURCES, Estimates
from phd_jdtc_ros.exit_status import OK, ArgumentParser
from phd_jdtc_ros.handover import picture, settings
from phd_jdtc_ros.handover.picture import JointPicture
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments
from phd_jdtc_ros.quoting import counted
from phd_jdtc_ros.report import load
from phd_jdtc_ros.report.record import Record

from . import command


def join(
    runs: Sequence[Record], regions: Sequence[Region], hysteresis: float, wait_s: float
) -> dict[str, list[Estimates]]:
    """Return the joint estimates of all trackers by source, with common numbers."""
    picture = JointPicture(regions, hysteresis, wait_s, math.inf)
    received = [
        (tracker, source, own)
        for source in SOURCES
        for tracker, run in enumerate(runs)
        for own in run.of_source(source)
    ]
    done = []
    for entry in sorted(received, key=lambda entry: entry[2].stamp_ns):
        complete = picture.add(*entry)
        done += complete if isinstance(complete, list) else []
    done += picture.close_all()
    return {kind: [own for source, own in done if source == kind] for kind in SOURCES}


def _of_bag(given: str) -> tuple[Path, TrackerConfig, Region]:
    path = resources.bag(given)
    BagReader(path)  # What is no bag has no parameters either
    recorded = bag_parameters.read(path)
    if recorded is None:
        raise BagError(
            f"{path}: has no {bag_parameters.NAME} beside it with the region of its tracker, as "
            "track_bag writes"
        )
    config = from_arguments.config_of(recorded)
    if config.region is None:
        raise ConfigError(f"region: not set in {bag_parameters.path_of(path)}, must be")
    return path, config, config.region


def _require_common(
    paths: Sequence[Path], configs: Sequence[TrackerConfig], regions: Sequence[Region]
) -> None:
    """Raise `ConfigError` with every reason why the bags are not of trackers of one area."""
    faults = settings.region_faults([f"{path}: " for path in paths], regions)
    first, first_path = configs[0], paths[0]
    for path, config in zip(paths[1:], configs[1:], strict=True):
        for name in ("world_frame", "world_origin"):
            given, needed = config.values[name], first.values[name]
            if given != needed:
                faults.append(
                    f"{path}: {name}: {given!r} given, must be {needed!r} as in {first_path}"
                )
    classes = {len(config.model.modes.classes) for config in configs}
    if len(classes) > 1:
        faults.append(f"classes: {sorted(classes)} in the bags, must be as many in all")
    if faults:
        raise ConfigError(*faults)


def _run(path: Path, config: TrackerConfig) -> Record:
    """Return the record of a bag; `ConfigError` if some of its estimates cannot be joined."""
    found = load.record(path, config)
    for source in SOURCES:
        for own in found.of_source(source):
            reason = picture.fault_of(own)
            if reason is not None:
                where = f"{path}: {names.estimates(source)} at {own.stamp_ns * 1e-9:.3f} s"
                raise ConfigError(f"{where}: {reason[1]}")
    return found


def _write(
    out: Path, found: Mapping[str, Sequence[Estimates]], config: TrackerConfig, first: Path
) -> None:
    """Write joint estimates with the truth of the first bag, and parameters without a region."""
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
                data = estimates.to_cdr(own, config.world_frame)
                bag.write(names.estimates(kind), data, own.stamp_ns)
    bag_parameters.write(out / bag_parameters.NAME, {**config.values, "region": []})


def main(argv: Sequence[str]) -> int:
    """Run the hand-over."""
    parser = ArgumentParser("hand_over", description=__doc__)
    parser.add_argument("bags", nargs="+", metavar="BAG", help=f"{command.BAG}; one per tracker")
    parser.add_argument("--out", type=Path, required=True, help="directory of the new bag")
    parser.add_argument(
        "--smoothed-wait",
        type=float,
        default=settings.SMOOTHED_WAIT_S,
        metavar="SECONDS",
        help="how much later than a smoothed estimate's stamp its track may have got its number; "
        "%(default)s",
    )

    def work(arguments: argparse.Namespace) -> int:
        if len(arguments.bags) < 2:
            raise ConfigError("BAG: one given, must be two or more")
        command.require_new("a bag", arguments.out)
        paths, configs, regions = zip(*map(_of_bag, arguments.bags), strict=True)
        if not 0.0 <= arguments.smoothed_wait <= settings.LONGEST_S:
            bounds = f"must be from 0 to {settings.LONGEST_S:g}"
            raise ConfigError(f"--smoothed-wait: {arguments.smoothed_wait} given, {bounds}")
        _require_common(paths, configs, regions)
        runs = [_run(path, config) for path, config in zip(paths, configs, strict=True)]
        found = join(runs, regions, settings.hysteresis(regions), arguments.smoothed_wait)
        _write(arguments.out, found, configs[0], paths[0])
        tracks = {n for own in found[FILTERED] for n in own.track_id.tolist()}
        print(
            f"{arguments.out}: {len(found[FILTERED])} filtered and {len(found[SMOOTHED])} "
            f"smoothed stamps of {len(runs)} trackers, {counted(len(tracks), 'track[s]')}"
        )
        return OK

    return command.run(parser, argv, work)
