"""The study of registration: known errors of one radar of three, found from twenty minutes."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from phd_jdtc_ros import output_files, resources
from phd_jdtc_ros.calibration.registration.sensors import RegistrationError
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.types import SOURCES
from phd_jdtc_ros.exit_status import FAILED, OK, ArgumentParser
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.study import registration

from . import command

SCENARIO = Path("config/scenarios/three_biased_radars.yaml")
# The tracker needs much more time than the registration: it runs on the first seconds only.
TRACKED_S = 150.0
SHORTEST_MIN = 3.0
# Of the study, which this is a part of.
SUMMARY = "summary.json"


def run(document: Mapping[str, Any], seed: int, tracked_s: float = TRACKED_S) -> dict[str, Any]:
    """Return the errors of every radar, those of the tracker, and the goals.

    Parameters
    ----------
    document : mapping
        Of a scenario file.
    seed : int
        Of the plots and of the tracker.
    tracked_s : float
        What the tracker is run on, from the beginning.

    Raises
    ------
    RegistrationError
        If the plots say nothing of the errors.
    """
    parameters = from_arguments.scenario_parameters(document)
    config = resolve(parameters)
    scene = scenario_file.resolve(document, config.model.radars)
    begin = time.process_time()
    found = registration.registration_of(scene, config, seed)
    spent_s = time.process_time() - begin
    rows = registration.rows_of(scene, found)
    # The targets are drawn for the whole time.
    part = scene.until(tracked_s)
    errors = registration.errors_of_tracks(part, parameters, found, seed)
    return {
        "seed": seed,
        "errors": [row._asdict() for row in rows],
        "rms_m": errors,
        "registration_cpu_s": spent_s,
        "goals": registration.goals_of(rows, errors),
    }


def tables(found: Mapping[str, Any]) -> list[Table]:
    """Return the tables of errors, of the tracker's, and of the goals."""
    errors = Table(title="registration: systematic errors", title_justify="left")
    for name in ("radar", "error", "true", "found", "+-"):
        errors.add_column(name, justify="left" if name in ("radar", "error") else "right")
    for row in found["errors"]:
        told = row["std"] is not None and row["std"] == row["std"]
        errors.add_row(
            row["radar"],
            f"{row['error']}, {row['unit']}",
            f"{row['true']:.3g}",
            f"{row['found']:.4f}" if told else "reference",
            f"{row['std']:.2g}" if told else "",
        )
    tracks = Table(title="registration: RMS position error, m", title_justify="left")
    tracks.add_column("radars")
    for source in SOURCES:
        tracks.add_column(source, justify="right")
    for name, of_run in found["rms_m"].items():
        tracks.add_row(name, *(f"{of_run[source]:.1f}" for source in SOURCES))
    goals = Table(title="goals", title_justify="left")
    for name in ("name", "value", "at most", "reached"):
        goals.add_column(name, no_wrap=True)
    for goal in found["goals"]:
        cells = f"{goal['value']:.4g}", f"{goal['goal']:g}", "yes" if goal["reached"] else "no"
        goals.add_row(goal["name"], *cells)
    return [errors, tracks, goals]


def merge(path: Path, goals: Sequence[Mapping[str, Any]]) -> None:
    """Write goals among those of a study's summary, instead of those of the same names."""
    summary: dict[str, Any] = {"cases": {}, "goals": []}
    if path.exists():
        summary = json.loads(path.read_text(encoding="utf-8"))
    names = {goal["name"] for goal in goals}
    kept = [goal for goal in summary.get("goals", []) if goal["name"] not in names]
    summary["goals"] = [*kept, *goals]
    output_files.write(path, json.dumps(summary, indent=2, allow_nan=False) + "\n")


def main(argv: Sequence[str]) -> int:
    """Run the study."""
    parser = ArgumentParser("registration", description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="%(default)s")
    parser.add_argument("--minutes", type=float, help="the first of the run only")
    parser.add_argument("--out", type=Path, default=Path("out/study"), help="%(default)s")
    arguments = parser.parse_args(argv)

    def work() -> int:
        if arguments.seed < 0:
            raise ConfigError([f"--seed: {arguments.seed} given, must be at least 0"])
        if arguments.minutes is not None and not arguments.minutes >= SHORTEST_MIN:
            raise ConfigError(
                [f"--minutes: {arguments.minutes} given, must be at least {SHORTEST_MIN:g}"]
            )
        document = dict(yaml_files.load(resources.find(SCENARIO)))
        if arguments.minutes is not None:
            scans = int(60.0 * arguments.minutes / float(document["interval_s"])) + 1
            document["scans"] = min(scans, int(document["scans"]))
        console = Console()
        try:
            found = run(document, arguments.seed)
        except RegistrationError as error:
            console.print(f"registration: {error}", style="red", markup=False)
            return FAILED
        arguments.out.mkdir(parents=True, exist_ok=True)
        path = arguments.out / "registration.json"
        known = [
            {**row, "std": None if row["std"] != row["std"] else row["std"]}
            for row in found["errors"]
        ]
        text = json.dumps({**found, "errors": known}, indent=2, allow_nan=False)
        output_files.write(path, text + "\n")
        merge(arguments.out / SUMMARY, found["goals"])
        for table in tables(found):
            console.print(table)
        console.print(f"results: {path}", soft_wrap=True, markup=False, highlight=False)
        return OK

    return command.guarded("registration", work)
