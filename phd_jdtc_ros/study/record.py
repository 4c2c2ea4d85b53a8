"""One run as values: what was there, what was seen, what was estimated."""

from __future__ import annotations

from dataclasses import dataclass

from phd_jdtc_ros.core.evaluation import FILTERED, SMOOTHED, Evaluation, PointSet
from phd_jdtc_ros.core.motion import POSITION
from phd_jdtc_ros.core.simulation import Truth
from phd_jdtc_ros.core.types import Estimates, FloatArray


@dataclass(frozen=True)
class Plot:
    """One radar's detections at one stamp, in the world frame.

    Parameters
    ----------
    stamp_ns : int
    radar : str
    position : array of shape (M, 2)
        Metres.
    amplitude : array of shape (M,)
        Linear envelope.
    """

    stamp_ns: int
    radar: str
    position: FloatArray
    amplitude: FloatArray


@dataclass(frozen=True)
class Record:
    """A run, each part ordered by stamp.

    Parameters
    ----------
    truth : tuple of Truth
        Empty where the truth is not known.
    plots : tuple of Plot
    filtered, smoothed : tuple of Estimates
    classes : int
    step_ms : array of shape (scans,)
        CPU time of each step; empty where it was not measured.
    """

    truth: tuple[Truth, ...]
    plots: tuple[Plot, ...]
    filtered: tuple[Estimates, ...]
    smoothed: tuple[Estimates, ...]
    classes: int
    step_ms: FloatArray

    def evaluate(self, cutoff: float, order: float) -> Evaluation:
        """Return the scores of the run; `cutoff` in metres."""
        evaluation = Evaluation(self.classes, cutoff, order)
        for truth in self.truth:
            points = PointSet(truth.state[:, list(POSITION)], truth.class_id)
            evaluation.add_truth(truth.stamp_ns, points)
        for source, run in ((FILTERED, self.filtered), (SMOOTHED, self.smoothed)):
            for estimates in run:
                points = PointSet(estimates.state[:, list(POSITION)], estimates.class_id)
                evaluation.add_estimates(source, estimates.stamp_ns, points)
        return evaluation
