"""What a recording says of the systematic errors of its radars."""

from __future__ import annotations

from dataclasses import dataclass

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.bias import RadarBias


@dataclass(frozen=True)
class Residuals:
    """The differences of one radar's plots to the targets as all radars together see them.

    Parameters
    ----------
    time_s : array of shape (N,)
        Ascending only within a target, seconds.
    before, after : array of shape (N, 2)
        With and without the errors that were found; range and azimuth, metres and radians.
    """

    time_s: FloatArray
    before: FloatArray
    after: FloatArray


@dataclass(frozen=True)
class Found:
    """The systematic errors of one radar.

    Parameters
    ----------
    name : str
    bias : RadarBias
        Zero where an error is not told.
    std : array of shape (4,)
        Deviations, in the order and units of a `RadarBias`; NaN where an error is not told.
    tracks, plots : int
        Common tracks that it has a part in, and its plots of them. A target that is lost and found
        again is another track.
    residuals : Residuals
    """

    name: str
    bias: RadarBias
    std: FloatArray
    tracks: int
    plots: int
    residuals: Residuals


@dataclass(frozen=True)
class Registration:
    """What a recording says of the systematic errors of its radars.

    Parameters
    ----------
    radars : tuple of Found
    reference : str
        The radar that is taken to be right in all kinds of `common`.
    common : tuple of str
        Kinds of errors that cannot be seen where they are common to all radars.
    hidden : dict of (radar, kind) to str
        Why an error of another radar cannot be told.
    tracks : int
        Number of common tracks.
    density : float
        Of the white acceleration of the targets, m^2/s^3.
    """

    radars: tuple[Found, ...]
    reference: str
    common: tuple[str, ...]
    hidden: dict[tuple[str, str], str]
    tracks: int
    density: float
