"""Bags of the dataset's scenarios, and the recording of a bag."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from msg_adapters.encoding import interfaces, names
from msg_adapters.incoming import moving_radars
from msg_adapters.incoming.readers import reader_of
from msg_adapters.targets import truth
from phd_jdtc_ros import resources
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.bags.writer import BagWriter, Topic
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.core.types import Pose
from phd_jdtc_ros.exit_status import OK, ArgumentParser
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments
from phd_jdtc_ros.parameter_files.sections import BAG_PARAMETERS
from phd_jdtc_ros.tools import command

from . import recording as dataset
from .recording import SENSORS, Look, Recording

PROFILE = Path("config/autoferry.yaml")
SHIPPED = resources.PROFILE_BAGS["autoferry"]
OWN_SHIP = "own_ship"
DEPTH = 50
# Additional parameters of a tracker that also uses the lidar.
LIDAR: Mapping[str, Any] = {
    "sensors": list(SENSORS),
    "lag": 5,
    "lag_s": 5.0,
    "lidar.pose": f"/{OWN_SHIP}/odometry",
    "lidar.fields.amplitude": "",
    # A vessel returns several detections, and the radar and the lidar see different parts of it.
    "lidar.cluster_distance": 15.0,
    "lidar.range_std": 4.0,
    "lidar.azimuth_std_deg": 3.0,
    "lidar.min_range": 5.0,
    "lidar.max_range": 150.0,
    # A vessel beyond about 80 m reflects too little, whatever the water does. Misses go together.
    "lidar.detection_probability": [0.7, 0.6, 0.2, 0.05],
    "lidar.detection_probability_range": [0.0, 50.0, 100.0, 150.0],
    "lidar.detection_correlation": 0.4,
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
    either, and the truth at every scan of the radar. The bytes depend on the arguments only.
    """
    with BagWriter(directory) as bag:
        for radar in config.inputs:
            bag.add_topic(Topic(radar.topic, reader_of(radar).type_name, DEPTH))
        for topic in config.radars_by_platform:
            bag.add_topic(Topic(topic, moving_radars.POSE_TYPES[config.pose_message], DEPTH))
        bag.add_topic(Topic(names.TRUTH, names.CLOUD, DEPTH))
        for stamp_ns, topic, data in _messages(recording, config):
            bag.write(topic, data, stamp_ns)
    bag_parameters.write(directory / BAG_PARAMETERS, config.values)


def _messages(recording: Recording, config: TrackerConfig) -> Iterator[tuple[int, str, bytes]]:
    """Yield stamp, topic and data of every message in the order of stamps, poses first."""
    radars, frame = {radar.name: radar for radar in config.inputs}, config.world_frame
    posed_ns = -1
    for look in recording.looks:
        stamp_ns = look.stamp_ns
        if stamp_ns > posed_ns:
            kind = config.pose_message
            data = moving_radars.pose_to_cdr(look.own, stamp_ns, frame, kind, OWN_SHIP)
            for topic in config.radars_by_platform:
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
    """Return the radar's data in a bag written by `write_bag`."""
    config, bag = resolve(parameters(lidar=False)), BagReader(path)
    (radar,), (odometry,) = config.inputs, config.radars_by_platform
    types = {radar.topic: names.CLOUD, names.TRUTH: names.CLOUD}
    bag.require({**types, odometry: moving_radars.POSE_TYPES[config.pose_message]})
    own: dict[int, Pose] = {}
    looks = []
    targets: dict[int, list[tuple[float, float, float]]] = {}
    for entry in bag.messages([odometry, radar.topic, names.TRUTH]):
        if entry.topic == odometry:
            stamp_ns, pose = moving_radars.pose_from_cdr(
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


def add_dataset_arguments(parser: ArgumentParser, **directory: Any) -> None:
    """Add the arguments that select scenarios of the dataset."""
    parser.add_argument("directory", type=Path, help="the dataset's CSV", **directory)
    parser.add_argument(
        "--scenario", type=int, action="append", default=[], metavar="NUMBER", help="only this one"
    )


def select_recordings(arguments: argparse.Namespace) -> list[Recording]:
    """Return the recordings of a directory that the arguments select."""
    directory: Path = arguments.directory
    try:
        numbers = arguments.scenario or dataset.scenarios_in(directory)
        return [dataset.read(directory, number) for number in numbers]
    except dataset.RecordingError as error:
        raise BagError(str(error)) from error


def main(argv: Sequence[str]) -> int:
    """Write bags of the scenarios of the dataset, with parameters and truth."""
    parser = ArgumentParser("studies autoferry_bags", description=main.__doc__)
    add_dataset_arguments(parser)
    parser.add_argument("--lidar", action="store_true", help="the lidar's detections too")
    parser.add_argument("--out", type=Path, required=True, help="directory of the bags")

    def work(arguments: argparse.Namespace) -> int:
        lidar: bool = arguments.lidar
        config = resolve(parameters(lidar))
        for recording in select_recordings(arguments):
            name = f"autoferry_{recording.scenario}{'_lidar' if lidar else ''}"
            directory = arguments.out / name
            write_bag(directory, recording, config)
            counts = (
                f"{len(recording.of(each.name))} of the {each.name}" for each in config.inputs
            )
            print(f"{directory}: scans {', '.join(counts)}")
        return OK

    return command.run(parser, argv, work)
