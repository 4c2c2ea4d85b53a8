"""How much ADS-B improves the tracks of a radar: of aircraft that have it, and of others.

The scenario `approach_adsb` is simulated and tracked by its radar, its receiver, and both, and by
the plot Kalman tracker with the radar's plots. The radar's biases are known to the trackers, as
after `register`, or with `--biased` they are not. An estimate belongs to the nearest target, by
assignment within `CUTOFF`, at the times of the truth.
"""

from __future__ import annotations

import argparse
import io
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from phd_jdtc_ros import resources
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.core.types import Truth
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.metrics import assign
from phd_jdtc_ros.exit_status import ArgumentParser
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments, yaml_files
from phd_jdtc_ros.tools import simulate, tune
from phd_jdtc_ros.tools.track_bag import track_bag

from .. import runner
from ..league import Recorded, plot_kalman, track
from ..runner import Figures, Goal, Study, StudyError

SCENARIO = Path("config/scenarios/approach_adsb.yaml")
CUTOFF, SETTLING_S = 1000.0, 60.0  # Metres; estimates are scored from this time on
RUNS = RADAR, REPORTS, JOINT = "radar", "reports", "joint"
PEER = "plot Kalman"
EQUIPPED, OTHERS = GROUPS = "equipped", "others"
# Goals: errors relative to those of the radar alone.
MOST = {EQUIPPED: 0.2, OTHERS: 1.02}
# Errors of the proposed biases: the entry among a radar's, the scale of the simulated one, as
# azimuths of this radar count counter-clockwise, digits, unit, and the goal in every run.
BIASES = {
    "range_bias": (0, 1.0, 1, "m", 5.0),
    "azimuth_bias_deg": (2, -1.0, 4, "deg", 0.01),
}


def _measure(arguments: argparse.Namespace, seed: int) -> Figures:
    path = resources.find(SCENARIO)
    document = yaml_files.load(path)
    (reception,) = document["self_reports"].values()
    equipped = {sender["target"] for sender in reception["transmitters"]}
    figures: Figures = {}
    with tempfile.TemporaryDirectory() as directory:
        bag = Path(directory) / "bag"
        words = ["--scenario", str(path), "--seed", str(seed), "--out", str(bag)]
        if simulate.main(words):
            raise StudyError(f"{SCENARIO}: not simulated")
        values = bag_parameters.read(bag) or {}
        ((radar, bias),) = document["biases"].items()
        own = [0.0] * 4
        for name, (entry, scale, *_) in BIASES.items():
            own[entry] = scale * bias[name]
        proposed = _proposed(bag, Path(directory) / "proposed.yaml")[f"{radar}.biases"]
        figures["bias_errors"] = {
            name: abs(proposed[entry] - own[entry]) for name, (entry, *_) in BIASES.items()
        }
        if not arguments.biased:
            values |= {f"{radar}.biases": own}
        for name in RUNS:
            first, last = values["sensors"]
            sensors = {RADAR: [first], REPORTS: [last], JOINT: [first, last]}[name]
            others = tuple(f"{each}." for each in {first, last} - set(sensors))
            kept = {each: value for each, value in values.items() if not each.startswith(others)}
            config = from_arguments.config_of({**kept, "sensors": sensors})
            tracked = track_bag(BagReader(bag), config, Path(directory) / name, f"seed {seed}")
            record = tracked.record()
            filtered = {each.stamp_ns: each for each in record.filtered}
            found = {
                stamp: PointSet.of(
                    each.select((each.track_state > 0) & np.isfinite(each.position[:, 0]))
                )
                for stamp, each in filtered.items()
            }
            figures[name] = _scored(record.truth, found, equipped)
            if name == RADAR:
                known = {truth.stamp_ns: PointSet.of(truth) for truth in record.truth}
                recorded = Recorded(config, truth=known)
                track(BagReader(bag), recorded)
                points = plot_kalman(recorded).points
                figures[PEER] = _scored(record.truth, points, equipped)
    figures["ratio"] = {group: figures[JOINT][group] / figures[RADAR][group] for group in GROUPS}
    return figures


def _proposed(bag: Path, out: Path) -> Mapping[str, Any]:
    """Return the parameters that `tune` proposes for a bag."""
    with redirect_stdout(io.StringIO()):
        if tune.main([str(bag), "--out", str(out)]):
            raise StudyError(f"{SCENARIO}: tune failed")
    return from_arguments.load(out)


def _combined(found: Sequence[Figures]) -> Figures:
    """Return the means of figures, and the largest errors of biases."""
    several = {"half_width": runner.half_width(found)} if len(found) > 1 else {}
    largest = {name: max(each["bias_errors"][name] for each in found) for name in BIASES}
    return {**runner.mean(found), "largest_bias_errors": largest, **several}


def _scored(truths: Sequence[Truth], found: Mapping[int, PointSet], equipped: set[int]) -> Figures:
    """Return RMS errors, and switches of numbers, of estimates by stamp."""
    begin_ns, switches = truths[0].stamp_ns, 0
    numbers: dict[int, int] = {}
    squares: dict[str, list[float]] = {group: [] for group in GROUPS}
    for truth in truths:
        # Estimates have the stamp of a sector at the end of a revolution.
        nearest = min(found, key=lambda stamp: abs(stamp - truth.stamp_ns))
        own, late_s = found[nearest], (truth.stamp_ns - nearest) * 1e-9
        if own.velocity is None or own.track_id is None:
            raise StudyError("tracks without velocities or numbers")
        place = own.position + late_s * own.velocity
        for target, row in zip(*assign(truth.position, place, CUTOFF), strict=True):
            label, number = int(truth.track_id[target]), int(own.track_id[row])
            switches += numbers.setdefault(label, number) != number
            numbers[label] = number
            if (truth.stamp_ns - begin_ns) * 1e-9 < SETTLING_S:
                continue
            error = place[row] - truth.position[target]
            squares[EQUIPPED if label in equipped else OTHERS].append(float(error @ error))
    return {
        # Aircraft without a transmitter have no reports.
        **{group: float(np.sqrt(np.mean(each))) for group, each in squares.items() if each},
        **{f"count_{group}": len(each) for group, each in squares.items()},
        "switches": switches,
    }


def _add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("--biased", action="store_true", help="the tracker knows no bias")


def _tables(figures: Figures) -> Sequence[Table | str]:
    half = figures.get("half_width", {})
    rows: list[tuple[str, ...]] = []
    by_run = [figures[name] for name in (RADAR, PEER, REPORTS, JOINT)]
    for group in GROUPS:
        width = half.get("ratio", {}).get(group)
        rows.append(
            (
                group,
                *(f"{each[group]:.1f} m" if group in each else "-" for each in by_run),
                f"{figures['ratio'][group]:.3f}" + (f" ± {width:.3f}" if width else ""),
            )
        )
    rows.append(("switches of numbers", *(f"{each['switches']:.1f}" for each in by_run), ""))
    headings = ("aircraft", "radar alone", PEER, "ADS-B alone", "both", "both / radar")
    errors = figures["bias_errors"], figures["largest_bias_errors"]
    biases = [
        (
            name.replace("_deg", "").replace("_", " "),
            *(f"{e[name]:.{digits}f} {unit}" for e in errors),
        )
        for name, (_, _, digits, unit, _) in BIASES.items()
    ]
    return [
        runner.table("RMS error, and switches in a run", headings, rows),
        runner.table("biases that tune proposes", ("bias", "mean error", "largest"), biases),
    ]


def _goals(figures: Figures) -> list[Goal]:
    goals = [
        runner.goal(f"RMS error of {group} aircraft / radar alone", figures["ratio"][group], most)
        for group, most in MOST.items()
    ]
    largest = figures["largest_bias_errors"]
    return [
        *goals,
        runner.goal("switches of numbers", figures[JOINT]["switches"], 0.0),
        *(
            runner.goal(f"largest error of tune's {name}", largest[name], most)
            for name, (*_, most) in BIASES.items()
        ),
    ]


STUDY = Study(
    name="aircraft_reports",
    purpose="How much ADS-B improves the tracks of a radar.",
    measure=_measure,
    tables=_tables,
    goals=_goals,
    seed=700,
    runs=12,
    combined=_combined,
    add_arguments=_add_arguments,
)
