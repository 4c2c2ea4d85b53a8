"""Reads a bag with estimates into a `Record`."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from msg_adapters.encoding import RejectedMessageError, interfaces, names
from msg_adapters.incoming import moving_radars
from msg_adapters.incoming.moving_radars import MovingRadars
from msg_adapters.incoming.readers import learn_call_signs_from_cdr, reader_of
from msg_adapters.outgoing import conflicts, diagnostics, map_layers
from msg_adapters.targets import estimates, truth
from phd_jdtc_ros.asterix.messages import CallSigns
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagMessage, BagReader
from phd_jdtc_ros.columns.selection import Report
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.place_forms import TRANSFORM_TOPICS
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.configuration.parameters.sensor import SensorParameters
from phd_jdtc_ros.core.intake.posed_reports import PosedReport, PosedReports
from phd_jdtc_ros.core.sensors.sensor import Sensor
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, SOURCES, UNKNOWN

from .record import RadarPlots, RadarSite, Record, learned_values, sensor_changes


def record(path: Path, config: TrackerConfig) -> Record:
    """Return the record of the run in a bag, or of the intact part of a damaged bag.

    Raise `BagError` if the bag cannot be read, or has none of the topics of a run.
    """
    bag = BagReader(path)
    sources = {names.estimates(source): source for source in (FILTERED, SMOOTHED)}
    figures, clutter, dangers = names.cardinality(), names.clutter_map(), names.conflicts()
    wanted = dict.fromkeys([*sources, names.TRUTH], names.CLOUD)
    wanted |= {radar.topic: reader_of(radar).type_name for radar in config.inputs}
    present = bag.types.keys() | bag.foreign.keys()
    if not wanted.keys() & present:
        raise BagError(f"{path}: none of {', '.join(wanted)} is in it")
    wanted |= {figures: names.FIGURES, clutter: names.GRID, dangers: names.CLOUD}
    bag.require({topic: kind for topic, kind in wanted.items() if topic in present})
    intact = Intact(bag)
    radars = config.model.radars
    parts: dict[str, list[Any]] = defaultdict(list)
    latest: dict[str, str] = {}
    classes = 0
    try:
        for entry in intact.messages([*sources, names.TRUTH, figures, clutter, dangers]):
            topic, message = entry.topic, interfaces.decode(entry.data, bag.types[entry.topic])
            if topic == names.TRUTH:
                parts["truth"].append(truth.from_msg(message))
            elif topic == clutter:
                parts["clutter"] = [map_layers.clutter_from_msg(message)]
            elif topic == dangers:
                parts["conflicts"].append(conflicts.from_msg(message))
            elif topic == figures:
                for status in message.status:
                    latest = diagnostics.values_of(status)
                    parts["step_ms"] += [latest["step_ms"]] if "step_ms" in latest else []
            else:
                classes = max(classes, estimates.class_count(message))
                parts[sources[topic]].append(estimates.from_msg(message))
        reports = posed_reports(intact, config, config.inputs, [Counter() for _ in radars])
        found = sorted(reports, key=lambda report: report.radar)
        for report in found:
            parts["plots"] += _plots(report, radars[report.radar])
    except RejectedMessageError as error:
        raise BagError(f"{path}: {error}") from error
    call_signs = CallSigns()
    addresses = (each.known_attributes.address for source in SOURCES for each in parts[source])
    if any((address != UNKNOWN).any() for address in addresses):
        for entry in intact.messages([radar.topic for radar in config.inputs]):
            if bag.types[entry.topic] == names.CLOUD:
                learn_call_signs_from_cdr(entry.data, call_signs)
    numbers = {name: float(value) for name, value in latest.items() if "." in name}
    return Record(
        truth=by_stamp(parts["truth"]),
        plots=by_stamp(parts["plots"]),
        filtered=by_stamp(parts[FILTERED]),
        smoothed=by_stamp(parts[SMOOTHED]),
        classes=classes or len(config.model.modes.classes),
        step_ms=np.array(parts["step_ms"], dtype=float),
        radars=tuple(
            RadarSite(
                radar.name,
                radar.position,
                source.height,
                tuple(map(math.radians, source.fov_elevation_deg)) if source.height_prior else (),
            )
            for radar, source in zip(radars, config.inputs, strict=True)
            if isinstance(source, RadarParameters) and not source.pose.topic
        ),
        damage=intact.damage,
        clutter=next(iter(parts["clutter"]), None),
        class_names=tuple(kind.name for kind in config.model.modes.classes),
        plane=config.plane,
        place_known=config.known_plane is not None,
        least_speed=config.least_speed,
        learned=tuple(learned_values(config.inputs, numbers)),
        changes=sensor_changes(config.inputs, numbers),
        call_signs=call_signs,
        conflicts=by_stamp(parts["conflicts"]),
        zones=config.conflicts.zones,
    )


class Intact:
    """Reads the intact messages of a bag and keeps its damage."""

    def __init__(self, bag: BagReader) -> None:
        self._bag = bag
        self.damage: BagError | None = None

    def messages(self, topics: list[str], until_ns: int | None = None) -> Iterator[BagMessage]:
        """Yield the intact messages of the given topics that are in the bag, up to a time."""
        present = [topic for topic in topics if topic in self._bag.types]
        if not present:
            return
        try:
            yield from self._bag.messages(present, until_ns)
        except BagError as error:
            if not error.corrupt:
                raise
            self.damage = error


def input_types(config: TrackerConfig, bag: BagReader) -> dict[str, str]:
    """Return the message types of the topics of the radars, and of their platforms' poses.

    If the bag has one of the two topics of transforms, the other one is left out.
    """
    types = {radar.topic: reader_of(radar).type_name for radar in config.inputs}
    types |= {own.topic: names.CLOUD for own in config.receivers}
    types |= moving_radars.types_of(config)
    present = bag.types.keys() | bag.foreign.keys()
    absent = {*TRANSFORM_TOPICS} - present
    return {t: kind for t, kind in types.items() if len(absent) != 1 or t not in absent}


def posed_reports(
    intact: Intact,
    config: TrackerConfig,
    inputs: Sequence[SensorParameters],
    dropped: Sequence[Counter[str]],
    until_ns: int | None = None,
    on_report: Callable[[int, Report], None] = lambda radar, report: None,
    moving: MovingRadars | None = None,
) -> Iterator[PosedReport]:
    """Yield the reports of all radars, of moving ones with poses, ordered by log time.

    `inputs` are the layouts of the radars' messages. `dropped` gains, by radar, the counts of
    rejected messages and points. The bag is read up to `until_ns`. `on_report` gets each radar's
    reports as they are read. `moving` is a new reader of poses, which knows why one is missing.
    """
    pending, carried = PosedReports(config.platforms()), config.radars_by_platform
    moving = moving or MovingRadars(config)
    radar_of = {radar.topic: index for index, radar in enumerate(inputs)}
    for entry in intact.messages([*radar_of, *carried], until_ns):
        try:
            if entry.topic in carried:
                for known in moving.read(entry.topic, entry.data)[0]:
                    pending.add_pose(*known)
            else:
                index = radar_of[entry.topic]
                report = reader_of(inputs[index]).from_cdr(entry.data, inputs[index])
                dropped[index].update(report.dropped)
                on_report(index, report)
                pending.add(index, [(report.stamp_ns, report.detections)])
        except RejectedMessageError as error:
            if entry.topic in radar_of:
                dropped[radar_of[entry.topic]][error.reason] += 1
        yield from pending.release()
    yield from pending.release(everything=True)


def _plots(report: PosedReport, model: Sensor) -> Iterator[RadarPlots]:
    """Yield the detections of a report in the world frame; none if the pose is unknown."""
    found = report.detections
    if found is None:
        return
    unknown = np.full(len(found), np.nan)
    yield RadarPlots(
        stamp_ns=report.stamp_ns,
        radar=model.name,
        # The map has no heights.
        position=model.at(found.pose).to_world(found.measurement)[:, :2],
        amplitude=unknown if found.amplitude is None else found.amplitude,
        sensor=None if found.pose is None else found.pose.position,
        height=found.height,
    )


def by_stamp(entries: Sequence[Any]) -> tuple[Any, ...]:
    """Return truth, plots or estimates in order of their stamps."""
    return tuple(sorted(entries, key=lambda entry: entry.stamp_ns))
