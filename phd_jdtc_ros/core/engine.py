"""The interface of a tracking engine: a filter and a smoother that are stepped scan by scan."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np

from .arrays import FloatArray, IntArray
from .models.tracker_model import TrackerModel
from .snapshot import Snapshot
from .tracks.reporting_rule import ReportingRule
from .types import Estimates, Scan
from .types.clutter_raster import ClutterRaster

# An observer that gets the filtered estimates that are due, before the step is complete.
OnFiltered: TypeAlias = "Callable[[tuple[Estimates, ...]], None]"


def ignore_filtered(_: tuple[Estimates, ...]) -> None:
    """Ignore the filtered estimates; the caller takes them from the complete step."""


@dataclass(frozen=True)
class Step:
    """The estimates and figures of one step."""

    # Estimates that are due: at the scan's stamp, or at the schedule's stamps up to it.
    filtered: tuple[Estimates, ...]
    # Estimates whose lag has passed. With a lag in scans, there are none until the window is full,
    # and one per step afterwards.
    smoothed: tuple[Estimates, ...]
    class_mass: FloatArray  # Expected number of targets of each class after the update, (C,)
    figures: Mapping[str, float]  # Diagnostics of the engine by name

    @property
    def targets(self) -> int:
        """Number of filtered targets, summed over the estimates that are due."""
        return sum(map(len, self.filtered))


@dataclass(frozen=True)
class EngineState:
    """The state of an engine before a scan, from which later scans can be reprocessed.

    A state is cheap to keep: it refers to the engine's sets, which are never modified. Unlike a
    `Snapshot` it cannot be stored in a file.
    """

    stamp_ns: int | None  # Stamp of the previous scan; None before the first
    model: TrackerModel  # Model of the next scan's step
    rule: ReportingRule  # Rule of the next scan's step
    # The engine's own state by name.
    state: Mapping[str, Any] = field(default_factory=dict, repr=False)


@dataclass(frozen=True)
class Reprocessed:
    """The result of reprocessing scans."""

    states: tuple[EngineState, ...]  # The engine's state before each scan
    # Estimates that have become due and were not published before.
    filtered: tuple[Estimates, ...]
    smoothed: tuple[Estimates, ...]


class Paths(NamedTuple):
    """Equally probable paths of targets over K intervals, given that the targets exist."""

    track_id: IntArray  # Track numbers, distinct, (T,)
    # Places, world frame, metres, (T, N, K + 1, 3). The height is NaN in the plane.
    place: FloatArray


class Engine(Protocol):
    """A filter with a smoother."""

    def step(self, scan: Scan, on_filtered: OnFiltered = ignore_filtered) -> Step:
        """Predict to the scan, update with it, and smooth.

        `on_filtered` gets the filtered estimates of the step, before the smoothing. Raise
        `ValueError` if the stamp is not later than the previous one; a filter of labels also if no
        sensor reported.
        """

    def flush(self) -> tuple[Estimates, ...]:
        """Return the pending smoothed estimates, oldest first, and begin again.

        Track numbers go on: a subscriber that follows tracks by number must not mistake a new
        target for an old one.
        """

    def interrupt(self) -> tuple[Estimates, ...]:
        """Flush, and let known aircraft keep their numbers.

        This is for a gap after which the stamps continue to increase.
        """

    def clutter_raster(self) -> ClutterRaster | None:
        """Return the learned clutter density; None if nothing was learned."""

    @property
    def track_count(self) -> int:
        """The latest track number; 0 if there is none."""

    def start_track(self, position: tuple[float, float], velocity: tuple[float, float]) -> None:
        """Begin a track with the next scan, at a place in metres with a velocity in m/s.

        Raise `ValueError` if the engine has no tracks.
        """

    def paths(
        self, tracks: IntArray, interval_s: float, steps: int, count: int, rng: np.random.Generator
    ) -> Paths | None:
        """Return `count` paths of each of some tracks from the last scan's stamp on.

        `tracks` has their numbers. None if the engine has no tracks.
        """

    def retune(self, model: TrackerModel, rule: ReportingRule) -> None:
        """Use another model of equal structure and another rule from the next scan on."""

    def reset(self) -> None:
        """Return to the initial state."""

    def save_state(self) -> EngineState:
        """Return the engine's state, from which later scans can be reprocessed."""

    def reprocess(self, scans: Sequence[tuple[EngineState, Scan]]) -> Reprocessed:
        """Reprocess scans after a scan was inserted among them, or reports were added to them.

        `scans` has every scan from some stamp on, in ascending order, with the state before it. The
        engine returns to the first `EngineState`; only the model and the rule of the others are
        used. Afterwards its state is as if it had stepped these scans in the first place, except
        that published track numbers remain: a target keeps its number, and no number is used for
        another target.
        """

    def snapshot(self) -> Snapshot:
        """Return the engine's state; its arrays are shared and must not be changed."""

    def restore(self, snapshot: Snapshot) -> None:
        """Continue from a snapshot of an engine of this configuration as if it had never stopped.

        Raise `ValueError` if the snapshot does not fit; the engine is then reset.
        """


@dataclass(frozen=True)
class Lag:
    """The lag of smoothed estimates: a number of later scans, or seconds."""

    scans: int  # Used if `seconds` is None
    # For radars without common stamps: a scan is smoothed when the newest scan is at least this
    # much later.
    seconds: float | None = None

    @property
    def positive(self) -> bool:
        """Whether smoothed estimates take later scans into account."""
        return self.scans > 0 or self.seconds is not None

    def reached(self, stamps_ns: list[int]) -> bool:
        """Return whether the lag of the first of the window's ascending stamps is reached."""
        if self.seconds is None or not stamps_ns:
            return len(stamps_ns) > self.scans
        return stamps_ns[-1] - stamps_ns[0] >= self.seconds * 1e9
