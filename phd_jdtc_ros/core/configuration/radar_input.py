# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""How one radar's messages are to be read."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RadarInput:
    """How one radar's clouds are to be read.

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
    max_range : float
        Metres.
    """

    name: str
    topic: str
    frame: str
    message: str
    range_field: str
    azimuth_field: str
    elevation_field: str
    amplitude_field: str
    amplitude_in_db: bool
    amplitude_offset_db: float
    compass: bool
    max_range: float
