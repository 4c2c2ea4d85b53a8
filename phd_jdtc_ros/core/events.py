"""Events of a run: the engine has stepped through a scan, or the run has ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from .engine import Step
from .intake.scans import Reset
from .types import Estimates, Scan


@dataclass(frozen=True)
class Stepped:
    """The engine has stepped through a scan.

    Parameters
    ----------
    scans_without_targets : int
        Number of consecutive scans with detections but without targets, if a warning is due;
        otherwise 0.
    """

    scan: Scan
    step: Step
    scans_without_targets: int = 0


@dataclass(frozen=True)
class RunEnded:
    """The stamps jumped, or the run was flushed; later events belong to a new run.

    Parameters
    ----------
    reset : Reset or None
        The jump; None if the run was flushed.
    smoothed : tuple of Estimates
        Pending smoothed estimates, oldest first.
    """

    reset: Reset | None
    smoothed: tuple[Estimates, ...]


Event: TypeAlias = "Stepped | RunEnded"
