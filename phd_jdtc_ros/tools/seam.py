"""What is lost at the seam of two neighbouring trackers, against one tracker for the whole area."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from phd_jdtc_ros import output_files, resources
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.exit_status import OK, ArgumentParser
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.study import seam

from . import command

# Its parameters: two radars that turn, and their tracker.
SCENARIO = Path("config/scenarios/two_terminal_radars.yaml")
# Not those with which the parts of the hand-over were set.
SEEDS = (11, 12)
COLUMNS = {
    "gospa": ("GOSPA", ".0f", " m"),
    "ospa": ("OSPA", ".0f", " m"),
    "switches": ("identity switches", ".1f", ""),
    "missing": ("missing", ".2f", ""),
    "duplicated": ("duplicated", ".2f", ""),
}


def table(scores: Mapping[str, Mapping[str, float]]) -> Table:
    """Return the scores near the seam by way of tracking."""
    found = Table(title=f"within {seam.NEAR / 1e3:g} km of the seam")
    found.add_column("trackers")
    for heading, _, _ in COLUMNS.values():
        found.add_column(heading, justify="right")
    for name, own in scores.items():
        found.add_row(name, *(f"{own[k]:{form}}{unit}" for k, (_, form, unit) in COLUMNS.items()))
    return found


def main(argv: Sequence[str]) -> int:
    """Run the simulation."""
    parser = ArgumentParser("seam", description=__doc__)
    parser.add_argument("--seed", type=int, action="append", help="may be repeated; 11 and 12")
    parser.add_argument("--out", type=Path, default=Path("out/study"), help="%(default)s")
    command.add_params_file_argument(parser)
    command.add_assignments_argument(parser)
    arguments = parser.parse_args(argv)

    def work() -> int:
        seeds = arguments.seed or SEEDS
        if min(seeds) < 0:
            raise ConfigError([f"--seed: {min(seeds)} given, must be at least 0"])
        parameters = from_arguments.scenario_parameters(yaml_files.load(resources.find(SCENARIO)))
        parameters |= {"engine": "gaussian", "accuracy": "fast"}
        parameters |= from_arguments.from_arguments(arguments.params_file, arguments.assignments)
        runs = [seam.run(parameters, seed) for seed in seeds]
        scores = {
            name: {
                key: float(np.mean([asdict(found[name])[key] for found, _ in runs]))
                for key in COLUMNS
            }
            for name in runs[0][0]
        }
        spent_s = {name: float(np.mean([spent[name] for _, spent in runs])) for name in runs[0][1]}
        arguments.out.mkdir(parents=True, exist_ok=True)
        path = arguments.out / "seam.json"
        summary = {"seeds": list(seeds), "scores": scores, "cpu_s": spent_s}
        output_files.write(path, json.dumps(summary, indent=2, allow_nan=False) + "\n")
        console = Console()
        console.print(table(scores))
        spent = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in spent_s.items())
        console.print("missing and duplicated: reports per aircraft, one every 4 s")
        console.print(f"means of {len(seeds)} runs of {seam.DURATION_S:g} s; CPU: {spent}")
        console.print(f"results: {path}", soft_wrap=True, markup=False, highlight=False)
        return OK

    return command.guarded("seam", work)
