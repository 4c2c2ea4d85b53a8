"""Detects changes of a sensor: fewer detections, more noise, or a blind sector."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from ..arrays import BoolArray, FloatArray, ReadOnly, zeros_field
from ..snapshot import floats
from .detection_factor import AZIMUTHS, RANGES, DetectionFactor, TrialSums
from .noise_factor import COMPONENTS, NoiseEvidence, NoiseFactor

# Changes to detect: ratios of the detection probability and of a variance to the learned values.
FEWER, NOISIER = 0.7, 2.0
# Ratios of the detection probability in a blind sector, and in any sector of a sensor that detects
# less as a whole.
BLIND, SHARED = 0.15, 0.6
# Log likelihood ratio from which a change is reported, and its upper bound. For a sensor that is as
# before, or whose change has been learned, it falls from one to the other in about ten turns.
RAISED, MOST = 12.0, 24.0
# Number of expected detections, of the sensor and of a sector, from which later detections are
# compared with the learned value; the first is also the number of innovations.
SETTLED, SETTLED_SECTOR = 50.0, 20.0


@dataclass(frozen=True, eq=False)
class ChangeAlarm(ReadOnly):
    """Evidence of changes of a sensor, as cumulative sums (CUSUM).

    E. S. Page, "Continuous inspection schemes", Biometrika 41, 1954: each sum is of the log
    likelihood ratios of the changed and the learned value, and is kept at zero or above. The
    learned value follows a change more slowly than the sum; the alarm ends when it has followed.
    """

    # Evidence of fewer detections by the sensor as a whole, and of almost none in each sector of
    # azimuth, (1 + A,).
    detection: Annotated[FloatArray, floats("A", 0.0, MOST)] = zeros_field(1 + AZIMUTHS)
    # Evidence of a larger noise in each component; see `NoiseFactor`.
    noise: Annotated[FloatArray, floats("Z", 0.0, MOST)] = zeros_field(COMPONENTS)

    @property
    def fewer_detections(self) -> bool:
        """Whether the sensor detects fewer targets than before."""
        return bool(self.detection[0] >= RAISED)

    @property
    def noisier(self) -> BoolArray:
        """Mask of the components whose noise is larger than before, (Z,)."""
        return self.noise >= RAISED

    @property
    def blind_azimuth(self) -> float:
        """Middle of the sector that has become blind, radians; NaN without any.

        Of several such sectors it is the one with the most evidence.
        """
        sector = int(self.detection[1:].argmax())
        if self.detection[1 + sector] < RAISED:
            return math.nan
        return (sector + 0.5) * 2.0 * np.pi / AZIMUTHS

    def figures(self, components: Sequence[str]) -> dict[str, float]:
        """Return the changes by name; `components` are those whose noise may be learned.

        1 for fewer detections or a larger noise, and the middle of a blind sector in degrees.
        """
        found = {"fewer_detections": 1.0} if self.fewer_detections else {}
        if not np.isnan(self.blind_azimuth):
            found["blind_azimuth_deg"] = float(np.degrees(self.blind_azimuth))
        noisier = zip(components, self.noisier.tolist(), strict=False)
        return found | {f"{component}_noisier": 1.0 for component, raised in noisier if raised}

    def after_trials(self, factor: DetectionFactor, sums: TrialSums) -> ChangeAlarm:
        """Return the alarm after trials that count, given the factor learned before them."""
        usual = factor.by_cell * sums.expected
        by_cell = np.stack([sums.trials, sums.detected, usual, factor.expected])
        trials, detected, usual, known = by_cell.reshape(4, RANGES, AZIMUTHS).sum(axis=1)
        whole = _evidence(trials.sum(), detected.sum(), usual.sum(), FEWER, 1.0)
        whole = np.where(factor.all_expected >= SETTLED, whole, 0.0)
        sectors = _evidence(trials, detected, usual, BLIND, SHARED)
        sectors = np.where(known >= SETTLED_SECTOR, sectors, 0.0)
        evidence = np.concatenate([[whole], sectors])
        return replace(self, detection=np.clip(self.detection + evidence, 0.0, MOST))

    def after_noise(self, factor: NoiseFactor, evidence: NoiseEvidence) -> ChangeAlarm:
        """Return the alarm after innovations, given the noise that was learned before them."""
        square = evidence.weight + evidence.excess
        ratio = 0.5 * (square * (1.0 - 1.0 / NOISIER) - evidence.weight * math.log(NOISIER))
        ratio = np.where(factor.learned & (factor.weight >= SETTLED), ratio, 0.0)
        return replace(self, noise=np.clip(self.noise + ratio, 0.0, MOST))


def _evidence(
    trials: FloatArray, detected: FloatArray, usual: FloatArray, ratio: float, against: float
) -> FloatArray:
    """Return the log likelihood of `ratio` against that of another one, elementwise.

    Both are ratios to the learned probability. Given are the numbers of trials, of detections, and
    of detections that the learned probability predicts.
    """
    learned = np.clip(usual / np.where(trials > 0.0, trials, 1.0), 0.01, 0.99)
    of_miss = np.log((1.0 - ratio * learned) / (1.0 - against * learned))
    evidence: FloatArray = detected * math.log(ratio / against) + (trials - detected) * of_miss
    return evidence
