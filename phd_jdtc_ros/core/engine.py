# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The engine's seam: what a tracking engine takes and gives, whatever it is made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from .arrays import FloatArray
from .models.tracker_model import TrackerModel
from .types import Estimates, Scan


@dataclass(frozen=True)
class Step:
    """What one scan brought.

    Parameters
    ----------
    filtered : Estimates
    smoothed : tuple of Estimates
        Those whose lag is reached: with a lag in scans one, none while the window fills.
    class_mass : array of shape (C,)
        Expected number of targets of each class after the update.
    particles : int
        Rows of the stored set.
    effective_sample_size : float
        Of the stored set.
    orphans : int
        See `Transition`.
    """

    filtered: Estimates
    smoothed: tuple[Estimates, ...]
    class_mass: FloatArray
    particles: int
    effective_sample_size: float
    orphans: int


class Engine(Protocol):
    """What a node needs of a tracker, whatever it is made of."""

    def step(self, scan: Scan) -> Step:
        """Take in one scan; stamps must increase."""
        ...

    def flush(self) -> tuple[Estimates, ...]:
        """Return the smoothed estimates still held back, oldest first, and reset."""
        ...

    def interrupt(self) -> tuple[Estimates, ...]:
        """Do as `flush`, but give tracks found from now on numbers that no other has had."""
        ...

    def retune(self, model: TrackerModel, existence_threshold: float) -> None:
        """Go by another model of equal structure and another threshold from the next scan on."""
        ...

    def reset(self) -> None:
        """Forget everything, as if newly made."""
        ...


@dataclass(frozen=True)
class Lag:
    """How long estimates are held back for smoothing.

    Parameters
    ----------
    scans : int
        Used unless `seconds` is set.
    seconds : float or None
        For radars without a common scan: a stamp is smoothed once one at least this much later
        has come.
    """

    scans: int
    seconds: float | None = None

    def reached(self, stamps_ns: list[int]) -> bool:
        """Return whether the first of the window's ascending stamps has waited long enough."""
        if self.seconds is None:
            return len(stamps_ns) > self.scans
        return stamps_ns[-1] - stamps_ns[0] >= self.seconds * 1e9
