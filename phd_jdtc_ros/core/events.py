"""Events of a run: the engine has stepped through a scan, or the run has ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from .engine import Step
from .intake.scans import Reset
from .types import Estimates, Scan


@dataclass(frozen=True)
class Stepped:
    """The engine has stepped through a scan."""

    scan: Scan
    step: Step
    # Number of consecutive scans with detections but without targets, if a warning is due;
    # otherwise 0.
    scans_without_targets: int = 0


@dataclass(frozen=True)
class RunEnded:
    """The stamps jumped, or the run was flushed; later events belong to a new run."""

    reset: Reset | None  # The jump; None if the run was flushed
    smoothed: tuple[Estimates, ...]  # Pending smoothed estimates, oldest first


Event: TypeAlias = "Stepped | RunEnded"
