"""A simulated radar's rotation and times of sending, and its measurements with their noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.configuration.schema import SMALL, parameter
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, wrap_angle
from phd_jdtc_ros.core.sensors.gaussians import UNKNOWN_STD
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.types import FULL_TURN

from .checked import degrees, read_by_radar

# Fixed-point steps for the time of a direction; each reduces the error at least by the factor
# `wobble`.
STEPS = 12


@dataclass(frozen=True)
class Antenna:
    """The rotation of a radar's antenna; the block ``antennas`` of a scenario document.

    A revolution, and its first sector, begins at the y axis.
    """

    bearing: float = degrees(
        0.0,
        "Direction at scan 0: angle from the radar's y axis in the sense of rotation, degrees.",
        (0.0, 360.0),
        "bearing_deg",
    )
    clockwise: bool = parameter(True, "Whether the antenna turns clockwise.")
    wobble: float = parameter(
        0.0, "Largest relative deviation of the rotation rate from its mean.", (0.0, 0.5)
    )
    wobble_period_s: float = parameter(600.0, "Period of this deviation, s.", (SMALL, 1e6))
    # Only for radars on the round earth.
    lowest: float = degrees(
        -90.0, "Lowest elevation of the beam, degrees.", (-90.0, 90.0), "lowest_deg"
    )
    highest: float = degrees(
        90.0, "Highest elevation of the beam, degrees.", (-90.0, 90.0), "highest_deg"
    )

    @property
    def begin(self) -> float:
        """Revolutions from the y axis to the direction at scan 0."""
        return self.bearing / FULL_TURN

    def revolutions_to(self, azimuth: FloatArray) -> FloatArray:
        """Return the part of a revolution from the y axis to azimuths, in [0, 1); same shape."""
        turned = np.pi / 2.0 - azimuth if self.clockwise else azimuth - np.pi / 2.0
        part: FloatArray = np.mod(turned / FULL_TURN, 1.0)
        return np.where(part < 1.0, part, 0.0)  # Rounding may reach 1

    def revolutions_at(self, time_s: FloatArray, rotation_s: float) -> FloatArray:
        """Return the revolutions at times after scan 0, s, counted from the start of scan 0's.

        `rotation_s` is the mean rotation period.
        """
        revolutions: FloatArray = (time_s + self.ahead_s(time_s)) / rotation_s + self.begin
        return revolutions

    def times_at(self, revolutions: FloatArray, rotation_s: float) -> FloatArray:
        """Return the times of revolutions, s after scan 0; the inverse of `revolutions_at`."""
        even = (revolutions - self.begin) * rotation_s
        time_s: FloatArray = even
        for _ in range(STEPS if self.wobble else 0):
            time_s = even - self.ahead_s(time_s)
        return time_s

    def ahead_s(self, time_s: FloatArray) -> FloatArray:
        """Return the lead over a uniform rotation at times after scan 0, seconds; same shape."""
        angular_frequency = FULL_TURN / self.wobble_period_s
        amplitude_s = self.wobble / angular_frequency
        ahead: FloatArray = amplitude_s * np.sin(angular_frequency * time_s)
        return ahead


def default_antenna(radar: int) -> Antenna:
    """Return the default antenna of a scenario's k-th radar.

    The first radar begins at its y axis, and each further one a golden angle behind the previous
    one, so that radars with equal revolutions are not synchronous.
    """
    golden = 0.5 * (3.0 - math.sqrt(5.0))
    return Antenna(FULL_TURN * (radar * golden % 1.0))


@dataclass(frozen=True)
class Sending:
    """The timing of a radar's messages."""

    sectors: int = parameter(
        32, "Number of sectors per revolution in which plots are sent.", (1, 1024)
    )
    plots: int = parameter(10, "Largest number of plots in a data block.", (1, 100))
    delay_s: float = parameter(0.3, "Delay of plots after the end of their sector, s.", (0.0, 60.0))
    services: bool = parameter(True, "Whether north marks and sector crossings are sent.")
    clock_ahead_s: float = parameter(
        0.0, "Lead of the radar's clock over true time, s.", (-86400, 86400)
    )


def read_sending(
    document: Mapping[str, object], radars: tuple[RadarModel, ...], faults: list[str]
) -> tuple[Sending, ...]:
    """Return the timing of each radar's messages in a document; add faults to `faults`."""
    given = read_by_radar(Sending, document, "sending", radars, faults)
    return tuple(each or Sending() for each in given)


class Observation(NamedTuple):
    """A radar's measurements of targets or reflectors."""

    # With noise, metres and radians, (N, Z); ranges are not negative, azimuths are in (-pi, pi].
    measurement: FloatArray
    amplitude: FloatArray  # Envelopes, (N,)
    seen: BoolArray  # True where the radar detects the target, (N,)

    @property
    def detected(self) -> tuple[FloatArray, FloatArray]:
        """Measurements and amplitudes of what is detected."""
        return self.measurement[self.seen], self.amplitude[self.seen]


def with_noise(exact: FloatArray, radar: RadarModel, rng: np.random.Generator) -> FloatArray:
    """Return true measurements with the radar's noise, metres and radians; shape (N, Z).

    A radar without elevations has none to add noise to: they stay, and are not sent.
    """
    std = radar.noise_std.copy()
    std[2:][std[2:] >= UNKNOWN_STD] = 0.0
    return polar(exact + rng.standard_normal(exact.shape) * std)


def polar(measurement: FloatArray) -> FloatArray:
    """Return measurements with ranges that are not negative and azimuths in (-pi, pi]."""
    distance, azimuth = np.abs(measurement[:, 0]), wrap_angle(measurement[:, 1])
    return np.column_stack([distance, azimuth, measurement[:, 2:]])
