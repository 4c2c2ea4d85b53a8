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
ADDED_COUNT = 0.5
# Largest number of remembered detections accepted in a snapshot.
MAX_DETECTIONS = 1e9
# Smallest number of remembered turns accepted in a snapshot.
MIN_TURNS = 0.5


@dataclass(frozen=True)
class ClutterCount:
    """Clutter rate estimate: remembered false detections and turns.

    The number of detections in a turn is Poisson, and the rate has a Gamma distribution. Prior and
    data fade alike: after T turns both have the factor exp(-T / MEMORY_TURNS).
    """

    # Remembered false detections; by default those of a radar whose rate was never learned.
    count: Annotated[float, floats("", 0.0, MAX_DETECTIONS)] = START_RATE
    # Remembered turns; a scan of the whole field is one.
    turns: Annotated[float, floats("", MIN_TURNS, 2.0 * MEMORY_TURNS)] = 1.0

    @property
    def rate(self) -> float:
        """Expected false detections per turn."""
        return (self.count + ADDED_COUNT) / (self.turns + ADDED_COUNT / START_RATE)

    def after(self, unclaimed: float, turns: float) -> ClutterCount:
        """Return the estimate after a further report, which covers a part of a turn.

        `unclaimed` is the expected number of detections without a known target.
        """
        retention = float(np.exp(-turns / MEMORY_TURNS))
        return ClutterCount(retention * self.count + unclaimed, retention * self.turns + turns)
