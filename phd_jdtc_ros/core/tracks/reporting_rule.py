"""Thresholds of the existence probability for confirmation and deletion: given, or derived.

The evidence of a missed detection depends on the target's own detection probability. The detection
probability of a class is a mean over its SNR band: targets at its lower end are missed often, and a
target at its upper end that all radars miss has probably disappeared. Thresholds derived from the
detection probability therefore use a track's own record: its number of misses against the number
expected for its class.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import BoolArray, FloatArray
from ..models.amplitude_model import Memory
from ..models.tracker_model import TrackerModel
from ..sensors.sensor import Sensor
from ..targets.modes import ClassModel

# Below this existence probability a track is deleted, whatever its record.
MIN_EXISTENCE = 0.05
# Number of points in a class's SNR band at which the detection probability is evaluated.
SNR_POINTS = 400


@dataclass(frozen=True)
class ReportingRule:
    """Thresholds for the confirmation and the deletion of tracks."""

    # Existence probability above which a track of each class is confirmed, (C,).
    confirm: FloatArray
    # Existence probability below which a confirmed track is no longer reported, (C,).
    delete: FloatArray
    hidden: FloatArray  # As `delete`, for tracks without coverage for `confirmation.PATIENCE`, (C,)
    # True if targets of each class are reported at all, (C,); see `report_resting` of `rule_of`.
    reported: BoolArray
    # Weight of the class's detection probability against the track's own record, as a number of
    # expected misses, (C,); infinite if the record is not used.
    record_weight: FloatArray
    # True if estimates have labels. If not, estimates above `confirm` are reported in each scan.
    labelled: bool = True
    # Time for which tracks outside all coverage are reported after their last detection, seconds.
    coasting_s: float = np.inf
    # Largest spread of a reported track in gates, of `GATE_SIGMA` standard deviations of the noise.
    coasting_gates: float = np.inf

    @cached_property
    def least(self) -> float:
        """Existence probability above which a track can be reported by the filter."""
        lowest = float(min(self.confirm.min(), self.delete.min()))
        return min(lowest, MIN_EXISTENCE) if np.isfinite(self.record_weight).any() else lowest

    @cached_property
    def least_smoothed(self) -> float:
        """Existence probability above which a target can be reported by the smoother."""
        return float((self.delete if self.labelled else self.confirm).min())


def rule_of(
    model: TrackerModel,
    labelled: bool,
    confirm: float = 0.0,
    delete: float = 0.0,
    coasting_scans: float = np.inf,
    coasting_gates: float = np.inf,
    report_resting: bool = False,
) -> ReportingRule:
    """Return the rule of given thresholds; thresholds of 0 are derived from the model.

    `coasting_scans` is `ReportingRule.coasting_s` in intervals, or in revolutions if these are
    longer, and the others are parameters of the same name, or with ``_probability``.

    In each scan a false report costs as much as a missed target. Withdrawing or resuming a report
    costs as much again. With detection probability p, a track that was deleted although its target
    exists returns in the next scan with probability p; with the same probability a false confirmed
    track disappears. A track is therefore confirmed if r > (1 - r) (1 + p), and deleted if
    r (1 + p) < 1 - r. Outside all coverage p is 0.
    """
    classes = model.modes.classes
    reported, never = model.modes.moves | report_resting, np.full(len(classes), np.inf)
    if not labelled:
        # Threshold of estimates without labels: at even odds, a false report costs as much as a
        # missed one.
        above = np.full(len(classes), confirm or 0.5)
        return ReportingRule(above, above, above, reported, never, labelled=False)
    limits = coasting_scans * slowest_s(model), coasting_gates
    misses = [_miss_probabilities(target_class, model.radars) for target_class in classes]
    p = 1.0 - np.array([missed.mean() for missed in misses])
    above = np.full(len(classes), confirm) if confirm else (1.0 + p) / (2.0 + p)
    if delete:
        below = np.full(len(classes), delete)
        above = np.maximum(above, delete)
        return ReportingRule(above, below, below, reported, never, True, *limits)
    weight = never
    if not isinstance(model.amplitudes, Memory):  # `Memory` estimates each target's own SNR
        weight = np.array([_record_weight(missed) for missed in misses])
    below, hidden = (
        np.minimum(1.0 / (2.0 + return_probability), above) for return_probability in (p, 0.0)
    )
    return ReportingRule(above, below, hidden, reported, weight, True, *limits)


def _miss_probabilities(target_class: ClassModel, sensors: tuple[Sensor, ...]) -> FloatArray:
    """Return the probability that all sensors miss a target, at points of its class's SNR band."""
    low, high = np.log1p(target_class.snr_band)
    log_snr = low + (high - low) * (np.arange(SNR_POINTS) + 0.5) / SNR_POINTS
    missed = np.ones(SNR_POINTS)
    for sensor in sensors:
        if (largest := sensor.visibility.largest_probability) is not None:
            missed *= 1.0 - largest
        else:
            missed *= -np.expm1(-0.5 * sensor.threshold**2 * np.exp(-log_snr))
    return missed


def _record_weight(missed: FloatArray) -> float:
    """Return the weight of a class's detection probability, in expected misses.

    It is the shape parameter of the gamma distribution with the mean and the variance of the
    probability that all radars miss a target of the class. A given detection probability is the
    same for all targets.
    """
    variance, mean = float(missed.var()), float(missed.mean())
    # Relative variances below this are rounding errors.
    return mean**2 / variance if variance > 1e-9 * mean**2 else float(np.inf)


def slowest_s(model: TrackerModel) -> float:
    """Return the nominal interval or the longest revolution, seconds."""
    return max([model.modes.interval_s, *[radar.rotation_s for radar in model.radars]])
