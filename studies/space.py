"""How well targets are tracked in space, beside the plane, in random traffic of five scenes.

The same detections go to three trackers: in space; in the plane, which takes an elevation to
flatten the range and a slant range for one over ground; and in the plane with what a user can work
out by hand from the elevation or a usual height.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from phd_jdtc_ros import resources
from phd_jdtc_ros.columns.selection import select
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.pipeline import Event, RunEnded
from phd_jdtc_ros.core.sensors.gaussians import UNKNOWN_STD
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.sensors.spatial_radar import SpatialRadar
from phd_jdtc_ros.core.targets.amplitude_density import snr_from_db
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, SOURCES, Detections, Estimates, Scan, Truth
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.metrics import assign, distances, ospa_of_distances
from phd_jdtc_ros.feed import Feed
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.simulate import simulate
from phd_jdtc_ros.simulation.targets import Flight, Leg
from phd_jdtc_ros.tally import Tally

from .runner import Figures, Study, cell, table

ORDER = 2.0
# Cutoffs within which a track is that of a target.
NEAR = 3.0
SPACE, PLANE, BY_HAND = "space", "plane", "by hand"
TRACKERS = (SPACE, PLANE, BY_HAND)
# Columns of the tables: figure and format.
SHOWN = {
    "ospa": ".2f",
    "ospa in the plane": ".2f",
    "height rms": ".2f",
    "missed": ".2f",
    "false": ".2f",
    "switches": ".1f",
    "nees of z": ".2f",
}
# Share of the scans, from the first, that do not count.
BEFORE = 0.2
# Parameters that the plane has not.
SPATIAL_ONLY = ("state", "height_prior", "fov_elevation_deg", "elevation_std_deg", "climb_std")


class Scene(NamedTuple):
    """Radars of a shipped scenario with random traffic."""

    scenario: str
    cutoff: float  # Metres
    targets: str  # Kind of the traffic; empty for that of the file
    third: bool = False  # With a third radar beside the two of the file


SCENES = {
    "drones and birds": Scene("drones", 30.0, "drones"),
    "air, 3-D and 2-D": Scene("air_3d", 2000.0, "aircraft"),
    "two slant ranges": Scene("two_slant", 1000.0, "approaches"),
    "three slant ranges": Scene("two_slant", 1000.0, "approaches", third=True),
    "cars and bridges": Scene("cars_4d", 5.0, ""),
}
# Number, speeds (m/s), least and largest distance from the middle (m) and height (m), largest turn
# rate (degrees/s) and climb rate (m/s), and durations of legs (s), of a kind of traffic.
AIR = (80.0, 230.0), (12e3, 300e3), (1.5e3, 11e3), 1.7, 12.0, (60.0, 180.0)
APPROACH = (70.0, 200.0), (2e3, 35e3), (2e3, 10e3), 1.7, 12.0, (30.0, 90.0)
DRONES = (3.0, 18.0), (100.0, 2600.0), (60.0, 450.0), 18.0, 4.0, (4.0, 12.0)
BIRDS = (6.0, 15.0), (150.0, 1500.0), (30.0, 200.0), 15.0, 1.5, (3.0, 5.0)
TRAFFIC = {
    "aircraft": ((0, 30, (20.0, 20.0), AIR),),
    "approaches": ((0, 12, (20.0, 20.0), APPROACH),),
    "drones": ((0, 20, (14.0, 20.0), DRONES), (1, 8, (8.0, 11.5), BIRDS)),
}
MIDDLE = {"approaches": (15e3, 5e3)}


def flights(kind: str, duration_s: float, rng: np.random.Generator) -> tuple[Flight, ...]:
    """Return random flights that last as long as a scene, within their heights."""
    found = []
    for class_id, count, (weak_db, strong_db), limits in TRAFFIC[kind]:
        speeds, reaches, heights, most_turn, most_climb, durations = limits
        for _ in range(count):
            height = begin = rng.uniform(*heights)
            legs: list[Leg] = []
            left_s = duration_s
            while left_s > 0.0:
                length_s = min(rng.uniform(*durations), left_s)
                turn = rng.uniform(-most_turn, most_turn) * (rng.random() < 0.4)
                climb = rng.uniform(-most_climb, most_climb) * (rng.random() < 0.4)
                if not heights[0] <= height + climb * length_s <= heights[1]:
                    climb = 0.0
                height += climb * length_s
                left_s -= length_s
                legs.append(Leg(length_s, math.radians(turn), 0.0, climb))
            bearing, course = rng.uniform(-math.pi, math.pi, 2)
            reach, speed = rng.uniform(*reaches), rng.uniform(*speeds)
            east, north = MIDDLE.get(kind, (0.0, 0.0))
            position = east + reach * math.cos(bearing), north + reach * math.sin(bearing)
            velocity = speed * math.cos(course), speed * math.sin(course)
            snr = float(snr_from_db(rng.uniform(weak_db, strong_db)))
            found.append(Flight(class_id, snr, 0.0, position, velocity, tuple(legs), begin))
    return tuple(found)


def scene_of(name: str, seed: int) -> tuple[Scenario, dict[str, Any]]:
    """Return a scene with the traffic of a seed, and the parameters in space."""
    scene = SCENES[name]
    path = resources.find(Path("config/scenarios", f"{scene.scenario}.yaml"))
    document = yaml_files.load(path)
    parameters = from_arguments.scenario_parameters(document)
    if scene.third:
        parameters |= {
            name.replace("west.", "north."): value
            for name, value in parameters.items()
            if name.startswith("west.")
        }
        parameters["sensors"] = [*parameters["sensors"], "north"]
        parameters["north.position"] = [12e3, 25e3, 30.0]
    scenario = scenario_file.resolve(document, polar_radars(resolve(parameters).model.radars))
    if scene.targets:
        rng = np.random.default_rng([seed, len(name)])
        own = flights(scene.targets, scenario.duration_s, rng)
        scenario = replace(scenario, targets=own)
    return scenario, parameters


def in_plane(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters of a tracker in the plane."""
    return {
        name: value
        for name, value in parameters.items()
        if name.rsplit(".", 1)[-1] not in (*SPATIAL_ONLY, "vertical_noise_density")
    }


def by_hand(parameters: Mapping[str, Any], far: float) -> dict[str, Any]:
    """Return parameters of a tracker in the plane with columns that `_worked_out` has.

    `far` is a usual distance of targets, metres, at which heights have their usual noise.
    """
    given = in_plane(parameters)
    for name in parameters["sensors"]:
        if f"{name}.fields.elevation" in parameters:
            given[f"{name}.fields.height"] = "height"
            given[f"{name}.fields.range_std"] = "range_std"
            if f"{name}.fields.range_rate" in parameters:
                given[f"{name}.fields.range_rate_std"] = "range_rate_std"
    return given


def _columns(found: Detections, radar: SpatialRadar) -> dict[str, FloatArray]:
    """Return the columns that a radar sends: slant ranges, and elevations if it measures them."""
    distance, azimuth, elevation = found.measurement.T
    columns = {"range": distance, "azimuth": azimuth}
    if radar.elevation_std < UNKNOWN_STD:
        columns["elevation"] = elevation
    if found.range_rate is not None:
        columns["range_rate"] = found.range_rate
    if found.amplitude is not None:
        columns["amplitude"] = found.amplitude
    return columns


def _worked_out(
    columns: Mapping[str, FloatArray], radar: SpatialRadar, climb_std: float
) -> dict[str, FloatArray]:
    """Return columns with what a user can work out for a tracker in the plane.

    With an elevation they are the height, the deviation of the range over ground, and the range
    rate over ground with its deviation; without one the range over ground at a usual height.
    """
    own, distance = dict(columns), columns["range"]
    if "elevation" not in own:
        above = np.clip(radar.height_prior.mean - radar.height, 0.0, 0.5 * distance)
        own["range"] = np.sqrt(distance**2 - above**2)
        return own
    cos, sin = np.maximum(np.cos(own["elevation"]), 0.2), np.sin(own["elevation"])
    own["height"] = distance * sin + radar.height
    own["range_std"] = np.hypot(cos * radar.range_std, distance * sin * radar.elevation_std)
    if radar.range_rate is not None:
        rate, tan = own["range_rate"] / cos, sin / cos
        noise = np.hypot(radar.range_rate.std / cos, climb_std * tan)
        own["range_rate"] = rate
        own["range_rate_std"] = np.hypot(noise, rate * tan * radar.elevation_std)
    return own


def _estimates(
    config: TrackerConfig, reports: Iterator[tuple[int, int, dict[str, FloatArray]]]
) -> dict[str, list[Estimates]]:
    """Return a tracker's estimates by source, given stamps, radars and columns."""
    feed = Feed(config, Tally(config))
    found: dict[str, list[Estimates]] = {source: [] for source in SOURCES}
    events: list[Event] = []
    for stamp_ns, index, columns in reports:
        radar = config.inputs[index]
        if isinstance(radar, RadarParameters):
            events += feed.report(index, select(stamp_ns, radar, columns)) or ()
    for event in (*events, *feed.flush()):
        if isinstance(event, RunEnded):
            found[SMOOTHED] += event.smoothed
        else:
            found[FILTERED] += event.step.filtered
            found[SMOOTHED] += event.step.smoothed
    return found


def measure(_: argparse.Namespace, seed: int) -> Figures:
    """Return the scores of a seed by scene, tracker and source."""
    return {name: _of_scene(name, seed) for name in SCENES}


def _of_scene(name: str, seed: int) -> Figures:
    scenario, parameters = scene_of(name, seed)
    run = simulate(scenario, seed)
    radars = [radar for radar in scenario.radars if isinstance(radar, SpatialRadar)]
    places = np.concatenate([truth.position for truth, _ in run])
    far = float(np.median(np.hypot(*places.T)))
    climb_std = float(parameters["detection_births.std"][2])
    given = {
        SPACE: parameters,
        PLANE: in_plane(parameters),
        BY_HAND: by_hand(parameters, far),
    }

    def reports(tracker: str) -> Iterator[tuple[int, int, dict[str, FloatArray]]]:
        for _, scan in run:
            for index, found in enumerate(scan.detections):
                columns = _columns(found or NOTHING, radars[index])
                if tracker == BY_HAND:
                    columns = _worked_out(columns, radars[index], climb_std)
                yield scan.stamp_ns, index, columns

    scores: Figures = {}
    for tracker, own in given.items():
        found = _estimates(resolve({**own, "seed": seed}), reports(tracker))
        scores[tracker] = {
            source: _score(run, found[source], SCENES[name].cutoff, radars) for source in SOURCES
        }
    return scores


NOTHING = Detections(np.zeros((0, 3)), None)


def _seen(truth: Truth, radars: Sequence[SpatialRadar]) -> PointSet:
    """Return the targets that any radar can see."""
    places = PointSet.of(truth).place
    seen = [radar.visibility.probability_in_view(radar.linearise(places)[0]) for radar in radars]
    return PointSet.of(truth).only(np.flatnonzero(np.max(seen, axis=0) > 0.5))


def _score(
    run: Sequence[tuple[Truth, Scan]],
    found: Sequence[Estimates],
    cutoff: float,
    radars: Sequence[SpatialRadar],
) -> Figures:
    """Return the scores of a source's estimates.

    An estimate without a height is at the mean height of the targets, which favours it. Missed
    targets are in percent, and false tracks per scan.
    """
    by_stamp = {each.stamp_ns: PointSet.of(each) for each in found}
    scans: dict[str, list[float]] = {"ospa": [], "ospa in the plane": []}
    numbers: dict[int, int] = {}
    errors, ratios, missed, false, switches, targets = [], [], 0, 0, 0, 0
    for truth, _ in run[int(BEFORE * len(run)) :]:
        true, own = _seen(truth, radars), by_stamp.get(truth.stamp_ns)
        if own is None:
            own = PointSet(np.zeros((0, 2)), np.zeros(0, dtype=np.int64))
        place, mean = own.place, float(np.mean(true.place[:, 2])) if len(true) else 0.0
        place[:, 2] = np.where(np.isfinite(place[:, 2]), place[:, 2], mean)
        for name, count in (("ospa", 3), ("ospa in the plane", 2)):
            apart = distances(true.place[:, :count], place[:, :count])
            scans[name].append(ospa_of_distances(apart, cutoff, ORDER).distance)
        # Without heights the plane decides on the pairs.
        axes = 2 if own.height is None else 3
        rows, columns = assign(true.place[:, :axes], place[:, :axes], NEAR * cutoff)
        missed, targets = missed + len(true) - len(rows), targets + len(true)
        false += len(place) - len(columns)
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
            if true.track_id is None or own.track_id is None:
                continue
            target, track = int(true.track_id[row]), int(own.track_id[column])
            switches += numbers.get(target, track) != track
            numbers[target] = track
        if own.height is not None:
            error = own.height[columns] - true.place[rows, 2]
            known = np.isfinite(error)
            errors.append(error[known])
            if own.space_covariance is not None:
                variance = own.space_covariance[columns, 2, 2][known]
                ratios.append(error[known] ** 2 / variance)
    heights = np.concatenate(errors) if errors else np.zeros(0)
    return {
        **{name: float(np.mean(values)) for name, values in scans.items()},
        "height rms": float(np.sqrt(np.mean(heights**2))) if len(heights) else None,
        "missed": 100.0 * missed / max(targets, 1),
        "false": false / max(len(scans["ospa"]), 1),
        "switches": float(switches),
        "nees of z": float(np.mean(np.concatenate(ratios))) if ratios else None,
    }


def tables(figures: Figures) -> list[Table]:
    """Return the scores of each scene, filtered / smoothed."""

    def both(scene: str, tracker: str, name: str, form: str) -> str:
        return " / ".join(cell(figures, [scene, tracker, each, name], form) for each in SOURCES)

    rows = [
        (scene, tracker, *(both(scene, tracker, *shown) for shown in SHOWN.items()))
        for scene in SCENES
        for tracker in TRACKERS
    ]
    return [table("Targets in space, filtered / smoothed", ("scene", "tracker", *SHOWN), rows)]


STUDY = Study(
    name="space",
    purpose=__doc__.split("\n", 1)[0],
    measure=measure,
    tables=tables,
    seed=99100,
    runs=12,
)
