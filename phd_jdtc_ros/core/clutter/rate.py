"""Clutter rate of a radar, estimated from the number of unclaimed detections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ..snapshot import floats

# Prior rate of false detections per turn, with the weight of one turn.
START_RATE = 20.0
# Memory in turns: after thirty turns a rate above one per turn is known within a fifth.
MEMORY_TURNS = 30.0
# Detections added to the count: keeps the rate of a radar without clutter above zero.
LEAST_COUNT = 0.5
# Bounds accepted in a snapshot: largest number of remembered detections, and fewest turns.
MOST_IN_ALL, LEAST_TURNS = 1e9, 0.5


@dataclass(frozen=True)
class ClutterCount:
    """Clutter rate estimate: remembered false detections and turns.

    Parameters
    ----------
    count : float
        Remembered false detections.
    turns : float
        Remembered turns; a scan of the whole field is one.

    Notes
    -----
    The number of detections in a turn is Poisson, and the rate has a Gamma distribution. Prior and
    data fade alike: after T turns both have the factor exp(-T / MEMORY_TURNS).
    """

    count: Annotated[float, floats("", 0.0, MOST_IN_ALL)] = START_RATE
    # The default is the prior of a radar whose rate was never learned.
    turns: Annotated[float, floats("", LEAST_TURNS, 2.0 * MEMORY_TURNS)] = 1.0

    @property
    def rate(self) -> float:
        """Expected false detections per turn."""
        return (self.count + LEAST_COUNT) / (self.turns + LEAST_COUNT / START_RATE)

    def after(self, unclaimed: float, turns: float) -> ClutterCount:
        """Return the estimate after a further report.

        Parameters
        ----------
        unclaimed : float
            Expected number of detections without a known target.
        turns : float
            Part of a turn that the report covers.
        """
        kept = float(np.exp(-turns / MEMORY_TURNS))
        return ClutterCount(kept * self.count + unclaimed, kept * self.turns + turns)
