# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Warnings of reports that are used but do not look as they are configured, live and offline."""

from __future__ import annotations

from phd_jdtc_ros.core.configuration.radar_input import RadarInput


def no_amplitude(radar: RadarInput) -> str:
    """Return the warning of a radar whose messages have no amplitudes."""
    return (
        f"{radar.topic}: no field {radar.amplitude_field!r}; "
        "its amplitudes say nothing of the class"
    )


def beyond_a_turn(radar: RadarInput, count: int) -> str:
    """Return the warning of `count` azimuths that are no angles of one turn in radians."""
    cause = (
        f"its definition has radians, {radar.message} in degrees needs another driver"
        if radar.message == "radar_scan"
        else f"degrees, set {radar.name}.azimuth_unit to deg"
    )
    return f"{radar.topic}: {count} azimuths beyond 2 pi rad; probably {cause}"
