"""The MADAP benchmark of multi-radar trackers: our figures beside the published ones."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from phd_jdtc_ros import output_files, resources
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.types import SOURCES
from phd_jdtc_ros.evaluation.scan_scores import PointSet
from phd_jdtc_ros.exit_status import OK, ArgumentParser
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.scenario import truth_at
from phd_jdtc_ros.simulation.turning_antenna import simulate_reports
from phd_jdtc_ros.study import madap, turning
from phd_jdtc_ros.study.peers.plot_kalman import follow

from . import command

SCENARIO = Path("config/scenarios/madap.yaml")
PEER = "plot Kalman"
# Tracks are not scored before.
SHORTEST_MIN = madap.SETTLING_S / 60.0


def run(document: Mapping[str, Any], parameters: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Return the figures of a seeded run by tracker, as `madap.figures_of`, and the CPU time.

    Parameters
    ----------
    document : mapping
        Of a scenario file.
    parameters : mapping
        Of the tracker.
    seed : int
        Of the plots and of the tracker.
    """
    config = resolve({**parameters, "seed": seed})
    scenario = scenario_file.resolve(document, config.model.radars)
    truth = [truth_at(scenario, scan) for scan in range(scenario.scans)]
    stamps = [targets.stamp_ns for targets in truth]
    found, spent_s = turning.estimates_of(scenario, config, seed)
    points: dict[str, Sequence[PointSet]] = {
        source: turning.at_stamps(found[source], stamps, 2.0 * scenario.interval_s)
        for source in SOURCES
    }
    reports = simulate_reports(scenario, config.inputs, seed)
    points[PEER] = follow(reports, scenario.radars, stamps)
    figures = {
        name: madap.figures_of(madap.errors_of(truth, of_one)) for name, of_one in points.items()
    }
    return {"figures": figures, "cpu_per_update_ms": 1e3 * spent_s / scenario.scans}


def table(figures: Mapping[str, Mapping[str, float | None]]) -> Table:
    """Return trackers' figures beside the published ones."""
    found = Table(title="MADAP benchmark, manoeuvring flights")
    found.add_column("figure")
    for name in ("published", "one radar", *figures):
        found.add_column(name, justify="right")
    for figure in madap.FIGURES:
        values = [figure.multi_radar, figure.single_radar]
        values += [of_one[figure.name] for of_one in figures.values()]
        cells = ["-" if v is None else f"{v:{figure.form}} {figure.unit}".rstrip() for v in values]
        found.add_row(figure.name, *cells)
    return found


def _shortened(document: Mapping[str, Any], minutes: float | None) -> dict[str, Any]:
    """Return the scenario document for the first minutes of the run; None for the whole."""
    if minutes is None:
        return dict(document)
    scans = int(60.0 * minutes / float(document["interval_s"])) + 1
    return {**document, "scans": min(scans, int(document["scans"]))}


def main(argv: Sequence[str]) -> int:
    """Run the benchmark."""
    parser = ArgumentParser("madap", description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="%(default)s")
    parser.add_argument("--minutes", type=float, help="the first of the run only")
    parser.add_argument("--out", type=Path, default=Path("out/study"), help="%(default)s")
    command.add_params_file_argument(parser)
    command.add_assignments_argument(parser)
    arguments = parser.parse_args(argv)

    def work() -> int:
        if arguments.seed < 0:
            raise ConfigError([f"--seed: {arguments.seed} given, must be at least 0"])
        if arguments.minutes is not None and not arguments.minutes > SHORTEST_MIN:
            raise ConfigError(
                [f"--minutes: {arguments.minutes} given, must be above {SHORTEST_MIN:g}"]
            )
        document = yaml_files.load(resources.find(SCENARIO))
        parameters = from_arguments.scenario_parameters(document)
        parameters |= from_arguments.from_arguments(arguments.params_file, arguments.assignments)
        found = run(_shortened(document, arguments.minutes), parameters, arguments.seed)
        ours = {source: found["figures"][source] for source in SOURCES}
        summary = {**found, "seed": arguments.seed, "goals": madap.goals_of(ours)}
        arguments.out.mkdir(parents=True, exist_ok=True)
        path = arguments.out / "madap.json"
        output_files.write(path, json.dumps(summary, indent=2, allow_nan=False) + "\n")
        console = Console()
        console.print(table(found["figures"]))
        console.print(f"CPU per update of all tracks: {found['cpu_per_update_ms']:.0f} ms")
        console.print(f"results: {path}", soft_wrap=True, markup=False, highlight=False)
        return OK

    return command.guarded("madap", work)
