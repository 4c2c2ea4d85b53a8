"""Simulates a scenario into a bag: the detections of every radar, and the truth."""

from __future__ import annotations

import argparse
import heapq
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from msg_adapters.encoding import interfaces, names
from msg_adapters.incoming import moving_radars
from msg_adapters.incoming.readers import reader_of
from msg_adapters.targets import truth
from phd_jdtc_ros import output_files, resources
from phd_jdtc_ros.bags.writer import BagWriter, Topic
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.place_forms import TF
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.types import Truth
from phd_jdtc_ros.exit_status import OK, ArgumentParser
from phd_jdtc_ros.parameter_files import bag_parameters, yaml_files
from phd_jdtc_ros.quoting import counted
from phd_jdtc_ros.report_bridge import cloud, missing
from phd_jdtc_ros.simulation import antenna, scenario_file, self_reports
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.self_reports import CLASS_B_S, Received
from phd_jdtc_ros.simulation.turning_antenna import SimulatedReport, check_sites, truth_and_reports
from phd_jdtc_ros.transponders.messages import AIS, FOOT, KNOT, Heard

from . import command
from .asterix import writing as asterix_writing

# Names and dimensions are sent with the first two reports, as they count when heard twice, and then
# every six minutes.
STATIC_NS, FIRST = 360 * 10**9, 2
_NO_HEADING, _NO_COURSE = 511, 360.0


def lines(reports: Iterable[Received]) -> Iterator[tuple[int, bytes]]:
    """Yield the lines of reports with their times of receipt, nanoseconds since the epoch.

    Raise `ModuleNotFoundError` if there are reports of AIS and pyais is not installed.
    """
    sent: dict[int, tuple[int, int]] = {}
    for receipt_ns, report in reports:
        heard = report.heard
        if heard.network != AIS:
            yield receipt_ns, _sbs(heard, report.time_ns)
            continue
        count, last_ns = sent.get(heard.address, (0, 0))
        messages = [_position(heard, report.time_ns)]
        if heard.name and (count < FIRST or receipt_ns - last_ns > STATIC_NS):
            messages += _static(heard)
            sent[heard.address] = count + 1, receipt_ns
        for message in messages:
            for line in _sentences(message):
                yield receipt_ns, _tagged(receipt_ns, line)


def _sentences(message: dict[str, Any]) -> list[str]:
    from pyais import encode_dict

    found: list[str] = encode_dict(message, sentence_type="VDM")
    return found


def _tagged(receipt_ns: int, sentence: str) -> bytes:
    tag, total = f"c:{receipt_ns // 10**9}".encode(), 0
    for byte in tag:
        total ^= byte
    return b"\\%s*%02X\\%s\r\n" % (tag, total, sentence.encode())


def _position(heard: Heard, time_ns: int) -> dict[str, Any]:
    return {
        "type": 18 if heard.interval_s == CLASS_B_S else 1,
        "mmsi": heard.address,
        "lat": heard.latitude,
        "lon": heard.longitude,
        "speed": round(heard.speed / KNOT, 1),
        "course": round(heard.course, 1) % _NO_COURSE,
        "heading": _NO_HEADING if math.isnan(heard.heading) else int(heard.heading + 0.5) % 360,
        "accuracy": int(heard.accurate == 1),
        "second": time_ns // 10**9 % 60,
    }


def _static(heard: Heard) -> list[dict[str, Any]]:
    bow, stern, port, starboard = heard.hull or (0, 0, 0, 0)
    hull = {"to_bow": bow, "to_stern": stern, "to_port": port, "to_starboard": starboard}
    ship = {"mmsi": heard.address, "shipname": heard.name, "ship_type": heard.type}
    if heard.interval_s != CLASS_B_S:
        return [{"type": 5, **ship, **hull}]
    return [{"type": 24, "partno": 0, **ship}, {"type": 24, "partno": 1, **ship, **hull}]


def _sbs(heard: Heard, time_ns: int) -> bytes:
    moment = datetime.fromtimestamp(time_ns // 10**9, timezone.utc)
    day, clock = f"{moment:%Y/%m/%d}", f"{moment:%H:%M:%S}.{time_ns // 10**6 % 1000:03d}"
    height = "" if math.isnan(heard.height) else f"{heard.height / FOOT:.0f}"
    moving = (
        f"{heard.speed / KNOT:.1f},{heard.course:.1f},{heard.latitude:.6f},{heard.longitude:.6f}"
    )
    first = f"MSG,3,1,1,{heard.address:06X},1,{day},{clock},{day},{clock},{heard.name}"
    return f"{first},{height},{moving},,,,,,0\r\n".encode()


# The scenario that is simulated by default.
REFERENCE = Path("config", "scenarios", "paper_scenario.yaml")
DEPTH = 50


def write_bag(
    directory: Path,
    run: Scenario,
    config: TrackerConfig,
    seed: int,
    told: Mapping[str, list[Received]] | None = None,
) -> None:
    """Simulate a scenario into a new bag, with parameters beside it, byte for byte reproducible.

    `told` has the self-reports by receiver.
    """
    with BagWriter(directory) as bag:
        for radar in config.radars:
            kind = reader_of(radar)
            layout = Topic(radar.topic, kind.type_name, DEPTH)
            bag.add_topic(replace(layout, definition=kind.definition, type_hash=kind.type_hash))
        for topic in config.radars_by_platform:
            bag.add_topic(Topic(topic, moving_radars.POSE_TYPES[config.pose_message], DEPTH))
        bag.add_topic(Topic(names.TRUTH, names.CLOUD, DEPTH))
        for own in config.receivers:
            bag.add_topic(Topic(own.topic, names.CLOUD, DEPTH))
        # By stamp; then poses, truth, detections, self-reports.
        parts = _poses(run, config), _scans(run, config, seed), _clouds(config, told or {})
        for stamp_ns, topic, data in heapq.merge(*parts, key=lambda message: message[0]):
            bag.write(topic, data, stamp_ns)
    bag_parameters.write(directory / bag_parameters.NAME, config.values)


def _clouds(
    config: TrackerConfig, told: Mapping[str, list[Received]]
) -> Iterator[tuple[int, str, bytes]]:
    for own in config.receivers:
        for batch in self_reports.batches(told.get(own.name, [])):
            data = interfaces.encode(cloud(batch, config.world_frame))
            yield batch.stamp_ns, own.topic, data


def check_platform(run: Scenario, config: TrackerConfig) -> None:
    """Raise `ConfigError` if radars move only in the scenario or only in the configuration."""
    faults = []
    for index, radar in enumerate(config.radars):
        carried = run.carrier(index) is not None
        if carried and not radar.pose.topic:
            faults.append(f"{radar.name}.pose: fixed given, must be a topic, with a platform")
        elif carried and radar.pose.message == TF:
            faults.append(f"{radar.name}.pose: {TF} given, must be a topic: a bag of poses is made")
        if radar.pose.topic and not carried:
            faults.append(f"platform: must carry {radar.name}, whose pose is {radar.pose.topic}")
        if carried and not radar.pose.yaw:
            faults.append(f"{radar.name}.pose_yaw: false given, must be true: a platform turns it")
    if faults:
        raise ConfigError(*faults)


def _poses(run: Scenario, config: TrackerConfig) -> Iterator[tuple[int, str, bytes]]:
    # The frame of the platform that carries radars.
    platform = "platform"
    for stamp_ns, pose in run.poses():
        data = moving_radars.pose_to_cdr(
            pose, stamp_ns, config.world_frame, config.pose_message, platform
        )
        for topic in config.radars_by_platform:
            yield stamp_ns, topic, data


def _scans(run: Scenario, config: TrackerConfig, seed: int) -> Iterator[tuple[int, str, bytes]]:
    """Yield stamp, topic and data of truth and detections in the order of stamps, truth first."""

    def of_truth(targets: Truth) -> tuple[int, str, bytes]:
        data = interfaces.encode(truth.to_msg(targets, config.world_frame))
        return targets.stamp_ns, names.TRUTH, data

    def of_radar(report: SimulatedReport) -> tuple[int, str, bytes]:
        radar, stamp_ns = config.radars[report.radar], report.stamp_ns
        return stamp_ns, radar.topic, reader_of(radar).to_cdr(report.detections, stamp_ns, radar)

    truths, reports = truth_and_reports(run, config.radars, seed)
    parts = map(of_truth, truths), map(of_radar, reports)
    yield from heapq.merge(*parts, key=lambda message: message[0])


def _write_reports(path: Path, told: Mapping[str, list[Received]]) -> None:
    """Write the reports of all receivers as lines, in the order of their receipt."""
    every = sorted(
        (each for reports in told.values() for each in reports), key=lambda each: each.receipt_ns
    )
    try:
        with output_files.opened(path) as stream:
            stream.writelines(line for _, line in lines(every))
    except ModuleNotFoundError as error:
        raise ConfigError(f"{path}: {missing(error)}") from error
    print(f"{path}: {counted(len(every), 'report[s]')}")


def main(argv: Sequence[str]) -> int:
    """Run the simulation tool."""
    parser = ArgumentParser("simulate", description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="%(default)s")
    parser.add_argument("--out", type=Path, required=True, help="directory of the new bag")
    parser.add_argument(
        "--asterix",
        type=Path,
        metavar="FILE",
        help="file for the radars' ASTERIX output; a capture with times of receipt if it ends with "
        f"{asterix_writing.CAPTURE}",
    )
    parser.add_argument(
        "--reports",
        type=Path,
        metavar="FILE",
        help="file for what receivers of self-reports send: sentences of AIS, SBS-1 of aircraft",
    )
    command.add_parameter_arguments(
        parser, "scenario file, or the name of a shipped one; without it the reference scenario"
    )

    def work(arguments: argparse.Namespace) -> int:
        command.require_least(arguments, {"seed": 0})
        command.require_new("a bag", arguments.out)
        sent_to: Path | None = arguments.asterix
        output_files.require_new(
            {"--asterix": sent_to, "--reports": arguments.reports}, arguments.out
        )
        path = arguments.scenario = arguments.scenario or resources.find(REFERENCE)
        document = yaml_files.load(path)
        config = command.tracker_config(arguments)
        radars = polar_radars(config.model.radars)
        run = scenario_file.resolve(document, radars)
        check_platform(run, config)
        check_sites(config.radars)
        if sent_to is not None:
            asterix_writing.check(run)
        faults: list[str] = []
        sent = antenna.read_sending(document, radars, faults)
        receptions = self_reports.receptions(document, len(run.targets), faults)
        if faults:
            raise ConfigError(*faults)
        self_reports.check(receptions, config.receivers)
        told = {
            own.name: self_reports.received(run, receptions[own.name], own, arguments.seed)
            for own in config.receivers
            if own.name in receptions
        }
        write_bag(arguments.out, run, config, arguments.seed, told)
        if arguments.reports is not None:
            _write_reports(arguments.reports, told)
        if sent_to is not None:
            blocks = asterix_writing.write(sent_to, run, config, sent, arguments.seed)
            print(f"{sent_to}: {blocks} data blocks")
        noun = "radar" if len(radars) == 1 else "radars"
        print(f"{arguments.out}: {run.scans} scans, {len(radars)} {noun}, seed {arguments.seed}")
        return OK

    return command.run(parser, argv, work)
