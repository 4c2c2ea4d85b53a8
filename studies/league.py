"""Trackers side by side on recordings that a user has: ``python -m studies league DIRECTORY``.

A manifest, a YAML file, names the recordings, the sensors that the trackers get, and what is
withheld from them as the truth::

    recordings:
      harbour:                     # any name
        file: harbour_bag          # a bag, relative to the directory
        sensors: [radar]           # those that are tracked; all of the parameters without
        truth: /ground_truth/targets   # or a topic of reports, such as /ais/reports: withheld
        parameters: mine.yaml      # of the tracker; those beside the bag without
        cutoff: 100.0              # farthest distance of a pair, metres
      ferry:
        scenario: 3                # of the Autoferry dataset in the directory

All trackers get the same scans. Ours reports what it confirms; the plot Kalman tracker
(`peers.plot_kalman`) and Stone Soup's nearest neighbour have the settings of the studies, which
were chosen on other recordings.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from msg_adapters.encoding import RejectedMessageError, interfaces, names, point_cloud
from msg_adapters.incoming.moving_radars import MovingRadars
from msg_adapters.incoming.readers import reader_of
from msg_adapters.targets import truth as truths
from phd_jdtc_ros import resources
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.pipeline import Event, Stepped
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel, polar_radars
from phd_jdtc_ros.core.types import Estimates, Scan
from phd_jdtc_ros.evaluation.comparison import LabelledPoints, PointSet, TrueTracks, without_slow
from phd_jdtc_ros.evaluation.metrics import assign
from phd_jdtc_ros.evaluation.tracks import IdentitySwitches
from phd_jdtc_ros.exit_status import ArgumentParser
from phd_jdtc_ros.feed import Feed
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments, yaml_files
from phd_jdtc_ros.report.load import input_types
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.turning_antenna import SimulatedReport
from phd_jdtc_ros.study.tracker import SimulatedRun
from phd_jdtc_ros.tally import Tally

from .autoferry import bags as ferry
from .autoferry import recording as dataset
from .peers import gnn
from .peers.plot_kalman import follow
from .peers.settings import ANYWHERE
from .runner import Figures, Study, table

MANIFEST = "league.yaml"
OURS, KALMAN, SOUP = "this tracker", "plot Kalman", "Stone Soup GNN"
CUTOFF = 1000.0
# Withheld reports are interpolated over at most this time, seconds.
LONGEST_GAP_S = 30.0
KEYS = frozenset(("file", "scenario", "sensors", "truth", "parameters", "cutoff"))


@dataclass
class Tracked:
    """What a tracker found, by stamp, and its CPU time."""

    points: Mapping[int, PointSet]
    cpu_s: float


@dataclass
class Recorded:
    """A recording as the trackers get it."""

    config: TrackerConfig
    scans: list[Scan] = field(default_factory=list)
    # Targets at the stamps of our estimates.
    truth: dict[int, PointSet] = field(default_factory=dict)


def recordings_of(path: Path) -> dict[str, Mapping[str, Any]]:
    """Return the entries of a manifest; raise `ConfigError` with every fault."""
    document = yaml_files.load(path)
    entries = document.get("recordings") if isinstance(document, Mapping) else None
    if not isinstance(entries, Mapping) or not entries:
        raise ConfigError(f"{path}: recordings: must be a mapping of names to recordings")
    faults = []
    for name, entry in entries.items():
        where = f"{path}: recordings.{name}"
        if not isinstance(entry, Mapping):
            faults.append(f"{where}: must be a mapping with file or scenario")
            continue
        faults += [
            f"{where}.{key}: unknown, must be one of {', '.join(sorted(KEYS))}"
            for key in entry
            if key not in KEYS
        ]
        if ("file" in entry) == ("scenario" in entry):
            faults.append(f"{where}: must have either file or scenario")
        cutoff = entry.get("cutoff", CUTOFF)
        if not (isinstance(cutoff, int | float) and 0.0 < cutoff < math.inf):
            faults.append(f"{where}.cutoff: {cutoff} given, must be a distance in metres")
    if faults:
        raise ConfigError(*faults)
    return {str(name): entry for name, entry in entries.items()}


def read(directory: Path, entry: Mapping[str, Any], work: Path) -> tuple[Recorded, Tracked]:
    """Return a recording, and what our tracker makes of it; `work` is for temporary files."""
    if "scenario" in entry:
        bag, given = _ferry(directory, int(entry["scenario"]), work)
    else:
        bag = directory / str(entry["file"])
        if not bag.exists():
            raise BagError(f"{bag}: no such recording; convert others to a bag first")
        beside = None if "parameters" in entry else bag_parameters.read(bag)
        path = directory / str(entry.get("parameters", ""))
        given = dict(from_arguments.load(path) if "parameters" in entry else beside or {})
    config = from_arguments.config_of(_restricted(given, entry.get("sensors")))
    recorded = Recorded(config)
    own = track(BagReader(bag), recorded)
    stamps = sorted(own.points)
    recorded.truth = _truth(BagReader(bag), str(entry.get("truth", names.TRUTH)), config, stamps)
    if not recorded.truth:
        raise BagError(f"{bag}: no target of the truth is known at the stamp of an estimate")
    return recorded, own


def _ferry(directory: Path, number: int, work: Path) -> tuple[Path, dict[str, Any]]:
    """Write a scenario of the Autoferry dataset as a bag; return it with the parameters."""
    try:
        recording = dataset.read(directory, number)
    except dataset.RecordingError as error:
        raise BagError(str(error)) from error
    given = ferry.parameters(lidar=False)
    path = work / f"autoferry_{number}"
    if not path.exists():
        ferry.write_bag(path, recording, from_arguments.config_of(given))
    return path, given


def _restricted(given: dict[str, Any], sensors: Sequence[str] | None) -> dict[str, Any]:
    """Return parameters of some of the sensors only."""
    if sensors is None:
        return given
    all_sensors = given.get("sensors", from_arguments.config_of(given).values["sensors"])
    absent = [name for name in sensors if name not in all_sensors]
    if absent:
        raise ConfigError(f"sensors: {absent[0]} given, must be of {', '.join(all_sensors)}")
    others = tuple(f"{name}." for name in all_sensors if name not in sensors)
    kept = {name: value for name, value in given.items() if not name.startswith(others)}
    return {**kept, "sensors": list(sensors)}


class _Scans:
    """Keeps the scans that a pipeline steps."""

    def __init__(self, scans: list[Scan]) -> None:
        self._scans = scans

    def add_scan(self, scan: Scan, filtered: Sequence[Estimates]) -> None:
        """See `feed.Monitor`."""
        self._scans.append(scan)

    def forget_tracks(self) -> None:
        """See `feed.Monitor`."""


def track(bag: BagReader, recorded: Recorded) -> Tracked:
    """Track a bag with our tracker, and keep the scans for the others."""
    config = recorded.config
    types = input_types(config, bag)
    bag.require(types)
    moving = MovingRadars(config)
    feed = Feed(config, Tally(config), [_Scans(recorded.scans)], why_missing=moving.missing)
    index = {own.topic: number for number, own in enumerate(config.inputs)}
    found: dict[int, PointSet] = {}
    entries = list(bag.messages([*types]))
    begin_s = time.process_time()

    def keep(events: Iterator[Event]) -> None:
        for event in events:
            if isinstance(event, Stepped):
                found.update((each.stamp_ns, PointSet.of(each)) for each in event.step.filtered)

    for entry in entries:
        if entry.topic in index:
            own = config.inputs[index[entry.topic]]
            read_one = partial(reader_of(own).from_cdr, entry.data, own)
            keep(feed.message(index[entry.topic], read_one, entry.log_time_ns) or iter(()))
        else:
            keep(feed.pose(entry.topic, partial(moving.read, entry.topic, entry.data)) or iter(()))
    keep(feed.flush())
    return Tracked(found, time.process_time() - begin_s)


def _truth(
    bag: BagReader, topic: str, config: TrackerConfig, stamps: Sequence[int]
) -> dict[int, PointSet]:
    """Return the targets at stamps, of the truth in a bag or of withheld reports."""
    bag.require({topic: names.CLOUD})
    try:
        if topic.endswith(names.REPORTS_SUFFIX):
            return _of_reports(bag, topic, config, stamps)
        tracks = TrueTracks()
        for entry in bag.messages([topic]):
            sample = truths.from_msg(interfaces.decode(entry.data, names.CLOUD))
            tracks.add(sample.stamp_ns, PointSet.of(sample))
    except RejectedMessageError as error:
        raise BagError(f"{topic}: {error}") from error
    known = {stamp: tracks.at(stamp) for stamp in stamps}
    return {stamp: points for stamp, points in known.items() if points is not None}


def _of_reports(
    bag: BagReader, topic: str, config: TrackerConfig, stamps: Sequence[int]
) -> dict[int, PointSet]:
    wanted = {"latitude": ("f8",), "longitude": ("f8",), "time": ("f8",), "address": ("u4",)}
    clouds = [
        point_cloud.decode(interfaces.decode(each.data, names.CLOUD), wanted)
        for each in bag.messages([topic])
    ]
    columns = {name: np.concatenate([cloud[name] for cloud in clouds]) for name in wanted}
    return interpolated(columns, config, stamps)


def interpolated(
    columns: Mapping[str, Any], config: TrackerConfig, stamps: Sequence[int]
) -> dict[int, PointSet]:
    """Return the transmitters at stamps, between two reports that are close enough in time.

    The columns are ``latitude longitude`` (degrees), ``time`` (s) and ``address`` of reports.
    """
    plane = config.known_plane
    if plane is None:
        raise ConfigError("world_origin: not given, must be where reports are the truth")
    x, y = plane.to_plane(columns["latitude"], columns["longitude"])
    rows: dict[int, list[FloatArray]] = {stamp: [] for stamp in stamps}
    numbers: dict[int, list[int]] = {stamp: [] for stamp in stamps}
    at_s = np.array(stamps) * 1e-9
    for number, address in enumerate(np.unique(columns["address"]).tolist(), start=1):
        own = np.flatnonzero(columns["address"] == address)
        own = own[np.argsort(columns["time"][own], kind="stable")]
        time_s, keep = np.unique(columns["time"][own], return_index=True)
        own = own[keep]
        after = np.searchsorted(time_s, at_s)
        inside = (after > 0) & (after < len(time_s))
        for k in np.flatnonzero(inside).tolist():
            i, j = own[after[k] - 1], own[after[k]]
            dt = columns["time"][j] - columns["time"][i]
            if dt > LONGEST_GAP_S:
                continue
            part = (at_s[k] - columns["time"][i]) / dt
            place = np.array([x[i] + part * (x[j] - x[i]), y[i] + part * (y[j] - y[i])])
            rows[stamps[k]].append(place)
            numbers[stamps[k]].append(number)
    return {
        stamp: PointSet(
            np.array(places), np.zeros(len(places), dtype=np.int64), np.array(numbers[stamp])
        )
        for stamp, places in rows.items()
        if places
    }


def _radars(recorded: Recorded) -> tuple[RadarModel, ...]:
    """Return the polar radars; raise `ConfigError` for sensors of other kinds."""
    return polar_radars(recorded.config.model.radars)


def plot_kalman(recorded: Recorded) -> Tracked:
    """Return the tracks of the nearest-neighbour Kalman tracker of the studies."""
    radars = _radars(recorded)
    reports = [
        SimulatedReport(index, scan.stamp_ns, seen, np.zeros(len(seen), dtype=np.int64))
        for scan in recorded.scans
        for index, seen in enumerate(scan.detections)
        if seen is not None
    ]
    periods = [
        radar.rotation_s or _period_s(recorded.scans, index) for index, radar in enumerate(radars)
    ]
    stamps = sorted(recorded.truth)
    begin_s = time.process_time()
    found = follow(reports, radars, stamps, rotations=np.array(periods))
    spent_s = time.process_time() - begin_s
    return Tracked(dict(zip(stamps, found, strict=True)), spent_s)


def _period_s(scans: Sequence[Scan], radar: int) -> float:
    """Return the usual time between the scans of a radar, seconds."""
    stamps = [scan.stamp_ns for scan in scans if scan.detections[radar] is not None]
    return float(np.median(np.diff(stamps))) * 1e-9 if len(stamps) > 1 else 1.0


def stone_soup(recorded: Recorded) -> Tracked:
    """Return the tracks of Stone Soup's nearest neighbour; raise `ImportError` without it."""
    radars, scans = _radars(recorded), recorded.scans
    if any(seen.coverage is not None for scan in scans for seen in scan.detections if seen):
        raise ConfigError("its deleter counts whole scans, and this recording has sectors")
    stamps = [scan.stamp_ns for scan in scans]
    interval_s = float(np.median(np.diff(stamps))) * 1e-9
    scenario = Scenario(stamps[0], interval_s, len(scans), (), radars)
    run = SimulatedRun(scenario, 0, (), tuple(scans), ())
    begin_s = time.process_time()
    try:
        found = gnn(run, recorded.config.model, ANYWHERE)[0]
    except StopIteration as error:
        raise ConfigError("no motion of constant velocity is configured") from error
    spent_s = time.process_time() - begin_s
    return Tracked(dict(zip(stamps, found, strict=True)), spent_s)


PEERS = {KALMAN: plot_kalman, SOUP: stone_soup}


def score(recorded: Recorded, tracked: Tracked, cutoff: float) -> Figures:
    """Return the figures of a tracker on a recording.

    A gap is a time without an estimate between two with one. Switches are counted as by
    `IdentitySwitches`; they are None if the estimates have no numbers. Targets that our tracker
    leaves out by design, because they rest, count for no tracker.
    """
    found = targets = false = 0
    square = 0.0
    gaps = 0
    last: dict[int, bool] = {}
    seen: set[int] = set()
    switches: int | None = 0
    counter, least_speed = IdentitySwitches(cutoff), recorded.config.least_speed
    for stamp in sorted(recorded.truth):
        empty = PointSet(np.zeros((0, 2)), np.zeros(0, dtype=np.int64))
        known, own = without_slow(
            recorded.truth[stamp], tracked.points.get(stamp, empty), least_speed, cutoff
        )
        label = np.zeros(0, dtype=np.int64) if known.track_id is None else known.track_id
        row, column = assign(known.position, own.position, cutoff)
        distance = known.position[row] - own.position[column]
        found, targets = found + len(row), targets + len(label)
        false += len(own.position) - len(column)
        square += float((distance**2).sum())
        paired = {int(label[k]) for k in row}
        for number in map(int, label):
            has = number in paired
            gaps += has and number in seen and not last.get(number, True)
            last[number] = has
        seen |= paired
        if own.track_id is None and len(own.position):
            switches = None
        if switches is not None and own.track_id is not None:
            switches += counter.add(
                LabelledPoints(label, known.position),
                LabelledPoints(own.track_id, own.position),
            )
    return {
        "found": found / max(targets, 1),
        "rms": math.sqrt(square / found) if found else None,
        "gaps": gaps,
        "switches": switches,
        "false": false / len(recorded.truth),
        "cpu_s": tracked.cpu_s,
        "scans": len(recorded.truth),
    }


def _add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("directory", type=Path, help="of the recordings")
    parser.add_argument(
        "--manifest",
        type=Path,
        help=f"file, or the name of a shipped one (bags, autoferry); default: {MANIFEST} in the "
        "directory",
    )
    parser.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="only this recording"
    )


def _manifest(arguments: argparse.Namespace) -> Path:
    given: Path | None = arguments.manifest
    if given is None:
        given = arguments.directory / MANIFEST
    elif not given.is_file() and given.suffix == "":
        given = resources.find(Path("config/leagues") / f"{given}.yaml")
    if not given.exists():
        raise ConfigError(f"--manifest: {given} does not exist")
    return given


def _measure(arguments: argparse.Namespace, _: int) -> Figures:
    entries = recordings_of(_manifest(arguments))
    absent = [name for name in arguments.only if name not in entries]
    if absent:
        raise ConfigError(f"--only: {absent[0]} given, must be of {', '.join(entries)}")
    found: dict[str, Figures] = {}
    for name in arguments.only or entries:
        entry = entries[name]
        cutoff = float(entry.get("cutoff", CUTOFF))
        with tempfile.TemporaryDirectory() as work:
            recorded, own = read(arguments.directory, entry, Path(work))
        rows = {OURS: score(recorded, own, cutoff)}
        for peer, track in PEERS.items():
            try:
                rows[peer] = score(recorded, track(recorded), cutoff)
            except (ImportError, ConfigError) as error:
                rows[peer] = {"reason": " ".join(str(error).split())}
        found[name] = rows
    return {"recordings": found}


def _tables(figures: Figures) -> list[Table | str]:
    """Return the table, and why a tracker has no figures."""
    headings = ("recording", "tracker", "found", "RMS", "gaps", "switches", "false", "CPU")
    rows, reasons = [], []
    for name, trackers in figures["recordings"].items():
        for tracker, own in trackers.items():
            if "reason" in own:
                reasons.append(f"{name}, {tracker}: {own['reason']}")
                continue
            rms = "-" if own["rms"] is None else f"{own['rms']:.1f} m"
            switches = "-" if own["switches"] is None else str(own["switches"])
            cells = (f"{own['found']:.1%}", rms, str(own["gaps"]), switches)
            rows.append((name, tracker, *cells, f"{own['false']:.2f}", f"{own['cpu_s']:.1f} s"))
    title = "League: found of the targets, false estimates per scan, CPU of this process"
    return [table(title, headings, rows), *reasons]


STUDY = Study(
    name="league",
    purpose="Trackers side by side on recordings that a manifest names.",
    measure=_measure,
    tables=_tables,
    # Nothing is random.
    runs=0,
    combined=lambda found: found[0],
    add_arguments=_add_arguments,
)
