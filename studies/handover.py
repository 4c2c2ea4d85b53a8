"""Accuracy at the border of two neighbouring trackers, against one tracker for the whole area.

All trackers get the same plots of two radars. A line from south to north divides the area; aircraft
cross it in both directions, straight or turning, or fly along it.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from phd_jdtc_ros import resources
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.targets.amplitude_density import snr_from_db
from phd_jdtc_ros.core.tracks.region import Region
from phd_jdtc_ros.core.types import FILTERED, Estimates
from phd_jdtc_ros.evaluation.comparison import LabelledPoints
from phd_jdtc_ros.evaluation.metrics import assign, gospa, ospa
from phd_jdtc_ros.evaluation.tracks import IdentitySwitches
from phd_jdtc_ros.handover.ownership import Handover
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.simulation.scenario import Scenario, truth_after
from phd_jdtc_ros.simulation.targets import Flight, Leg
from phd_jdtc_ros.simulation.turning_antenna import simulate_reports
from phd_jdtc_ros.study.tracker import estimates_of

from .runner import Figures, Study, figures_table

# Supplies the parameters of two turning radars and of their tracker.
SCENARIO = Path("config/scenarios/two_terminal_radars.yaml")
# Position of the dividing line, metres east, and extent of the area, metres.
SEAM, FAR = 12.5e3, 150e3
# Overlap on each side of the line, metres: the proposed one, and one crossed in two revolutions.
MARGIN, NARROW = 10e3, 2e3
# A target is handed over this far beyond the line, as a share of the overlap.
HYSTERESIS = 0.2
# Only targets and estimates within this distance of the line are scored, metres.
NEAR = 10e3
# Cut-off, metres, and order of GOSPA and OSPA; the cut-off is also the gate of the assignment.
CUTOFF, ORDER = 1000.0, 2.0
# Estimates are scored from this time on, when tracks are established, seconds.
SETTLING_S = 40.0
DURATION_S, INTERVAL_S, START_NS = 180.0, 4.0, 1000 * 10**9
CROSSING, ALONG = 24, 4
# Aircraft: speeds in m/s, largest angle to the normal of the line in rad, and largest distance of
# the crossing from the middle of the line in metres.
SPEED, SLANT, SPREAD = (140.0, 250.0), 0.7, 60e3
# Every third aircraft turns at the line: turn rate in rad/s and duration in s.
TURN_RATE, TURN_S = np.radians(1.5), 40.0

ONE, CORE, JOINT = "one tracker", "two, by core region", "two, handed over"
JOINT_NARROW = f"two, overlap of {NARROW / 1e3:g} km"


@dataclass(frozen=True)
class Scores:
    """The scores near the dividing line."""

    # `gospa`, `ospa`: mean distances over the stamps, metres.
    gospa: float
    ospa: float
    switches: int  # Identity switches of targets near the line
    # `missing`, `duplicated`: per target that comes near the line: the number of stamps without an
    # estimate of it, and the number of false or duplicate estimates.
    missing: float
    duplicated: float


def regions(margin: float) -> tuple[Region, Region]:
    """Return the western and the eastern tracker's region."""
    return (
        Region(SEAM - FAR, -FAR, SEAM, FAR, margin),
        Region(SEAM, -FAR, SEAM + FAR, FAR, margin),
    )


def scene(config: TrackerConfig, seed: int) -> Scenario:
    """Return a scenario of random traffic with the radars of a configuration."""
    rng = np.random.default_rng([seed, 0])
    flights = [_crossing(number, rng) for number in range(CROSSING)]
    flights += [_along(number, rng) for number in range(ALONG)]
    return Scenario(
        start_ns=START_NS,
        interval_s=INTERVAL_S,
        scans=int(DURATION_S / INTERVAL_S) + 1,
        targets=tuple(flights),
        radars=polar_radars(config.model.radars),
    )


def _crossing(number: int, rng: np.random.Generator) -> Flight:
    """Return an aircraft that crosses the line during the run."""
    speed, slant = rng.uniform(*SPEED), rng.uniform(-SLANT, SLANT)
    east = 1.0 if number % 2 else -1.0
    velocity = speed * np.array([east * np.cos(slant), np.sin(slant)])
    at_s = rng.uniform(0.35, 0.75) * DURATION_S
    start = np.array([SEAM, rng.uniform(-SPREAD, SPREAD)]) - at_s * velocity
    legs: tuple[Leg, ...] = (Leg(DURATION_S),)
    if number % 3 == 0:
        before_s = at_s - 0.5 * TURN_S
        # The turn is towards the normal of the line, so that the aircraft still crosses it.
        rate = -np.sign(slant) * east * TURN_RATE
        legs = (Leg(before_s), Leg(TURN_S, float(rate)), Leg(DURATION_S - before_s - TURN_S))
    return _flight(start, velocity, legs)


def _along(number: int, rng: np.random.Generator) -> Flight:
    """Return an aircraft that flies along the line, within a kilometre of it."""
    speed = rng.uniform(*SPEED)
    velocity = speed * np.array([0.0, 1.0 if number % 2 else -1.0])
    middle = np.array([SEAM + rng.uniform(-1e3, 1e3), rng.uniform(-2e4, 2e4)])
    return _flight(middle - 0.5 * DURATION_S * velocity, velocity, (Leg(DURATION_S),))


def _flight(start: Any, velocity: Any, legs: tuple[Leg, ...]) -> Flight:
    (x, y), (vx, vy) = start.tolist(), velocity.tolist()
    return Flight(0, snr_from_db(30.0), 0.0, (x, y), (vx, vy), legs)


def run(parameters: Mapping[str, Any], seed: int) -> tuple[dict[str, Scores], dict[str, float]]:
    """Return the scores of a seeded run by arrangement of trackers, and their CPU seconds.

    The parameters are those of a tracker of two radars, whose detections have no amplitudes.
    """
    # Only filtered estimates are scored.
    given = {**parameters, "seed": seed, "lag": 0, "lag_s": 0.0}
    whole = resolve(given)
    scenario = scene(whole, seed)
    reports = simulate_reports(scenario, whole.radars, seed)
    found, spent_s = estimates_of(scenario, whole, reports)
    ways = {ONE: found[FILTERED]}
    spent = {"whole": spent_s}
    for margin in (MARGIN, NARROW):
        parts = []
        for side, region in zip(("west", "east"), regions(margin), strict=True):
            found, spent_s = estimates_of(scenario, _of_region(given, region), reports)
            parts.append(found[FILTERED])
            spent.setdefault(side, spent_s)
        pairs = list(zip(*parts, strict=True))
        joint = Handover(regions(margin), HYSTERESIS * margin)
        if margin == MARGIN:
            ways[CORE] = [_by_core(pair) for pair in pairs]
        name = JOINT if margin == MARGIN else JOINT_NARROW
        ways[name] = [joint.add(dict(enumerate(pair))) for pair in pairs]
    return {name: score(scenario, own) for name, own in ways.items()}, spent


def _of_region(given: Mapping[str, Any], region: Region) -> TrackerConfig:
    corners = [region.x_min, region.y_min, region.x_max, region.y_max]
    return resolve({**given, "region": [*corners, region.margin]})


def _by_core(found: Sequence[Estimates]) -> Estimates:
    """Return the estimates of each tracker in its core region, with numbers of its own."""
    own = []
    for index, (region, estimates) in enumerate(zip(regions(0.0), found, strict=True)):
        mine = estimates.take(np.flatnonzero(region.covers(estimates.position)))
        own.append(replace(mine, track_id=len(found) * mine.track_id + index))
    return Estimates.concatenate(own, found[0].lag)[0]


def score(scenario: Scenario, found: Sequence[Estimates]) -> Scores:
    """Return the scores near the line, from `SETTLING_S` on."""
    settled_ns = scenario.start_ns + round(SETTLING_S * 1e9)
    ways = [each for each in found if each.stamp_ns >= settled_ns]
    switches, counter = 0, IdentitySwitches(CUTOFF)
    distances, missing, duplicated = [], 0, 0
    crossed: set[int] = set()
    for estimates in ways:
        truth = truth_after(scenario, (estimates.stamp_ns - scenario.start_ns) * 1e-9)
        near, own = _near(truth.position), _near(estimates.position)
        crossed |= set(truth.track_id[near].tolist())
        true, seen = truth.position[near], estimates.position[own]
        distances.append(
            (gospa(true, seen, CUTOFF, ORDER).distance, ospa(true, seen, CUTOFF, ORDER).distance)
        )
        # Estimates beyond the scored strip take part, because they may belong to a target in it.
        targets, used = assign(truth.position, estimates.position, CUTOFF)
        missing += int(near.sum() - near[targets].sum())
        duplicated += int(own.sum() - own[used].sum())
        tracks = LabelledPoints(estimates.track_id, estimates.position)
        switches += counter.add(LabelledPoints(truth.track_id[near], true), tracks)
    mean = np.mean(distances, axis=0)
    per_crossing = max(len(crossed), 1)
    return Scores(
        float(mean[0]), float(mean[1]), switches, missing / per_crossing, duplicated / per_crossing
    )


def _near(position: Any) -> Any:
    return np.abs(position[:, 0] - SEAM) <= NEAR


def _measure(arguments: argparse.Namespace, seed: int) -> Figures:
    """Return the scores by arrangement of trackers, and the CPU time of each tracker."""
    parameters = from_arguments.scenario_parameters(yaml_files.load(resources.find(SCENARIO)))
    parameters["accuracy"] = "fast"
    parameters |= from_arguments.from_arguments(arguments.params_file, arguments.assignments)
    found, spent_s = run(parameters, seed)
    return {"scores": {name: asdict(own) for name, own in found.items()}, "cpu_s": spent_s}


def _tables(found: Figures) -> list[Table | str]:
    columns = {
        "gospa": ("GOSPA", ".0f", "m"),
        "ospa": ("OSPA", ".0f", "m"),
        "switches": ("identity switches", ".1f"),
        "missing": ("missing", ".2f"),
        "duplicated": ("duplicated", ".2f"),
    }
    rows = {name: ("scores", name) for name in found["scores"]}
    spent = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in found["cpu_s"].items())
    return [
        figures_table(f"within {NEAR / 1e3:g} km of the seam", "trackers", found, columns, rows),
        "missing and duplicated: reports per aircraft, one every 4 s",
        f"runs of {DURATION_S:g} s; CPU: {spent}",
    ]


STUDY = Study(
    name="handover",
    purpose="What is lost where two trackers divide an area, against one tracker for all of it.",
    measure=_measure,
    tables=_tables,
    # The parameters of the hand-over were chosen on other seeds.
    seed=11,
    runs=2,
    has_parameters=True,
)
