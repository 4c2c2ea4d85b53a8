"""Compares the reports of a running tracker with the tracks before them, for all monitors at once.

A report is compared with the tracks of the newest estimates before its scan, predicted to its
stamp. Monitors read these comparisons, and change no estimate.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.sensors.sensor import Sensor
from phd_jdtc_ros.core.types import Detections, Estimates, Scan

# Age from which estimates, and detections of a track, are too old, in scans of the slowest sensor.
MAX_AGE_SCANS = 2.5


class Compared(NamedTuple):
    """The M detections of a report, at least one, and the T tracks before it, at least one."""

    sensor_index: int  # In the configured order
    sensor: Sensor  # At its pose
    detections: Detections
    stamp_ns: int
    tracks: Estimates
    since_s: float  # Time between the tracks and the report
    expected: FloatArray  # Measurements of the tracks at the stamp, without noise, (T, Z)
    covered: FloatArray  # Probability that the report covers each track, (T,)
    max_age_s: float  # See `MAX_AGE_SCANS`


class Monitor(Protocol):
    """Reads comparisons of reports with tracks."""

    def add(self, compared: Compared) -> None:
        """Receive the comparison of a report, in the order of the scans and of the sensors."""

    def retune(self, model: TrackerModel) -> None:
        """Use another model of the same structure from the next scan on."""

    def forget_tracks(self) -> None:
        """Begin a new run, in which numbers belong to other tracks."""


class Comparison:
    """Compares the reports of each scan with the tracks before it; see `feed.Monitor`.

    In space nothing is compared: noise of three components, and biases outside the plane.
    """

    def __init__(self, model: TrackerModel, monitors: Sequence[Monitor]) -> None:
        self._model, self._monitors = model, monitors
        self._tracks: Estimates | None = None  # The newest estimates

    def retune(self, model: TrackerModel) -> None:
        """Use another model of the same structure from the next scan on."""
        self._model = model
        for monitor in self._monitors:
            monitor.retune(model)

    def forget_tracks(self) -> None:
        """Begin a new run; what the monitors have found of the sensors stays."""
        self._tracks = None
        for monitor in self._monitors:
            monitor.forget_tracks()

    def add_scan(self, scan: Scan, filtered: Sequence[Estimates]) -> None:
        """Compare a scan's detections with the tracks before it, and store the tracks after it."""
        tracks, model = self._tracks, self._model
        if filtered:
            self._tracks = filtered[-1]
        slowest_s = max([model.modes.interval_s, *(sensor.rotation_s for sensor in model.radars)])
        since_s = 0.0 if tracks is None else (scan.stamp_ns - tracks.stamp_ns) * 1e-9
        max_age_s = MAX_AGE_SCANS * slowest_s
        if tracks is None or not len(tracks) or not 0.0 < since_s <= max_age_s:
            return
        position = tracks.position + since_s * tracks.velocity
        for index, (sensor, found) in enumerate(zip(model.radars, scan.detections, strict=True)):
            if found is None or not len(found) or sensor.space.vertical:
                continue
            posed = sensor.at(found.pose)
            expected, _ = posed.linearise(position)
            covered = posed.visibility.coverage_probability(
                expected, found.coverage, posed.noise_std
            )
            seen = index, posed, found, scan.stamp_ns
            compared = Compared(*seen, tracks, since_s, expected, covered, max_age_s)
            for monitor in self._monitors:
                monitor.add(compared)
