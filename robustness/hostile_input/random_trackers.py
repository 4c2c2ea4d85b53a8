"""Trackers of random configurations with random reports: no exception, and finite values only.

The scenes are small, with sets of no and of one hypothesis, and reports arrive late and twice.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.configuration.parameters.radar import LEARNED, RadarParameters
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.intake.poses import PoseFault
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.pipeline import Event, Pipeline, RunEnded, Stepped
from phd_jdtc_ros.core.sensors.gaussians import UNKNOWN_STD
from phd_jdtc_ros.core.types import FULL_TURN, Coverage, Detections, Pose, SelfReports
from phd_jdtc_ros.core.types.reports import ICAO, MMSI

from ..harness.figures import Found, measures, such_as

TRACKERS = 400
MOTIONS = {"turn.model": "coordinated_turn", "rest.model": "stationary"}
# Values of parameters, of which each tracker has one.
TRACKER: Mapping[str, Sequence[Any]] = {
    "state": ("plane", "plane", "space"),
    "sensors": (["a"], ["a", "b"], ["a", "b", "c"]),
    "classes": (["x"], ["x", "y"], ["x", "y", "z"]),
    "births": ([], [], ["gate"]),
    "interval_s": (0.1, 1.0, 4.0, 10.0),
    "max_gap_scans": (2.0, 15.0),
    "reorder_s": (0.0, 0.0, 0.5, 4.0),
    "lag": (0, 1, 5, 5, 5),
    "lag_s": (0.0, 0.0, 20.0),
    "accuracy": ("fast", "normal", "high"),
    "estimates_period_s": (0.0, 0.0, 2.0),
    "late_reports": ("drop", "rework"),
    "amplitude": ("auto", "band", "memory", "none"),
    "detection_births.least_probability": (1e-4, 0.005, 0.3),
    "report_resting": (False, True),
    "spawn.rate": (0.0, 0.01),
    "coasting": ([0.0], [10.0]),
    "region": ([], [], [], [-6e3, -6e3, 6e3, 6e3, 500.0]),
    "world_origin": ([], [], [48.0, 11.0, 0.0]),
}
CLASS: Mapping[str, Sequence[Any]] = {
    "motions": (["line"], ["line", "turn"], ["rest"], ["line", "rest"], ["turn"]),
    "snr_band_db": ([10.0, 50.0], [5.0, 15.0], [20.0, 20.1]),
    "survival_probability": (0.9, 0.99, 1.0),
}
RADAR: Mapping[str, Sequence[Any]] = {
    "max_range": (15e3, 2e4),
    "min_range": (0.0, 500.0),
    "learn": ([], ["noise"], ["outliers"], ["detection", "clutter"], [*LEARNED]),
    "range_std": (30.0, 50.0),
    "azimuth_std_deg": (0.3, 1.0),
    "detection_probability": (0.0, 0.9, [0.95, 0.4]),
    "detection_probability_range": ([2e3, 15e3],),
    "detection_correlation": (0.0, 0.5),
    "clutter_rate": (0.1, 5.0),
    "clutter_map": (False, False, True),
    "clutter_amplitude": ("rayleigh", "learned"),
    "rotation_s": (0.0, 4.0),
    "sectors": (0, 0, 4, 16),
    "range_rate_std": (0.1, 0.5),
    "range_rate_ambiguity": (0.0, 25.0),
    "cluster_distance": (0.0, 0.0, 5.0),
    "fov_deg": ([0.0, 360.0], [-60.0, 60.0]),
    "blind_sectors_deg": ([], [10.0, 30.0]),
    "pose": ("fixed", "fixed", "fixed", "/odometry"),
}
# Further parameters of a radar in space, and those of a sensor of positions.
DOME: Mapping[str, Sequence[Any]] = {
    "elevation_std_deg": (0.5, 2.0),
    "fov_elevation_deg": ([-90.0, 90.0], [-2.0, 60.0]),
    "tilt_deg": ([0.0, 0.0], [0.0, 0.0], [10.0, -5.0]),
}
POSITION: Mapping[str, Sequence[Any]] = {
    "kind": ("position",),
    "area": ([-2e4, -2e4, 2e4, 2e4], [-4e3, -4e3, 4e3, -4e3, 0.0, 5e3]),
    "learn": ([], ["noise", "detection", "clutter", "outliers"]),
    "position_std": (10.0, 40.0),
    "detection_probability": (0.5, 0.9),
    "clutter_rate": (0.1, 5.0),
    "cluster_distance": (0.0, 0.0, 5.0),
    "pose": ("fixed", "fixed", "/odometry"),
}
RECEIVER: Mapping[str, Sequence[Any]] = {
    "kind": ("reports",),
    "identity": ("mmsi", "icao", "other"),
    "offset_std": (5.0, 40.0),
    "obliged": ([], ["x"]),
    "coverage": ([], [-4e3, -4e3, 4e3, -4e3, 0.0, 5e3]),
}
# Optional columns of detections, and those of positions.
COLUMNS = ("amplitude", "range_rate", "height", "noise_std", "time_s", "code", "address")
OF_POSITIONS = ("height", "noise_std", "time_s", "address", "velocity", "noise_correlation")
SPEED, FIELD = 60.0, 5e3


class _Report(NamedTuple):
    arrival_ns: int
    sensor: int
    stamp_ns: int
    detections: Detections
    sector: int | None


def _any_of(rng: np.random.Generator, values: Sequence[Any]) -> Any:
    return values[int(rng.integers(len(values)))]


def _drawn(
    rng: np.random.Generator, table: Mapping[str, Sequence[Any]], prefix: str = ""
) -> dict[str, Any]:
    return {f"{prefix}{name}": _any_of(rng, values) for name, values in table.items()}


def configuration(rng: np.random.Generator) -> TrackerConfig:
    """Return a random configuration; those that are refused are drawn again."""
    while True:
        given: dict[str, Any] = {"motions": ["line", "turn", "rest"]}
        given |= {**MOTIONS, **_drawn(rng, TRACKER)}
        count = len(given["classes"])
        given["detection_births.rates"] = rng.choice([0.0, 0.01, 1.0], count).tolist()
        given |= {"gate.rates": [0.01] * count} if given["births"] else {}
        for name in given["classes"]:
            given |= _drawn(rng, CLASS, f"{name}.")
            modes = len(given[f"{name}.motions"])
            given[f"{name}.mode_transition"] = [1.0] if modes == 1 else [0.9, 0.1, 0.1, 0.9]
        for name in given["sensors"]:
            tables: tuple[Mapping[str, Sequence[Any]], ...] = (RADAR,)
            if rng.random() < 0.2:
                tables = (POSITION,)
            elif given["state"] == "space":
                tables = RADAR, DOME
            for each in tables:
                given |= _drawn(rng, each, f"{name}.")
            east, north = rng.normal(0.0, 2e3, 2).tolist()
            given |= (
                {f"{name}.geodetic": [48.0 + north / 1.1e5, 11.0 + east / 7e4, 300.0]}
                if given["world_origin"]
                else {f"{name}.position": [east, north]}
            )
        if rng.random() < 0.4:
            given |= _drawn(rng, RECEIVER, "told.") | {"sensors": [*given["sensors"], "told"]}
        try:
            return resolve(given)
        except ConfigError:
            continue


def _column(
    rng: np.random.Generator, name: str, count: int, part_s: float, sides: Sequence[float]
) -> Any:
    """Return a random column of detections, some of them unknown.

    `sides` are the usual deviations of the components of a measurement.
    """
    if name == "code":
        return rng.choice([-1, 0o1234, 0o7000, 0o4321], count)
    if name == "address":
        return rng.choice([-1, 77, 78], count)
    if name == "noise_std":
        noise = rng.uniform(0.5, 2.0, (count, len(sides))) * sides
        noise[:, 2:][rng.random((count, len(sides) - 2)) < 0.2] = UNKNOWN_STD
        return noise
    if name == "velocity":
        velocity = SPEED * rng.standard_normal((count, len(sides)))
        return np.where(rng.random((count, 1)) < 0.2, np.nan, velocity)
    if name == "noise_correlation":
        return rng.uniform(-0.99, 0.99, count)
    if name == "time_s":
        return -rng.uniform(0.0, part_s, count)
    low, high = {"amplitude": (0.1, 9.0), "range_rate": (-12.0, 12.0), "height": (0.0, 1e4)}[name]
    return np.where(rng.random(count) < 0.1, np.nan, rng.uniform(low, high, count))


def _measured(rng: np.random.Generator, position: FloatArray) -> FloatArray:
    """Return ranges and azimuths of some targets, which most looks detect, and of clutter."""
    seen = position[rng.random(len(position)) < 0.85]
    clutter = rng.uniform(-FIELD, FIELD, (rng.poisson(rng.choice([0.0, 0.3, 3.0])), 2))
    x, y = (np.concatenate([seen, clutter]) + 30.0 * rng.standard_normal((1, 2))).T
    return np.stack([np.hypot(x, y), np.arctan2(y, x)], axis=1)


def _places(measured: FloatArray) -> FloatArray:
    """Return ranges and azimuths as places, metres, (M, 2)."""
    distance, azimuth = measured.T
    return np.stack([distance * np.cos(azimuth), distance * np.sin(azimuth)], axis=1)


def reports(rng: np.random.Generator, config: TrackerConfig) -> Iterator[_Report]:
    """Yield the reports of radars that see up to three targets, in the order of their stamps."""
    targets = int(rng.integers(0, 4))
    start = rng.uniform(-FIELD, FIELD, (targets, 2))
    velocity = SPEED * rng.standard_normal((targets, 2))
    columns = [
        [
            name
            for name in (COLUMNS if isinstance(own, RadarParameters) else OF_POSITIONS)
            if rng.random() < 0.35
        ]
        for own in config.inputs
    ]
    now_ns = 10**18
    for _ in range(int(rng.integers(3, 22))):
        now_ns += int(1e9 * rng.choice([0.0] * 19 + [1.0, 60.0, -30.0]))
        for index, radar in enumerate(config.inputs):
            revolution_s, parts = (
                radar.rotation_s or config.model.modes.interval_s,
                radar.sectors or 1,
            )
            for sector in range(parts if rng.random() < 0.9 else 0):
                stamp_ns = now_ns + round(
                    1e9 * ((sector + 1) / parts * revolution_s + 0.01 * index)
                )
                position = start + velocity * ((stamp_ns - 10**18) * 1e-9)
                measured, coverage = _measured(rng, position), None
                sides = [30.0, 0.01]
                if not isinstance(radar, RadarParameters):
                    measured, sides = _places(measured), [30.0, 30.0]
                elif radar.height_prior is not None:
                    up = rng.uniform(-0.05, 1.0, (len(measured), 1))
                    measured, sides = np.append(measured, up, axis=1), [30.0, 0.01, 0.02]
                if radar.sectors:
                    coverage = Coverage(FULL_TURN * sector / parts, FULL_TURN / parts)
                    turned = (measured[:, 1] - coverage.start) % FULL_TURN
                    measured = measured[turned < coverage.width]
                given = {
                    name: _column(rng, name, len(measured), revolution_s / parts, sides)
                    for name in columns[index]
                }
                if radar.height_prior is not None:
                    given["z"] = given.pop("height", None)
                if not isinstance(radar, RadarParameters) and rng.random() < 0.2:
                    given["area"] = (-3e3, -2e3, float(rng.uniform(0.0, 1e4)), 5e3)
                detections = Detections(measured, given.pop("amplitude", None), **given)
                detections = detections.changed(coverage=coverage)
                late_ns = int(rng.exponential(4e8 * revolution_s)) if rng.random() < 0.2 else 0
                at = sector if radar.sectors else None
                yield _Report(stamp_ns + late_ns, index, stamp_ns, detections, at)
        now_ns += round(1e9 * max(radar.rotation_s for radar in config.inputs)) or round(
            1e9 * config.model.modes.interval_s
        )


def _told(rng: np.random.Generator, stamp_ns: int) -> SelfReports:
    """Return what transmitters say of themselves, some of it unknown, doubled or absurd."""
    count = int(rng.integers(0, 9))
    known = np.where(rng.random((count, 4)) < 0.7, 1.0, np.nan)
    scale = rng.choice([1.0, FIELD, 1e8], (count, 1), p=[0.1, 0.88, 0.02])
    root = rng.normal(0.0, 20.0, (count, 2, 2))
    return SelfReports.of(
        stamp_ns + (rng.normal(0.0, 3e9, count) * rng.choice([0.0, 1.0, 100.0], count)).astype(int),
        scale * rng.standard_normal((count, 2)),
        covariance=known[:, :1, None] * (root @ root.swapaxes(1, 2)),
        velocity=known[:, 1:2] * rng.normal(0.0, SPEED, (count, 2)),
        heading=known[:, 2] * rng.uniform(-4.0, 4.0, count),
        interval_s=known[:, 3] * rng.choice([0.0, 2.0, 30.0], count),
        hull=known[:, 3:] * rng.normal(0.0, 300.0, (count, 3)),
        address=rng.choice([-1, 77, 78, 79], count),
        space=rng.choice([MMSI, ICAO], count),
    )


def _take(events: Iterable[Event]) -> int:
    """Return the number of steps; raise for a value that is not finite."""
    steps = 0
    for event in events:
        estimates = event.smoothed if isinstance(event, RunEnded) else ()
        figures: Mapping[str, float] = {}
        if isinstance(event, Stepped):
            steps, figures = steps + 1, event.step.figures
            estimates = (*event.step.filtered, *event.step.smoothed)
        values = [np.array(list(figures.values()))]
        values += [value for each in estimates for value in (each.state, each.covariance)]
        if not all(np.isfinite(value).all() for value in values):
            raise ArithmeticError(f"not finite: {figures}")
    return steps


def _pose(rng: np.random.Generator, pipeline: Pipeline, sensor: int, stamp_ns: int) -> int:
    pose = Pose(tuple(rng.normal(0.0, 10.0, 2)), 0.1, (3.0, 4.0))
    events = pipeline.add_pose(sensor, stamp_ns + int(rng.uniform(-6e8, 3e8)), pose)
    return 0 if isinstance(events, PoseFault) else _take(events)


def track(seed: int) -> int:
    """Run a random tracker; return the number of its steps."""
    rng = np.random.default_rng(seed)
    config = configuration(rng)
    pipeline, steps = new_pipeline(config), 0
    arriving = sorted(reports(rng, config), key=lambda report: report.arrival_ns)
    for _, sensor, stamp_ns, detections, sector in arriving:
        if config.inputs[sensor].pose.topic and rng.random() < 0.9:
            steps += _pose(rng, pipeline, sensor, stamp_ns)
        if config.model.receivers and rng.random() < 0.5:
            steps += _take(pipeline.add_reports(0, _told(rng, stamp_ns)))
        for _ in range(1 if rng.random() < 0.97 else 2):
            events = pipeline.add(sensor, stamp_ns, detections, sector)
            steps += 0 if isinstance(events, Rejection) else _take(events)
        if rng.random() < 0.02:
            new_pipeline(config).engine.restore(pipeline.engine.snapshot())
    return steps + _take(pipeline.flush())


@measures("random configurations and reports", "0 exceptions, 0 values not finite")
def measure(trackers: int = TRACKERS) -> Found:
    """Run random trackers."""
    steps, wrong, kinds = 0, {}, Counter[str]()
    for seed in range(trackers):
        try:
            steps += track(seed)
        except Exception as error:
            wrong[f"tracker {seed}"] = f"{type(error).__name__}: {error}"[:120]
            kinds[type(error).__name__] += 1
    text = f"{trackers:,} trackers, {steps:,} steps: {len(wrong)} exceptions{such_as(wrong)}"
    return text, not wrong and steps > 0, dict(kinds)
