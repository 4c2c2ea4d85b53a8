"""The result of a registration."""

from __future__ import annotations

from dataclasses import dataclass

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.bias import SensorBias


@dataclass(frozen=True)
class Residuals:
    """Residuals of one radar's plots against the trajectories from all radars."""

    time_s: FloatArray  # Ascending only within a target, seconds, (N,)
    before: FloatArray  # In range and azimuth of the plots as reported, metres and radians, (N, 2)
    after: FloatArray  # After removal of the estimated biases, (N, 2)


@dataclass(frozen=True)
class RadarEstimate:
    """The estimated biases of one radar."""

    name: str
    bias: SensorBias  # Zero for unobservable biases
    # Standard deviations in the order and units of a `SensorBias`, (4,); NaN for unobservable
    # biases.
    std: FloatArray
    # Number of common tracks with its plots; a target that is lost and found again counts twice.
    tracks: int
    plots: int  # Number of these plots
    residuals: Residuals


@dataclass(frozen=True)
class Registration:
    """The estimated biases of all radars."""

    radars: tuple[RadarEstimate, ...]
    reference: str  # The radar that is assumed to have no bias of the kinds in `common`
    common: tuple[str, ...]  # Kinds of biases that are unobservable if all radars share them
    # Why the bias of another radar is unobservable, by radar and kind.
    hidden: dict[tuple[str, str], str]
    tracks: int  # Number of common tracks
    density: float  # Spectral density of the targets' white acceleration, m^2/s^3
