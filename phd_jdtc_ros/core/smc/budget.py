# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""How many particles represent what."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ParticleBudget:
    """How many particles represent what.

    Parameters
    ----------
    per_target : int
        Copies a unit of mass is resampled to.
    least : int
        Copies that a (class, origin) group gets at the least.
    per_birth_term : int
        A power of two.
    most : int
        Copies in all that are kept of a scan.
    """

    per_target: int
    least: int
    per_birth_term: int
    most: int
