"""Offline tracking: reads a bag with detections and writes a bag with estimates.

The detections take the same path as in the live node, so that the estimates are equal to the live
ones. Two runs write the same bytes.
"""

from __future__ import annotations

import argparse
import sys
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from msg_adapters.encoding import RejectedMessageError, interfaces, names
from msg_adapters.incoming import self_reports
from msg_adapters.incoming.moving_radars import MovingRadars
from msg_adapters.incoming.readers import reader_of
from msg_adapters.outgoing import conflicts, diagnostics, manual, map_layers
from msg_adapters.targets import estimates, geodetic, truth
from phd_jdtc_ros import interruption, output_files, resources
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagMessage, BagReader
from phd_jdtc_ros.bags.writer import BagWriter, Topic
from phd_jdtc_ros.calibration.comparison import Comparison
from phd_jdtc_ros.calibration.innovations import InnovationMonitor
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.place_forms import STATIC_TRANSFORMS
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.conflicts.watch import Watch
from phd_jdtc_ros.core.pipeline import Event, RunEnded, Stepped
from phd_jdtc_ros.core.tracks.manual import Command
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, SOURCES, Estimates
from phd_jdtc_ros.evaluation.run_scores import ORDER
from phd_jdtc_ros.exit_status import CORRUPT, OK, ArgumentParser, fail
from phd_jdtc_ros.feed import Feed, StepClock
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments
from phd_jdtc_ros.quoting import counts_text
from phd_jdtc_ros.report import track_files
from phd_jdtc_ros.report.load import by_stamp, input_types
from phd_jdtc_ros.report.record import Record
from phd_jdtc_ros.report.table import score_tables
from phd_jdtc_ros.tally import Tally

from . import command, recorded_plots

# Formats of track files, by option.
WRITERS = {"geojson": track_files.to_geojson, "csv": track_files.to_csv}


class OfflineTracker:
    """Feeds recorded detections to a pipeline and writes the estimates to a bag."""

    def __init__(
        self, config: TrackerConfig, bag: BagWriter, commands: Iterable[tuple[int, Command]] = ()
    ) -> None:
        self._config = config
        self._bag = bag
        self._innovations = InnovationMonitor(config.model)
        self.tally = Tally(config)
        self._moving = MovingRadars(config)
        why = self._moving.missing
        comparison = Comparison(config.model, [self._innovations])
        self._feed = Feed(config, self.tally, [comparison], why_missing=why)
        self._radar_of = {radar.topic: index for index, radar in enumerate(config.inputs)}
        self._receiver_of = {own.topic: index for index, own in enumerate(config.receivers)}
        self.scans = 0
        self._last_ns = 0
        self.step_ms: list[float] = []  # CPU time of each scan, milliseconds
        self._step_clock = StepClock()
        self._watch = Watch(config.conflicts)
        # Manual work with the stamp of the scan after which it was done, in that order.
        self._manual = deque(commands)
        self.damage: BagError | None = None  # Damage of the bag; its intact messages were tracked
        # Serialised, as in the new bag.
        self._estimates: dict[str, list[bytes]] = {source: [] for source in SOURCES}
        self._runs = [0]  # Number of smoothed estimates before each run
        self._truth: list[bytes] = []
        self._operate(0)

    def add(self, entry: BagMessage) -> None:
        """Process a recorded message: a radar's report, a platform's pose, or the truth."""
        if entry.topic == names.TRUTH:
            self._truth.append(entry.data)
            return
        with self._step_clock:
            self._write(self._events(entry))

    def _events(self, entry: BagMessage) -> Iterable[Event]:
        """Decode a radar's report or a platform's pose; return the events that follow from it."""
        if entry.topic in self._radar_of:
            index = self._radar_of[entry.topic]
            radar = self._config.inputs[index]
            reader = reader_of(radar)
            read = partial(reader.from_cdr, entry.data, radar)
            return self._feed.message(index, read, entry.log_time_ns) or ()
        if entry.topic in self._receiver_of:
            index = self._receiver_of[entry.topic]
            told = partial(self_reports.from_cdr, entry.data, self._config.receivers[index])
            return self._feed.self_reports(index, told)
        poses = partial(self._moving.read, entry.topic, entry.data)
        return self._feed.pose(entry.topic, poses) or ()

    def finish(self) -> None:
        """Close all scans, and write what was learned and the pending estimates."""
        with self._step_clock:
            self._write(self._feed.close_scans())
        raster = self._feed.pipeline.engine.clutter_raster()
        if raster is not None:
            message = map_layers.clutter_to_msg(raster, self._last_ns, self._config.world_frame)
            self._bag.write(names.clutter_map(), interfaces.encode(message), self._last_ns)
        learned = self.tally.learned
        if learned:
            figures = diagnostics.figures_to_cdr(self._last_ns, learned)
            self._bag.write(names.cardinality(), figures, self._last_ns)
        self._write(self._feed.flush())

    def record(self) -> Record:
        """Return truth and estimates as in the new bag, without plots."""
        config = self._config
        found = {
            source: [_estimates(data) for data in clouds]
            for source, clouds in self._estimates.items()
        }
        try:
            known = [truth.from_msg(interfaces.decode(data, names.CLOUD)) for data in self._truth]
        except RejectedMessageError as error:
            raise BagError(f"{names.TRUTH}: {error}") from error
        class_names = tuple(kind.name for kind in config.model.modes.classes)
        return Record(
            truth=by_stamp(known),
            plots=(),
            filtered=by_stamp(found[FILTERED]),
            smoothed=by_stamp(found[SMOOTHED]),
            classes=len(class_names),
            step_ms=np.array(self.step_ms),
            class_names=class_names,
            plane=config.plane,
            place_known=config.known_plane is not None,
            least_speed=config.least_speed,
        )

    def smoothed_runs(self) -> list[list[Estimates]]:
        """Return the smoothed estimates as in the new bag, of each run in turn."""
        clouds = self._estimates[SMOOTHED]
        return [[_estimates(each) for each in clouds[i:j]] for i, j in pairwise(self._runs)]

    def warnings(self) -> Iterator[str]:
        """Yield each contradiction between the radars' reports and their configuration once."""
        return self.tally.warnings(self._innovations.fits())

    def _write(self, events: Iterable[Event]) -> None:
        for event in events:
            self.tally.note_event(event)
            if isinstance(event, RunEnded):
                self._write_estimates(SMOOTHED, event.smoothed)
                self._runs.append(len(self._estimates[SMOOTHED]))
                self._watch.begin_run()
                continue
            self.scans += 1
            self._last_ns = event.scan.stamp_ns
            self._write_estimates(FILTERED, event.step.filtered)
            self._write_estimates(SMOOTHED, event.step.smoothed)
            self.step_ms.append(self._step_clock.take_ms())
            self._write_conflicts(event)
            self._operate(event.scan.stamp_ns)

    def _operate(self, stamp_ns: int) -> None:
        """Do the manual work that was done until after the scan of a stamp."""
        while self._manual and self._manual[0][0] <= stamp_ns:
            try:
                self._feed.pipeline.operate(self._manual.popleft()[1])
            except ValueError:  # With other parameters than live there may be no such track
                self.tally.dropped["manual"] += 1

    def _write_conflicts(self, event: Stepped) -> None:
        pipeline, stamp_ns = self._feed.pipeline, event.scan.stamp_ns
        own = pipeline.own_ship(stamp_ns)
        watched = self._watch.step(
            stamp_ns, event.step.filtered, pipeline.engine, own, pipeline.manual
        )
        if watched is not None:
            data = conflicts.to_cdr(watched[0], self._config.world_frame)
            self._bag.write(names.conflicts(), data, stamp_ns)

    def _write_estimates(self, source: str, published: Iterable[Estimates]) -> None:
        for values in published:
            data = estimates.to_cdr(values, self._config.world_frame)
            self._estimates[source].append(data)
            self._bag.write(names.estimates(source), data, values.stamp_ns)
            if source == FILTERED and self._config.known_plane is not None:
                for fix in geodetic.to_msgs(values, self._config.known_plane):
                    self._bag.write(names.fixes(), interfaces.encode(fix), values.stamp_ns)


def _estimates(data: bytes) -> Estimates:
    return estimates.from_msg(interfaces.decode(data, names.CLOUD))


def track_bag(
    source: BagReader, config: TrackerConfig, out: Path, doing: str = "tracking"
) -> OfflineTracker:
    """Track a bag and write the estimates, with the bag's detections and truth, into a new one.

    `doing` is the caption of the progress bar. `BagError` is raised if the bag lacks a radar's
    topic, or the new one cannot be written.
    """
    types = input_types(config, source)
    given = [each.name for each in config.inputs if each.topic == names.TRUTH]
    if given:
        text = f"topic: {names.TRUTH} given, which is that of the truth"
        raise ConfigError(*(f"{name}.{text}" for name in given))
    copied = [*types, *([names.TRUTH] if names.TRUTH in source.types else [])]
    source.require({topic: types.get(topic, names.CLOUD) for topic in copied})
    commands = _commands(source)
    with BagWriter(out) as bag:
        for topic in copied:
            latched = topic == STATIC_TRANSFORMS
            bag.add_topic(replace(source.topic(topic, depth=50), transient_local=latched))
        for kind in (FILTERED, SMOOTHED):
            bag.add_topic(Topic(names.estimates(kind), names.CLOUD))
        if config.known_plane is not None:
            bag.add_topic(Topic(names.fixes(), names.FIX))
        if config.model.has_clutter_map:
            bag.add_topic(Topic(names.clutter_map(), names.GRID, depth=1, transient_local=True))
        if config.model.learns_figures:
            bag.add_topic(Topic(names.cardinality(), names.FIGURES))
        if config.conflicts.enabled:
            bag.add_topic(Topic(names.conflicts(), names.CLOUD))
        tracker = OfflineTracker(config, bag, commands)
        total = sum(source.counts[topic] for topic in copied)
        console = Console(stderr=True)
        try:
            messages = _stamped(source.messages(copied))
            for entry, stamp_ns in track(messages, doing, total, console=console):
                with interruption.step():
                    bag.write(entry.topic, entry.data, stamp_ns)
                    tracker.add(entry)
        except BagError as error:
            if not error.corrupt:
                raise
            tracker.damage = error
        finally:
            with interruption.step():
                tracker.finish()
                bag_parameters.write(out / bag_parameters.NAME, config.values)
    return tracker


def _commands(source: BagReader) -> list[tuple[int, Command]]:
    """Return the manual work in a bag, with stamps; raise `BagError` if some cannot be read."""
    if names.manual() not in source.types:
        return []
    source.require({names.manual(): names.FIGURES})
    try:
        return [
            manual.from_msg(interfaces.decode(entry.data, names.FIGURES))
            for entry in source.messages([names.manual()])
        ]
    except RejectedMessageError as error:
        raise BagError(f"{names.manual()}: {error}") from error


def _stamped(messages: Iterable[BagMessage]) -> Iterator[tuple[BagMessage, int]]:
    """Yield each message with its stamp, a static transform with that of the next other one.

    The own stamps of static transforms may be days before the recording.
    """
    static: list[BagMessage] = []
    stamp_ns = 0
    for entry in messages:
        static.append(entry)
        if entry.topic != STATIC_TRANSFORMS:
            stamp_ns = entry.stamp_ns
            yield from ((each, stamp_ns) for each in static)
            static = []
    yield from ((each, stamp_ns or each.stamp_ns) for each in static)


def _print_outcome(tracker: OfflineTracker, source: Path, out: Path) -> int:
    """Print the number of scans, drops and warnings; return the exit status."""
    if tracker.damage is not None:
        return fail("track_bag", tracker.damage)
    drops = counts_text(tracker.tally.dropped) or "none"
    print(f"{out}: {tracker.scans} scans tracked, dropped: {drops}")
    for warning in tracker.warnings():
        print(f"track_bag: {warning}", file=sys.stderr)
    fault = tracker.tally.fault()
    if fault is None:
        return OK
    print(f"track_bag: {source}: {fault}", file=sys.stderr)
    return CORRUPT


def _write_track_files(
    tracker: OfflineTracker, config: TrackerConfig, files: Mapping[str, Path]
) -> None:
    if config.plane and config.known_plane is None:
        print(
            "track_bag: latitudes and longitudes are left out, because the position of the radar "
            "is unknown; set its geodetic, and world_origin",
            file=sys.stderr,
        )
    class_names = tuple(kind.name for kind in config.model.modes.classes)
    rows = list(track_files.fixes(tracker.smoothed_runs(), config.known_plane, class_names))
    for name, path in files.items():
        output_files.write(path, WRITERS[name](rows))


def _config(arguments: argparse.Namespace, source: Path) -> TrackerConfig:
    """Return the configuration that was given or recorded, or else what the bag shows.

    A bag with the topics of the default configuration has that one.
    """
    known = arguments.params_file or arguments.assignments or arguments.scenario
    if not known and bag_parameters.read(source) is None:
        bag, usual = BagReader(source), from_arguments.config_of({})
        if not any(own.topic in bag.types for own in usual.inputs):
            note = partial(print, "track_bag:", file=sys.stderr)
            note(f"{source} has no parameters; its topics, fields and noise are found as by tune")
            return from_arguments.config_of(recorded_plots.parameters_of(source, note))
    return command.tracker_config(arguments, source)


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
    command.add_clock_argument(parser)
    command.add_parameter_arguments(parser)

    def work(arguments: argparse.Namespace) -> int:
        source = resources.bag(arguments.bag)
        command.require_new("a bag", arguments.out)
        files = {name: getattr(arguments, name) for name in WRITERS if getattr(arguments, name)}
        output_files.require_new({f"--{n}": path for n, path in files.items()}, arguments.out)
        config = _config(arguments, source)
        if "geojson" in files and config.known_plane is None:
            raise ConfigError(
                "--geojson: given without world_origin, which it needs: the latitude and "
                "longitude of the world frame's origin"
            )
        bag = BagReader(source)
        command.use_clock(bag, config, arguments.clock)
        tracker = track_bag(bag, config, arguments.out)
        status = _print_outcome(tracker, source, arguments.out)
        run = tracker.record()
        if files:
            _write_track_files(tracker, config, files)
        if run.class_fault:
            print(f"track_bag: {run.class_fault}", file=sys.stderr)
        if run.truth:
            summary = run.evaluate(arguments.cutoff, ORDER).summary()
            Console().print(score_tables(summary))
        return status

    return command.run(parser, argv, work)
