"""The Autoferry dataset: bags of its scenarios, and our figures beside those of other trackers."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from msg_adapters import interfaces, names, platform_poses, truth
from msg_adapters.readers import reader_of
from phd_jdtc_ros import output_files, resources
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.bags.writer import BagWriter, Topic
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.core.types import Pose
from phd_jdtc_ros.exit_status import OK, ArgumentParser
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments
from phd_jdtc_ros.study import autoferry, autoferry_scores
from phd_jdtc_ros.study.autoferry import SENSORS, Look, Recording

from . import command

PROFILE = Path("config/autoferry.yaml")
SHIPPED = resources.PROFILE_BAGS["autoferry"]
OWN_SHIP = "own_ship"
DEPTH = 50
# What a tracker that uses the lidar too has in addition.
LIDAR: Mapping[str, Any] = {
    "sensors": list(SENSORS),
    "lag": "5 s",
    "lidar.pose": f"/{OWN_SHIP}/odometry",
    "lidar.fields.amplitude": "",
    "lidar.range_std": 2.0,
    "lidar.azimuth_std_deg": 2.0,
    "lidar.min_range": 5.0,
    "lidar.max_range": 150.0,
    # A vessel beyond about 80 m reflects too little, whatever the water does.
    "lidar.detection_probability": [0.0, 0.7, 50.0, 0.6, 100.0, 0.2, 150.0, 0.05],
    "lidar.clutter_rate": 2.0,
    "lidar.clutter_max_range": 150.0,
}


def parameters(lidar: bool) -> dict[str, Any]:
    """Return the profile's parameters, for the radar alone or with the lidar."""
    given = dict(from_arguments.load(resources.find(PROFILE)))
    return {**given, **LIDAR} if lidar else given


def write_bag(directory: Path, recording: Recording, config: TrackerConfig) -> None:
    """Write a scenario into a new bag, with the parameters beside it that a tracker needs.

    The bag has the detections of the configured sensors, the ferry's position at every scan of
    either, and the truth at every scan of the radar. Equal arguments give equal bytes.
    """
    with BagWriter(directory) as bag:
        for radar in config.inputs:
            bag.add_topic(Topic(radar.topic, reader_of(radar).type_name, DEPTH))
        for topic in config.carried:
            bag.add_topic(Topic(topic, platform_poses.TYPES[config.pose_message], DEPTH))
        bag.add_topic(Topic(names.TRUTH, names.CLOUD, DEPTH))
        for stamp_ns, topic, data in _messages(recording, config):
            bag.write(topic, data, stamp_ns)
    bag_parameters.write(directory / bag_parameters.NAME, config.values)


def _messages(recording: Recording, config: TrackerConfig) -> Iterator[tuple[int, str, bytes]]:
    """Yield stamp, topic and data of every message in the order of stamps, poses first."""
    radars, frame = {radar.name: radar for radar in config.inputs}, config.world_frame
    posed_ns = -1
    for look in recording.looks:
        stamp_ns = look.stamp_ns
        if stamp_ns > posed_ns:
            kind = config.pose_message
            data = platform_poses.to_cdr(look.own, stamp_ns, frame, kind, OWN_SHIP)
            for topic in config.carried:
                yield stamp_ns, topic, data
            posed_ns = stamp_ns
        if look.sensor == SENSORS[0]:
            targets = truth.to_msg(recording.truth(stamp_ns), frame)
            yield stamp_ns, names.TRUTH, interfaces.encode(targets)
        if look.sensor in radars:
            radar = radars[look.sensor]
            data = reader_of(radar).to_cdr(look.detections, stamp_ns, radar)
            yield stamp_ns, radar.topic, data


def of_bag(path: Path) -> Recording:
    """Return the radar's part of a bag that `write_bag` has written, named as it names it."""
    config, bag = resolve(parameters(lidar=False)), BagReader(path)
    (radar,), (odometry,) = config.inputs, config.carried
    types = {radar.topic: names.CLOUD, names.TRUTH: names.CLOUD}
    bag.require({**types, odometry: platform_poses.TYPES[config.pose_message]})
    own: dict[int, Pose] = {}
    looks = []
    targets: dict[int, list[tuple[float, float, float]]] = {}
    for entry in bag.messages([odometry, radar.topic, names.TRUTH]):
        if entry.topic == odometry:
            stamp_ns, pose = platform_poses.from_cdr(
                entry.data, config.pose_message, config.world_frame
            )
            own[stamp_ns] = pose
        elif entry.topic == radar.topic:
            report = reader_of(radar).from_cdr(entry.data, radar)
            distance, azimuth = report.detections.measurement.T
            east, north = distance * np.cos(azimuth), distance * np.sin(azimuth)
            relative = np.stack([east, north], axis=1)
            looks.append(Look(radar.name, report.stamp_ns, own[report.stamp_ns], relative))
        else:
            known = truth.from_msg(interfaces.decode(entry.data, names.CLOUD))
            for number, place in zip(known.track_id, known.position, strict=True):
                targets.setdefault(int(number), []).append((known.stamp_ns * 1e-9, *place))
    scenario = int(path.resolve().name.split("_")[1])
    return Recording(scenario, tuple(looks), {k: np.array(v) for k, v in targets.items()})


def table(scores: Sequence[autoferry_scores.Score]) -> Table:
    """Return the figures of all trackers, a row for each and its source."""
    numbers = list(dict.fromkeys(score.scenario for score in scores))
    title = "Autoferry: mean GOSPA in metres (c = 50 m, p = 2) by scenario"
    # Narrow enough for a terminal of 80 columns.
    found = Table(title=title, box=SIMPLE_HEAD, padding=0)
    found.add_column("tracker", no_wrap=True)
    for name in (*map(str, numbers), "mean", "missed", "false", "RMS"):
        found.add_column(name, justify="right")
    for (tracker, source), mean in autoferry_scores.means(scores).items():
        rows = [each for each in scores if (each.tracker, each.source) == (tracker, source)]
        cells = [f"{each.gospa:.1f}" for each in rows]
        cells += [f"{mean['gospa']:.1f}", f"{mean['missed']:.2f}", f"{mean['false']:.2f}"]
        found.add_row(f"{tracker}, {source}", *cells, f"{mean['position_rms']:.1f}")
    return found


def _figures(recordings: Sequence[Recording], out: Path) -> None:
    """Print the figures of all trackers, and write them."""
    scores = []
    for recording in recordings:
        with_lidar = parameters(lidar=True) if recording.of("lidar") else None
        scores += autoferry_scores.scores_of(recording, parameters(lidar=False), with_lidar)
    judged = autoferry_scores.goals_of(scores)
    document = {"scores": [score.as_json() for score in scores], "goals": judged}
    out.mkdir(parents=True, exist_ok=True)
    path = out / "autoferry.json"
    output_files.write(path, json.dumps(document, indent=2, allow_nan=False) + "\n")
    console = Console()
    console.print(table(scores))
    for goal in judged:
        verdict = "reached" if goal["reached"] else "not reached"
        console.print(f"{goal['name']}: {goal['value']:.2f} (goal {goal['goal']:.2f}, {verdict})")
    console.print(f"results: {path}", soft_wrap=True, markup=False, highlight=False)


def _write_bags(recordings: Sequence[Recording], out: Path, lidar: bool) -> None:
    config = resolve(parameters(lidar))
    for recording in recordings:
        directory = out / f"autoferry_{recording.scenario}{'_lidar' if lidar else ''}"
        write_bag(directory, recording, config)
        counts = ", ".join(f"{len(recording.of(s.name))} of the {s.name}" for s in config.inputs)
        print(f"{directory}: scans {counts}")


def main(argv: Sequence[str]) -> int:
    """Run the tool."""
    parser = ArgumentParser("autoferry", description=__doc__)
    parser.add_argument(
        "directory",
        type=Path,
        nargs="?",
        help="the dataset's radar and lidar parts, CSV; --figures alone are of the shipped bag",
    )
    parser.add_argument(
        "--out", type=Path, help="directory of the bags; with --figures of the results, out/study"
    )
    parser.add_argument(
        "--scenario", type=int, action="append", default=[], metavar="NUMBER", help="only this one"
    )
    parser.add_argument("--lidar", action="store_true", help="bags with the lidar's detections too")
    parser.add_argument(
        "--figures", action="store_true", help="track, score and compare; needs Stone Soup"
    )
    arguments = parser.parse_args(argv)

    def work() -> int:
        recordings = _recordings(arguments)
        if arguments.figures:
            try:
                _figures(recordings, arguments.out or Path("out/study"))
            except ImportError as error:
                raise BagError(f"--figures: {error}") from error
            return OK
        if arguments.out is None:
            raise BagError("--out: must be the directory of the new bags")
        _write_bags(recordings, arguments.out, arguments.lidar)
        return OK

    return command.guarded("autoferry", work)


def _recordings(arguments: argparse.Namespace) -> list[Recording]:
    directory: Path | None = arguments.directory
    if directory is None:
        if not arguments.figures or arguments.scenario:
            raise BagError("directory: must be that of the dataset's CSV")
        return [of_bag(resources.bag(SHIPPED))]
    try:
        numbers = arguments.scenario or autoferry.scenarios_in(directory)
        return [autoferry.read(directory, number) for number in numbers]
    except autoferry.RecordingError as error:
        raise BagError(str(error)) from error
