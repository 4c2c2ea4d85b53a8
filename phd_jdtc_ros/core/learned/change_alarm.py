"""Detects changes of a sensor: fewer detections, more noise, or a blind sector."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ..arrays import BoolArray, FloatArray, ReadOnly, zeros_field
from ..snapshot import floats
from .detection_factor import AZIMUTHS, DetectionFactor, TrialSums
from .noise_factor import COMPONENTS, NoiseEvidence, NoiseFactor

# Changes to detect: ratios of the detection probability and of a variance to the learned values.
FEWER, NOISIER = 0.7, 2.0
# Ratios of the detection probability in a blind sector, and in any sector of a sensor that detects
# less as a whole.
BLIND, SHARED = 0.15, 0.6
# Log likelihood ratio from which a change is reported, and its upper bound. For a sensor that is as
# before, or whose change has been learned, it falls from one to the other in about ten turns.
RAISED, MOST = 12.0, 24.0
# Bounds of the learned factors accepted in a snapshot.
LEAST_FACTOR, MOST_FACTOR = 1e-4, 1e4
# Number of expected detections, of the sensor and of a sector, after which detections are compared
# with the learned value. `SETTLED` is also the number of innovations after which the noise is.
SETTLED, SETTLED_SECTOR = 50.0, 20.0


def _of_both(of_sensor: float, of_sector: float) -> FloatArray:
    """Return the value of the sensor as a whole, and then that of each sector, (1 + A,)."""
    return np.array([of_sensor, *[of_sector] * AZIMUTHS])


# Ratios of the detection probability to the learned one with and without a change, and the number
# of expected detections from which they count.
CHANGED, UNCHANGED = _of_both(FEWER, BLIND), _of_both(1.0, SHARED)
KNOWN = _of_both(SETTLED, SETTLED_SECTOR)


@dataclass(frozen=True, eq=False)
class ChangeAlarm(ReadOnly):
    """Evidence of changes of a sensor, as cumulative sums (CUSUM).

    E. S. Page, "Continuous inspection schemes", Biometrika 41, 1954: each sum is of the log
    likelihood ratios of the changed and the learned value, and is kept at zero or above. For the
    noise and for a sector, the learned value is the one at the time when the sum was last zero,
    because later values follow the change. After an alarm it is the present value, so that the
    alarm ends once this has followed the change. For the sensor as a whole it is always the present
    value.
    """

    # Evidence of fewer detections by the sensor as a whole, and of almost none in each sector of
    # azimuth, (1 + A,).
    detection: Annotated[FloatArray, floats("A", 0.0, MOST)] = zeros_field(1 + AZIMUTHS)
    # Factor of each cell when the evidence of its sector began, (K,); None if there was none yet.
    detection_before: Annotated[FloatArray | None, floats("K", 0.0, MOST_FACTOR)] = None
    # Evidence of a larger noise in each component; see `NoiseFactor`.
    noise: Annotated[FloatArray, floats("Z", 0.0, MOST)] = zeros_field(COMPONENTS)
    # Expected ratio to each configured variance, outliers included, when that evidence began, (Z,);
    # None if there was none yet.
    noise_before: Annotated[FloatArray | None, floats("Z", LEAST_FACTOR, MOST_FACTOR)] = None

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
        figures = {"fewer_detections": 1.0} if self.fewer_detections else {}
        if not np.isnan(self.blind_azimuth):
            figures["blind_azimuth_deg"] = float(np.degrees(self.blind_azimuth))
        noisier = zip(components, self.noisier.tolist(), strict=False)
        return figures | {f"{component}_noisier": 1.0 for component, raised in noisier if raised}

    def after_trials(self, factor: DetectionFactor, sums: TrialSums) -> ChangeAlarm:
        """Return the alarm after trials that count, given the factor learned before them."""
        from .loops import evidence_after_trials

        learned, before = factor.by_cell, self.detection_before
        detection, factor_before = evidence_after_trials(
            *(self.detection, RAISED, MOST, learned, learned if before is None else before, *sums),
            *(factor.expected, factor.all_expected, CHANGED, UNCHANGED, KNOWN),
        )
        return self.changed(detection=detection, detection_before=factor_before)

    def after_noise(self, factor: NoiseFactor, evidence: NoiseEvidence) -> ChangeAlarm:
        """Return the alarm after innovations, given the noise that was learned before them.

        Outliers count: after a change, most detections look like outliers.
        """
        evidence = evidence.with_outliers or evidence
        expected = factor.variance * evidence.expected
        before = expected
        if self.noise_before is not None:
            # In comparison with the present value, which follows a change immediately, evidence
            # would shrink while it is collected.
            begun = (self.noise > 0.0) & (self.noise < RAISED)
            before = np.where(begun, self.noise_before, expected)
        square = (evidence.weight + evidence.excess) * factor.variance / before
        ratio = 0.5 * (square * (1.0 - 1.0 / NOISIER) - evidence.weight * math.log(NOISIER))
        ratio = np.where(factor.learned & (factor.weight >= SETTLED), ratio, 0.0)
        noise = np.minimum(np.maximum(self.noise + ratio, 0.0), MOST)
        return self.changed(noise=noise, noise_before=before)
