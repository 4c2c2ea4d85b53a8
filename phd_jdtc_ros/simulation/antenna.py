"""How the antenna of a simulated radar turns, and where it points when."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import FULL_TURN

# Each leaves at most the share of the wobble of the error that the one before left.
STEPS = 12


@dataclass(frozen=True)
class Antenna:
    """The sense in which a radar's antenna turns, how evenly, and where it points at scan 0.

    Parameters
    ----------
    bearing : float
        At scan 0, radians from the sensor's y axis in the sense in which it turns, from 0 to 2 pi.
        A turn, and its first sector, begins at the y axis.
    clockwise : bool
    wobble : float
        Largest share by which it is faster or slower than on average, as by wind; below 1.
    wobble_period_s : float
        In which it becomes faster, slower, and again as it was.
    lowest, highest : float
        Elevations between which targets are in its beam, radians. Only of radars on the round
        earth.
    """

    bearing: float = 0.0
    clockwise: bool = True
    wobble: float = 0.0
    wobble_period_s: float = 600.0
    lowest: float = -0.5 * math.pi
    highest: float = 0.5 * math.pi

    @property
    def begin(self) -> float:
        """Turns from the y axis to where it points at scan 0."""
        return self.bearing / FULL_TURN

    def turns_to(self, azimuth: FloatArray) -> FloatArray:
        """Return the part of a turn from the y axis to azimuths, in [0, 1); shape kept."""
        turned = np.pi / 2.0 - azimuth if self.clockwise else azimuth - np.pi / 2.0
        part: FloatArray = np.mod(turned / FULL_TURN, 1.0)
        return np.where(part < 1.0, part, 0.0)  # rounding may reach 1

    def turns_at(self, time_s: FloatArray, rotation_s: float) -> FloatArray:
        """Return the turns at times after scan 0, counted from that turn's begin; shape kept.

        Parameters
        ----------
        time_s : array
            Seconds.
        rotation_s : float
            Mean time of a turn.
        """
        turns: FloatArray = (time_s + self.ahead_s(time_s)) / rotation_s + self.begin
        return turns

    def times_at(self, turns: FloatArray, rotation_s: float) -> FloatArray:
        """Return when it has turned so far, seconds after scan 0; the inverse of `turns_at`."""
        even = (turns - self.begin) * rotation_s
        time_s: FloatArray = even
        for _ in range(STEPS if self.wobble else 0):
            time_s = even - self.ahead_s(time_s)
        return time_s

    def ahead_s(self, time_s: FloatArray) -> FloatArray:
        """Return what it is ahead of even turns at times after scan 0, seconds; shape kept."""
        pulsatance = FULL_TURN / self.wobble_period_s
        ahead: FloatArray = self.wobble / pulsatance * np.sin(pulsatance * time_s)
        return ahead


def usual_antenna(radar: int) -> Antenna:
    """Return the antenna of a scenario's k-th radar where the scenario does not say.

    The first begins at its y axis, and each of the others a golden angle behind the one before, so
    that radars with equal turns are not synchronous.
    """
    golden = 0.5 * (3.0 - math.sqrt(5.0))
    return Antenna(FULL_TURN * (radar * golden % 1.0))
