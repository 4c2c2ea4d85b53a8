"""Offline tracking: reads a bag with detections and writes a bag with estimates.

The detections take the same path as in the live node, so that the estimates are equal to the live
ones. Two runs write the same bytes.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import track

from msg_adapters import clutter_maps, doubts, estimates, interfaces, names, navsat, platform_poses
from msg_adapters.errors import RejectedMessageError
from msg_adapters.readers import reader_of
from phd_jdtc_ros import output_files, resources
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.reader import BagMessage, BagReader
from phd_jdtc_ros.bags.writer import BagWriter, Topic
from phd_jdtc_ros.calibration.innovations import InnovationMonitor
from phd_jdtc_ros.configuration.assembly import new_pipeline
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.intake.poses import PoseFault
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.pipeline import Event, RunEnded
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, Estimates
from phd_jdtc_ros.exit_status import CORRUPT, OK, ArgumentParser, fail
from phd_jdtc_ros.parameter_files import bag_parameters
from phd_jdtc_ros.report import load, track_files
from phd_jdtc_ros.report.table import score_tables

from . import asterix_parameters, command
from .used_detections import UsedDetections

# What writes tracks, by the option that asks for it.
WRITERS = {"geojson": track_files.to_geojson, "csv": track_files.to_csv}


class OfflineTracker:
    """Feeds recorded detections to a pipeline and writes the estimates.

    Parameters
    ----------
    config : TrackerConfig
    bag : BagWriter
        Has the topics of the estimates.

    Attributes
    ----------
    step_ms : list of float
        CPU time of each report that closed a scan and of those since the one before, milliseconds:
        decoding, steps and writing.
    """

    def __init__(self, config: TrackerConfig, bag: BagWriter) -> None:
        self._config = config
        self._bag = bag
        self._pipeline = new_pipeline(config)
        self._radar_of = {radar.topic: index for index, radar in enumerate(config.inputs)}
        self._carried = config.carried
        self.scans = 0
        self._last_ns = 0
        self.step_ms: list[float] = []
        self._cpu_s = 0.0
        self.dropped: Counter[str] = Counter()
        self.used = UsedDetections()
        self._targets_seen = False
        self._overdue = 0
        self._without_amplitude: set[int] = set()
        self._doubts: list[Counter[str]] = [Counter() for _ in config.inputs]
        self._innovations = InnovationMonitor(config.model)

    def add(self, entry: BagMessage) -> None:
        """Process one recorded message of a radar, or a pose of what carries one."""
        begin_s, scans = time.thread_time(), self.scans
        if entry.topic in self._carried:
            self._take_pose(entry)
        else:
            self._take(entry)
        self._cpu_s += time.thread_time() - begin_s
        if self.scans > scans:
            self.step_ms.append(1e3 * self._cpu_s)
            self._cpu_s = 0.0

    def _take(self, entry: BagMessage) -> None:
        index = self._radar_of[entry.topic]
        radar = self._config.inputs[index]
        try:
            report = reader_of(radar).from_cdr(entry.data, radar)
        except RejectedMessageError as error:
            self.dropped[error.reason] += 1
            self.used.unreadable(error.reason)
            return
        self.dropped.update(report.dropped)
        self.used.read(len(report.detections), report.dropped)
        if report.detections.amplitude is None:
            self._without_amplitude.add(index)
        events = self._pipeline.add(index, report.stamp_ns, report.detections, report.sector)
        self._doubts[index] += report.doubts + self._pipeline.take_doubts(index)
        if isinstance(events, Rejection):
            self.dropped[events.value] += 1
            self.used.refused(events.value, len(report.detections))
        else:
            self._write(events)

    def _take_pose(self, entry: BagMessage) -> None:
        carried = self._carried[entry.topic]
        kind = self._config.inputs[carried[0]].pose_message
        try:
            stamp_ns, pose = platform_poses.from_cdr(entry.data, kind, self._config.world_frame)
        except RejectedMessageError as error:
            self.dropped[f"pose_{error.reason}"] += 1
            return
        faults = set()
        for index in carried:
            events = self._pipeline.add_pose(index, stamp_ns, pose)
            if isinstance(events, PoseFault):
                faults.add(events.value)
            else:
                self._write(events)
        self.dropped.update(f"pose_{fault}" for fault in faults)

    def finish(self) -> None:
        """Close all scans, write the learned clutter, and the estimates that are held back."""
        self._write(self._pipeline.close_scans())
        shown = self._pipeline.engine.clutter_raster()
        if shown is not None:
            message = clutter_maps.to_msg(shown, self._last_ns, self._config.world_frame)
            self._bag.write(names.clutter_map(), interfaces.encode(message), self._last_ns)
        self._write(self._pipeline.flush())

    def warnings(self) -> Iterator[str]:
        """Yield what of the radars' reports does not look as it is configured, each once."""
        for index, radar in enumerate(self._config.inputs):
            if index in self._without_amplitude and len(self._config.model.modes.classes) > 1:
                yield doubts.no_amplitude(radar)
            if turn_s := self._pipeline.turn_found_s(index):
                yield doubts.turn_found(radar, turn_s)
            for doubt in doubts.of(radar, self._doubts[index]):
                yield f"{radar.topic}: {doubt}"
        for radar, fit in zip(self._config.inputs, self._innovations.fits(), strict=True):
            wrong = doubts.of_noise(fit)
            if wrong is not None:
                yield f"{radar.topic}: {wrong}"
        if self._overdue and not self._targets_seen:
            yield doubts.nothing_reported(self._overdue)

    def _write(self, events: Iterable[Event]) -> None:
        for event in events:
            if isinstance(event, RunEnded):
                self._write_estimates(SMOOTHED, event.smoothed)
                self._innovations.forget_tracks()
                continue
            self.scans += 1
            self._last_ns = event.scan.stamp_ns
            self._targets_seen |= event.step.targets > 0
            self._innovations.stepped(event.scan, event.step.filtered)
            self._overdue = event.overdue or self._overdue
            self._write_estimates(FILTERED, event.step.filtered)
            self._write_estimates(SMOOTHED, event.step.smoothed)
        # What waited for a pose, or until the end, was judged only now.
        for index, counts in enumerate(self._doubts):
            drops = self._pipeline.take_drops(index)
            self.dropped.update(drops)
            self.used.reports_lost(drops)
            counts.update(self._pipeline.take_doubts(index))

    def _write_estimates(self, source: str, by_stamp: Iterable[Estimates]) -> None:
        for values in by_stamp:
            message = estimates.to_msg(values, self._config.world_frame)
            self._bag.write(names.estimates(source), interfaces.encode(message), values.stamp_ns)
            if source == FILTERED and self._config.plane is not None:
                for fix in navsat.to_msgs(values, self._config.plane):
                    self._bag.write(names.fixes(), interfaces.encode(fix), values.stamp_ns)


def track_bag(
    source: BagReader, config: TrackerConfig, out: Path, doing: str = "tracking"
) -> OfflineTracker:
    """Track a bag and write the estimates, with the bag's detections and truth, into a new one.

    The progress is shown with what is `doing`.

    Raises
    ------
    BagError
        If the bag lacks a radar's topic or is damaged; detections before the damage are tracked.
    """
    types = {radar.topic: reader_of(radar).type_name for radar in config.inputs}
    for topic, carried in config.carried.items():
        types[topic] = platform_poses.TYPES[config.inputs[carried[0]].pose_message]
    topics = list(types)
    copied = [*topics, *([names.TRUTH] if names.TRUTH in source.types else [])]
    source.require({topic: types.get(topic, names.CLOUD) for topic in copied})
    with BagWriter(out) as bag:
        for topic in copied:
            bag.add_topic(source.topic(topic, depth=50))
        for kind in (FILTERED, SMOOTHED):
            bag.add_topic(Topic(names.estimates(kind), names.CLOUD))
        if config.plane is not None:
            bag.add_topic(Topic(names.fixes(), names.FIX))
        if any(radar.clutter_map is not None for radar in config.model.radars):
            bag.add_topic(Topic(names.clutter_map(), names.GRID, depth=1, transient_local=True))
        tracker = OfflineTracker(config, bag)
        total = sum(source.counts[topic] for topic in copied)
        console = Console(stderr=True)
        try:
            for entry in track(source.messages(copied), doing, total, console=console):
                bag.write(entry.topic, entry.data, entry.stamp_ns)
                if entry.topic in topics:
                    tracker.add(entry)
        finally:
            tracker.finish()
            bag_parameters.write(out / bag_parameters.NAME, config.values)
    return tracker


def main(argv: Sequence[str]) -> int:
    """Run the offline tracker."""
    parser = ArgumentParser("track_bag", description=__doc__)
    parser.add_argument("bag", help=command.BAG)
    parser.add_argument("--out", type=Path, required=True, help="directory of the new bag")
    parser.add_argument(
        "--geojson", type=Path, metavar="FILE", help="smoothed tracks as GeoJSON; with world_origin"
    )
    parser.add_argument(
        "--csv",
        type=Path,
        metavar="FILE",
        help="smoothed tracks as rows: x and y, and with world_origin latitude and longitude",
    )
    command.add_cutoff_argument(parser)
    command.add_parameter_arguments(parser)
    arguments = parser.parse_args(argv)

    def work() -> int:
        source = resources.bag(arguments.bag)
        config = command.tracker_config(arguments, source)
        status = OK
        files = {name: getattr(arguments, name) for name in WRITERS if getattr(arguments, name)}
        if "geojson" in files and config.plane is None:
            raise ConfigError(["--geojson: given without world_origin, where is the map's zero?"])
        if arguments.out.exists():
            raise BagError(f"{arguments.out}: already exists, a bag is not overwritten")
        output_files.require_new({f"--{n}": path for n, path in files.items()}, arguments.out)
        try:
            tracker = track_bag(BagReader(source), config, arguments.out)
            drops = ", ".join(f"{reason} {n}" for reason, n in sorted(tracker.dropped.items()))
            print(f"{arguments.out}: {tracker.scans} scans tracked, dropped: {drops or 'none'}")
            for warning in tracker.warnings():
                print(f"track_bag: {warning}", file=sys.stderr)
            fault = tracker.used.fault()
            if fault is not None:
                print(f"track_bag: {source}: {fault}", file=sys.stderr)
                status = CORRUPT
        except BagError as error:
            if not (error.corrupt and arguments.out.exists()):
                raise
            status = fail("track_bag", error)
        run = load.record(arguments.out, config)
        if files:
            if config.plane and asterix_parameters.guessed(config.values["world_origin"]):
                print(
                    "track_bag: latitudes and longitudes are not true: where the radar stands was "
                    "guessed; set its geodetic, and world_origin",
                    file=sys.stderr,
                )
            rows = list(track_files.fixes(run.smoothed, config.plane, run.sets.class_names))
            for name, path in files.items():
                output_files.write(path, WRITERS[name](rows))
        if run.class_fault:
            print(f"track_bag: {run.class_fault}", file=sys.stderr)
        if run.truth:
            summary = run.evaluate(arguments.cutoff, command.ORDER).summary()
            Console().print(score_tables(summary))
        return status

    return command.guarded("track_bag", work)
