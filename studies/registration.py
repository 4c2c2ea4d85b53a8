"""The study of registration: accuracy of the estimated biases, and their effect on the tracker.

The tracker is run on unbiased radars, on biased ones, and on biased ones with the estimated biases
removed; the noise is the same in all three. Its error is the distance of targets to their estimates
by assignment, within `CUTOFF`, at the end of each revolution of the first radar.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from phd_jdtc_ros import resources
from phd_jdtc_ros.calibration.registration.common import KINDS, RegistrationError, tracked_radar
from phd_jdtc_ros.calibration.registration.solution import Registration, register
from phd_jdtc_ros.calibration.tuning.plots import plots_of
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.types import SOURCES
from phd_jdtc_ros.evaluation.metrics import assign
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.scenario import Scenario, truth_after
from phd_jdtc_ros.simulation.turning_antenna import simulate_reports
from phd_jdtc_ros.study import tracker

from .runner import Figures, Goal, Study, StudyError, figures_table, goal, table, until

SCENARIO = Path("config/scenarios/three_biased_radars.yaml")
# The tracker runs on the first seconds only, because it takes much longer than the registration.
TRACKED_S = 150.0
# Gate of the assignment of estimates to targets, metres.
CUTOFF = 1000.0
# Estimates are scored from this time on, when tracks are established, seconds.
SETTLING_S = 60.0
# The biases in the table: name, unit, scale and goal.
ERRORS = (
    ("range bias", "m", 1.0, 8.0),
    ("range gain", "m/km", 1e3, None),
    ("azimuth, clockwise", "deg", -float(np.degrees(1.0)), 0.02),
    ("time offset", "s", 1.0, 0.05),
)
# Goal: ratio of the root mean square error after registration to that with unbiased radars.
MOST_RATIO = 1.05
UNBIASED, BIASED, CORRECTED = RUNS = "no errors", "with errors", "registered"


class Row(NamedTuple):
    """A bias of a radar: true value, estimate, standard deviation; None if not observable."""

    radar: str
    error: str
    unit: str
    true: float
    found: float
    std: float | None


def registration_of(scenario: Scenario, config: TrackerConfig, seed: int) -> Registration:
    """Return the registration from the plots of a seeded run, or raise `RegistrationError`."""
    reports = simulate_reports(scenario, config.radars, seed)
    sensors = []
    for index, radar in enumerate(scenario.radars):
        own = [(each.stamp_ns, each.detections) for each in reports if each.radar == index]
        sensors.append(tracked_radar(plots_of(own), radar, scenario.start_ns, moving=False))
    return register(sensors, scenario.radars[0].name)


def rows_of(scenario: Scenario, found: Registration) -> list[Row]:
    """Return every bias of every radar, true and estimated."""
    rows = []
    for index, each in enumerate(found.radars):
        true = scenario.bias(index)
        for kind, std, (name, unit, scale, _) in zip(KINDS, each.std, ERRORS, strict=True):
            exact, seen = (0.0 + scale * getattr(bias, kind) for bias in (true, each.bias))
            known = None if math.isnan(std) else abs(scale) * float(std)
            rows.append(Row(each.name, name, unit, exact, seen, known))
    return rows


def errors_of_tracks(
    scenario: Scenario, parameters: Mapping[str, Any], found: Registration, seed: int
) -> dict[str, dict[str, float]]:
    """Return the tracker's root mean square error, metres, by run (`RUNS`) and source."""
    given = {**parameters, "seed": seed}
    plain = resolve(given)
    corrections: dict[str, Any] = {}
    for layout, each in zip(plain.radars, found.radars, strict=True):
        corrections |= layout.bias_parameters(each.bias)
    runs = (
        (replace(scenario, biases=()), plain),
        (scenario, plain),
        (scenario, resolve({**given, **corrections})),
    )
    return {
        name: _rms(scene, config, seed) for name, (scene, config) in zip(RUNS, runs, strict=True)
    }


def _rms(scenario: Scenario, config: TrackerConfig, seed: int) -> dict[str, float]:
    reports = simulate_reports(scenario, config.radars, seed)
    found, _ = tracker.estimates_of(scenario, config, reports)
    ends = [end for end in tracker.revolution_ends(scenario) if end >= SETTLING_S]
    truth = [truth_after(scenario, end) for end in ends]
    oldest_s = tracker.OLDEST_REVOLUTIONS * scenario.radars[0].rotation_s
    errors: dict[str, float] = {}
    for source in SOURCES:
        points = tracker.at_stamps(found[source], [each.stamp_ns for each in truth], oldest_s)
        squares = [np.zeros(0)]
        for true, own in zip(truth, points, strict=True):
            i, j = assign(true.position, own.position, CUTOFF)
            squares.append(((true.position[i] - own.position[j]) ** 2).sum(axis=1))
        errors[source] = float(np.sqrt(np.mean(np.concatenate(squares))))
    return errors


def goals_of(rows: Sequence[Row], errors: Mapping[str, Mapping[str, float]]) -> list[Goal]:
    """Return the goals: the largest error of a bias, and the tracker's error after registration."""
    goals = []
    for name, unit, _, bound in ERRORS:
        if bound is not None:
            off = [abs(row.found - row.true) for row in rows if row.error == name]
            goals.append(goal(f"registration: {name}, {unit}", max(off), bound))
    for source in SOURCES:
        ratio = errors[CORRECTED][source] / errors[UNBIASED][source]
        goals.append(goal(f"registration: RMS {source}, to no errors", ratio, MOST_RATIO))
    return goals


def run(
    document: Mapping[str, Any], seed: int, seconds: float | None, tracked_s: float = TRACKED_S
) -> Figures:
    """Return the biases of every radar and the errors of the tracker, for a scenario's document.

    The registration takes the first `seconds` of the scenario, or all of it, the tracker
    `tracked_s`. Raise `StudyError` if the biases are not observable in the plots.
    """
    parameters = from_arguments.scenario_parameters(document)
    config = resolve(parameters)
    whole = scenario_file.resolve(document, polar_radars(config.model.radars))
    begin = time.process_time()
    try:
        found = registration_of(whole if seconds is None else until(whole, seconds), config, seed)
    except RegistrationError as error:
        raise StudyError(str(error)) from error
    spent_s = time.process_time() - begin
    return {
        "errors": [row._asdict() for row in rows_of(whole, found)],
        "rms_m": errors_of_tracks(until(whole, tracked_s), parameters, found, seed),
        "registration_cpu_s": spent_s,
    }


def _measure(arguments: argparse.Namespace, seed: int) -> Figures:
    document = yaml_files.load(resources.find(SCENARIO))
    return run(document, seed, arguments.minutes and 60.0 * arguments.minutes)


def tables(found: Figures) -> list[Table | str]:
    """Return the tables of the radars' biases and of the tracker's errors."""
    errors = []
    for row in (Row(**each) for each in found["errors"]):
        cells = ("reference", "") if row.std is None else (f"{row.found:.4f}", f"{row.std:.2g}")
        errors.append((row.radar, f"{row.error}, {row.unit}", f"{row.true:.3g}", *cells))
    columns = {source: (source, ".1f") for source in SOURCES}
    rows = {name: ("rms_m", name) for name in found["rms_m"]}
    return [
        table("registration: systematic errors", ("radar", "error", "true", "found", "+-"), errors),
        figures_table("registration: RMS position error, m", "radars", found, columns, rows),
    ]


STUDY = Study(
    name="registration",
    purpose="Known errors of one radar of three, found in twenty minutes of plots.",
    measure=_measure,
    tables=tables,
    goals=lambda found: goals_of([Row(**each) for each in found["errors"]], found["rms_m"]),
    least_minutes=3.0,
    in_summary="registration",
)
