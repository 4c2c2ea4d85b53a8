"""The benchmark as a command: measures, compares with the goals, prints and writes."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from phd_jdtc_ros.exit_status import FAILED, OK

from .engine import late, peers, step_growth, steps
from .results import curves, goals, machine, report
from .transport import asterix_rates, live, messages, replay_clock, turning

# The live parts come first, when the machine is coolest and this process smallest.
PARTS: Mapping[str, Callable[[bool], dict[str, Any]]] = {
    "live": live.measure,
    "turning": turning.measure,
    "replay_clock": replay_clock.measure,
    "messages": messages.measure,
    "late": late.measure,
    "asterix": asterix_rates.measure,
    "peers": peers.measure,
    "steps": steps.measure,
    "step_growth": step_growth.measure,
}


def run(quick: bool, parts: Sequence[str], console: Console) -> dict[str, Any]:
    """Return the summary of the selected parts; print a line when each begins."""
    begin = time.monotonic()
    summary: dict[str, Any] = {"quick": quick, "machine": machine.description()}
    for name, measure in PARTS.items():
        if name in parts:
            console.print(f"{time.monotonic() - begin:4.0f} s  {name} ...", highlight=False)
            summary[name] = measure(quick)
    summary["figures"] = goals.judge(summary)
    summary["elapsed_s"] = time.monotonic() - begin
    return summary


def write(summary: Mapping[str, Any], directory: Path) -> list[Path]:
    """Write the summary, the tables and the pictures; return the paths."""
    directory.mkdir(parents=True, exist_ok=True)
    path = directory / "summary.json"
    path.write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n")
    text = directory / "table.md"
    text.write_text(report.markdown(report.tables(summary)))
    return [path, text, *curves.write_all(summary, directory)]


def main(argv: Sequence[str]) -> int:
    """Run the benchmark; fail if a figure that was to be measured is missing."""
    parser = argparse.ArgumentParser("python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small sizes, under a minute")
    parser.add_argument("--out", type=Path, default=Path("out/bench"), help="%(default)s")
    parser.add_argument(
        "--part", action="append", choices=list(PARTS), help="only this one; may be repeated"
    )
    arguments = parser.parse_args(argv)
    console = Console()
    arguments.out.mkdir(parents=True, exist_ok=True)
    summary = run(arguments.quick, arguments.part or list(PARTS), console)
    for table in report.tables(summary):
        console.print(table)
    for path in write(summary, arguments.out):
        console.print(path, highlight=False)
    console.print(
        "{elapsed_s:.0f} s; {cpu}, {cpus} CPUs, load {load_average:.1f}, Python {python}, "
        "NumPy {numpy}".format(**summary, **summary["machine"]),
        highlight=False,
    )
    missing = [each for each in summary["figures"] if goals.is_missing(each)]
    for each in missing:
        console.print(f"missing: {each['name']}: {each['reason']}", style="red", markup=False)
    return FAILED if missing else OK
