"""What is learned about one sensor from scan to scan, and the sensor with these values.

Clutter is learned from detections that no target claims. Births do not count as claims: while the
learned clutter is wrong, each false detection of a new type resembles a newborn target, and would
otherwise never be learned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import FloatArray, ReadOnly
from ..clutter.amplitude_law import Learned
from ..clutter.map import ClutterMap
from ..clutter.rate import ClutterCount
from ..learned.antenna_pass import WIDEST, AntennaPass
from ..learned.change_alarm import ChangeAlarm
from ..learned.correlation import Correlation
from ..learned.detection_chains import DetectionChains, Look, LookPrediction
from ..learned.detection_factor import DetectionFactor, TrialSums
from ..learned.noise_factor import NoiseEvidence, NoiseFactor
from ..learned.outliers import OutlierEvidence, Outliers
from ..sensors.report import EarlierSectors, Report
from ..sensors.sensor import Sensor
from ..types import Coverage

# Turns after which the usual number of detections is known.
USUAL_TURNS = 5.0
# Number of standard deviations of a Poisson number by which a report may have more than usual.
USUAL_SIGMA = 5.0


@dataclass(frozen=True)
class LearnedSensor(ReadOnly):
    """Learned values of a sensor; None before the first report from which each is learned."""

    clutter_law: Learned | None = None  # Law of the amplitudes of false detections
    clutter_map: ClutterMap | None = None
    clutter_count: ClutterCount | None = None  # Rate of false detections
    usual_count: ClutterCount | None = None  # Number of all detections in a turn
    detection: DetectionFactor | None = None
    noise: NoiseFactor | None = None
    outliers: Outliers | None = None
    correlation: Correlation | None = None  # Correlation of detections from look to look
    chains: DetectionChains | None = None  # Last look at each target; if misses are correlated
    alarm: ChangeAlarm | None = None  # Evidence of changes
    antenna_pass: AntennaPass | None = None  # Latest sectors of a turning antenna

    def applied_to(self, sensor: Sensor) -> Sensor:
        """Return the configured sensor with learned values for what is not configured."""
        law = self.clutter_law if isinstance(sensor.clutter_amplitude, Learned) else None
        if law is not None and law.threshold != sensor.threshold:
            law = Learned(sensor.threshold, law.count)
        count = sensor.clutter_count and (self.clutter_count or sensor.clutter_count)
        noise = sensor.noise_factor and self.noise
        learned: dict[str, Any] = {
            "clutter_amplitude": law,
            "clutter_map": sensor.clutter_map and self.clutter_map,
            "clutter_count": count,
            "clutter_rate": count and count.rate,
            "detection_factor": sensor.detection_factor and self.detection,
            "noise_factor": noise,
            "outliers": sensor.outliers and self.outliers,
            "correlation": sensor.correlation and self.correlation,
        }
        changed = {name: value for name, value in learned.items() if value is not None}
        if noise is not None:
            changed |= sensor.scaled_noise(noise)
        return sensor.changed(**changed) if changed else sensor

    def earlier_sectors(self, report: Report) -> EarlierSectors | None:
        """Return the sectors before a report in the same pass of the antenna; None without any."""
        sector, latest = report.detections.coverage, self.antenna_pass
        if sector is None or latest is None or sector.width > WIDEST:
            return None
        continued = latest.then(sector, report.stamp_ns, 1e9 * report.sensor.rotation_s)
        if continued is None:
            return None
        return EarlierSectors(Coverage(latest.start, latest.width), continued)

    def look_prediction(self, report: Report, correlation: Correlation) -> LookPrediction:
        """Return what the sensor's last look at each target predicts for a report."""
        chains = DetectionChains() if self.chains is None else self.chains
        return chains.predict(report.stamp_ns, report.turn_ns, correlation.value)

    def with_surplus(self, report: Report, turn_share: float) -> Report:
        """Return a report, which covers a part of a turn, whose sensor has the clutter of a burst.

        Detections far beyond the usual number are clutter that no configured or learned rate
        expects: jamming, rain, a faulty plot extractor. Targets do not appear in such numbers
        at once, except at the start, when nothing is usual yet.
        """
        usual = self.usual_count
        if usual is None or usual.turns < USUAL_TURNS:
            return report
        size = len(report)
        surplus = size - usual.rate * turn_share - USUAL_SIGMA * math.sqrt(size)
        if surplus <= 0.0:
            return report
        sensor, rate = report.sensor, report.sensor.clutter_rate + surplus / turn_share
        return report.changed(sensor=sensor.changed(clutter_rate=rate))

    def after_count(self, detections: int, turn_share: float) -> LearnedSensor:
        """Return the values after a number of detections in a part of a turn."""
        usual = self.usual_count or ClutterCount()
        return self.changed(usual_count=usual.after(detections, turn_share))

    def after_clutter(
        self, report: Report, claimed: FloatArray, stationary: FloatArray
    ) -> LearnedSensor:
        """Return the values after the clutter of a report, whose sensor has the learned values.

        `claimed` is the probability that a known target is the source of each detection, (M,), and
        `stationary` the share of it for targets slower than `clutter_map_speed`, (M,); one half if
        their velocities are unknown, see `stationary`.
        """
        sensor, detections = report.sensor, report.detections
        law, clutter_map, count = sensor.clutter_amplitude, sensor.clutter_map, sensor.clutter_count
        learned, turns = self, report.part_of_turn
        if isinstance(law, Learned) and detections.amplitude is not None:
            law = law.after(detections.amplitude, 1.0 - claimed)
            learned = learned.changed(clutter_law=law)
        if turns and count is not None:
            # Unclaimed detections that the clutter map does not explain.
            uniform = np.exp(-sensor.log_clutter_factor(detections.measurement))
            unclaimed = float(((1.0 - claimed) * uniform).sum()) / sensor.clutter_share
            learned = learned.changed(clutter_count=count.after(unclaimed, turns))
        if turns and clutter_map is not None:
            weight, measurement = 1.0 - claimed * (1.0 - stationary), detections.measurement
            clutter_map = clutter_map.after(
                measurement, sensor.to_world(measurement), weight, turns
            )
            learned = learned.changed(clutter_map=clutter_map)
        return learned

    def after_trials(self, sums: TrialSums) -> LearnedSensor:
        """Return the values after trials that count."""
        if self.detection is None:
            return self
        alarm = (self.alarm or ChangeAlarm()).after_trials(self.detection, sums)
        return self.changed(alarm=alarm, detection=self.detection.after(sums))

    def after_noise(
        self, sensor: Sensor, noise: NoiseEvidence | None, outliers: OutlierEvidence | None
    ) -> LearnedSensor:
        """Return the values after the innovations of a report, given the sensor used for it."""
        values: dict[str, Any] = {}
        if (factor := sensor.noise_factor) is not None and noise is not None:
            values["alarm"] = (self.alarm or ChangeAlarm()).after_noise(factor, noise)
            values["noise"] = factor.after(noise)
        if sensor.outliers is not None and outliers is not None:
            values["outliers"] = sensor.outliers.after(outliers)
        return self.changed(**values)

    def after_any_look(self, look: Look) -> LearnedSensor:
        """Return the values after any sensor's look, whose detections let pairs of looks count."""
        if self.chains is None or self.correlation is None:
            return self
        chains, sums = self.chains.count_pairs(look)
        correlation = self.correlation.after(sums) if sums[0] > 0.0 else self.correlation
        return self.changed(chains=chains, correlation=correlation)

    def after_look(self, report: Report, look: Look) -> LearnedSensor:
        """Return the values after the sensor's own look; the report is as it was prepared."""
        learned, sector, sensor = self, report.detections.coverage, report.sensor
        if sector is not None and report.turn_ns and sector.width <= WIDEST:
            latest = (
                AntennaPass.of(sector, report.stamp_ns)
                if report.earlier_sectors is None
                else report.earlier_sectors.continued
            )
            learned = learned.changed(antenna_pass=latest.detecting(look.label, look.detected))
        prediction, correlation = report.look_prediction, sensor.correlation
        if prediction is not None and correlation is not None:
            chains = DetectionChains() if self.chains is None else self.chains
            chains = chains.after(look, prediction, report.stamp_ns, report.turn_ns)
            learned = learned.changed(chains=chains)
            if correlation.learned and self.correlation is None:
                learned = learned.changed(correlation=correlation)
        return learned

    def figures(self, sensor: Sensor) -> dict[str, float]:
        """Return the learned values by name; see `SensorMemory.figures`."""
        figures: dict[str, float] = {}
        if (detection := self.detection) is not None and detection.all_looks:
            figures["detection_probability"] = detection.configured * detection.mean
            figures["detection_probability_std"] = detection.configured * detection.std
            figures["detection_probability_set"] = detection.configured
        if (noise := self.noise) is not None:
            columns = sensor.noise_components, noise.of_std, noise.error, noise.learned
            for component, ratio, error, learned in zip(*columns, strict=True):
                if learned:
                    figures[f"{component}_noise_ratio"] = float(ratio)
                    figures[f"{component}_noise_ratio_std"] = float(error)
        if (outliers := self.outliers) is not None and outliers.detections:
            figures["outlier_share"], figures["outlier_share_std"] = outliers.share, outliers.std
        correlation = self.correlation
        if correlation is not None and correlation.std < math.inf:
            figures["detection_correlation"] = correlation.value
            figures["detection_correlation_std"] = correlation.std
        if self.alarm is not None:
            figures |= self.alarm.figures(sensor.noise_components)
        return figures
