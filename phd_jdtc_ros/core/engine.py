# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The engine's seam: what a tracking engine takes and gives, whatever it is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from .arrays import FloatArray
from .models.tracker_model import TrackerModel
from .snapshot import Snapshot
from .types import Estimates, Scan


@dataclass(frozen=True)
class Step:
    """What one scan brought.

    Parameters
    ----------
    filtered : Estimates
    smoothed : tuple of Estimates
        Those whose lag is reached: one with a lag in scans, none of them while the window fills.
    class_mass : array of shape (C,)
        Expected number of targets of each class after the update.
    figures : mapping of name to number
        The engine's own diagnostics.
    """

    filtered: Estimates
    smoothed: tuple[Estimates, ...]
    class_mass: FloatArray
    figures: Mapping[str, float]


class Engine(Protocol):
    """What a node needs of an engine."""

    def step(self, scan: Scan) -> Step:
        """Take in one scan; stamps must increase.

        Raises
        ------
        ValueError
            If the stamp is not later than the one before.
        """
        ...

    def flush(self) -> tuple[Estimates, ...]:
        """Return the smoothed estimates still held back, oldest first, and reset."""
        ...

    def interrupt(self) -> tuple[Estimates, ...]:
        """Do as `flush`, but number tracks found from now on as no track was numbered before.

        For a gap in a time that goes on: whoever follows tracks by their numbers must not take a
        new target for an old one.
        """
        ...

    def retune(self, model: TrackerModel, existence_threshold: float) -> None:
        """Use another model of equal structure and another threshold from the next scan on."""
        ...

    def reset(self) -> None:
        """Forget everything, as if newly made."""
        ...

    def snapshot(self) -> Snapshot:
        """Return all that the engine holds; it shares its arrays, which nobody changes."""
        ...

    def restore(self, snapshot: Snapshot) -> None:
        """Go on from a snapshot as if the engine had never stopped.

        Parameters
        ----------
        snapshot : Snapshot
            Of an engine with the same configuration.

        Raises
        ------
        ValueError
            If it is not one; the engine is reset then.
        """
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
