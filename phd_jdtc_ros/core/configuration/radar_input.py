# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The layout of one radar's messages: where they come, what they are called, their units."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class RadarInput:
    """The layout of one radar's messages, by default that of the package's own clouds.

    Parameters
    ----------
    name, topic, frame : str
    message : str
        ``point_cloud`` or ``radar_scan``.
    range_field, azimuth_field, elevation_field, amplitude_field : str
        `amplitude_field` is empty where there is none, `elevation_field` where ranges are over
        ground.
    amplitude_in_db : bool
        The field is an SNR in dB rather than a linear envelope.
    amplitude_offset_db : float
    compass : bool
        Azimuth is from north, clockwise.
    azimuth_in_degrees : bool
        Azimuth is in degrees rather than radians.
    max_range : float
        Metres.
    """

    name: str
    topic: str
    frame: str
    message: str = "point_cloud"
    range_field: str = "range"
    azimuth_field: str = "azimuth"
    elevation_field: str = ""
    amplitude_field: str = "amplitude"
    amplitude_in_db: bool = False
    amplitude_offset_db: float = 0.0
    compass: bool = False
    azimuth_in_degrees: bool = False
    max_range: float = math.inf
