# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Offline tracking: a bag with detections in, a bag with estimates out.

The scans take the same path as in the live node (decode, group by stamp, step), so the estimates
are equal to the live ones, and two runs write the same bytes.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import track

from msg_adapters import detections, estimates, interfaces, names
from msg_adapters.errors import RejectedMessageError
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.reader import BagMessage, BagReader
from phd_jdtc_ros.bags.writer import BagWriter, Topic
from phd_jdtc_ros.core.configuration.build import TrackerConfig
from phd_jdtc_ros.core.engine import Engine
from phd_jdtc_ros.core.scans import Rejection, Reset
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, Estimates, Scan
from phd_jdtc_ros.exit_status import OK, fail
from phd_jdtc_ros.report import load
from phd_jdtc_ros.report.table import score_tables

from . import command


class OfflineTracker:
    """Feeds recorded clouds to an engine and writes what comes out.

    Parameters
    ----------
    config : TrackerConfig
    bag : BagWriter
        With the estimates' topics added.
    """

    def __init__(self, config: TrackerConfig, bag: BagWriter) -> None:
        self._config = config
        self._bag = bag
        self._engine: Engine = config.engine()
        self._grouper = config.grouper()
        self._radar_of = {radar.topic: index for index, radar in enumerate(config.inputs)}
        self.scans = 0
        self.dropped: Counter[str] = Counter()

    def add(self, entry: BagMessage) -> None:
        """Take in one recorded cloud."""
        index = self._radar_of[entry.topic]
        try:
            cloud = interfaces.decode(entry.data, names.CLOUD)
            report = detections.from_msg(cloud, self._config.inputs[index])
        except RejectedMessageError as error:
            self.dropped[error.reason] += 1
            return
        self.dropped.update(report.dropped)
        events = self._grouper.add(index, report.stamp_ns, report.detections)
        if isinstance(events, Rejection):
            self.dropped[events.value] += 1
        else:
            self._handle(events)

    def finish(self) -> None:
        """Close what is pending and write the estimates still held back."""
        self._handle(self._grouper.close_all())
        self._write_all(SMOOTHED, self._engine.flush())

    def _handle(self, events: Sequence[Scan | Reset]) -> None:
        for event in events:
            if isinstance(event, Reset):
                rest = self._engine.interrupt() if event.ahead else self._engine.flush()
                self._write_all(SMOOTHED, rest)
                continue
            step = self._engine.step(event)
            self.scans += 1
            self._write_all(FILTERED, (step.filtered,))
            self._write_all(SMOOTHED, step.smoothed)

    def _write_all(self, source: str, run: Sequence[Estimates]) -> None:
        for found in run:
            message = estimates.to_msg(found, self._config.world_frame)
            self._bag.write(names.estimates(source), interfaces.encode(message), found.stamp_ns)


def track_bag(source: BagReader, config: TrackerConfig, out: Path) -> OfflineTracker:
    """Track a bag into a new one that also holds the bag's detections and truth.

    Raises
    ------
    BagError
        If the bag lacks a radar's topic or is damaged; what precedes the damage is tracked.
    """
    topics = [radar.topic for radar in config.inputs]
    copied = [*topics, *([names.TRUTH] if names.TRUTH in source.types else [])]
    source.require(dict.fromkeys(copied, names.CLOUD))
    with BagWriter(out) as bag:
        for topic in copied:
            bag.add_topic(Topic(topic, source.types[topic], depth=50))
        for kind in (FILTERED, SMOOTHED):
            bag.add_topic(Topic(names.estimates(kind), names.CLOUD))
        tracker = OfflineTracker(config, bag)
        total = sum(source.counts[topic] for topic in copied)
        console = Console(stderr=True)
        try:
            for entry in track(source.messages(copied), "tracking", total, console=console):
                bag.write(entry.topic, entry.data, entry.stamp_ns)
                if entry.topic in topics:
                    tracker.add(entry)
        finally:
            tracker.finish()
    return tracker


def main(argv: Sequence[str]) -> int:
    """Run the offline tracker."""
    parser = argparse.ArgumentParser("track_bag", description=__doc__)
    parser.add_argument("bag", type=Path, help="rosbag2 directory or MCAP file")
    parser.add_argument("--out", type=Path, required=True, help="directory of the new bag")
    command.add_parameter_arguments(parser)
    arguments = parser.parse_args(argv)

    def work() -> int:
        config = command.tracker_config(arguments)
        status = OK
        if arguments.out.exists():
            raise BagError(f"{arguments.out}: already exists, a bag is not overwritten")
        try:
            tracker = track_bag(BagReader(arguments.bag), config, arguments.out)
            drops = ", ".join(f"{reason} {n}" for reason, n in sorted(tracker.dropped.items()))
            print(f"{arguments.out}: {tracker.scans} scans tracked, dropped: {drops or 'none'}")
        except BagError as error:
            if not (error.corrupt and arguments.out.exists()):
                raise
            status = fail("track_bag", error)
        run = load.record(arguments.out, config)
        if run.truth:
            summary = run.evaluate(command.CUTOFF, command.ORDER).summary()
            Console().print(score_tables(summary))
        return status

    return command.guarded("track_bag", work)
