"""The MADAP benchmark of multi-radar trackers: its figures, and the results published in 1993.

The published text (ECAC, Guidelines for the Application of the ECAC Radar Separation Minima, annex
on tracker benchmark tests) has radars, flights, thresholds and results. It does not say how its
figures are computed; the assumptions made here are those of `errors_of` and `figures_of`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.table import Table

from phd_jdtc_ros import resources
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.arrays import FloatArray, wrap_angle
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.types import SOURCES, Truth
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.metrics import assign
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.scenario import truth_at
from phd_jdtc_ros.simulation.targets import METRES_PER_NM, MPS_PER_KT
from phd_jdtc_ros.simulation.turning_antenna import simulate_reports
from phd_jdtc_ros.study import tracker

from .peers.plot_kalman import follow
from .runner import Figures, Goal, Study, cell, goal, table, until

SCENARIO = Path("config/scenarios/madap.yaml")
PEER = "plot Kalman"

# Gate of the assignment of tracks to flights, NM.
CUTOFF_NM = 5.0
# Tracks are scored from this time on, when they are established, seconds.
SETTLING_S = 60.0


class Errors(NamedTuple):
    """The errors of every track update."""

    position: FloatArray  # Distance between track and flight, NM, (N,)
    speed: FloatArray  # Estimated minus true ground speed, kt, (N,)
    heading: FloatArray  # Estimated minus true heading, clockwise, degrees, (N,)
    turning: FloatArray  # 1 where the flight is in a turn, else 0, (N,)
    expected: int  # Number of updates if every flight always had a track


def expected_speed(velocity: FloatArray, covariance: FloatArray | None) -> FloatArray:
    """Return the expected ground speeds, metres per second, (T,), of uncertain velocities, (T, 2).

    The length of the mean velocity is below the mean speed, because the course is uncertain. The
    velocity's variance across the course, if known, corrects this to second order.
    """
    length: FloatArray = np.hypot(*velocity.T)
    if covariance is None:
        return length
    course = velocity / np.maximum(length, np.finfo(float).tiny)[:, None]
    across = np.column_stack([-course[:, 1], course[:, 0]])
    variance = np.einsum("ti,tij,tj->t", across, covariance, across)
    return np.asarray(np.sqrt(length**2 + variance))


class Figure(NamedTuple):
    """A figure of the benchmark."""

    # `name`, `unit`, `form`: name, unit and Python format specification.
    name: str
    unit: str
    form: str
    value: Callable[[Errors], float]
    # `multi_radar`, `single_radar`: published results of the operational multi-radar tracker, and
    # of one radar.
    multi_radar: float | None
    single_radar: float | None
    goal: str = ""  # ``at_most`` or ``at_least`` the multi-radar result, or empty


def _share(name: str, bound: float, turning: bool) -> Callable[[Errors], float]:
    def value(errors: Errors) -> float:
        rows = errors.turning == turning
        return float(np.mean(np.abs(getattr(errors, name)[rows]) < bound))

    return value


FIGURES = (
    Figure(
        "position error, mean", "NM", ".3f", lambda e: float(e.position.mean()), 0.06, 0.13,
        "at_most",
    ),
    Figure(
        "position error, deviation", "NM", ".3f", lambda e: float(e.position.std()), 0.08, 0.13,
        "at_most",
    ),
    Figure("ground speed error, mean", "kt", ".1f", lambda e: float(e.speed.mean()), 0.2, -1.1),
    Figure(
        "ground speed error, deviation", "kt", ".1f", lambda e: float(e.speed.std()), 4.4, 12.7,
        "at_most",
    ),
    Figure("heading error, mean", "deg", ".2f", lambda e: float(e.heading.mean()), -3.69, -6.77),
    Figure(
        "heading error, deviation", "deg", ".2f", lambda e: float(e.heading.std()), 9.40, 12.22,
        "at_most",
    ),
    Figure(
        "position within 0.25 NM, straight", "", ".2%", _share("position", 0.25, False), 0.9951,
        0.9592, "at_least",
    ),
    Figure(
        "position within 1 NM, turns", "", ".2%", _share("position", 1.0, True), 1.0, 0.9998,
    ),
    Figure(
        "ground speed within 20 kt, straight", "", ".2%", _share("speed", 20.0, False), 0.9956,
        0.9505,
    ),
    Figure(
        "ground speed within 70 kt, turns", "", ".2%", _share("speed", 70.0, True), 1.0, 0.9943,
    ),
    Figure(
        "heading within 10 deg, straight", "", ".2%", _share("heading", 10.0, False), 0.9797,
        0.9586,
    ),
    Figure(
        "heading within 90 deg, turns", "", ".2%", _share("heading", 90.0, True), 0.9991, 0.9980,
    ),
    Figure(
        "flights with a track", "", ".2%", lambda e: len(e.position) / max(e.expected, 1), None,
        None,
    ),
)  # fmt: skip


def errors_of(truth: Sequence[Truth], found: Sequence[PointSet]) -> Errors:
    """Return the errors of tracks with velocities at the stamps of the truth.

    Assumptions: tracks are assigned to flights by distance, within `CUTOFF_NM`; the first
    `SETTLING_S` are left out; a flight is in a turn exactly where its true turn rate is not zero; a
    track's ground speed is the expected one, `expected_speed`.
    """
    rows: list[FloatArray] = [np.zeros((0, 4))]
    expected = 0
    for targets, points in zip(truth, found, strict=True):
        if targets.stamp_ns - truth[0].stamp_ns < SETTLING_S * 1e9:
            continue
        expected += len(targets.state)
        i, j = assign(targets.position, points.position, CUTOFF_NM * METRES_PER_NM)
        paired, velocity = points.only(j), targets.velocity[i]
        if paired.velocity is None or not len(i):
            continue
        away = np.hypot(*(paired.position - targets.position[i]).T) / METRES_PER_NM
        speed = expected_speed(paired.velocity, paired.velocity_covariance)
        faster = (speed - np.hypot(*velocity.T)) / MPS_PER_KT
        heading = np.degrees(wrap_angle(_course(velocity) - _course(paired.velocity)))
        turning = targets.state[i, targets.space.turn_rate] != 0.0
        rows.append(np.column_stack([away, faster, heading, turning]))
    position, speed, heading, turning = np.concatenate(rows).T
    return Errors(position, speed, heading, turning > 0.0, expected)


def _course(velocity: FloatArray) -> FloatArray:
    """Return directions from the x axis, radians, counter-clockwise."""
    return np.arctan2(velocity[:, 1], velocity[:, 0])


def figures_of(errors: Errors) -> dict[str, float | None]:
    """Return the figures by name; None without data.

    Assumptions: the position error is the distance, the errors of speed and heading are signed; all
    means and standard deviations are over straight legs and turns together. The published mean
    heading error is negative, as of a track that lags in turns to the right.
    """
    with np.errstate(invalid="ignore"):
        return {
            figure.name: figure.value(errors) if len(errors.position) else None
            for figure in FIGURES
        }


def goals_of(found: Mapping[str, Mapping[str, float | None]]) -> list[Goal]:
    """Return the goals, by tracker and figure."""
    return [
        goal(
            f"{figure.name}, {tracker}",
            figures[figure.name],
            figure.multi_radar,
            figure.goal == "at_most",
        )
        for tracker, figures in found.items()
        for figure in FIGURES
        if figure.goal and figure.multi_radar is not None
    ]


def _measure(arguments: argparse.Namespace, seed: int) -> Figures:
    """Return the figures by tracker, and the CPU time."""
    document = dict(yaml_files.load(resources.find(SCENARIO)))
    given = from_arguments.scenario_parameters(document)
    given |= from_arguments.from_arguments(arguments.params_file, arguments.assignments)
    config = resolve({**given, "seed": seed})
    scenario = scenario_file.resolve(document, polar_radars(config.model.radars))
    if arguments.minutes is not None:
        scenario = until(scenario, 60.0 * arguments.minutes)
    truth = [truth_at(scenario, scan) for scan in range(scenario.scans)]
    stamps = [targets.stamp_ns for targets in truth]
    reports = simulate_reports(scenario, config.radars, seed)
    found, spent_s = tracker.estimates_of(scenario, config, reports)
    points: dict[str, Sequence[PointSet]] = {
        source: tracker.at_stamps(found[source], stamps, 2.0 * scenario.interval_s)
        for source in SOURCES
    }
    points[PEER] = follow(reports, scenario.radars, stamps)
    figures = {name: figures_of(errors_of(truth, of_one)) for name, of_one in points.items()}
    return {"figures": figures, "cpu_per_update_ms": 1e3 * spent_s / scenario.scans}


def _tables(found: Figures) -> list[Table | str]:
    rows = []
    for figure in FIGURES:
        published = {"all": figure.multi_radar, "one": figure.single_radar}
        cells = [cell(published, [key], figure.form, figure.unit) for key in published]
        for name in found["figures"]:
            cells.append(cell(found, ["figures", name, figure.name], figure.form, figure.unit))
        rows.append((figure.name, *cells))
    heading = "MADAP benchmark, manoeuvring flights"
    columns = ("figure", "published, all radars", "published, one radar", *found["figures"])
    return [
        table(heading, columns, rows),
        f"CPU per update of all tracks: {found['cpu_per_update_ms']:.0f} ms",
    ]


STUDY = Study(
    name="madap",
    purpose="The MADAP benchmark of multi-radar trackers: our figures beside the published ones.",
    measure=_measure,
    tables=_tables,
    goals=lambda found: goals_of({source: found["figures"][source] for source in SOURCES}),
    # Tracks are scored from the second minute on.
    least_minutes=2.0,
    has_parameters=True,
)
