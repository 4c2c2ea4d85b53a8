"""Reads the detections of a bag's radars, and recognises which of its topics are radars."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from msg_adapters.encoding import RejectedMessageError, interfaces, names
from msg_adapters.incoming import moving_radars, recognised
from msg_adapters.incoming.moving_radars import MovingRadars
from msg_adapters.incoming.readers import READERS
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.calibration.tuning import proposal
from phd_jdtc_ros.calibration.tuning.area import area_of
from phd_jdtc_ros.calibration.tuning.findings import Findings, TuningError, findings
from phd_jdtc_ros.calibration.tuning.plots import (
    DENSE_CLOUDS,
    MOST_PLOTS,
    Plots,
    limit_plots,
    plots_of,
)
from phd_jdtc_ros.calibration.tuning.proposal import Row
from phd_jdtc_ros.calibration.tuning.remarks import remarks
from phd_jdtc_ros.calibration.tuning.unspecified import unspecified
from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.columns.position_selection import unlimited
from phd_jdtc_ros.columns.selection import Report
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.place_forms import (
    STATIC_TRANSFORMS,
    TF,
    TRANSFORM_TOPICS,
)
from phd_jdtc_ros.configuration.parameters.position import PositionParameters
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.configuration.parameters.sensor import SensorParameters, Units
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.intake.input_checks import NOT_IN_RECORDINGS
from phd_jdtc_ros.core.intake.transforms import TransformBuffer
from phd_jdtc_ros.core.types import Detections
from phd_jdtc_ros.parameter_files import from_arguments
from phd_jdtc_ros.quoting import counts_text
from phd_jdtc_ros.report.load import Intact, input_types, posed_reports

# Messages of radars whose definition fixes their fields, by type.
_DEFINED = {own.type_name: name for name, own in READERS.items() if own.definition}


@dataclass(frozen=True)
class RecordedPlots:
    """The detections in a bag, by radar of a configuration."""

    plots: dict[str, Plots | None]  # None if a radar has no usable messages
    dropped: dict[str, Counter[str]]  # Unused messages and points, by reason
    # Number of usable detections without copies, of which `plots` may be the first.
    offered: dict[str, int]
    # Largest range of all of these, metres; or their area, see `area.area_of`.
    reach: dict[str, float | tuple[float, ...]]
    # Contradictions of the configuration, by radar.
    warnings: dict[str, list[str]] = field(default_factory=dict)
    damage: BagError | None = None  # Damage of the bag; all intact messages were used


def read(
    bag: BagReader, config: TrackerConfig, seconds: float | None = None, most: int = MOST_PLOTS
) -> RecordedPlots:
    """Return the first detections of a bag, at any range; `most` bounds each radar's.

    The bag is read for some seconds, or to its end: some radars need hours for enough detections.
    Raises `BagError` if the bag lacks a topic of the configuration.
    """
    inputs = [unlimited(sensor) for sensor in config.inputs]
    bag.require(input_types(config, bag))
    reports: list[list[tuple[int, Detections]]] = [[] for _ in inputs]
    dropped: list[Counter[str]] = [Counter() for _ in inputs]
    found: list[Counter[str]] = [Counter() for _ in inputs]
    checks = config.report_checks()

    def check(radar: int, report: Report) -> None:
        noticed = {*checks[radar].add(report.detections)} & {*NOT_IN_RECORDINGS}
        found[radar].update(report.anomalies + Counter(noticed))

    kept, unread, farthest = [0 for _ in inputs], [0 for _ in inputs], [0.0 for _ in inputs]
    places: list[list[FloatArray]] = [[] for _ in inputs]
    intact, moving = Intact(bag), MovingRadars(config)
    without: dict[int, str] = {}  # Why a radar has no pose where it last has none
    until_ns = None if seconds is None else bag.start_ns + round(seconds * 1e9)
    for report in posed_reports(intact, config, inputs, dropped, until_ns, check, moving):
        if report.detections is None:
            dropped[report.radar]["pose_missing"] += 1
            without[report.radar] = moving.missing(report.radar)
            continue
        radar, detections = report.radar, checks[report.radar].used(report.detections)
        if isinstance(inputs[radar], PositionParameters):
            places[radar].append(detections.measurement)
        farthest[radar] = max(farthest[radar], detections.measurement[:, 0].max(initial=0.0))
        # Copies among the detections are left out later.
        if kept[radar] > 2 * most and len(reports[radar]) >= 2 * DENSE_CLOUDS:
            unread[radar] += len(detections)
            continue
        kept[radar] += len(detections)
        reports[radar].append((report.stamp_ns, detections))
    plots = [
        _plots_of(own, sensor) if own else None for sensor, own in zip(inputs, reports, strict=True)
    ]
    areas = [area_of(np.concatenate(own)) if any(map(len, own)) else None for own in places]
    return RecordedPlots(
        {
            radar.name: whole and limit_plots(whole, most)
            for radar, whole in zip(inputs, plots, strict=True)
        },
        {radar.name: count for radar, count in zip(inputs, dropped, strict=True)},
        {
            radar.name: len(whole or ()) + more
            for radar, whole, more in zip(inputs, plots, unread, strict=True)
        },
        {
            sensor.name: far if area is None else area
            for sensor, far, area in zip(inputs, farthest, areas, strict=True)
        },
        {
            radar.name: [
                *anomalies.of(radar, anomalies.likely(own)),
                *filter(None, [without.get(index)]),
            ]
            for index, (radar, own) in enumerate(zip(inputs, found, strict=True))
        },
        intact.damage,
    )


def _plots_of(reports: list[tuple[int, Detections]], sensor: SensorParameters) -> Plots:
    if isinstance(sensor, RadarParameters):
        return plots_of(reports, ambiguity=sensor.range_rate_ambiguity)
    return plots_of(reports, places=True)


def findings_of(
    source: Path, recorded: RecordedPlots, note: Callable[[str], None] = lambda text: None
) -> dict[str, Findings]:
    """Return the findings of each radar; `BagError` names every radar that cannot be tuned.

    `note` is called with a line about each radar before its estimation, which takes the time.
    """
    found, faults, count = {}, [], len(recorded.plots)
    for number, (radar, plots) in enumerate(recorded.plots.items(), start=1):
        dropped = counts_text(recorded.dropped[radar])
        suffix = f" (dropped: {dropped})" if dropped else ""
        if plots is None:
            texts = ["none of its messages can be used", *recorded.warnings.get(radar, ())]
            faults.append(f"{radar}: {'; '.join(texts)}{suffix}")
            continue
        note(f"{radar}, radar {number} of {count}: estimating from {len(plots)} detections")
        try:
            own = findings(plots)
        except TuningError as error:
            texts = [str(error), *recorded.warnings.get(radar, ())]
            faults.append(f"{radar}: {'; '.join(texts)}{suffix}")
            continue
        # A few detections show the noise, but only all of them the coverage.
        reach = recorded.reach[radar]
        changed = {"area": reach} if isinstance(reach, tuple) else {"max_range": reach}
        found[radar] = replace(own, field=replace(own.field, **changed))
    if faults:
        raise _fault(f"{source}: {'; '.join(faults)}", recorded.damage)
    return found


def _fault(text: str, damage: BagError | None) -> BagError:
    """Return an error with the damage of the bag, which may be its cause."""
    return BagError(text) if damage is None else BagError(f"{text}; {damage}", corrupt=True)


def proposed(
    given: Mapping[str, Any],
    found: Mapping[str, Findings],
    rows: Mapping[str, Sequence[Row]],
    recorded: RecordedPlots,
    specified: bool,
) -> dict[str, Any]:
    """Return parameters with all proposed values; `specified` if some were given before."""
    values = dict(given)
    if not specified:
        values.update(unspecified(found))
    values["interval_s"] = proposal.interval_s(found)
    for radar, own in rows.items():
        values.update({f"{radar}.{row.name}": row.value for row in own if row.proposed})
        # Antennas turn clockwise. One that seems to turn counter-clockwise has azimuths that count
        # clockwise. The default is written too, because a wrong convention mirrors the picture.
        convention = f"{radar}.units.azimuth_convention"
        timing, is_polar = found[radar].timing, not found[radar].of_places
        if not specified and is_polar and convention not in values:
            compass = timing.rotation_s and not timing.clockwise
            values[convention] = "compass_cw" if compass else Units().azimuth_convention
    return values


def parameters_of(source: Path, note: Callable[[str], None]) -> dict[str, Any]:
    """Return parameters for a bag of which nothing is known, as `tune` proposes them.

    `note` is called with each remark on what they may have wrong. Raise `BagError` if none of its
    topics is a sensor, or it is too short to tell their noise.
    """
    bag = BagReader(source)
    given = {**recognised_radars(bag), "births": []}
    recorded = read(bag, from_arguments.config_of(given))
    found = findings_of(source, recorded)
    for name, each in found.items():
        for text in remarks(each, given, name):
            note(f"{name}: {text}")
    rows = {name: proposal.rows(each, given, name) for name, each in found.items()}
    return proposed(given, found, rows, recorded, specified=False)


def recognised_radars(bag: BagReader) -> dict[str, Any]:
    """Return parameters for the radars in a bag; `BagError` if none of its topics is a radar."""
    found: dict[str, Any] = {"sensors": []}
    intact, seen = Intact(bag), []
    for topic, kind in sorted(bag.types.items()):
        if kind in _DEFINED:
            given: dict[str, Any] | None = {"message": _DEFINED[kind], **_frame_of(intact, topic)}
        elif kind == names.DETECTIONS_3D:
            if interfaces.installed_class(kind) is None:
                raise BagError(f"{bag.path}: {topic} needs vision_msgs, which is not installed")
            given = {"kind": "position", "message": "detections_3d", **_frame_of(intact, topic)}
        elif kind == names.CLOUD:
            clouds = _clouds(intact, topic)
            given = recognised.parameters(clouds)
            fields = sorted({field.name for cloud in clouds for field in cloud.fields})
            seen.append(f"{topic} ({', '.join(fields) or 'without any cloud'})")
        else:
            continue
        if given is None:
            continue
        name = _name_of(topic, found["sensors"])
        found["sensors"].append(name)
        found.update({f"{name}.topic": topic} | {f"{name}.{key}": given[key] for key in given})
        if "kind" not in given:
            # As for a parameter file that does not name it: what is estimated is not learned too.
            found[f"{name}.learn"] = RadarParameters().learn
    if any(f"{name}.fields.elevation" in found for name in found["sensors"]):
        found["state"] = "space"
    if not found["sensors"]:
        advice = ". Name them in a parameter file and give it as --params-file"
        # One topic shows what kind of recording it is.
        foreign = next((f"; {topic} is {bag.foreign[topic]}" for topic in sorted(bag.foreign)), "")
        raise _fault(
            f"{bag.path}: has no cloud with a range and an azimuth, or with x and y, that are "
            "recognised by their names and are FLOAT32 or FLOAT64, in metres; it has "
            f"{'; '.join(seen) + advice if seen else 'no clouds at all'}{foreign}",
            intact.damage,
        )
    frames = {name: moving_radars.plain(found[f"{name}.frame"]) for name in found["sensors"]}
    return found | _placed(bag, frames)


def _placed(bag: BagReader, frames: Mapping[str, str]) -> dict[str, Any]:
    """Return the parameters of the sensors whose frames transforms place in a common frame."""
    topics = [topic for topic in TRANSFORM_TOPICS if bag.types.get(topic) == names.TRANSFORMS]
    buffer = TransformBuffer("", frames.values())
    # Number of messages in which every robot has sent its whole tree.
    for entry in islice(Intact(bag).messages(topics), 1000):
        try:
            for each in moving_radars.transforms_from_cdr(entry.data, lambda frame: False):
                buffer.add(each, static=entry.topic == STATIC_TRANSFORMS)
        except RejectedMessageError:
            continue
    above = {name: buffer.path(frame)[1:] for name, frame in frames.items()}
    longest = max(above.values(), key=len)
    # The usual names of frames that do not move; without one of them that above all others.
    world = next((frame for frame in ("map", "odom", *longest[-1:]) if frame in longest), None)
    placed = {f"{name}.pose": TF for name, path in above.items() if world in path}
    return {"world_frame": world, **placed} if placed else {}


def _clouds(intact: Intact, topic: str) -> list[Any]:
    """Return some clouds of a topic."""
    found = []
    for entry in intact.messages([topic]):
        try:
            found.append(interfaces.decode(entry.data, names.CLOUD))
        except RejectedMessageError:
            continue
        # Number of clouds by which fields are recognised.
        if len([cloud for cloud in found if cloud.width]) >= 40:
            break
    return found


def _frame_of(intact: Intact, topic: str) -> dict[str, str]:
    for entry in intact.messages([topic]):
        # The frame's name, a string, follows 4 bytes of encapsulation and 8 of the stamp.
        size = int.from_bytes(entry.data[12:16], "little")
        return {"frame": entry.data[16 : 16 + max(size - 1, 0)].decode(errors="replace")}
    return {}


def _name_of(topic: str, taken: list[str]) -> str:
    """Return a radar's name, derived from its topic and different from those taken."""
    parts = [part for part in topic.split("/") if part]
    name = re.sub(r"\W", "_", parts[-2] if len(parts) > 1 else parts[-1]) or "radar"
    candidates = (name, *(f"{name}_{number}" for number in range(2, len(taken) + 2)))
    return next(each for each in candidates if each not in taken)
