"""The robustness tests as a command: measures, prints and writes figures."""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from rich.console import Console

from . import (
    absurd,
    asterix_bytes,
    bad_scans,
    bags,
    bombs,
    clutter,
    crowd,
    decoders,
    engines,
    flood,
    forgeries,
    hostile,
    late_sectors,
    moving,
    network,
    numerics,
    overload,
    publishers,
    raw_bytes,
    recordings,
    report,
    restarts,
    soak,
    stamps_and_time,
    turning,
    warm_restart,
)
from .figures import Figure, all_reached, unmeasured

Measure = Callable[[], Figure]

ELSEWHERE = (
    unmeasured(
        "position detection, gaps, RMS",
        "better than ED-142 en route on the paper's scenario",
        "make study measures it, by Monte Carlo",
    ),
    unmeasured(
        "line coverage",
        "95 % core and msg_adapters, 90 % overall",
        "make coverage measures it",
    ),
)


# What an engine has to do with; the rest is the same whatever tracks.
OF_ENGINES: tuple[Measure, ...] = (
    bad_scans.measure,
    turning.measure,
    late_sectors.measure,
    moving.measure,
    numerics.measure,
    absurd.measure,
    hostile.measure_repeated,
    forgeries.measure,
    crowd.measure,
    overload.measure,
    overload.measure_said,
    clutter.measure,
    warm_restart.measure,
)


def faults(arguments: argparse.Namespace) -> Iterator[Measure]:
    """Yield the faults' measurements: all with one engine, and those of engines with the others."""
    parts = arguments.part or [part_of(measure) for measure in every_fault()]
    for measure in every_fault():
        if part_of(measure) in parts:
            yield engines.of(arguments.engine, measure)
    others = [engine for engine in engines.ALL if engine != arguments.engine]
    for engine in [] if arguments.only else others:
        for measure in OF_ENGINES:
            if part_of(measure) in parts:
                yield engines.of(engine, measure)
    for figure in () if arguments.part else ELSEWHERE:
        yield lambda found=figure: found


def part_of(measure: Measure) -> str:
    """Return the name of the module that a measurement is in."""
    return measure.__module__.rpartition(".")[2]


def every_fault() -> Iterator[Measure]:
    """Yield the measurements of all faults, the quick and informative ones first."""
    yield bad_scans.measure
    yield turning.measure
    yield turning.measure_refused
    yield late_sectors.measure
    yield moving.measure
    yield bags.measure_recovery
    yield bags.measure_bomb
    yield overload.measure
    yield overload.measure_said
    yield clutter.measure
    yield crowd.measure
    yield numerics.measure
    yield absurd.measure
    yield hostile.measure_seam
    yield hostile.measure_repeated
    yield hostile.measure_names
    yield hostile.measure_forged_times
    yield flood.measure
    yield bombs.measure
    yield stamps_and_time.measure_silence
    yield publishers.measure
    yield restarts.measure_kills
    yield warm_restart.measure
    yield forgeries.measure
    yield restarts.measure_stops
    yield stamps_and_time.measure_time_faults
    yield network.measure
    yield stamps_and_time.measure_gap
    yield recordings.measure_full
    yield recordings.measure_read_only
    yield restarts.measure_second


def soaking(arguments: argparse.Namespace) -> Iterator[Measure]:
    """Yield the soak's measurement."""
    yield engines.of(arguments.engine, lambda: soak.measure(arguments.scans))


def fuzzing(arguments: argparse.Namespace) -> Iterator[Measure]:
    """Yield the measurements with random input, offline and live."""
    yield lambda: decoders.measure(arguments.examples)
    yield lambda: decoders.measure_bags(max(1, arguments.examples // 10))
    yield lambda: asterix_bytes.measure(arguments.examples)
    yield engines.of(arguments.engine, lambda: raw_bytes.measure(arguments.seconds))


COMMANDS = {"faults": faults, "soak": soaking, "fuzz": fuzzing}


def run(measures: Iterator[Measure], console: Console) -> list[Figure]:
    """Measure one after the other, and print each result."""
    found = []
    begin = time.monotonic()
    for count, measure in enumerate(measures, 1):
        # Many take minutes.
        with console.status(f"measuring figure {count}"):
            figure = measure()
        console.print(
            f"{time.monotonic() - begin:4.0f} s  {figure.name}: {figure.measured or figure.reason}",
            highlight=False,
            markup=False,
        )
        found.append(figure)
    return found


def write(figures: Sequence[Figure], directory: Path, elapsed_s: float) -> Path:
    """Write the summary; return its path."""
    directory.mkdir(parents=True, exist_ok=True)
    path = directory / "summary.json"
    summary = {
        "figures": [figure.as_dict() for figure in figures],
        "elapsed_s": elapsed_s,
        "cpus": len(os.sched_getaffinity(0)),
        "load_average": os.getloadavg()[0],
    }
    path.write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n")
    return path


def main(argv: Sequence[str]) -> int:
    """Run a command; the exit status is 1 if a measured figure misses its goal."""
    parser = argparse.ArgumentParser("python -m robustness", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    added = {name: commands.add_parser(name) for name in COMMANDS}
    for name, sub in added.items():
        sub.add_argument("--engine", choices=engines.ALL, default=engines.PARTICLES)
        sub.add_argument("--out", type=Path, default=Path("out") / name, help="%(default)s")
    added["faults"].add_argument(
        "--only", action="store_true", help="nothing with another engine than this one"
    )
    added["faults"].add_argument(
        "--part",
        action="append",
        choices=sorted({part_of(measure) for measure in every_fault()}),
        help="only these faults; may be repeated",
    )
    added["soak"].add_argument("--scans", type=int, default=soak.SCANS, help="%(default)s")
    added["fuzz"].add_argument("--examples", type=int, default=decoders.EXAMPLES)
    added["fuzz"].add_argument("--seconds", type=float, default=raw_bytes.SECONDS)
    arguments = parser.parse_args(argv)
    console = Console()
    begin = time.monotonic()
    figures = run(COMMANDS[arguments.command](arguments), console)
    elapsed_s = time.monotonic() - begin
    console.print(report.table(arguments.command, figures))
    console.print(write(figures, arguments.out, elapsed_s), highlight=False)
    console.print(
        f"{elapsed_s:.0f} s; {len(os.sched_getaffinity(0))} CPUs, load {os.getloadavg()[0]:.1f}",
        highlight=False,
    )
    return 0 if all_reached(figures) else 1
