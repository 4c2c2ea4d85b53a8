"""Rate of false detections, learned from unclaimed detections, and bursts far beyond the usual."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, TypeVar

import numpy as np

from ...sensors.view import View
from ...snapshot import floats
from ..factor import Factor, Look, Targets

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


RateT = TypeVar("RateT", bound="PoissonRate")


@dataclass(frozen=True)
class PoissonRate(Factor):
    """Rate per turn: remembered detections and turns.

    The number of detections in a turn is Poisson, and the rate has a Gamma distribution. Prior and
    data fade alike: after T turns both have the factor exp(-T / MEMORY_TURNS).
    """

    # Remembered detections; by default those of a radar whose rate was never learned.
    count: Annotated[float, floats("", 0.0, MAX_DETECTIONS)] = START_RATE
    # Remembered turns; a scan of the whole field is one.
    turns: Annotated[float, floats("", MIN_TURNS, 2.0 * MEMORY_TURNS)] = 1.0

    @classmethod
    def beginning_with(cls: type[RateT], rate: float) -> RateT:
        """Return the estimate from which a rate is learned, given the expected one per turn."""
        return cls(max(rate + ADDED_COUNT * (rate / START_RATE - 1.0), 0.0))

    @property
    def rate(self) -> float:
        """Expected detections per turn."""
        return (self.count + ADDED_COUNT) / (self.turns + ADDED_COUNT / START_RATE)

    def after(self: RateT, counted: float, turns: float) -> RateT:
        """Return the estimate after a number of detections in a part of a turn."""
        retention = float(np.exp(-turns / MEMORY_TURNS))
        return self.changed(
            count=retention * self.count + counted, turns=retention * self.turns + turns
        )


class ClutterRate(PoissonRate):
    """Rate of uniform false detections, in the place of the configured one."""

    NAME: ClassVar[str] = "clutter_rate"

    def expect(self, view: View) -> View:
        """Return the report with the learned rate."""
        return view.changed(clutter_rate=self.rate)

    def learn(self, look: Look) -> ClutterRate:
        """Count unclaimed detections that no local clutter explains."""
        view = look.view
        turns = view.part_of_turn
        if not (turns and view.complete):
            return self
        uniform = np.exp(-view.log_clutter_factor(view.detections.measurement))
        unclaimed = float((look.unclaimed * uniform).sum()) / view.sensor.clutter_share
        return self.after(unclaimed, turns)


class Bursts(PoissonRate):
    """Detections far beyond the usual number are clutter that no rate expects.

    They come from jamming, rain or a faulty plot extractor. Targets do not appear in such numbers
    at once, except at the start, when nothing is usual yet. The rate is that of all detections.
    """

    NAME: ClassVar[str] = "usual_detections"
    # Turns after which the usual number of detections is known.
    KNOWN_TURNS: ClassVar[float] = 5.0
    # Number of standard deviations of a Poisson number by which a report may have more than usual.
    SIGMA: ClassVar[float] = 5.0

    def given(self, view: View, targets: Targets) -> View:
        """Return the report with the clutter of a burst, unless its detections were limited."""
        turns = view.part_of_turn
        if not turns or not view.complete or self.turns < self.KNOWN_TURNS:
            return view
        size = len(view)
        surplus = size - self.rate * turns - self.SIGMA * math.sqrt(size)
        if surplus <= 0.0:
            return view
        return view.changed(clutter_rate=view.clutter_rate + surplus / turns)

    def learn(self, look: Look) -> Bursts:
        """Count the detections of a report."""
        turns = look.expected.part_of_turn
        return self.after(len(look.expected), turns) if turns else self
