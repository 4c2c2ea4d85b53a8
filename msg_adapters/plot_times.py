"""Conversion of detection times between the radar's convention and seconds from the stamp."""

from __future__ import annotations

from phd_jdtc_ros.configuration.radar_parameters import RadarParameters
from phd_jdtc_ros.core.arrays import FloatArray

# This is defined here, because `stamps` imports ROS.
NS_PER_S = 1_000_000_000


def relative(sent: FloatArray, stamp_ns: int, radar: RadarParameters) -> FloatArray:
    """Convert times from the radar's convention to seconds from the stamp.

    Times since the epoch keep the resolution of doubles, 0.24 us today.
    """
    if not radar.time_since_epoch:
        return sent * radar.time_unit_s
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    # Whole seconds are exact in every unit, as is the difference of two close doubles.
    since_second = (sent - float(seconds) * _per_second(radar)) * radar.time_unit_s
    return since_second - nanoseconds * 1e-9


def encode(time_s: FloatArray, stamp_ns: int, radar: RadarParameters) -> FloatArray:
    """Convert seconds from the stamp to the radar's convention: the inverse of `relative`."""
    per_second = _per_second(radar)
    if not radar.time_since_epoch:
        return time_s * per_second
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    return (time_s + nanoseconds * 1e-9) * per_second + float(seconds) * per_second


def _per_second(radar: RadarParameters) -> float:
    """Return the number of the radar's time units per second."""
    return float(round(1.0 / radar.time_unit_s))
