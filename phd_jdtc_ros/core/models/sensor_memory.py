"""Learns each sensor's clutter, detection probability and noise while the tracker runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import is_

import numpy as np

from ..arrays import TINY, FloatArray, IntArray
from ..clutter.amplitude_law import Learned
from ..clutter.map import ClutterMap
from ..learned.detection_chains import Look
from ..learned.detection_factor import CELLS, TrialSums
from ..learned.noise_factor import NoiseEvidence
from ..learned.open_trials import OpenTrials, ReportTrials
from ..learned.outliers import OutlierEvidence
from ..sensors.report import Report
from ..sensors.sensor import Sensor
from .detection_birth import EarlierLooks
from .learned_sensor import LearnedSensor
from .recent_looks import RecentLooks
from .tracker_model import TrackerModel

# Existence probability from which the looks at a target are used for learning.
KNOWN_EXISTENCE = 0.7
# Targets with a smaller detection probability count as outside the coverage.
LEAST_EXPECTED = 0.01
# Number of open trials and chains below which those of targets that have ended are kept.
FEW_ENTRIES = 256

NOTHING_LEARNED = LearnedSensor()


@dataclass
class SensorMemory:
    """The learned values of all sensors, which their reports use and update."""

    names: tuple[str, ...]  # Names of all sensors, in the configured order
    # True if detections are associated with labelled targets; otherwise only clutter is learned.
    labelled: bool = True
    # By sensor; those that are not given have learned nothing yet.
    sensors: dict[str, LearnedSensor] = field(default_factory=dict)
    trials: OpenTrials = field(default_factory=OpenTrials)  # Trials that do not count yet
    # Recent looks of all sensors; births at detections depend on what others have missed.
    looks: RecentLooks = field(default_factory=RecentLooks.of_none)
    # Number of open trials and chains after those of ended targets were last dropped.
    entries_kept: int = 0
    # A configured sensor, its learned values, and the sensor with these, by name.
    _cache: dict[str, tuple[Sensor, LearnedSensor, Sensor]] = field(
        default_factory=dict, init=False, repr=False
    )

    @staticmethod
    def of(model: TrackerModel, labelled: bool = True) -> SensorMemory:
        """Return the memory of a model's sensors, of which nothing is learned yet."""
        return SensorMemory(tuple(sensor.name for sensor in model.radars), labelled)

    def __post_init__(self) -> None:
        self.sensors = dict.fromkeys(self.names, NOTHING_LEARNED) | self.sensors

    def _set(self, sensor: Sensor, learned: LearnedSensor) -> None:
        # A copy, because saved states share the mapping.
        self.sensors = {**self.sensors, sensor.name: learned}

    def prepare(self, report: Report) -> Report:
        """Return a report whose sensor has its learned values, with what earlier reports predict.

        These are the earlier sectors of the same pass of an antenna, and the last look at each
        target if misses are correlated.
        """
        learned, sensor = self.sensors[report.sensor.name], self.with_learned_values(report.sensor)
        earlier = prediction = None
        if self.labelled:
            earlier = learned.earlier_sectors(report)
            if (correlation := sensor.correlation) is not None:
                prediction = learned.look_prediction(report, correlation)
        if sensor is report.sensor and earlier is None and prediction is None:
            return report
        return report.changed(sensor=sensor, earlier_sectors=earlier, look_prediction=prediction)

    def with_learned_values(self, sensor: Sensor) -> Sensor:
        """Return a configured sensor with its learned values."""
        values, cached = self.sensors[sensor.name], self._cache.get(sensor.name)
        # A scan begins with the values learned by the one before, whose sensor is used again.
        if cached is not None and cached[0] is sensor and cached[1] is values:
            return cached[2]
        learned = values.applied_to(sensor)
        self._cache[sensor.name] = sensor, values, learned
        return learned

    def with_learned_sensors(self, model: TrackerModel) -> TrackerModel:
        """Return a tracker's model whose sensors have their learned values."""
        radars = tuple(map(self.with_learned_values, model.radars))
        return model if all(map(is_, radars, model.radars)) else model.changed(radars=radars)

    @property
    def clutter_maps(self) -> Mapping[str, ClutterMap]:
        """The learned clutter map of each sensor that has one, by name."""
        maps = {name: learned.clutter_map for name, learned in self.sensors.items()}
        return {name: clutter_map for name, clutter_map in maps.items() if clutter_map is not None}

    def figures(self, sensors: Sequence[Sensor]) -> dict[str, float]:
        """Return the learned values of configured sensors, by dotted name.

        For each sensor that learns: the mean detection probability of the targets, with its
        standard deviation and the configured one, the ratios of the standard deviations of
        measurements to the configured ones, the share of outliers, and the correlation of
        detections from look to look.
        For a sensor that has changed: 1 for fewer detections or a larger noise, and the middle of a
        blind sector in degrees, counter-clockwise from its x axis.
        """
        return {
            f"{sensor.name}.{name}": figure
            for sensor in sensors
            for name, figure in self.sensors[sensor.name].figures(sensor).items()
        }

    def earlier_looks(self, report: Report, model: TrackerModel) -> EarlierLooks | None:
        """Return the looks since the previous report of a report's sensor.

        None if that is unknown, and for a sector, whose births are those of a turn.
        """
        if report.detections.coverage is not None:
            return None
        looks = self.looks
        previous = looks.since_last(report, self._index(report))
        if previous is None:
            return None
        last, later = previous
        others = [
            looks.report(row, self.with_learned_values(model.radars[looks.sensor[row]]))
            for row in later
        ]
        return EarlierLooks(int(looks.stamp_ns[last]), others)

    def others_looked(self, report: Report) -> bool:
        """Return whether another sensor has looked recently, and the report's own has not.

        The interval since the previous scan then says nothing about the sensor's own interval.
        """
        is_own = self.looks.sensor == self._index(report)
        return len(is_own) > 0 and not is_own.any()

    def remember_look(self, report: Report) -> None:
        """Remember where a sensor has looked, if there are others."""
        if len(self.names) > 1:
            self.looks = self.looks.after(report, self._index(report))

    def _index(self, report: Report) -> int:
        return self.names.index(report.sensor.name)

    def count(self, report: Report) -> Report:
        """Count a report's detections towards the usual number.

        Return it with the clutter of a burst; see `LearnedSensor.with_surplus`.
        """
        turn_share = report.part_of_turn
        if not turn_share:
            return report
        learned = self.sensors[report.sensor.name]
        self._set(report.sensor, learned.after_count(len(report), turn_share))
        return learned.with_surplus(report, turn_share)

    def learns_clutter(self, report: Report) -> bool:
        """Return whether the clutter can be learned from a report; it must be complete."""
        sensor = report.sensor
        learning = isinstance(sensor.clutter_amplitude, Learned) or sensor.clutter_map is not None
        return report.complete and (learning or sensor.clutter_count is not None)

    def learn_clutter(self, report: Report, claimed: FloatArray, stationary: FloatArray) -> None:
        """Learn the clutter of a report; see `LearnedSensor.after_clutter`."""
        learned = self.sensors[report.sensor.name]
        self._set(report.sensor, learned.after_clutter(report, claimed, stationary))

    def learns_detections(self, report: Report) -> bool:
        """Return whether anything is learned from the detections and misses of a report."""
        learns = report.sensor.detection_factor is not None or len(self.trials) > 0
        return self.labelled and learns

    def learn_detections(
        self,
        report: Report,
        label: IntArray,
        measured: FloatArray,
        existence_before: FloatArray,
        clutter: FloatArray,
        probability: FloatArray,
        detected: FloatArray,
        existence_after: FloatArray,
    ) -> None:
        """Learn from the detections and misses of T targets, of ascending labels, in one report.

        The report is as `prepare` returns it. `measured` is the expected measurement of each
        target, (T, Z), `probability` its detection probability if it exists, and `detected` the
        probability that it exists and was detected, (T,). `existence_before` and `existence_after`
        are the existence probabilities before and after the report, and `clutter` is the
        probability that the target is clutter if it exists, (T,).
        """
        factor, learned = report.sensor.detection_factor, self.sensors[report.sensor.name]
        cell = np.zeros(len(label), dtype=np.int64)
        expected = np.zeros(len(label))
        if factor is not None and factor is not learned.detection:
            self._set(report.sensor, learned.changed(detection=factor))
        if factor is not None and report.complete:
            cell = factor.cell(report.sensor.polar_place(measured))
            existence = existence_before
            if report.sensor.correlation is not None:
                # A target that was known stays known in a run of misses, or the longest runs, which
                # are frequent where misses are correlated, would not count.
                existence = np.where(np.isin(label, self.trials.label), 1.0, existence_before)
            is_known = existence * (1.0 - clutter) >= KNOWN_EXISTENCE
            is_known &= probability > LEAST_EXPECTED
            expected = np.where(is_known, probability / factor.by_cell[cell], 0.0)
            cell += self._index(report) * CELLS
        share = np.minimum(detected / np.maximum(existence_after, TINY), 1.0)
        trials = ReportTrials(label, cell, expected, share, np.minimum(existence_after, 1.0))
        self.trials, sums = self.trials.after(trials, CELLS * len(self.names))
        for first, name in zip(range(0, CELLS * len(self.names), CELLS), self.names, strict=True):
            counted = TrialSums(*sums[:, first : first + CELLS])
            if counted.trials.any():
                self.sensors = {**self.sensors, name: self.sensors[name].after_trials(counted)}

    def learn_noise(
        self, report: Report, noise: NoiseEvidence | None, outliers: OutlierEvidence | None
    ) -> None:
        """Learn the noise and the share of outliers from the innovations of one report."""
        if self.labelled and report.complete and (noise is not None or outliers is not None):
            learned = self.sensors[report.sensor.name].after_noise(report.sensor, noise, outliers)
            self._set(report.sensor, learned)

    def needs_look(self, report: Report) -> bool:
        """Return whether `learn_look` learns anything from a report."""
        sector = report.detections.coverage
        return self.labelled and (sector is not None or self.correlates_looks(report))

    def correlates_looks(self, report: Report) -> bool:
        """Return whether `learn_look` uses more of a report than the detected targets."""
        learning = any(learned.correlation is not None for learned in self.sensors.values())
        return learning or report.look_prediction is not None

    def learn_look(self, report: Report, look: Look) -> None:
        """Remember a sensor's look at targets, and learn how misses are correlated.

        The report is as `prepare` returns it.
        """
        for name, other in self.sensors.items():
            if other.correlation is not None:
                self.sensors = {**self.sensors, name: other.after_any_look(look)}
        self._set(report.sensor, self.sensors[report.sensor.name].after_look(report, look))

    def forget_ended(self, labels: Iterable[IntArray]) -> None:
        """Drop trials and chains of ended targets, once their number has doubled.

        `labels` has the labels of the living targets, in any number of arrays.
        """
        if self._entries > 2 * self.entries_kept + FEW_ENTRIES:
            living = np.unique(np.concatenate(list(labels)))
            self.trials = self.trials.of(living)
            self.sensors = {
                name: learned
                if learned.chains is None
                else learned.changed(chains=learned.chains.of(living))
                for name, learned in self.sensors.items()
            }
            self.entries_kept = self._entries

    @property
    def _entries(self) -> int:
        """Number of open trials and chains."""
        chains = [each.chains for each in self.sensors.values() if each.chains is not None]
        return len(self.trials) + sum(map(len, chains))
