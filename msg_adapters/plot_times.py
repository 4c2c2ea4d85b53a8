"""The detections' own times, relative to the stamp and as a radar sends them."""

from __future__ import annotations

from phd_jdtc_ros.configuration.radar_input import RadarInput
from phd_jdtc_ros.core.arrays import FloatArray

# That of `stamps` would bring ROS with it.
NS_PER_S = 1_000_000_000


def relative(sent: FloatArray, stamp_ns: int, radar: RadarInput) -> FloatArray:
    """Return times as the radar sends them in seconds relative to the stamp, shape kept.

    Times since the epoch keep the precision with which doubles hold them, 0.24 us today.
    """
    if not radar.time_since_epoch:
        return sent * radar.time_unit_s
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    # Whole seconds are exact in every unit, and so is the difference of two close doubles.
    since_second = (sent - float(seconds) * _per_second(radar)) * radar.time_unit_s
    return since_second - nanoseconds * 1e-9


def sent(time_s: FloatArray, stamp_ns: int, radar: RadarInput) -> FloatArray:
    """Return times relative to the stamp as the radar sends them: the inverse of `relative`."""
    per_second = _per_second(radar)
    if not radar.time_since_epoch:
        return time_s * per_second
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    return (time_s + nanoseconds * 1e-9) * per_second + float(seconds) * per_second


def _per_second(radar: RadarInput) -> float:
    """Return how many of the radar's units of time are a second."""
    return float(round(1.0 / radar.time_unit_s))
