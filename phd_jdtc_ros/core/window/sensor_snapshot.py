"""Storage of the learned values of sensors in a snapshot, and their restoration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..clutter.amplitude_law import CELLS as AMPLITUDE_CELLS
from ..clutter.amplitude_law import MAX_COUNT, MEMORY, Learned
from ..clutter.grid import Grid, GroundGrid, PolarGrid
from ..clutter.map import MAX_CELLS, ClutterMap
from ..clutter.rate import ClutterCount
from ..learned.antenna_pass import AntennaPass
from ..learned.change_alarm import ChangeAlarm
from ..learned.correlation import SUMS, Correlation
from ..learned.detection_chains import DetectionChains
from ..learned.detection_factor import AZIMUTHS, CELLS, DetectionFactor
from ..learned.noise_factor import COMPONENTS, NoiseFactor
from ..learned.open_trials import OpenTrials
from ..learned.outliers import Outliers
from ..models.learned_sensor import LearnedSensor
from ..models.recent_looks import RecentLooks
from ..models.sensor_memory import SensorMemory
from ..sensors.sensor import Sensor
from ..snapshot import MAX_STATE, Snapshot, floats, from_snapshot, to_snapshot

TRIALS, LOOKS = "open_looks", "recent_looks"


class Place(NamedTuple):
    """The location of a sensor with a learned clutter map."""

    # World x and y in metres, and yaw in radians, (3,).
    pose: Annotated[FloatArray, floats("X", -MAX_STATE, MAX_STATE)]


def sensors_to_snapshot(
    memory: SensorMemory, sensors: Sequence[Sensor], snapshot: Snapshot
) -> None:
    """Store the learned values of these sensors."""
    for sensor in sensors:
        learned = memory.sensors[sensor.name]
        for field, (part, _) in PARTS.items():
            value = getattr(learned, field)
            if value is not None:
                to_snapshot(value, snapshot, f"{part}.{sensor.name}")
        if learned.clutter_map is not None:
            name = f"{MAP}.{sensor.name}"
            to_snapshot(learned.clutter_map.grid, snapshot, f"{name}.grid")
            to_snapshot(_place_of(sensor), snapshot, name)
    if len(memory.trials):
        to_snapshot(memory.trials, snapshot, TRIALS)
    if len(memory.looks.stamp_ns):
        to_snapshot(memory.looks, snapshot, LOOKS)


def sensors_from_snapshot(
    snapshot: Snapshot, sensors: Sequence[Sensor], labelled: bool = True
) -> SensorMemory:
    """Return the learned values of these sensors.

    A learned value is dropped if the configuration sets it now. The open trials are dropped if the
    learned detection probability of any sensor is not in the snapshot.

    Raises
    ------
    ValueError
        If a value belongs to another sensor or place, or a tracker could not have stored it.
    """
    by_name = {sensor.name: sensor for sensor in sensors}
    values_of: dict[str, dict[str, Any]] = {name: {} for name in by_name}
    for field, (part, restore) in PARTS.items():
        names = snapshot.names_below(part)
        for name in names.difference(by_name):
            raise ValueError(f"{part}: {name[:40]} given, must be a sensor: {', '.join(by_name)}")
        for name in sorted(names):
            value = restore(snapshot, f"{part}.{name}", by_name[name])
            if value is not None:
                values_of[name][field] = value
    learned = {name: LearnedSensor(**values) for name, values in values_of.items() if values}
    trials, learns = OpenTrials(), [sensor.name for sensor in sensors if sensor.detection_factor]
    if snapshot.names_below(TRIALS) and all("detection" in values_of[name] for name in learns):
        trials = from_snapshot(OpenTrials, snapshot, TRIALS, {"K": CELLS * len(by_name)})
    looks = RecentLooks.of_none()
    if snapshot.names_below(LOOKS):
        looks = from_snapshot(RecentLooks, snapshot, LOOKS, {"P": 3, "C": 2})
        if looks.sensor.max(initial=0) >= len(by_name):
            raise ValueError(f"{LOOKS}.sensor: must be below the number of sensors, {len(by_name)}")
    return SensorMemory(tuple(by_name), labelled, learned, trials, looks)


def _place_of(sensor: Sensor) -> Place:
    return Place(np.array([*sensor.position, sensor.yaw], dtype=np.float64))


def _restore_clutter_law(snapshot: Snapshot, name: str, sensor: Sensor) -> Learned | None:
    if not isinstance(sensor.clutter_amplitude, Learned):
        return None
    sizes, threshold = {"K": AMPLITUDE_CELLS}, sensor.threshold
    law = from_snapshot(Learned, snapshot, name, sizes, threshold=threshold)
    if law.count.sum() > MAX_COUNT:
        raise ValueError(f"{name}.count: {law.count.sum():.4g} detections, at most {MEMORY:g}")
    return law


def _restore_clutter_map(snapshot: Snapshot, name: str, sensor: Sensor) -> ClutterMap | None:
    """Return the stored clutter map of a sensor; raises ValueError for one of another place."""
    if sensor.clutter_map is None:
        return None
    pose = _place_of(sensor).pose.tolist()
    stored = from_snapshot(Place, snapshot, name, {"X": 3}).pose.tolist()
    if stored != pose:
        raise ValueError(
            f"{name}: map of a radar at {stored} (x, y in m, yaw in rad), expected {pose}"
        )
    polar = isinstance(sensor.clutter_map.grid, PolarGrid)
    if polar != (f"{name}.grid.columns" in snapshot.arrays):
        stored_kind, sensor_kind = ("moving", "fixed") if polar else ("fixed", "moving")
        raise ValueError(
            f"{name}: map of a {stored_kind} radar given, but this radar is {sensor_kind}"
        )
    grid_type: type[Grid] = PolarGrid if polar else GroundGrid
    grid = from_snapshot(grid_type, snapshot, f"{name}.grid", {})
    learned = from_snapshot(ClutterMap, snapshot, name, {}, grid=grid)
    if len(learned.cell) > MAX_CELLS:
        raise ValueError(f"{name}.cell: {len(learned.cell)} cells, at most {MAX_CELLS}")
    return learned


def _restore_clutter_count(snapshot: Snapshot, name: str, sensor: Sensor) -> ClutterCount | None:
    if sensor.clutter_count is None:
        return None
    return from_snapshot(ClutterCount, snapshot, name, {})


def _restore_usual_count(snapshot: Snapshot, name: str, sensor: Sensor) -> ClutterCount:
    return from_snapshot(ClutterCount, snapshot, name, {})


def _restore_detection(snapshot: Snapshot, name: str, sensor: Sensor) -> DetectionFactor | None:
    if (factor := sensor.detection_factor) is None:
        return None
    return from_snapshot(DetectionFactor, snapshot, name, {"K": CELLS}, max_range=factor.max_range)


def _restore_noise(snapshot: Snapshot, name: str, sensor: Sensor) -> NoiseFactor | None:
    if (factor := sensor.noise_factor) is None:
        return None
    sizes = {"Z": COMPONENTS}
    return from_snapshot(NoiseFactor, snapshot, name, sizes, learned=factor.learned)


def _restore_outliers(snapshot: Snapshot, name: str, sensor: Sensor) -> Outliers | None:
    if (outliers := sensor.outliers) is None:
        return None
    constants = {"start": outliers.start, "ratio": outliers.ratio}
    return from_snapshot(Outliers, snapshot, name, {}, **constants)


def _restore_alarm(snapshot: Snapshot, name: str, sensor: Sensor) -> ChangeAlarm | None:
    if sensor.detection_factor is None and sensor.noise_factor is None:
        return None
    sizes = {"A": 1 + AZIMUTHS, "Z": COMPONENTS, "K": CELLS}
    return from_snapshot(ChangeAlarm, snapshot, name, sizes)


def _restore_chains(snapshot: Snapshot, name: str, sensor: Sensor) -> DetectionChains | None:
    if sensor.correlation is None:
        return None
    return from_snapshot(DetectionChains, snapshot, name, {"B": SUMS})


def _restore_correlation(snapshot: Snapshot, name: str, sensor: Sensor) -> Correlation | None:
    if (correlation := sensor.correlation) is None or not correlation.learned:
        return None
    values = {"start": correlation.start, "learned": True}
    return from_snapshot(Correlation, snapshot, name, {"B": SUMS}, **values)


def _restore_antenna_pass(snapshot: Snapshot, name: str, sensor: Sensor) -> AntennaPass:
    return from_snapshot(AntennaPass, snapshot, name, {})


MAP = "clutter_map"
# Name in a snapshot of each field of `LearnedSensor`, and the function that restores it; None if
# the sensor does not learn it.
PARTS: Mapping[str, tuple[str, Callable[[Snapshot, str, Sensor], Any]]] = {
    "clutter_law": ("clutter", _restore_clutter_law),
    "clutter_map": (MAP, _restore_clutter_map),
    "clutter_count": ("clutter_rate", _restore_clutter_count),
    "usual_count": ("usual_detections", _restore_usual_count),
    "detection": ("detection_factor", _restore_detection),
    "noise": ("noise_factor", _restore_noise),
    "outliers": ("outliers", _restore_outliers),
    "alarm": ("change_alarm", _restore_alarm),
    "chains": ("last_looks", _restore_chains),
    "correlation": ("correlation", _restore_correlation),
    "antenna_pass": ("antenna_pass", _restore_antenna_pass),
}
