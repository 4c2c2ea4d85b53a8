# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The settings for decoding one radar's messages."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RadarInput:
    """The settings for decoding one radar's messages.

    Parameters
    ----------
    name, topic, frame : str
    message : str
        ``point_cloud`` or ``radar_scan``.
    range_field, azimuth_field, elevation_field, amplitude_field : str
        Names of the point cloud's fields. `amplitude_field` is empty if there is none, and
        `elevation_field` is empty if the ranges are ground ranges.
    amplitude_in_db : bool
        Whether the amplitude field is an SNR in dB and not a linear envelope.
    amplitude_offset_db : float
    compass : bool
        Whether azimuths are clockwise from north.
    max_range : float
        Metres; detections beyond it are dropped.
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
