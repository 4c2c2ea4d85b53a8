"""Reliability of the probabilities of conflicts: of those said with 0.7, how many come true.

Random traffic that flies straight and turns now and then is tracked with the shipped profiles. Each
conflict that is reported is compared with the true paths of both targets from there on, and so is
each alarm: a conflict when its probability first reaches the threshold, which is the lower bound of
a row of the table.
"""

from __future__ import annotations

import argparse
import math
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from phd_jdtc_ros import resources
from phd_jdtc_ros.columns.selection import Report
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.conflicts.model import Conflicts
from phd_jdtc_ros.core.conflicts.watch import Watch
from phd_jdtc_ros.core.pipeline import Stepped
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.targets.amplitude_density import snr_from_db
from phd_jdtc_ros.core.tracks.manual import Manual
from phd_jdtc_ros.core.types import Estimates
from phd_jdtc_ros.exit_status import ArgumentParser
from phd_jdtc_ros.feed import Feed
from phd_jdtc_ros.parameter_files import sections
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.targets import Flight, Leg
from phd_jdtc_ros.simulation.transponder import Transponders
from phd_jdtc_ros.simulation.turning_antenna import simulate_reports
from phd_jdtc_ros.study.results import Mean
from phd_jdtc_ros.tally import Tally

from . import runner
from .runner import Figures, Goal, Study

START_NS = 1000 * 10**9
# Conflicts are scored from this time on, when tracks are established, seconds, and one report in
# this time: those in between are of the same tracks.
SETTLING_S, INTERVAL_S = 60.0, 20.0
PERIOD_S = 8.0  # Time between two computations of conflicts, which keeps a run short
# Bounds of the table's rows, and of the goals: alarms said with 0.7.
BOUNDS = (0.05, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95, 1.0 + 1e-9)
SAID, WANTED = (0.65, 0.75), (0.6, 0.8)


class Scene(NamedTuple):
    """Traffic, and the profile that tracks it."""

    profile: Path
    parameters: Mapping[str, Any]
    targets: int
    radius: float  # Targets begin within this distance of the radar, metres
    speed: tuple[float, float]  # Metres per second
    straight_s: float  # Mean time between two turns, which is exponentially distributed
    turn_deg: tuple[float, float]
    turn_rate_deg_s: float
    near: float  # Largest distance between a track and its target, metres
    duration_s: float
    # Transponders with heights: a third of the targets each keep their level, climb and descend.
    transponders: Transponders | None = None


AIRCRAFT = Scene(
    Path("config/air_traffic.yaml"),
    {"conflicts.distance": [5556.0], "conflicts.horizon_s": 180.0},
    *(40, 70e3, (120.0, 240.0), 240.0, (15.0, 90.0), 2.0, 1000.0, 420.0),
)
SCENES = {
    "aircraft": AIRCRAFT,
    "aircraft with heights": AIRCRAFT._replace(
        parameters={
            **AIRCRAFT.parameters,
            "conflicts.distance": [5556.0, 600.0],
            **{f"approach.fields.{each}": each for each in ("height", "code", "address")},
        },
        transponders=Transponders(shared_code_share=0.0),
    ),
    "ships": Scene(
        Path("config/marine.yaml"),
        {"conflicts.distance": [300.0], "conflicts.horizon_s": 480.0},
        *(30, 6e3, (2.0, 9.0), 900.0, (15.0, 90.0), 0.7, 150.0, 900.0),
    ),
}


def scenario(scene: Scene, config: TrackerConfig, rng: np.random.Generator, seed: int) -> Scenario:
    """Return random traffic that the radar of a configuration sees; `seed` is of its heights."""
    return Scenario(
        start_ns=START_NS,
        interval_s=config.interval_s,
        scans=int(scene.duration_s / config.interval_s) + 1,
        targets=tuple(_flight(scene, rng) for _ in range(scene.targets)),
        radars=polar_radars(config.model.radars),
        transponders=scene.transponders and replace(scene.transponders, seed=seed),
    )


def _flight(scene: Scene, rng: np.random.Generator) -> Flight:
    speed, course = rng.uniform(*scene.speed), rng.uniform(-math.pi, math.pi)
    place, bearing = scene.radius * math.sqrt(rng.random()), rng.uniform(-math.pi, math.pi)
    # Conflicts at the end of the run come true or not after it.
    horizon_s, legs = scene.parameters["conflicts.horizon_s"], []
    left_s = scene.duration_s + 2.0 * horizon_s
    while left_s > 0.0:
        turn_s = rng.uniform(*scene.turn_deg) / scene.turn_rate_deg_s
        rate = math.radians(scene.turn_rate_deg_s) * rng.choice([-1.0, 1.0])
        legs += [Leg(rng.exponential(scene.straight_s) + 1.0), Leg(turn_s, rate)]
        left_s -= legs[-1].duration_s + legs[-2].duration_s
    return Flight(
        0,
        snr_from_db(25.0),
        0.0,
        (place * math.cos(bearing), place * math.sin(bearing)),
        (speed * math.cos(course), speed * math.sin(course)),
        tuple(legs),
    )


def _watched(
    seen: Scenario, config: TrackerConfig, seed: int
) -> Iterator[tuple[Conflicts, Estimates]]:
    """Yield conflicts with the estimates of their stamp."""
    feed = Feed(config, Tally(config))
    watch = Watch(replace(config.conflicts, period_s=PERIOD_S))
    for report in simulate_reports(seen, config.radars, seed):
        received = Report(report.stamp_ns, report.detections, Counter())
        for event in feed.report(report.radar, received) or ():
            if isinstance(event, Stepped) and event.step.filtered:
                stamp_ns, engine = event.scan.stamp_ns, feed.pipeline.engine
                done = watch.step(stamp_ns, event.step.filtered, engine, None, Manual())
                if done is not None:
                    yield done[0], event.step.filtered[-1]


def forecasts(name: str, seed: int) -> Figures:
    """Return the probabilities of a seed's conflicts and alarms, and which of them came true.

    Its own alarms, which the wanted rate allows, are counted.
    """
    scene = SCENES[name]
    profile = sections.read(resources.find(scene.profile)).values("/tracker")
    config = resolve({**profile, **scene.parameters, "lag": 0, "lag_s": 0.0})
    seen = scenario(scene, config, np.random.default_rng([seed, len(name)]), seed)
    found: Figures = {"said": [], "true": [], "alarm_said": [], "alarm_true": []}
    scored_s = SETTLING_S
    raised: set[tuple[int, int, int]] = set()
    highest: dict[tuple[int, int, int], int] = {}  # Row of each conflict's largest probability
    for conflicts, estimates in _watched(seen, config, seed):
        now_s = (conflicts.stamp_ns - START_NS) * 1e-9
        target_of = _targets(seen, now_s, estimates, scene.near)
        scored = now_s >= scored_s
        for row, key in enumerate(conflicts.keys):
            said = float(conflicts.probability[row])
            line = bisect_right(BOUNDS, said) - 1
            fresh = line > highest.get(key, -1)
            highest[key] = max(line, highest.get(key, -1))
            if now_s < SETTLING_S:
                continue
            raised |= {key} if conflicts.alarm[row] else set()
            if not (fresh or scored):
                continue
            pair = [target_of.get(number) for number in key[1:]]
            true = None not in pair and _comes_near(seen, now_s, pair, config)
            for kind in (["alarm_"] if fresh else []) + ([""] if scored else []):
                found[f"{kind}said"].append(said)
                found[f"{kind}true"].append(bool(true))
        scored_s = now_s + INTERVAL_S if scored else scored_s
    found |= {"hours": (scene.duration_s - SETTLING_S) / 3600.0, "raised": len(raised)}
    return found


def _targets(seen: Scenario, now_s: float, estimates: Estimates, near: float) -> dict[int, int]:
    """Return the index of the target of each track, by track number."""
    states = [flight.state_at(now_s) for flight in seen.flights]
    place = np.array([state[[0, 2]] for state in states if state is not None])
    found = {}
    for number, position in zip(estimates.track_id.tolist(), estimates.position, strict=True):
        distance = np.hypot(*(place - position).T)
        if distance.min() <= near:
            found[number] = int(distance.argmin())
    return found


def _comes_near(
    seen: Scenario, now_s: float, pair: Sequence[int | None], config: TrackerConfig
) -> bool:
    """Return whether two targets truly come too near each other within the horizon."""
    model = config.conflicts
    times = now_s + np.linspace(0.0, model.horizon_s, round(model.horizon_s) + 1)
    one, other = (_places(seen.flights[index or 0], times) for index in pair)
    near = np.hypot(*(one - other).T) < model.distance
    if model.height:
        own, others = (seen.replies_of[(index or 0) + 1].height(times)[:, 0] for index in pair)
        near &= np.abs(own - others) < model.height
    return bool(near.any())


def _places(flight: Flight, times: FloatArray) -> FloatArray:
    places: FloatArray = flight.states(times)[:, [0, 2]]
    return places


def _measure(arguments: argparse.Namespace, seed: int) -> Figures:
    return {name: forecasts(name, seed) for name in arguments.scenes}


def _add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=[*SCENES], help="these only")


def _combined(found: Sequence[Figures]) -> Figures:
    """Return the reliability of all seeds together, by scene."""
    scenes: Figures = {}
    for name in found[0]:
        of_scene = [each[name] for each in found]
        scenes[name] = {
            kind or "reports": _reliability(
                [own[f"{kind}said"] for own in of_scene], [own[f"{kind}true"] for own in of_scene]
            )
            for kind in ("", "alarm_")
        }
        hours = sum(own["hours"] for own in of_scene)
        alarms = sum(own["raised"] for own in of_scene)
        scenes[name]["alarms_per_hour"] = alarms / hours
    return {"runs": len(found), "scenes": scenes}


def _reliability(said: Sequence[list[float]], true: Sequence[list[bool]]) -> list[Figures]:
    """Return mean probability and share that came true of each row of the table, of all runs.

    The share has half the width of its 95 % interval: the reports of a run are of the same pairs
    again and again, so that its runs are what is independent (a ratio estimate).
    """
    p, came = np.concatenate(said), np.concatenate(true).astype(float)
    run = np.repeat(np.arange(len(said)), [len(own) for own in said])
    rows = []
    for low, high in pairwise(BOUNDS):
        own = (p >= low) & (p < high)
        count = int(own.sum())
        row: Figures = {"low": low, "high": min(high, 1.0), "count": count}
        row |= dict.fromkeys(("said", "true", "half_width"))
        if count:
            share = float(came[own].mean())
            off = Mean.of(np.bincount(run[own], came[own] - share, len(said)).astype(float))
            width = off.half_width * len(said) / count
            row |= {"said": float(p[own].mean()), "true": share}
            row["half_width"] = None if math.isnan(width) else width  # Of a single run
        rows.append(row)
    return rows


def _tables(figures: Figures) -> list[Table | str]:
    shown: list[Table | str] = []
    for name, scene in figures["scenes"].items():
        rows = []
        for reports, alarms in zip(scene["reports"], scene["alarm_"], strict=True):
            cells = [f"{reports['low']:.2f} to {reports['high']:.2f}"]
            for each in (reports, alarms):
                width = each["half_width"]
                within = "" if width is None else f" ± {width:.2f}"
                cells += [str(each["count"]), _share(each["said"]), _share(each["true"]) + within]
            rows.append(cells)
        headings = ("probability", "reports", "said", "came true", "alarms", "said", "came true")
        shown += [
            runner.table(f"{name}, {figures['runs']} runs", headings, rows),
            f"{scene['alarms_per_hour']:.1f} alarms in an hour",
        ]
    return shown


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _goals(figures: Figures) -> list[Goal]:
    goals = []
    for name, scene in figures["scenes"].items():
        for kind, what in (("reports", "conflicts"), ("alarm_", "alarms")):
            row = next(each for each in scene[kind] if each["low"] == SAID[0])
            for bound, at_most in zip(WANTED, (False, True), strict=True):
                text = f"{name}: share of {what} said with 0.7 that come true"
                goals.append(runner.goal(text, row["true"], bound, at_most))
    return goals


STUDY = Study(
    name="conflicts",
    purpose="Whether conflicts come true as often as their probabilities say.",
    measure=_measure,
    tables=_tables,
    goals=_goals,
    seed=500,
    runs=12,
    combined=_combined,
    add_arguments=_add_arguments,
)
