"""The existence probabilities at which tracks are confirmed and deleted: given, or derived.

How much a missed detection says depends on how often the target is missed. A class's detection
probability is a mean over its SNR band: targets at its lower end are missed again and again, and
of one at its upper end a miss by all radars says that it is gone. The thresholds that are derived
from the detection probability therefore take a track's own record into account: how often it has
been missed, against how often a target of its class is expected to be.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import FloatArray
from ..models.amplitude_model import Memory
from ..models.tracker_model import TrackerModel
from ..sensors.sensor import Sensor
from ..targets.modes import ClassModel

# Of estimates without labels: at even odds, a wrong report costs as much as a missing one.
EVEN = 0.5
# Below this existence probability a track is deleted, whatever its record.
LEAST = 0.05
# Number of places in a class's band, at which the detection probability is averaged.
PLACES = 400
# Relative variances below this are rounding.
SAME = 1e-9


@dataclass(frozen=True)
class ReportingRule:
    """When tracks are reported.

    Parameters
    ----------
    confirm : array of shape (C,)
        Existence probability above which a track of each class is confirmed.
    delete : array of shape (C,)
        Existence probability below which a confirmed track is no longer reported.
    hidden : array of shape (C,)
        As `delete`, of tracks that no antenna has passed for `confirmation.PATIENCE`.
    record_weight : array of shape (C,)
        Number of expected misses that the class's detection probability counts as, against the
        track's own record. Infinite if the record is not used.
    labelled : bool
        Whether estimates have labels. If not, those above `confirm` are reported, scan by scan.
    coasting_s : float
        Tracks that no radar can see are reported for so long after their last detection.
    """

    confirm: FloatArray
    delete: FloatArray
    hidden: FloatArray
    record_weight: FloatArray
    labelled: bool = True
    coasting_s: float = np.inf

    @property
    def least(self) -> float:
        """Existence probability above which a track can be reported by the filter."""
        lowest = float(min(self.confirm.min(), self.delete.min()))
        return min(lowest, LEAST) if np.isfinite(self.record_weight).any() else lowest

    @property
    def least_smoothed(self) -> float:
        """Existence probability above which a target can be reported by the smoother."""
        return float((self.delete if self.labelled else self.confirm).min())

    def slower(self, factor: float) -> ReportingRule:
        """Return the rule where targets are seen so many times more rarely."""
        return replace(self, coasting_s=self.coasting_s * factor)


def rule_of(
    model: TrackerModel,
    labelled: bool,
    confirm: float = 0.0,
    delete: float = 0.0,
    coasting_scans: float = np.inf,
) -> ReportingRule:
    """Return the rule of given thresholds; those that are 0 are derived from the model.

    Parameters
    ----------
    model : TrackerModel
    labelled : bool
        Whether estimates have labels.
    confirm, delete : float
        `confirm_probability` and `delete_probability`.
    coasting_scans : float
        Intervals, or turns where they are longer; see `ReportingRule.coasting_s`.

    Notes
    -----
    In each scan, to report a target that does not exist costs as much as to miss one that does. To
    take back a report, or the end of one, costs as much again. If the class's targets are detected
    with probability p, a track that is deleted although it exists is back in the next scan with
    this probability, and a false one that is confirmed is gone. So a track is confirmed where
    r > (1 - r) (1 + p), and deleted where r (1 + p) < 1 - r. Where no radar looks, p is 0.
    """
    classes = model.modes.classes
    never = np.full(len(classes), np.inf)
    if not labelled:
        above = np.full(len(classes), confirm or EVEN)
        return ReportingRule(above, above, above, never, labelled=False)
    coasting_s = coasting_scans * slowest_s(model)
    misses = [_misses(kind, model.radars) for kind in classes]
    p = 1.0 - np.array([missed.mean() for missed in misses])
    above = np.full(len(classes), confirm) if confirm else (1.0 + p) / (2.0 + p)
    if delete:
        below = np.full(len(classes), delete)
        return ReportingRule(np.maximum(above, delete), below, below, never, coasting_s=coasting_s)
    weight = never
    if not isinstance(model.amplitudes, Memory):  # which knows each target's own SNR
        weight = np.array([_record_weight(missed) for missed in misses])
    below, hidden = (np.minimum(1.0 / (2.0 + again), above) for again in (p, 0.0))
    return ReportingRule(above, below, hidden, weight, coasting_s=coasting_s)


def _misses(kind: ClassModel, sensors: tuple[Sensor, ...]) -> FloatArray:
    """Return the probability that all sensors miss a target, at places in its class's band."""
    low, high = np.log1p(kind.snr_band)
    place = low + (high - low) * (np.arange(PLACES) + 0.5) / PLACES
    missed = np.ones(PLACES)
    for sensor in sensors:
        missed *= sensor.miss_probability(place)
    return missed


def _record_weight(missed: FloatArray) -> float:
    """Return the weight of a class's detection probability, in expected misses.

    Notes
    -----
    The shape of the gamma distribution with the mean and the variance of the probability that all
    radars miss a target of the class. A given probability holds for every target.
    """
    variance = float(missed.var())
    mean = float(missed.mean())
    return mean**2 / variance if variance > SAME * mean**2 else float(np.inf)


def slowest_s(model: TrackerModel) -> float:
    """Return the nominal interval or the longest turn, seconds."""
    return max([model.modes.interval_s, *(radar.rotation_s for radar in model.radars)])
