# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The numbers of particles: per target, per group, per birth term and per scan."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class ParticleBudget:
    """The numbers of particles that represent the intensity.

    Parameters
    ----------
    per_target : int
        Copies to which a unit of mass is resampled.
    least : int
        Minimum number of copies of a (class, origin) group.
    per_birth_term : int
        Particles of each birth term per scan; a power of two.
    most : int
        Maximum number of copies in a stored set.
    """

    per_target: int
    least: int
    per_birth_term: int
    most: int

    def beside(self, held: int) -> ParticleBudget:
        """Return the budget of a set that is held beside others of `held` copies together."""
        return self if held == 0 else replace(self, most=max(self.most - held, self.least))
