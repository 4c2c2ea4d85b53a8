"""The robustness tests as a command: measures, prints and writes figures."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from .harness.figures import Figure, all_reached
from .hostile_input import asterix_bytes, bad_receivers, decoders, random_trackers, raw_bytes
from .operation import soak

Measure = Callable[[], Figure]
REACHED = {True: "yes", False: "no", None: "-"}
STYLE = {True: None, False: "red", None: "dim"}

ELSEWHERE = (
    Figure(
        "position detection, gaps, RMS",
        "better than ED-142 en route on the paper's scenario",
        None,
        None,
        "make study measures it, by Monte Carlo",
    ),
    Figure(
        "line coverage",
        "95 % core and msg_adapters, 90 % overall",
        None,
        None,
        "make coverage measures it",
    ),
)

# The modules of the fault matrix, the quick and informative ones first.
MODULES = (
    *("reports.bad_scans", "reports.turning", "reports.late_sectors", "reports.moving"),
    *("hostile_input.bags", "operation.overload", "reports.clutter", "reports.crowd"),
    *("reports.numerics", "reports.absurd", "reports.reflected", "reports.self_reports"),
    "hostile_input.hostile",
    "hostile_input.flood",
    *("hostile_input.bombs", "operation.publishers", "operation.restarts"),
    *("operation.warm_restart", "hostile_input.forgeries", "reports.stamps_and_time"),
    *("operation.network", "operation.recordings", "operation.user_files"),
    "operation.receivers",
    "operation.browsers",
    "operation.open_browser",
    *("hostile_input.asterix_recordings", "hostile_input.bad_receivers"),
)
PARTS = {module.rpartition(".")[2]: module for module in MODULES}


def figures_of(part: str) -> list[Measure]:
    """Return the measurements of a module, in its order."""
    module = importlib.import_module(f".{PARTS[part]}", __package__)
    made = [found for found in vars(module).values() if hasattr(found, "is_measurement")]
    return [found for found in made if found.__module__ == module.__name__]


FAULTS = tuple(measure for part in PARTS for measure in figures_of(part))


def faults(arguments: argparse.Namespace) -> Iterator[Measure]:
    """Yield the measurements of all parts, or of those that are asked for."""
    for part in arguments.part or PARTS:
        yield from figures_of(part)
    for figure in () if arguments.part else ELSEWHERE:
        yield partial(_unchanged, figure)


def _unchanged(figure: Figure) -> Figure:
    return figure


def soaking(arguments: argparse.Namespace) -> Iterator[Measure]:
    """Yield the soak's measurement."""
    yield lambda: soak.measure(arguments.scans)


def fuzzing(arguments: argparse.Namespace) -> Iterator[Measure]:
    """Yield the measurements with random input, offline and live."""
    yield lambda: decoders.measure(arguments.examples)
    yield lambda: decoders.measure_bags(max(1, arguments.examples // 10))
    yield lambda: asterix_bytes.measure(arguments.examples)
    yield lambda: bad_receivers.measure(arguments.examples)
    yield lambda: random_trackers.measure(max(1, arguments.examples // 25))
    yield lambda: raw_bytes.measure(arguments.seconds)


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


def table(title: str, figures: Sequence[Figure]) -> Table:
    """Return measured figures beside their goals as a table."""
    found = Table(title=title, show_lines=True)
    for heading in ("figure", "goal", "measured", "reached"):
        found.add_column(heading, overflow="fold")
    for figure in figures:
        measured = f"not measured: {figure.reason}" if figure.measured is None else figure.measured
        found.add_row(
            escape(figure.name),
            escape(figure.goal),
            escape(measured),
            REACHED[figure.reached],
            style=STYLE[figure.reached],
        )
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
        sub.add_argument("--out", type=Path, default=Path("out") / name, help="%(default)s")
    added["faults"].add_argument(
        "--part", action="append", choices=PARTS, help="only these faults; may be repeated"
    )
    added["soak"].add_argument("--scans", type=int, default=soak.SCANS, help="%(default)s")
    added["fuzz"].add_argument("--examples", type=int, default=decoders.EXAMPLES)
    added["fuzz"].add_argument("--seconds", type=float, default=raw_bytes.SECONDS)
    arguments = parser.parse_args(argv)
    console = Console()
    arguments.out.mkdir(parents=True, exist_ok=True)
    begin = time.monotonic()
    figures = run(COMMANDS[arguments.command](arguments), console)
    elapsed_s = time.monotonic() - begin
    console.print(table(arguments.command, figures))
    console.print(write(figures, arguments.out, elapsed_s), highlight=False)
    console.print(
        f"{elapsed_s:.0f} s; {len(os.sched_getaffinity(0))} CPUs, load {os.getloadavg()[0]:.1f}",
        highlight=False,
    )
    return 0 if all_reached(figures) else 1
