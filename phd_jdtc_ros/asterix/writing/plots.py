"""Encodes plots as CAT048 and the antenna's motion as CAT034."""

from __future__ import annotations

import math

from ..messages import (
    AZIMUTH_UNIT,
    FULL_TURN,
    NAUTICAL_MILE,
    NONE,
    NORTH,
    QUARTER_LEVEL,
    SECTOR,
    SECTOR_UNIT,
    TICKS_PER_S,
    Plot,
)
from .encoding import blocks, record, signed, time_of_day, unsigned

RANGE_UNIT = NAUTICAL_MILE / 256.0
# Upper bound of the range in I048/040, metres.
FARTHEST = (2**16 - 1) * RANGE_UNIT


def plot_record(plot: Plot, time_ns: int) -> bytes:
    """Encode a plot as a record of CAT048; one of an unknown type is sent as a primary plot.

    Ranges are limited to `FARTHEST`.
    """
    azimuth = round(plot.azimuth % FULL_TURN / AZIMUTH_UNIT) % 2**16
    items = {
        "010": plot.radar.to_bytes(2, "big"),
        "140": time_of_day(time_ns),
        "020": bytes([(plot.detection_type or 1) << 5]),
        "040": unsigned(plot.distance, RANGE_UNIT, 2) + azimuth.to_bytes(2, "big"),
    }
    if plot.code != NONE:
        items["070"] = plot.code.to_bytes(2, "big")
    if math.isfinite(plot.height):
        quarters = round(plot.height / QUARTER_LEVEL)
        items["090"] = (min(max(quarters, -(2**13)), 2**13 - 1) & 0x3FFF).to_bytes(2, "big")
    if plot.address != NONE:
        items["220"] = plot.address.to_bytes(3, "big")
    levels = ((0x20, plot.secondary_dbm), (0x08, plot.primary_dbm))
    known = [(bit, dbm) for bit, dbm in levels if math.isfinite(dbm)]
    if known:
        chosen = bytes([sum(bit for bit, _ in known)])
        items["130"] = chosen + b"".join(signed(dbm, 1.0, 1) for _, dbm in known)
    return record(48, items)


def plot_blocks(plots: list[tuple[int, Plot]]) -> list[bytes]:
    """Encode plots as data blocks, each plot with its time in nanoseconds since the epoch."""
    return blocks(48, [plot_record(plot, time_ns) for time_ns, plot in plots])


def service_block(radar: int, time_ns: int, azimuth: float, rotation_s: float) -> bytes:
    """Encode a service message: the antenna passes an azimuth, radians clockwise from north.

    Azimuth 0 is sent as a north mark. `radar` has SAC in the upper and SIC in the lower eight
    bits, and the rotation period, seconds, is 0 if unknown.
    """
    number = round(azimuth % FULL_TURN / SECTOR_UNIT) % 2**8
    items = {
        "010": radar.to_bytes(2, "big"),
        "000": bytes([SECTOR if number else NORTH]),
        "030": time_of_day(time_ns),
    }
    if number:
        items["020"] = bytes([number])
    if rotation_s:
        items["041"] = unsigned(rotation_s, 1.0 / TICKS_PER_S, 2)
    (block,) = blocks(34, [record(34, items)])
    return block
