"""The study of hours: recordings of an hour, tracked by the commands that a user would run.

Each hour is written as ASTERIX, read by `asterix_bridge` and tracked by `track_bag`: unchanged,
without codes and addresses, and with the parameters that `tune` proposes. A plot Kalman tracker
gives the reference.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from msg_adapters.encoding import interfaces, names
from msg_adapters.incoming.readers import reader_of
from msg_adapters.targets import estimates
from phd_jdtc_ros import resources
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.types import SOURCES, Estimates
from phd_jdtc_ros.exit_status import ArgumentParser
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments, yaml_files
from phd_jdtc_ros.simulation import antenna, scenario_file
from phd_jdtc_ros.tools.asterix import writing as asterix_writing

from ..runner import Figures, Study, figures_table, until
from . import hour as hours
from .goals import AS_IS, NO_IDENTITIES, TUNED, goals_of
from .hour import Hour, Reader, Scores

# File names of the scenarios' recordings; a network capture has times of receipt.
RECORDINGS = {"approach_hour": "recording.ast", "en_route_hour": "recording.pcap"}
# Shortest part of an hour that can be scored, minutes.
LEAST_MINUTES = 2.0
PEER = "plot_kalman"


class Run(NamedTuple):
    """The outcome of a command."""

    status: int  # Exit status
    cpu_s: float
    text: str  # Its output


def hour_of(name: str, minutes: float | None, seed: int) -> tuple[Hour, TrackerConfig, Any]:
    """Return a scenario's hour, the configuration of its radar, and its document.

    The targets of a part of an hour are the same as of the whole.
    """
    document = dict(yaml_files.load(resources.find(Path(f"config/scenarios/{name}.yaml"))))
    config = from_arguments.config_of(from_arguments.scenario_parameters(document))
    scene = scenario_file.resolve(document, polar_radars(config.model.radars))
    if minutes is not None:
        scene = until(scene, 60.0 * minutes)
    return Hour(scene, config.radars[0], seed), config, document


def record(hour: Hour, config: TrackerConfig, document: Mapping[str, Any], path: Path) -> None:
    """Write the recording of an hour's radar."""
    faults: list[str] = []
    sent = antenna.read_sending(document, hour.scenario.radars, faults)
    if faults:
        raise ConfigError(*faults)
    asterix_writing.write(path, hour.scenario, config, sent, hour.seed)


def path_of_user(recording: Path, work: Path) -> dict[str, tuple[Path, list[Run]]]:
    """Return, for each way to track a recording, the directory of estimates and its commands."""
    bag = work / "in"
    read = run("asterix_bridge", recording, "--out", bag)
    ways: dict[str, tuple[Path, list[Run]]] = {}
    if not bag.is_dir():
        return {AS_IS: (work / AS_IS, [read])}
    ways[AS_IS] = work / "out", [read, run("track_bag", bag, "--out", work / "out")]
    recorded = bag_parameters.read(bag) or {}
    removed = [
        f"-p{radar}.fields.{field}:=''"
        for radar in recorded.get("sensors", [])
        for field in ("code", "address")
    ]
    bare = work / "out_no_identities"
    ways[NO_IDENTITIES] = bare, [read, run("track_bag", bag, "--out", bare, *removed)]
    proposed, tuned = work / "tuned.yaml", work / "out_tuned"
    chosen = run("tune", bag, "--out", proposed)
    last = run("track_bag", bag, "--out", tuned, "--params-file", proposed)
    ways[TUNED] = tuned, [read, chosen, last]
    return ways


def run(name: str, *arguments: object) -> Run:
    """Run one of the package's executables in a process of its own."""
    with tempfile.TemporaryFile() as out:
        process = subprocess.Popen(
            [sys.executable, "-m", "phd_jdtc_ros", name, *map(str, arguments)],
            stdout=out,
            stderr=subprocess.STDOUT,
        )
        _, status, spent = os.wait4(process.pid, 0)
        # `os.wait4` has reaped the process, so that `Popen` needs its return code.
        process.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        text = out.read().decode("utf-8", "replace")
    return Run(process.returncode, spent.ru_utime + spent.ru_stime, text)


def score_bag(hour: Hour, tracked: Path) -> tuple[dict[str, Scores], Scores]:
    """Return the scores of the estimates in a bag by source, and the plot Kalman tracker's.

    The plot Kalman tracker is scored at the stamps of the filtered estimates. Raise `BagError` if
    the bag is not an output of `track_bag` with one radar.
    """
    config = from_arguments.config_of(bag_parameters.read(tracked) or {})
    if len(config.radars) != 1:
        raise BagError(f"{tracked}: {len(config.radars)} radars, must be 1")
    reader = Reader(config.radars[0], polar_radars(config.model.radars)[0])
    bag = BagReader(tracked)
    own_s, _ = hour.plots
    recorded_s = _detection_times(bag, config)
    if not len(recorded_s):
        raise BagError(f"{tracked}: no detections")
    zero_s = hour.scenario.start_ns * 1e-9
    later_s = hours.shift_s(own_s, recorded_s - zero_s)
    found = {source: _estimates(bag, source) for source in SOURCES}
    by_source, stamps = {}, {}
    for source in SOURCES:
        stamps[source], points = hours.tracks(hour, found[source], later_s)
        by_source[source] = hours.scores(hour, reader, stamps[source], points)
    times_s = stamps[SOURCES[0]]
    peer = hours.plot_kalman(hour, reader, times_s)
    return by_source, hours.scores(hour, reader, times_s, peer)


def _detection_times(bag: BagReader, config: TrackerConfig) -> FloatArray:
    """Return the times of the detections in a bag, seconds since the epoch."""
    (radar,) = config.radars
    times = [np.zeros(0)]
    for entry in bag.messages([radar.topic]):
        report = reader_of(radar).from_cdr(entry.data, radar)
        own = report.detections.time_s
        if own is None:
            own = np.zeros(len(report.detections))
        times.append(report.stamp_ns * 1e-9 + own)
    return np.concatenate(times)


def _estimates(bag: BagReader, source: str) -> list[Estimates]:
    return [
        estimates.from_msg(interfaces.decode(entry.data, names.CLOUD))
        for entry in bag.messages([names.estimates(source)])
    ]


def measure_hour(name: str, minutes: float | None, seed: int, work: Path) -> Figures:
    """Return the figures of each way to track an hour; files are written into `work`."""
    hour, config, document = hour_of(name, minutes, seed)
    work.mkdir(parents=True, exist_ok=True)
    recording = work / RECORDINGS[name]
    record(hour, config, document, recording)
    found = {}
    for way, (tracked, runs) in path_of_user(recording, work).items():
        (work / f"{way}.txt").write_text("\n".join(each.text for each in runs), encoding="utf-8")
        found[way] = {
            "status": max(each.status for each in runs),
            "cpu_s": runs[-1].cpu_s,
            **_figures(*(score_bag(hour, tracked) if tracked.is_dir() else ({}, None))),
        }
    return found


def _figures(by_source: Mapping[str, Scores], peer: Scores | None) -> Figures:
    scores = {source: _as_json(each) for source, each in by_source.items()}
    return {"scores": scores, PEER: peer and _as_json(peer)}


def _as_json(scores: Scores) -> Figures:
    return {**scores._asdict(), "half_width": dict(scores.half_width)}


def _add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--hour", action="append", choices=[*RECORDINGS], default=[], help="only this one"
    )
    parser.add_argument("--keep", type=Path, help="new directory of recordings and bags; kept")


def _measure(arguments: argparse.Namespace, seed: int) -> Figures:
    keep: Path | None = arguments.keep
    if keep is not None:
        keep = keep if arguments.runs == 1 else keep / str(seed)
        if keep.exists():
            raise BagError(f"{keep}: already exists, is not overwritten")
    with tempfile.TemporaryDirectory() as temporary:
        place = keep or Path(temporary)
        found = {
            name: measure_hour(name, arguments.minutes, seed, place / name)
            for name in arguments.hour or RECORDINGS
        }
    return {"hours": found, "half_width": {"hours": _widths(found)}}


def _widths(found: Mapping[str, Any]) -> Figures:
    """Return the intervals of scores in the places of the scores."""
    return {
        name: _widths(each) if "half_width" not in each else each["half_width"]
        for name, each in found.items()
        if isinstance(each, Mapping)
    }


def _tables(found: Figures) -> list[Table | str]:
    shown: list[Table | str] = []
    for name, ways in found["hours"].items():
        rows: dict[str, tuple[str, ...]] = {
            f"{way}, {source}": ("hours", name, way, "scores", source)
            for way in ways
            for source in SOURCES
        }
        cpu = ", ".join(f"{way} {each['cpu_s']:.1f} s" for way, each in ways.items())
        rows["plot Kalman"] = ("hours", name, AS_IS, PEER)
        shown += [
            figures_table(name, "tracks", found, COLUMNS, rows),
            f"CPU time of track_bag: {cpu}",
        ]
    return shown


COLUMNS = {
    "found": ("found", ".2%"),
    "found_from_first": ("from 1st plot", ".2%"),
    "rms": ("RMS, m", ".1f"),
    "false_a_revolution": ("false a revolution", ".3f"),
    "switches": ("switches", ".3g"),
    "renumbered": ("renumbered", ".3g"),
    "returned": ("of", ".3g"),
}


STUDY = Study(
    name="hours",
    purpose="Simulated hours of a radar's ASTERIX, tracked the way a user does, with nothing set.",
    measure=_measure,
    tables=_tables,
    goals=lambda found: [
        goal for name, ways in found["hours"].items() for goal in goals_of(name, ways)
    ],
    complete=lambda found: all(
        w["scores"] for ways in found["hours"].values() for w in ways.values()
    ),
    least_minutes=LEAST_MINUTES,
    in_summary="hours",
    add_arguments=_add_arguments,
)


def _add_bag_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("bag", type=Path, help="what track_bag wrote of the hour of this seed")
    parser.add_argument("--hour", choices=[*RECORDINGS], required=True)


def _measure_bag(arguments: argparse.Namespace, seed: int) -> Figures:
    hour, _, _ = hour_of(arguments.hour, arguments.minutes, seed)
    figures = _figures(*score_bag(hour, arguments.bag))
    return {"hour": arguments.hour, **figures, "half_width": _widths(figures)}


OF_BAG = Study(
    name="hour_of_bag",
    purpose="Scores of a bag that track_bag wrote of a simulated hour.",
    measure=_measure_bag,
    tables=lambda found: [
        figures_table(
            found["hour"],
            "tracks",
            found,
            COLUMNS,
            {**{source: ("scores", source) for source in SOURCES}, "plot Kalman": (PEER,)},
        )
    ],
    least_minutes=LEAST_MINUTES,
    add_arguments=_add_bag_arguments,
)
