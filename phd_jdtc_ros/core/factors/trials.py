"""Values that the compiled loops of a learned detection probability take; see `detection`."""

from __future__ import annotations

from typing import NamedTuple

from ..arrays import Float1, Int1


class TrialSums(NamedTuple):
    """Sums over the trials that count, by cell, arrays of shape (K,)."""

    trials: Float1  # Number of trials
    expected: Float1  # Number of detections expected with the configured probability
    detected: Float1  # Number of detections


class ReportTrials(NamedTuple):
    """Trials of one sensor for T targets in one report, arrays of shape (T,)."""

    label: Int1  # Ascending
    cell: Int1  # Number of the sensor's cell in which the target is, unique among sensors
    # Detections expected with the configured probability; the trial does not count if 0.
    expected: Float1
    detected: Float1  # Probability that the target was detected, if it exists
    existence: Float1  # Existence probability after the report


class Trials(NamedTuple):
    """The columns of `OpenTrials`, as compiled functions take them."""

    label: Int1
    cell: Int1
    expected: Float1
    detected: Float1
    open_share: Float1


class FactorPriors(NamedTuple):
    """What is assumed of the factors on a detection probability; see `RatioPrior`."""

    # Prior of the sensor's factor.
    right: float
    scale: float
    wide: float
    # Prior of a cell's factor relative to the sensor's.
    cell_right: float
    cell_scale: float
    cell_wide: float
    weight: float  # Weight of the configured probability, in expected detections
    most: float  # The largest probability


class Alarm(NamedTuple):
    """Changes that raise an alarm, of the sensor as a whole and of each sector."""

    raised: float  # Evidence from which the alarm is raised
    most: float  # Bound of the evidence
    changed: Float1  # Ratio of the probability to the learned one with a change, (1 + A,)
    unchanged: Float1  # The ratio without a change, (1 + A,)
    known: Float1  # Number of expected detections from which they count, (1 + A,)


class LearnedFactors(NamedTuple):
    """The factor of each cell, arrays of shape (K,)."""

    now: Float1
    before: Float1  # When the evidence of a change began
    remembered: Float1  # Number of expected detections from which it is learned
