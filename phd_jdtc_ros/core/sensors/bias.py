"""Biases of a radar: the constant errors of its ranges, azimuths and stamps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import FloatArray, wrap_angle
from ..types import Detections


@dataclass(frozen=True)
class SensorBias:
    """Biases of one radar, zero by default: positive for measurements that are too large.

    A true range r is measured as ``range_bias + (1 + range_gain) r``.
    """

    range_bias: float = 0.0  # Constant bias of ranges, metres
    range_gain: float = 0.0  # Additional bias proportional to the range, metres per metre
    azimuth: float = 0.0  # Bias of azimuths, radians counter-clockwise
    time_offset_s: float = 0.0  # Delay of stamps and of times of detections, seconds

    @property
    def offset_ns(self) -> int:
        """Delay of stamps, nanoseconds."""
        return round(self.time_offset_s * 1e9)

    def true_range(self, measured: FloatArray) -> FloatArray:
        """Return ranges without their biases, metres, elementwise."""
        return (measured - self.range_bias) / (1.0 + self.range_gain)

    def remove_from(self, stamp_ns: int, detections: Detections) -> tuple[int, Detections]:
        """Return a report's stamp and detections without the biases; ranges are at least zero."""
        if self == NO_BIAS:
            return stamp_ns, detections
        distance = np.maximum(self.true_range(detections.measurement[:, 0]), 0.0)
        azimuth = wrap_angle(detections.measurement[:, 1] - self.azimuth)
        return stamp_ns - self.offset_ns, _with_measurement(detections, distance, azimuth)

    def apply_to(self, stamp_ns: int, detections: Detections) -> tuple[int, Detections]:
        """Return a report's stamp and detections as a radar with these biases measures them."""
        if self == NO_BIAS:
            return stamp_ns, detections
        distance = self.range_bias + (1.0 + self.range_gain) * detections.measurement[:, 0]
        azimuth = wrap_angle(detections.measurement[:, 1] + self.azimuth)
        return stamp_ns + self.offset_ns, _with_measurement(
            detections, np.maximum(distance, 0.0), azimuth
        )

    def followed_by(self, later: SensorBias) -> SensorBias:
        """Return the total biases of a radar with `later` ones after these have been removed."""
        scale = 1.0 + self.range_gain
        return SensorBias(
            self.range_bias + scale * later.range_bias,
            scale * (1.0 + later.range_gain) - 1.0,
            self.azimuth + later.azimuth,
            self.time_offset_s + later.time_offset_s,
        )


NO_BIAS = SensorBias()


def _with_measurement(
    detections: Detections, distance: FloatArray, azimuth: FloatArray
) -> Detections:
    others = detections.measurement[:, 2:]  # An elevation has no bias
    measurement = np.column_stack([distance, azimuth, others])
    return replace(detections, measurement=measurement)
