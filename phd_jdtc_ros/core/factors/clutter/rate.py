"""Rate of false detections, which is learned, and bursts of them far beyond the usual."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, TypeVar

import numpy as np

from ...sensors.view import View
from ...snapshot import floats
from ..factor import Factor, Look, Targets

# Prior rate of false detections per revolution, with the weight of one revolution.
START_RATE = 20.0
# Memory in revolutions: after thirty revolutions a rate above one per revolution is known within a
# fifth.
MEMORY_REVOLUTIONS = 30.0
# Detections added to the count: keeps the rate of a radar without clutter above zero.
ADDED_COUNT = 0.5
# Largest number of remembered detections accepted in a snapshot.
MAX_DETECTIONS = 1e9
# Smallest number of remembered revolutions accepted in a snapshot.
MIN_REVOLUTIONS = 0.5


RateT = TypeVar("RateT", bound="PoissonRate")


@dataclass(frozen=True)
class PoissonRate(Factor):
    """Rate per revolution: remembered detections and revolutions.

    The number of detections in a revolution is Poisson, and the rate has a Gamma distribution.
    Prior and data fade alike: after T revolutions both have the factor exp(-T /
    MEMORY_REVOLUTIONS).
    """

    # Remembered detections; by default those of a radar whose rate was never learned.
    count: Annotated[float, floats("", 0.0, MAX_DETECTIONS)] = START_RATE
    # Remembered revolutions; a scan of the whole field is one.
    revolutions: Annotated[float, floats("", MIN_REVOLUTIONS, 2.0 * MEMORY_REVOLUTIONS)] = 1.0

    @classmethod
    def beginning_with(cls: type[RateT], rate: float) -> RateT:
        """Return the estimate to begin with, given the expected rate per revolution."""
        return cls(max(rate + ADDED_COUNT * (rate / START_RATE - 1.0), 0.0))

    @property
    def rate(self) -> float:
        """Expected detections per revolution."""
        return (self.count + ADDED_COUNT) / (self.revolutions + ADDED_COUNT / START_RATE)

    def after(self: RateT, counted: float, revolutions: float) -> RateT:
        """Return the estimate after a number of detections in a part of a revolution."""
        retention = float(np.exp(-revolutions / MEMORY_REVOLUTIONS))
        return self.changed(
            count=retention * self.count + counted,
            revolutions=retention * self.revolutions + revolutions,
        )


class ClutterRate(PoissonRate):
    """Rate of uniform false detections, in the place of the configured one."""

    NAME: ClassVar[str] = "clutter_rate"

    def expect(self, view: View) -> View:
        """Return the report with the learned rate."""
        return view.changed(clutter_rate=self.rate)

    def learn(self, look: Look) -> ClutterRate:
        """Count the detections that are probably false, and that no local clutter explains.

        Among replies new targets count as false, because a reflected reply looks like one.
        """
        view = look.view
        revolutions = view.part_of_revolution
        if not (revolutions and view.complete):
            return self
        uniform = np.exp(-view.log_clutter_factor(view.detections.measurement))
        found = look.association
        probability = found.false_probability if found.evidence is None else look.unclaimed
        false = float((probability * uniform).sum())
        return self.after(false / view.sensor.visibility.clutter_share, revolutions)


class Bursts(PoissonRate):
    """Detections far beyond the usual number are clutter that no rate expects.

    They come from jamming, rain or a faulty plot extractor. Targets do not appear in such numbers
    at once, except at the start, when nothing is usual yet. The rate is that of all detections.
    """

    NAME: ClassVar[str] = "usual_detections"
    # Revolutions after which the usual number of detections is known.
    KNOWN_REVOLUTIONS: ClassVar[float] = 5.0
    # Number of standard deviations of a Poisson number by which a report may have more than usual.
    SIGMA: ClassVar[float] = 5.0

    def given(self, view: View, targets: Targets) -> View:
        """Return the report with the clutter of a burst, unless its detections were limited."""
        revolutions = view.part_of_revolution
        if not revolutions or not view.complete or self.revolutions < self.KNOWN_REVOLUTIONS:
            return view
        size = len(view)
        surplus = size - self.rate * revolutions - self.SIGMA * math.sqrt(size)
        if surplus <= 0.0:
            return view
        return view.changed(clutter_rate=view.clutter_rate + surplus / revolutions)

    def learn(self, look: Look) -> Bursts:
        """Count the detections of a report."""
        revolutions = look.expected.part_of_revolution
        return self.after(len(look.expected), revolutions) if revolutions else self
