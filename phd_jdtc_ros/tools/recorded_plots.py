"""The detections of a bag's radars as columns, and which of its topics are radars."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from msg_adapters import interfaces, names, platform_poses, radar_scan, recognised
from msg_adapters.errors import RejectedMessageError
from msg_adapters.readers import reader_of
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.reader import BagMessage, BagReader
from phd_jdtc_ros.calibration.tuning.findings import Findings, TuningError, findings
from phd_jdtc_ros.calibration.tuning.plots import MOST_PLOTS, Plots, limit_plots, plots_of
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.core.intake.posed_reports import PosedReports
from phd_jdtc_ros.core.types import Detections

# Clouds that fields are recognised by.
LOOKED_AT = 40


@dataclass(frozen=True)
class Recorded:
    """What a bag has of the radars of a configuration, by radar.

    Parameters
    ----------
    plots : dict of name to (Plots or None)
        None of a radar without usable messages.
    dropped : dict of name to Counter
        Messages and points that were not used, by reason.
    damage : BagError or None
        What of the bag is damaged; all intact messages were used.
    """

    plots: dict[str, Plots | None]
    dropped: dict[str, Counter[str]]
    damage: BagError | None = None


def read(bag: BagReader, config: TrackerConfig, seconds: float, most: int = MOST_PLOTS) -> Recorded:
    """Return the detections of the first part of a bag.

    Those beyond a radar's configured range are read too.

    Parameters
    ----------
    config : TrackerConfig
        Topics, fields, units and platforms.
    seconds : float
        Length of the part.
    most : int
        Of each radar, about the largest number of detections.

    Raises
    ------
    BagError
        If the bag lacks a topic.
    """
    inputs = [replace(radar, max_range=math.inf) for radar in config.inputs]
    types = {radar.topic: reader_of(radar).type_name for radar in inputs}
    for topic, carried in config.carried.items():
        types[topic] = platform_poses.TYPES[inputs[carried[0]].pose_message]
    bag.require(types)
    radars = {radar.topic: index for index, radar in enumerate(inputs)}
    posed = PosedReports(config.platforms())
    reports: list[list[tuple[int, Detections]]] = [[] for _ in inputs]
    dropped: list[Counter[str]] = [Counter() for _ in inputs]

    def release(everything: bool = False) -> None:
        for report in posed.released(everything):
            if report.detections is None:
                dropped[report.radar]["pose_missing"] += 1
            else:
                reports[report.radar].append((report.stamp_ns, report.detections))

    until_ns = bag.start_ns + round(seconds * 1e9)
    intact = _Intact(bag.messages(list(types), until_ns))
    for entry in intact:
        try:
            if entry.topic in config.carried:
                carried = config.carried[entry.topic]
                kind = inputs[carried[0]].pose_message
                stamp_ns, pose = platform_poses.from_cdr(entry.data, kind, config.world_frame)
                for index in carried:
                    posed.add_pose(index, stamp_ns, pose)
            else:
                index = radars[entry.topic]
                found = reader_of(inputs[index]).from_cdr(entry.data, inputs[index])
                dropped[index].update(found.dropped)
                posed.add(index, [(found.stamp_ns, found.detections)])
        except RejectedMessageError as error:
            if entry.topic in radars:
                dropped[radars[entry.topic]][error.reason] += 1
        release()
    release(everything=True)
    return Recorded(
        {
            radar.name: limit_plots(plots_of(own), most) if own else None
            for radar, own in zip(inputs, reports, strict=True)
        },
        {radar.name: count for radar, count in zip(inputs, dropped, strict=True)},
        intact.damage,
    )


class _Intact:
    """The intact messages of a bag, and after them what is damaged."""

    def __init__(self, messages: Iterator[BagMessage]) -> None:
        self._messages = messages
        self.damage: BagError | None = None

    def __iter__(self) -> Iterator[BagMessage]:
        try:
            yield from self._messages
        except BagError as error:
            if not error.corrupt:
                raise
            self.damage = error


def findings_of(source: Path, recorded: Recorded) -> dict[str, Findings]:
    """Return what a recording says of each radar.

    Raises
    ------
    BagError
        With what is missing, of every radar that cannot be tuned.
    """
    found, faults = {}, []
    for radar, plots in recorded.plots.items():
        dropped = ", ".join(f"{reason} {n}" for reason, n in recorded.dropped[radar].items() if n)
        suffix = f" (dropped: {dropped})" if dropped else ""
        if plots is None:
            faults.append(f"{radar}: none of its messages can be used{suffix}")
            continue
        try:
            found[radar] = findings(plots)
        except TuningError as error:
            faults.append(f"{radar}: {error}{suffix}")
    if faults:
        raise BagError(f"{source}: {'; '.join(faults)}")
    return found


def recognised_radars(bag: BagReader) -> dict[str, Any]:
    """Return the parameters that say which of a bag's topics are radars and how they are read.

    Raises
    ------
    BagError
        If none of them is one.
    """
    found: dict[str, Any] = {"sensors": []}
    seen = []
    for topic, kind in sorted(bag.types.items()):
        if kind == radar_scan.TYPE_NAME:
            given: dict[str, Any] | None = {"message": "radar_scan", **_frame_of(bag, topic)}
        elif kind == names.CLOUD:
            clouds = _clouds(bag, topic)
            given = recognised.parameters(clouds)
            fields = sorted({field.name for cloud in clouds for field in cloud.fields})
            seen.append(f"{topic} ({', '.join(fields)})")
        else:
            continue
        if given is None:
            continue
        name = _name_of(topic, found["sensors"])
        found["sensors"].append(name)
        found.update({f"{name}.topic": topic} | {f"{name}.{key}": given[key] for key in given})
    if not found["sensors"]:
        raise BagError(
            f"{bag.path}: has no cloud with a range and an azimuth that are recognised by their "
            f"names; it has {'; '.join(seen) or 'no clouds at all'}. Name them in a parameter file "
            "and give it as --params-file"
        )
    return found


def _clouds(bag: BagReader, topic: str) -> list[Any]:
    """Return some clouds of a topic."""
    found = []
    for entry in _Intact(bag.messages([topic])):
        try:
            found.append(interfaces.decode(entry.data, names.CLOUD))
        except RejectedMessageError:
            continue
        if len([cloud for cloud in found if cloud.width]) >= LOOKED_AT:
            break
    return found


def _frame_of(bag: BagReader, topic: str) -> dict[str, str]:
    """Return the frame of a topic's first message."""
    for entry in _Intact(bag.messages([topic])):
        # The header's stamp takes 8 bytes behind the encapsulation's 4, then comes the string.
        size = int.from_bytes(entry.data[12:16], "little")
        return {"frame": entry.data[16 : 16 + max(size - 1, 0)].decode(errors="replace")}
    return {}


def _name_of(topic: str, taken: list[str]) -> str:
    """Return a name for a radar by its topic."""
    parts = [part for part in topic.split("/") if part]
    name = re.sub(r"\W", "_", parts[-2] if len(parts) > 1 else parts[-1]) or "radar"
    number, chosen = 2, name
    while chosen in taken:
        chosen, number = f"{name}_{number}", number + 1
    return chosen
