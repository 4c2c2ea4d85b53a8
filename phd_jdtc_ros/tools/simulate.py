# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulates a scenario into a bag: the detections of every radar, and the truth."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from pathlib import Path

from msg_adapters import interfaces, names, truth
from msg_adapters.readers import reader_of
from phd_jdtc_ros import yaml_files
from phd_jdtc_ros.bags.writer import BagWriter, Topic
from phd_jdtc_ros.core.configuration.radar_input import RadarInput
from phd_jdtc_ros.core.configuration.schema import ConfigError
from phd_jdtc_ros.core.simulation import scenario, scenario_file
from phd_jdtc_ros.core.simulation.scenario import Scenario
from phd_jdtc_ros.core.simulation.simulate import simulate
from phd_jdtc_ros.core.simulation.sweep import simulate_reports
from phd_jdtc_ros.core.types import Detections, Truth
from phd_jdtc_ros.exit_status import OK, ArgumentParser

from . import command

DEPTH = 50


def write_bag(
    directory: Path, run: Scenario, inputs: tuple[RadarInput, ...], world_frame: str, seed: int
) -> None:
    """Simulate a scenario into a new bag; equal arguments give equal bytes.

    Every radar's messages have the layout that `inputs` says, so that the same parameters read
    them.
    """
    with BagWriter(directory) as bag:
        for radar in inputs:
            kind = reader_of(radar)
            bag.add_topic(
                Topic(
                    radar.topic,
                    kind.type_name,
                    DEPTH,
                    definition=kind.definition,
                    type_hash=kind.type_hash,
                )
            )
        bag.add_topic(Topic(names.TRUTH, names.CLOUD, DEPTH))
        for stamp_ns, topic, data in _messages(run, inputs, world_frame, seed):
            bag.write(topic, data, stamp_ns)


def _messages(
    run: Scenario, inputs: tuple[RadarInput, ...], world_frame: str, seed: int
) -> Iterator[tuple[int, str, bytes]]:
    """Yield stamp, topic and data of every message in the order of stamps, the truth first."""

    def of_truth(targets: Truth) -> tuple[int, str, bytes]:
        data = interfaces.encode(truth.to_msg(targets, world_frame))
        return targets.stamp_ns, names.TRUTH, data

    def of_radar(index: int, stamp_ns: int, found: Detections) -> tuple[int, str, bytes]:
        radar = inputs[index]
        return stamp_ns, radar.topic, reader_of(radar).to_cdr(found, stamp_ns, radar)

    if run.turning:
        true = map(of_truth, (scenario.truth_at(run, scan) for scan in range(run.scans)))
        reports = simulate_reports(run, inputs, seed)
        seen = (of_radar(each.radar, each.stamp_ns, each.detections) for each in reports)
        yield from heapq.merge(true, seen, key=lambda message: message[0])
        return
    for targets, scan in simulate(run, seed):
        yield of_truth(targets)
        for index, found in enumerate(scan.detections):
            if found is not None:
                yield of_radar(index, scan.stamp_ns, found)


def main(argv: Sequence[str]) -> int:
    """Run the simulation tool."""
    parser = ArgumentParser("simulate", description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True, help="directory of the new bag")
    command.add_parameter_arguments(parser)
    arguments = parser.parse_args(argv)

    def work() -> int:
        if arguments.seed < 0:
            raise ConfigError([f"--seed: {arguments.seed} given, must be at least 0"])
        path: Path | None = arguments.scenario
        document = yaml_files.load(path) if path else None
        config = command.tracker_config(arguments)
        radars = config.model.radars
        run = scenario_file.resolve(document, radars) if path else scenario.paper_scenario(radars)
        write_bag(arguments.out, run, config.inputs, config.world_frame, arguments.seed)
        print(f"{arguments.out}: {run.scans} scans, {len(radars)} radars, seed {arguments.seed}")
        return OK

    return command.guarded("simulate", work)
