"""Simulated hours of radars as they are recorded, tracked the way a user does it, with nothing set.

Each hour is written as ASTERIX, read by `asterix_bridge` and tracked by `track_bag`: as it is,
without codes and addresses, and with what `tune` proposes. Beside it is a plot Kalman tracker.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from msg_adapters import estimates, ground_ranges, interfaces, names
from msg_adapters.readers import reader_of
from phd_jdtc_ros import output_files, resources
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import SOURCES, Estimates
from phd_jdtc_ros.exit_status import FAILED, OK, ArgumentParser
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments, tracker_params, yaml_files
from phd_jdtc_ros.simulation import scenario_file, sending
from phd_jdtc_ros.study import hour_goals, hours
from phd_jdtc_ros.study.hour_goals import AS_IS, NO_IDENTITIES, TUNED, Tracked
from phd_jdtc_ros.study.hours import Hour, Reader, Scores

from . import command, registration, simulated_asterix

# The scenarios, and what their recordings are: a capture has times of receipt.
RECORDINGS = {"approach_hour": "recording.ast", "en_route_hour": "recording.pcap"}
SHORTEST_MIN = 2.0


class Run(NamedTuple):
    """What a command did.

    Parameters
    ----------
    status : int
        Its exit status.
    cpu_s : float
    text : str
        What it printed.
    """

    status: int
    cpu_s: float
    text: str


def hour_of(name: str, minutes: float | None, seed: int) -> tuple[Hour, TrackerConfig, Any]:
    """Return a scenario's hour, the configuration of its radar, and its document.

    Of a part of an hour the targets are those of the whole one.
    """
    document = dict(yaml_files.load(resources.find(Path(f"config/scenarios/{name}.yaml"))))
    config = tracker_params.config(from_arguments.scenario_parameters(document))
    scene = scenario_file.resolve(document, config.model.radars)
    if minutes is not None:
        scene = scene.until(60.0 * minutes)
    return Hour(scene, config.inputs[0], seed), config, document


def record(hour: Hour, config: TrackerConfig, document: Mapping[str, Any], path: Path) -> None:
    """Write what the radar of an hour sends."""
    faults: list[str] = []
    sent = sending.of_radars(document, hour.scenario.radars, faults)
    if faults:
        raise ConfigError(faults)
    simulated_asterix.write(path, hour.scenario, config, sent, hour.seed)


def path_of_user(recording: Path, work: Path) -> dict[str, tuple[Path, list[Run]]]:
    """Return the directory of the estimates and the commands of each way to track a recording."""
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
        # It has been waited for.
        process.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        text = out.read().decode("utf-8", "replace")
    return Run(process.returncode, spent.ru_utime + spent.ru_stime, text)


def scored(hour: Hour, tracked: Path) -> tuple[dict[str, Scores], Scores]:
    """Return the scores of the estimates in a bag by source, and the plot Kalman tracker's.

    That one is scored at the stamps of the filtered estimates.

    Raises
    ------
    BagError
        If it is not what `track_bag` writes of one radar.
    """
    config = tracker_params.config(bag_parameters.read(tracked) or {})
    if len(config.inputs) != 1:
        raise BagError(f"{tracked}: {len(config.inputs)} radars, must be 1")
    reader = Reader(config.inputs[0], config.model.radars[0], ground_ranges.read)
    bag = BagReader(tracked)
    own_s, _ = hour.plots
    recorded_s = _recorded(bag, config)
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


def _recorded(bag: BagReader, config: TrackerConfig) -> FloatArray:
    """Return the times of the detections in a bag, seconds since the epoch."""
    (radar,) = config.inputs
    times = [np.zeros(0)]
    for entry in bag.messages([radar.topic]):
        report = reader_of(radar).from_cdr(entry.data, radar)
        own = report.detections.time_s
        if own is None:
            own = np.zeros(len(report.detections))
        times.append(report.stamp_ns * 1e-9 + own)
    return np.concatenate(times)


def _estimates(bag: BagReader, source: str) -> list[Estimates]:
    topic = names.estimates(source)
    return [
        estimates.from_msg(interfaces.decode(entry.data, names.CLOUD))
        for entry in bag.messages([topic])
    ]


def measured(name: str, minutes: float | None, seed: int, work: Path) -> dict[str, Tracked]:
    """Return what each way to track an hour makes of it; all files are written into `work`."""
    hour, config, document = hour_of(name, minutes, seed)
    work.mkdir(parents=True, exist_ok=True)
    recording = work / RECORDINGS[name]
    record(hour, config, document, recording)
    found = {}
    for way, (tracked, runs) in path_of_user(recording, work).items():
        status = max(each.status for each in runs)
        (work / f"{way}.txt").write_text("\n".join(each.text for each in runs), encoding="utf-8")
        own = scored(hour, tracked) if tracked.is_dir() else None
        found[way] = Tracked(status, runs[-1].cpu_s, *(own or (None, None)))
    return found


def table(title: str, rows: Mapping[str, Scores | None]) -> Table:
    """Return the scores of several tracks of an hour."""
    head = "found, %", "from 1st plot, %", "RMS, m", "false a turn", "switches", "renumbered"
    shown = Table(title=title, title_justify="left")
    shown.add_column("tracks", no_wrap=True)
    for name in head:
        shown.add_column(name, justify="right")
    for name, row in rows.items():
        if row is None:
            shown.add_row(name, "none")
            continue
        shown.add_row(
            name,
            f"{100.0 * row.found:.2f}",
            f"{100.0 * row.found_from_first:.2f}",
            f"{row.rms:.1f}",
            f"{row.false_a_turn:.3f}",
            str(row.switches),
            f"{row.renumbered} of {row.returned}",
        )
    return shown


def _goals_table(goals: Sequence[Mapping[str, Any]]) -> Table:
    shown = Table(title="goals", title_justify="left")
    for name in ("name", "value", "goal", "reached"):
        shown.add_column(name)
    for goal in goals:
        bound = f"{'at most' if goal['at_most'] else 'at least'} {goal['goal']:.4g}"
        reached = "yes" if goal["reached"] else "no"
        shown.add_row(goal["name"], f"{goal['value']:.4g}", bound, reached)
    return shown


def main(argv: Sequence[str]) -> int:
    """Run the study, or score a bag."""
    parser = ArgumentParser("hours", description=__doc__)
    parser.add_argument(
        "--hour", action="append", choices=[*RECORDINGS], default=[], help="only this one"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the plots (%(default)s)")
    parser.add_argument("--minutes", type=float, help="the first of the hours only")
    parser.add_argument("--out", type=Path, default=Path("out/study"), help="%(default)s")
    parser.add_argument("--keep", type=Path, help="new directory of recordings and bags; kept")
    parser.add_argument(
        "--score",
        type=Path,
        metavar="BAG",
        help="nothing is run: scores of what track_bag wrote of the --hour of this seed",
    )
    arguments = parser.parse_args(argv)
    if arguments.score is not None and len(arguments.hour) != 1:
        parser.error(f"--score: {len(arguments.hour)} --hour given, must be one")

    def work() -> int:
        if arguments.seed < 0:
            raise ConfigError([f"--seed: {arguments.seed} given, must be at least 0"])
        if arguments.minutes is not None and not arguments.minutes >= SHORTEST_MIN:
            raise ConfigError(
                [f"--minutes: {arguments.minutes} given, must be at least {SHORTEST_MIN:g}"]
            )
        if arguments.keep is not None and arguments.keep.exists():
            raise BagError(f"{arguments.keep}: already exists, is not overwritten")
        console = Console()
        if arguments.score is not None:
            hour, _, _ = hour_of(arguments.hour[0], arguments.minutes, arguments.seed)
            by_source, peer = scored(hour, arguments.score)
            console.print(table(arguments.hour[0], {**by_source, "plot Kalman": peer}))
            return OK
        with tempfile.TemporaryDirectory() as temporary:
            place = arguments.keep or Path(temporary)
            return _study(arguments.hour or [*RECORDINGS], arguments, place, console)

    return command.guarded("hours", work)


def _study(chosen: Sequence[str], arguments: Any, place: Path, console: Console) -> int:
    """Run the study of some hours, and write and show what was found."""
    found = {
        name: measured(name, arguments.minutes, arguments.seed, place / name) for name in chosen
    }
    goals = [goal for name, ways in found.items() for goal in hour_goals.goals_of(name, ways)]
    for name, ways in found.items():
        console.print(table(name, _rows(ways)))
        cpu = ", ".join(f"{way} {each.cpu_s:.1f} s" for way, each in ways.items())
        console.print(f"CPU time of track_bag: {cpu}", markup=False, highlight=False)
    console.print(_goals_table(goals))
    arguments.out.mkdir(parents=True, exist_ok=True)
    path = arguments.out / "hours.json"
    values = {name: {way: each.figures() for way, each in w.items()} for name, w in found.items()}
    text = json.dumps(
        {"seed": arguments.seed, "hours": values, "goals": goals}, indent=2, allow_nan=False
    )
    output_files.write(path, text + "\n")
    registration.merge(arguments.out / registration.SUMMARY, goals)
    console.print(f"results: {path}", soft_wrap=True, markup=False, highlight=False)
    return OK if all(each.scores for ways in found.values() for each in ways.values()) else FAILED


def _rows(ways: Mapping[str, Tracked]) -> dict[str, Scores | None]:
    """Return the scores of an hour by way and source, and of the plot Kalman tracker."""
    rows: dict[str, Scores | None] = {}
    for way, each in ways.items():
        for source in SOURCES:
            rows[f"{way}, {source}"] = each.scores[source] if each.scores else None
    rows["plot Kalman"] = ways[AS_IS].peer
    return rows
