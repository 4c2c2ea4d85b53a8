# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""How far plots are off their targets, and how targets depart from straight flight."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Deviations:
    """What tells where a target's next plot may be.

    Parameters
    ----------
    range_std, azimuth_std : float
        Of a measurement, metres and radians.
    densities : tuple of two floats
        Of the white acceleration: while targets keep their velocity, and while they manoeuvre,
        m^2/s^3.
    """

    range_std: float
    azimuth_std: float
    densities: tuple[float, float]
