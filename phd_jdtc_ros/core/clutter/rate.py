"""How much clutter a radar has: a rate learned from how many detections no target claims."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ..snapshot import floats

# False detections per turn before any is known, which counts as much as one turn tells.
START_RATE = 20.0
# Turns that are remembered: the rate is known within a fifth after thirty of them, if there is more
# than one false detection in each.
MEMORY_TURNS = 30.0
# Detections that are always remembered: a radar without any clutter may still have some.
LEAST_COUNT = 0.5
# Bounds of what may have been stored: detections of all remembered turns, and these.
MOST_IN_ALL, LEAST_TURNS = 1e9, 0.5


@dataclass(frozen=True)
class ClutterCount:
    """False detections remembered, and the turns that they are of.

    Parameters
    ----------
    count : float
    turns : float
        A scan of the whole field is one.

    Notes
    -----
    The number of a turn is Poisson, and the rate has a Gamma prior, which is forgotten as turns
    are: after T turns both have the factor exp(-T / MEMORY_TURNS).
    """

    count: Annotated[float, floats("", 0.0, MOST_IN_ALL)] = START_RATE
    # No turns are remembered of a radar whose rate was never learned.
    turns: Annotated[float, floats("", LEAST_TURNS, 2.0 * MEMORY_TURNS)] = 1.0

    @property
    def rate(self) -> float:
        """Expected false detections per turn."""
        return (self.count + LEAST_COUNT) / (self.turns + LEAST_COUNT / START_RATE)

    def after(self, unclaimed: float, turns: float) -> ClutterCount:
        """Return what is remembered after a further report.

        Parameters
        ----------
        unclaimed : float
            Expected number of its detections that are of no known target.
        turns : float
            Part of a turn that the report is of.
        """
        kept = float(np.exp(-turns / MEMORY_TURNS))
        return ClutterCount(kept * self.count + unclaimed, kept * self.turns + turns)
