"""The result of a registration."""

from __future__ import annotations

from dataclasses import dataclass

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.bias import SensorBias


@dataclass(frozen=True)
class Residuals:
    """Residuals of one radar's plots against the trajectories from all radars."""

    time_s: FloatArray  # Ascending only within a target, seconds, (N,)
    before: FloatArray  # Of the plots as reported: range and azimuth, m and rad, (N, 2)
    after: FloatArray  # After removal of the estimated biases, (N, 2)


@dataclass(frozen=True)
class RadarEstimate:
    """The estimated biases of one radar."""

    name: str
    bias: SensorBias  # Zero for unobservable biases
    # (4,). Standard deviations in the order and units of a `SensorBias`; NaN for unobservable
    # biases.
    std: FloatArray
    # Number of common tracks with its plots; a target that is lost and found again is another one.
    tracks: int
    plots: int  # Number of these plots
    residuals: Residuals


@dataclass(frozen=True)
class Registration:
    """The estimated biases of all radars."""

    radars: tuple[RadarEstimate, ...]
    reference: str  # The radar that is assumed to have no bias of the kinds in `common`
    common: tuple[str, ...]  # Kinds of biases that are unobservable if all radars share them
    # Dict of (radar, kind) to str. Reason why another radar's bias is unobservable.
    hidden: dict[tuple[str, str], str]
    tracks: int  # Number of common tracks
    density: float  # Spectral density of the targets' white acceleration, m^2/s^3
