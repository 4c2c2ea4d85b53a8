"""Learns each sensor's detection probability and noise from scan to scan, from known targets."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from operator import is_

import numpy as np

from ..arrays import FloatArray, IntArray
from ..learned.change_alarm import ChangeAlarm
from ..learned.correlation import Correlation
from ..learned.detection_chains import DetectionChains, Look
from ..learned.detection_factor import CELLS, DetectionFactor
from ..learned.noise_factor import NoiseEvidence, NoiseFactor
from ..learned.open_trials import OpenTrials, ReportTrials
from ..sensors.report import Report
from ..sensors.sensor import Sensor
from .tracker_model import TrackerModel

# Existence probability from which the looks at a target are used for learning.
KNOWN_EXISTENCE = 0.7
# Targets with a smaller detection probability count as outside the coverage.
LEAST_EXPECTED = 0.01
# Number of open trials and chains below which those of targets that have ended are kept.
FEW_ENTRIES = 256
# A configured sensor, its learned values, and the sensor with these.
_CacheEntry = tuple[Sensor, DetectionFactor | None, NoiseFactor | None, Correlation | None, Sensor]


@dataclass
class SensorMemory:
    """The learned detection probability, noise and correlation of each sensor."""

    sensors: tuple[str, ...]  # Names of all sensors, in the configured order
    # By sensor, after the first report from which something was learned.
    detection: dict[str, DetectionFactor] = field(default_factory=dict)
    noise: dict[str, NoiseFactor] = field(default_factory=dict)
    trials: OpenTrials = field(default_factory=OpenTrials)  # Trials that do not count yet
    settled: int = (
        0  # Number of open trials and chains when those of ended targets were last dropped
    )
    # By sensor with correlated misses, after its first report.
    correlation: dict[str, Correlation] = field(default_factory=dict)
    chains: dict[str, DetectionChains] = field(default_factory=dict)
    # By sensor, after the first looks or innovations from which something was learned.
    alarms: dict[str, ChangeAlarm] = field(default_factory=dict)
    _cache: dict[str, _CacheEntry] = field(default_factory=dict, init=False, repr=False)

    def learned(self, sensor: Sensor) -> Sensor:
        """Return a sensor with its learned values."""
        detection = noise = correlation = None
        if sensor.detection_factor is not None:
            detection = self.detection.get(sensor.name)
        if sensor.noise_factor is not None:
            noise = self.noise.get(sensor.name)
        if sensor.correlation is not None:
            correlation = self.correlation.get(sensor.name)
        found = detection, noise, correlation
        if all(each is None for each in found):
            return sensor
        # A scan begins with the values learned by the one before, whose sensor is used again.
        cached = self._cache.get(sensor.name)
        if cached is not None and all(map(is_, cached, (sensor, *found))):
            return cached[-1]
        learned = sensor.with_learned(*found)
        self._cache[sensor.name] = sensor, *found, learned
        return learned

    def with_learned_sensor(self, report: Report) -> Report:
        """Return a report whose sensor has its learned values."""
        sensor = self.learned(report.sensor)
        return report if sensor is report.sensor else replace(report, sensor=sensor)

    def with_learned_sensors(self, model: TrackerModel) -> TrackerModel:
        """Return a tracker's model whose sensors have their learned values."""
        if not (self.detection or self.noise or self.correlation):
            return model
        return replace(model, radars=tuple(map(self.learned, model.radars)))

    def figures(self, sensors: Sequence[Sensor]) -> dict[str, float]:
        """Return the learned values of configured sensors, by dotted name.

        For each sensor that learns: the mean detection probability of the targets, with its
        standard deviation and the configured one, the ratios of the standard deviations of
        measurements to the configured ones, and the correlation of detections from look to look.
        For a sensor that has changed: 1 for fewer detections or a larger noise, and the middle of a
        blind sector in degrees, counter-clockwise from its x axis.
        """
        found: dict[str, float] = {}
        for sensor in sensors:
            if (detection := self.detection.get(sensor.name)) is not None and detection.all_looks:
                name = f"{sensor.name}.detection_probability"
                found[name] = detection.configured * detection.mean
                found[f"{name}_std"] = detection.configured * detection.std
                found[f"{name}_set"] = detection.configured
            if (noise := self.noise.get(sensor.name)) is not None:
                columns = sensor.components, noise.of_std, noise.error, noise.learned
                for component, ratio, error, learned in zip(*columns, strict=True):
                    if learned:
                        name = f"{sensor.name}.{component}_noise_ratio"
                        found[name], found[f"{name}_std"] = float(ratio), float(error)
            own = self.correlation.get(sensor.name)
            if own is not None and own.learned and own.sums[0] > 0.0:
                name = f"{sensor.name}.detection_correlation"
                found[name], found[f"{name}_std"] = own.value, own.std
            found |= self._changes(sensor)
        return found

    def _changes(self, sensor: Sensor) -> dict[str, float]:
        """Return the changes of a sensor by dotted name; see `figures`."""
        alarm, found = self.alarms.get(sensor.name), {}
        if alarm is None:
            return {}
        if alarm.fewer_detections:
            found[f"{sensor.name}.fewer_detections"] = 1.0
        if not np.isnan(alarm.blind_azimuth):
            found[f"{sensor.name}.blind_azimuth_deg"] = float(np.degrees(alarm.blind_azimuth))
        for component in np.array(sensor.components)[alarm.noisier[: len(sensor.components)]]:
            found[f"{sensor.name}.{component}_noisier"] = 1.0
        return found

    def learns(self, report: Report) -> bool:
        """Return whether anything is learned from the detections and misses of a report."""
        return report.sensor.detection_factor is not None or len(self.trials) > 0

    def learn_detections(
        self,
        report: Report,
        label: IntArray,
        measured: FloatArray,
        before: FloatArray,
        probability: FloatArray,
        detected: FloatArray,
        after: FloatArray,
    ) -> None:
        """Learn from the detections and misses of T targets in one report.

        The report's sensor is as `with_learned_sensor` returns it.

        Parameters
        ----------
        label : int array of shape (T,)
            Ascending.
        measured : array of shape (T, Z)
            Expected measurement of each target.
        before, after : arrays of shape (T,)
            Probability that each target exists and is no clutter, before the report, and its
            existence probability after it.
        probability : array of shape (T,)
            Detection probability of each target, if it exists.
        detected : array of shape (T,)
            Probability that each target exists and was detected.
        """
        sensor, factor = report.sensor, report.sensor.detection_factor
        cell = np.zeros(len(label), dtype=np.int64)
        expected = np.zeros(len(label))
        if factor is not None:
            self.detection = {**self.detection, sensor.name: factor}
        if factor is not None and report.complete:
            own = factor.cell(measured)
            known = (before >= KNOWN_EXISTENCE) & (probability > LEAST_EXPECTED)
            expected = np.where(known, probability / factor.by_cell[own], 0.0)
            cell = own + self.sensors.index(sensor.name) * CELLS
        share = np.minimum(detected / np.maximum(after, np.finfo(float).tiny), 1.0)
        trials = ReportTrials(label, cell, expected, share, np.minimum(after, 1.0))
        self.trials, sums = self.trials.after(trials, CELLS * len(self.sensors))
        for index in np.flatnonzero(sums.trials.reshape(-1, CELLS).any(axis=1)).tolist():
            name, first = self.sensors[index], index * CELLS
            part = sums.part(slice(first, first + CELLS))
            alarm = self.alarms.get(name, ChangeAlarm()).after_trials(self.detection[name], part)
            self.alarms = {**self.alarms, name: alarm}
            self.detection = {**self.detection, name: self.detection[name].after(part)}

    def learn_noise(self, report: Report, evidence: NoiseEvidence) -> None:
        """Learn from the innovations of one report; see `evidence.evidence_of`."""
        factor = report.sensor.noise_factor
        if factor is not None and report.complete:
            name = report.sensor.name
            alarm = self.alarms.get(name, ChangeAlarm()).after_noise(factor, evidence)
            self.alarms = {**self.alarms, name: alarm}
            self.noise = {**self.noise, name: factor.after(evidence)}

    def with_look_prediction(self, report: Report, stamp_ns: int) -> Report:
        """Return a report with what its sensor's last look at each target predicts."""
        correlation = self._correlation(report.sensor)
        if correlation is None:
            return report
        chains = self.chains.get(report.sensor.name, DetectionChains())
        prediction = chains.predict(stamp_ns, _sector_turn_ns(report), correlation.value)
        return replace(report, look_prediction=prediction)

    def _correlation(self, sensor: Sensor) -> Correlation | None:
        own = sensor.correlation
        if own is None or not own.learned:
            return own
        return self.correlation.get(sensor.name, own)

    def needs_look(self, report: Report) -> bool:
        """Return whether `learn_correlation` needs the look of a report."""
        return report.look_prediction is not None or len(self.correlation) > 0

    def learn_correlation(self, report: Report, stamp_ns: int, look: Look) -> None:
        """Remember a sensor's look at targets, and learn how misses are correlated.

        The report is as `with_look_prediction` returns it.
        """
        for name, correlation in self.correlation.items():
            chains, sums = self.chains[name].count_pairs(look)
            self.chains = {**self.chains, name: chains}
            if sums[0] > 0.0:
                self.correlation = {**self.correlation, name: correlation.after(sums)}
        own = self._correlation(report.sensor)
        if report.look_prediction is None or own is None:
            return
        name = report.sensor.name
        chains = self.chains.get(name, DetectionChains())
        chains = chains.after(look, report.look_prediction, stamp_ns, _sector_turn_ns(report))
        self.chains = {**self.chains, name: chains}
        if own.learned:
            self.correlation = {**self.correlation, name: own}

    def forget_ended(self, labels: Iterable[IntArray]) -> None:
        """Drop trials and chains of ended targets, when there are twice as many as before.

        `labels` are those of the living targets, in parts.
        """
        size = len(self.trials) + sum(map(len, self.chains.values()))
        if size > 2 * self.settled + FEW_ENTRIES:
            living = np.unique(np.concatenate(list(labels)))
            self.trials = self.trials.of(living)
            self.chains = {name: chains.of(living) for name, chains in self.chains.items()}
            self.settled = len(self.trials) + sum(map(len, self.chains.values()))


def look_at(
    report: Report,
    label: IntArray,
    measured: FloatArray,
    before: FloatArray,
    probability: FloatArray,
    detected: FloatArray,
    after: FloatArray,
) -> Look:
    """Return a report as a look at T targets, whose misses may be correlated.

    The report is as `SensorMemory.with_look_prediction` returns it. `before` is each target's
    existence probability, and `detected` the probability that it was detected, given that it
    exists, (T,); for the others see `SensorMemory.learn_detections`.
    """
    covered = report.sensor.coverage_probability(measured, report.detections.coverage)
    expected = np.zeros(len(label))
    if report.look_prediction is not None and report.complete:
        expected = report.look_prediction.usual(probability, label)
    known = before >= KNOWN_EXISTENCE
    return Look(label, covered, detected, expected, np.minimum(after, 1.0), known)


def _sector_turn_ns(report: Report) -> float:
    """Return the duration of a turn if a report is of a sector, nanoseconds; otherwise 0."""
    sector = report.detections.coverage
    turns = sector is not None and sector.turns
    return 1e9 * report.sensor.rotation_s if turns else 0.0
