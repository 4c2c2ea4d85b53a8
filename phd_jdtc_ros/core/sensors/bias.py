"""The systematic errors of a radar: what all its measurements are wrong by alike."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import FloatArray, wrap_angle
from ..types import Detections


@dataclass(frozen=True)
class RadarBias:
    """The systematic errors of one radar; all are zero for a radar that has none.

    A true range r is measured as ``range_bias + (1 + range_gain) r``.

    Parameters
    ----------
    range_bias : float
        What ranges are too long by, metres.
    range_gain : float
        What they are too long by in addition, metres per metre.
    azimuth : float
        What azimuths are too large by, radians counter-clockwise.
    time_offset_s : float
        What stamps, and times of detections, are late by, seconds.
    """

    range_bias: float = 0.0
    range_gain: float = 0.0
    azimuth: float = 0.0
    time_offset_s: float = 0.0

    @property
    def offset_ns(self) -> int:
        """What stamps are late by, nanoseconds."""
        return round(self.time_offset_s * 1e9)

    def true_range(self, measured: FloatArray) -> FloatArray:
        """Return ranges without their systematic errors, metres; shape kept."""
        true: FloatArray = (measured - self.range_bias) / (1.0 + self.range_gain)
        return true

    def removed(self, stamp_ns: int, found: Detections) -> tuple[int, Detections]:
        """Return a report's stamp and detections without the systematic errors.

        Ranges are not below zero.
        """
        if self == NO_BIAS:
            return stamp_ns, found
        distance = np.maximum(self.true_range(found.measurement[:, 0]), 0.0)
        azimuth = _wrap_angle(found.measurement[:, 1] - self.azimuth)
        return stamp_ns - self.offset_ns, _with(found, distance, azimuth)

    def added(self, stamp_ns: int, found: Detections) -> tuple[int, Detections]:
        """Return a report's stamp and detections as a radar with these errors would give them."""
        if self == NO_BIAS:
            return stamp_ns, found
        distance = self.range_bias + (1.0 + self.range_gain) * found.measurement[:, 0]
        azimuth = _wrap_angle(found.measurement[:, 1] + self.azimuth)
        return stamp_ns + self.offset_ns, _with(found, np.maximum(distance, 0.0), azimuth)

    def followed_by(self, later: RadarBias) -> RadarBias:
        """Return the errors of a radar that are `later` once these have been removed."""
        scale = 1.0 + self.range_gain
        return RadarBias(
            self.range_bias + scale * later.range_bias,
            scale * (1.0 + later.range_gain) - 1.0,
            self.azimuth + later.azimuth,
            self.time_offset_s + later.time_offset_s,
        )


NO_BIAS = RadarBias()


def _wrap_angle(azimuth: FloatArray) -> FloatArray:
    """Return angles in (-pi, pi], shape kept."""
    return -wrap_angle(-azimuth)


def _with(found: Detections, distance: FloatArray, azimuth: FloatArray) -> Detections:
    return replace(found, measurement=np.stack([distance, azimuth], axis=1))
