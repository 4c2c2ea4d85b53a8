"""Learns each sensor's clutter from scan to scan, from detections that no target claims.

Births do not count as claims: while the learned clutter is wrong, each false detection of a new
type resembles a newborn target, and would otherwise never be learned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ..arrays import FloatArray
from ..clutter.amplitude_law import Learned
from ..clutter.map import ClutterMap
from ..clutter.rate import ClutterCount
from ..sensors.report import Report
from .tracker_model import TrackerModel

# Turns after which the usual number of detections is known.
USUAL_TURNS = 5.0
# Number of standard deviations of a Poisson number by which a report may have more than usual.
USUAL_SIGMA = 5.0


@dataclass
class ClutterMemory:
    """Learned rate, amplitude law and map of each radar's clutter."""

    # Laws, maps and rate estimates by radar, after the radar's first report.
    laws: dict[str, Learned] = field(default_factory=dict)
    maps: dict[str, ClutterMap] = field(default_factory=dict)
    counts: dict[str, ClutterCount] = field(default_factory=dict)
    # The same for the number of all detections in a turn.
    usual: dict[str, ClutterCount] = field(default_factory=dict)

    def with_learned_clutter(self, report: Report) -> Report:
        """Return a report whose sensor has the learned clutter."""
        sensor = report.sensor
        law = self.laws.get(sensor.name) if isinstance(sensor.clutter_amplitude, Learned) else None
        if law is not None and law.threshold != sensor.threshold:
            law = Learned(sensor.threshold, law.count)
        places = None if sensor.clutter_map is None else self.maps.get(sensor.name)
        count = sensor.clutter_count
        count = None if count is None else self.counts.get(sensor.name, count)
        if law is None and places is None and count is None:
            return report
        return replace(report, sensor=sensor.with_clutter(law, places, count))

    def with_surplus(self, report: Report) -> Report:
        """Return a report whose sensor has the clutter of a burst.

        Detections far beyond the usual number are clutter that no configured or learned rate
        expects: jamming, rain, a faulty plot extractor. Targets do not appear in such numbers
        at once, except at the start, when nothing is usual yet.
        """
        usual, part = self.usual.get(report.sensor.name), _part_of_turn(report)
        if usual is None or usual.turns < USUAL_TURNS or not part:
            return report
        size = len(report)
        surplus = size - usual.rate * part - USUAL_SIGMA * math.sqrt(size)
        if surplus <= 0.0:
            return report
        sensor, rate = report.sensor, report.sensor.clutter_rate + surplus / part
        return replace(report, sensor=replace(sensor, clutter_rate=rate))

    def count(self, report: Report) -> None:
        """Count a report's detections towards the usual number."""
        name, part = report.sensor.name, _part_of_turn(report)
        if part:
            usual = self.usual.get(name, ClutterCount()).after(len(report), part)
            self.usual = {**self.usual, name: usual}

    def with_learned_maps(self, model: TrackerModel) -> TrackerModel:
        """Return a tracker's model whose radars have the learned maps."""
        if not self.maps:
            return model
        radars = (
            radar
            if radar.clutter_map is None
            else radar.with_clutter(places=self.maps.get(radar.name))
            for radar in model.radars
        )
        return replace(model, radars=tuple(radars))

    def learns(self, report: Report) -> bool:
        """Return whether the clutter can be learned from a report; it must be complete."""
        sensor = report.sensor
        learning = isinstance(sensor.clutter_amplitude, Learned) or sensor.clutter_map is not None
        return report.complete and (learning or sensor.clutter_count is not None)

    def learn(self, report: Report, claimed: FloatArray, stationary: FloatArray) -> None:
        """Learn from one report, whose sensor is as `with_learned_clutter` returns it.

        Parameters
        ----------
        claimed : array of shape (M,)
            Probability that a known target is the source of each detection.
        stationary : array of shape (M,)
            Share of that probability for targets slower than `clutter_map_speed`; one half if their
            velocities are unknown, see `stationary`.
        """
        radar, detections = report.sensor, report.detections
        law, places = radar.clutter_amplitude, radar.clutter_map
        if isinstance(law, Learned) and detections.amplitude is not None:
            law = law.after(detections.amplitude, 1.0 - claimed)
            self.laws = {**self.laws, radar.name: law}
        turns = _part_of_turn(report)
        if not turns:
            return
        if radar.clutter_count is not None:
            # Unclaimed detections that the clutter map does not explain.
            uniform = np.exp(-radar.log_clutter_factor(detections.measurement))
            unclaimed = float(((1.0 - claimed) * uniform).sum())
            count = radar.clutter_count.after(unclaimed, turns)
            self.counts = {**self.counts, radar.name: count}
        if places is not None:
            weight = 1.0 - claimed * (1.0 - stationary)
            seen = detections.measurement
            world = radar.to_world(seen)
            self.maps = {**self.maps, radar.name: places.after(seen, world, weight, turns)}


def _part_of_turn(report: Report) -> float:
    """Return the part of a turn that a report covers; 0 if it is unknown."""
    coverage = report.detections.coverage
    return 1.0 if coverage is None else coverage.turns
