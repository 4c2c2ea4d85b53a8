"""The accuracy of a tracker with misconfigured radars, with and without learning.

Noise, detection probability and clutter of the radars of the reference scenario are the nominal
ones times a factor; in one case the noise has heavy tails. Each profile is run as it is shipped, on
its scenario and on one with other radars. A tracker with the true values is the reference. The
first scans do not count, because nothing is learned yet.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from phd_jdtc_ros import resources
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.types import Detections
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.metrics import ospa
from phd_jdtc_ros.parameter_files import from_arguments, sections, yaml_files
from phd_jdtc_ros.simulation import antenna, scenario_file
from phd_jdtc_ros.simulation.scenario import Scenario, paper_scenario
from phd_jdtc_ros.study import tracker
from phd_jdtc_ros.study.definition import CUTOFF, ORDER
from phd_jdtc_ros.study.tracker import TAXIING, IgnoredTargets, SimulatedRun, simulated_run

from .runner import Figures, Goal, Study, cell, goal, table

RADARS = ("radar_1", "radar_2")
# The nominal values, and those from which a tracker learns.
NOMINAL: Mapping[str, float] = {
    "range_std": 300.0,
    "azimuth_std_deg": 1.0,
    "detection_probability": 0.9,
    "clutter_rate": 20.0,
}
LEARNED: Mapping[str, Any] = {
    **NOMINAL,
    "learn": ["noise", "outliers", "detection", "clutter"],
}
# Factors of the truth.
CASES: Mapping[str, Mapping[str, float]] = {
    "nominal": {},
    "noise x 0.5": {"range_std": 0.5, "azimuth_std_deg": 0.5},
    "noise x 2": {"range_std": 2.0, "azimuth_std_deg": 2.0},
    "detection x 0.75": {"detection_probability": 0.75},
    "detection x 0.5": {"detection_probability": 0.5},
    "clutter x 0.3": {"clutter_rate": 0.3},
    "clutter x 3": {"clutter_rate": 3.0},
    "noise x 2, detection x 0.75, clutter x 3": {
        "range_std": 2.0,
        "azimuth_std_deg": 2.0,
        "detection_probability": 0.75,
        "clutter_rate": 3.0,
    },
}
# Factors of the truth for a profile. Range rates are part of the noise where they are measured.
AS_SET = "as set"
PROFILE_CASES: Mapping[str, Mapping[str, float]] = {
    AS_SET: {},
    "all wrong": {"range_rate_std": 2.0, **CASES["noise x 2, detection x 0.75, clutter x 3"]},
}
# Noise with heavy tails, which a tracker with the true values knows; see `heavy_tailed`.
HEAVY_TAILS = "heavy tails"
# Noise of detections to which other noise is added.
EXACT: Mapping[str, float] = {"range_std": 1e-2, "azimuth_std_deg": 1e-4}


class Scene(NamedTuple):
    """The scenario of a profile."""

    scenario: str
    cutoff: float = CUTOFF  # Metres
    ignored: IgnoredTargets = TAXIING  # Unscored targets if antennas turn


PROFILES = {
    "surveillance": Scene("paper_scenario"),
    "air_traffic": Scene("terminal_radar"),
    "marine": Scene("coastal", 200.0, IgnoredTargets(1.0, 150.0)),
    "automotive": Scene("automotive", 20.0),
}
# Lags of the filtered and of the smoothed estimates.
LAGS = {"filtered": 0, "smoothed": 5}
# Scans that do not count.
BEFORE = 20
# Largest ratios to the errors of a tracker with the true values, where these are not the nominal
# ones and where they are.
MOST_WRONG, MOST_RIGHT = 1.1, 1.01


def measure(_: argparse.Namespace, seed: int) -> Figures:
    """Return the mean OSPA distances of a seed in metres, by case, tracker and source."""
    found: Figures = {}
    for case, factors in CASES.items():
        truth = truth_of(factors)
        run = simulated_run(scenario_of(truth), seed)
        trackers = {"true values": truth, "nominal values": NOMINAL, "learned": LEARNED}
        found[case] = {name: _distances(run, of_radars(given)) for name, given in trackers.items()}
    found[HEAVY_TAILS] = _of_heavy_tails(seed)
    profiles = {
        f"{profile}, {case}": _of_profile(profile, factors, seed)
        for profile in PROFILES
        for case, factors in PROFILE_CASES.items()
    }
    return {"cases": found, "profiles": profiles}


def _of_heavy_tails(seed: int) -> Figures:
    """Return the distances with heavy-tailed noise, of trackers with outliers and without."""
    run = heavy_tailed_run(seed)
    trackers: dict[str, Mapping[str, Any]] = {
        "true values": {**NOMINAL, "learn": ["outliers"]},
        "nominal values": NOMINAL,
        "learned": LEARNED,
    }
    return {name: _distances(run, of_radars(given)) for name, given in trackers.items()}


def heavy_tailed_run(seed: int) -> SimulatedRun:
    """Return a run of the reference scenario with nominal noise that has heavy tails."""
    run = simulated_run(scenario_of({**NOMINAL, **EXACT}), seed)
    rng = np.random.default_rng(seed)
    std = np.array([NOMINAL["range_std"], np.radians(NOMINAL["azimuth_std_deg"])])

    def moved(exact: Detections | None) -> Detections | None:
        if exact is None:
            return None
        measured = exact.measurement + std * heavy_tailed(rng, len(exact))
        return replace(exact, measurement=antenna.polar(measured))

    scans = (replace(scan, detections=tuple(map(moved, scan.detections))) for scan in run.scans)
    return replace(run, scans=tuple(scans))


def heavy_tailed(rng: np.random.Generator, count: int) -> FloatArray:
    """Return noise in standard deviations, (N, 2): Student's t, and outliers in one of twenty."""
    outlier = rng.random((count, 1)) < 0.05
    large, usual = 5.0 * rng.standard_normal((count, 2)), rng.standard_t(3, (count, 2))
    found: FloatArray = np.where(outlier, large, usual / np.sqrt(3.0))
    return found


def _of_profile(profile: str, factors: Mapping[str, float], seed: int) -> Figures:
    """Return the distances of a profile with its radars' true values, and as it is shipped."""
    scene = PROFILES[profile]
    document = yaml_files.load(resources.find(Path("config/scenarios", f"{scene.scenario}.yaml")))
    shipped = sections.read(resources.find(Path("config", f"{profile}.yaml"))).values("/tracker")
    given = from_arguments.scenario_parameters(document)
    truth = {
        f"{radar}.{name}": scaled(given.get(f"{radar}.{name}", NOMINAL.get(name)), factor)
        for radar in shipped["sensors"]
        for name, factor in ({**dict.fromkeys(NOMINAL, 1.0), **factors}).items()
        if name in NOMINAL or f"{radar}.{name}" in given
    }
    radars = polar_radars(resolve({**given, **truth}).model.radars)
    scenario = scenario_file.resolve(document, radars)
    turns = any(radar.rotation_s for radar in radars)
    run = (
        tracker.turning_run(scenario, seed, scene.ignored)
        if turns
        else simulated_run(scenario, seed)
    )
    trackers = {"true values": {**shipped, **truth}, "as shipped": shipped}
    return {name: _distances(run, own, scene.cutoff) for name, own in trackers.items()}


def scaled(value: Any, factor: float) -> Any:
    """Return a number, or each of several numbers, times a factor."""
    return [each * factor for each in value] if isinstance(value, Sequence) else value * factor


def truth_of(factors: Mapping[str, float]) -> dict[str, float]:
    """Return the true values of radars, given the factors of the nominal ones."""
    return {name: value * factors.get(name, 1.0) for name, value in NOMINAL.items()}


def scenario_of(truth: Mapping[str, float]) -> Scenario:
    """Return the reference scenario with radars like these."""
    return paper_scenario(polar_radars(resolve(of_radars(truth)).model.radars))


def of_radars(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the reference scenario's parameters, with some that all radars have."""
    own = {f"{radar}.{name}": value for radar in RADARS for name, value in values.items()}
    return from_arguments.scenario_parameters(None) | own


def _distances(
    run: SimulatedRun, parameters: Mapping[str, Any], cutoff: float = CUTOFF
) -> dict[str, float]:
    """Return the mean OSPA distances of a tracker with these parameters, by source, metres."""
    lags = tuple(LAGS.values())
    if run.scans:
        tracks = tracker.track(run, resolve(parameters), lags)
    else:
        tracks = tracker.track_turning(run, parameters, lags).tracks
    return {source: _mean(run, tracks[lag], cutoff) for source, lag in LAGS.items()}


def _mean(run: SimulatedRun, found: Sequence[PointSet], cutoff: float) -> float:
    pairs = list(zip(run.truth, found, strict=True))[BEFORE:]
    scores = [ospa(truth.position, points.position, cutoff, ORDER) for truth, points in pairs]
    return float(np.mean([score.distance for score in scores]))


def tables(figures: Figures) -> list[Table]:
    """Return the distances of each case and of each profile, filtered / smoothed."""
    found = []
    parts = (("cases", "OSPA after 20 scans in metres", ".1f"), ("profiles", "The profiles", ".2f"))
    for part, title, form in parts:
        trackers = next(iter(figures[part].values()))
        rows = [
            (
                case,
                *(
                    " / ".join(cell(figures, [part, case, own, source], form) for source in LAGS)
                    for own in trackers
                ),
            )
            for case in figures[part]
        ]
        found.append(table(f"{title}, filtered / smoothed", ("radars", *trackers), rows))
    return found


def goals(figures: Figures) -> list[Goal]:
    """Return the goals: the error of a learning tracker, relative to one with the true values."""
    found = []
    for case, of_case in (figures["cases"] | figures["profiles"]).items():
        right = case == "nominal" or case.endswith(AS_SET)
        bound = MOST_RIGHT if right else MOST_WRONG
        learned = next(own for own in ("learned", "as shipped") if own in of_case)
        for source in LAGS:
            ratio = of_case[learned][source] / of_case["true values"][source]
            found.append(
                goal(f"misspecified, {case}, {learned} / true values, {source}", ratio, bound)
            )
    return found


STUDY = Study(
    name="misspecified",
    purpose=__doc__.split("\n", 1)[0],
    measure=measure,
    tables=tables,
    goals=goals,
    seed=61000,
    runs=12,
    in_summary="misspecified",
)
