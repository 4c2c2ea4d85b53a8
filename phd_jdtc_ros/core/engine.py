"""The interface of a tracking engine: a filter and a smoother that are stepped scan by scan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from .arrays import FloatArray
from .models.clutter_raster import ClutterRaster
from .models.tracker_model import TrackerModel
from .snapshot import Snapshot
from .tracks.reporting_rule import ReportingRule
from .types import Estimates, Scan


@dataclass(frozen=True)
class Step:
    """The estimates and figures of one step.

    Parameters
    ----------
    filtered : tuple of Estimates
        Those that are due: at the scan's stamp, or at the stamps of the schedule until then.
    smoothed : tuple of Estimates
        Those whose lag is reached. With a lag in scans these are none while the window fills, and
        then one per step.
    class_mass : array of shape (C,)
        Expected number of targets of each class after the update.
    figures : mapping of name to number
        Diagnostics of the engine.
    """

    filtered: tuple[Estimates, ...]
    smoothed: tuple[Estimates, ...]
    class_mass: FloatArray
    figures: Mapping[str, float]

    @property
    def targets(self) -> int:
        """Number of filtered targets in the estimates that are due."""
        return sum(map(len, self.filtered))


@dataclass(frozen=True)
class EngineState:
    """The state of an engine before a scan, to return to.

    Its sets are those of the engine itself and are never changed, so that it costs some references.
    Unlike a `Snapshot` it cannot be stored.

    Parameters
    ----------
    stamp_ns : int or None
        Of the scan before; None if there was none.
    model : TrackerModel
    rule : ReportingRule
        With the model, what the next scan was stepped with.
    state : mapping of name to value
        The engine's own.
    """

    stamp_ns: int | None
    model: TrackerModel
    rule: ReportingRule
    state: Mapping[str, Any] = field(default_factory=dict, repr=False)


@dataclass(frozen=True)
class Reworked:
    """The result of stepping scans again.

    Parameters
    ----------
    states : tuple of EngineState
        Those of the engine before each of them.
    filtered, smoothed : tuples of Estimates
        Those that have become due and had not been given out before.
    """

    states: tuple[EngineState, ...]
    filtered: tuple[Estimates, ...]
    smoothed: tuple[Estimates, ...]


class Engine(Protocol):
    """A filter and a smoother behind one interface."""

    def step(self, scan: Scan) -> Step:
        """Predict to the scan, update with it, and smooth; stamps must increase.

        Raises
        ------
        ValueError
            If the stamp is not later than the previous one.
        """
        ...

    def flush(self) -> tuple[Estimates, ...]:
        """Return the smoothed estimates that are held back, oldest first, and reset."""
        ...

    def interrupt(self) -> tuple[Estimates, ...]:
        """Do as `flush`, but use no track number a second time.

        This is for a gap after which the stamps continue to increase. A subscriber that follows
        tracks by their numbers must not take a new target for an old one.
        """
        ...

    def clutter_raster(self) -> ClutterRaster | None:
        """Return where clutter comes from, as far as it was learned; None if nothing was."""
        ...

    def retune(self, model: TrackerModel, rule: ReportingRule) -> None:
        """Use another model of equal structure and another rule from the next scan on."""
        ...

    def reset(self) -> None:
        """Return to the initial state."""
        ...

    def save_state(self) -> EngineState:
        """Return the engine's state, to step later scans again from there."""
        ...

    def rework(self, scans: Sequence[tuple[EngineState, Scan]]) -> Reworked:
        """Step scans again, with others between them or with more reports in them.

        The engine is then in the state in which it would be had it stepped these scans at once.
        Only track numbers are those that have been given out: a target keeps its own, and no number
        is used for another target.

        Parameters
        ----------
        scans : sequence of (EngineState, Scan)
            By ascending stamp: every scan from some stamp on. The engine returns to the first
            `EngineState`; of the others only the model and the rule are used.
        """
        ...

    def snapshot(self) -> Snapshot:
        """Return the engine's state; its arrays are shared and must not be changed."""
        ...

    def restore(self, snapshot: Snapshot) -> None:
        """Continue from a snapshot as if the engine had never stopped.

        Parameters
        ----------
        snapshot : Snapshot
            Of an engine with the same configuration.

        Raises
        ------
        ValueError
            If the snapshot does not fit; the engine is then reset.
        """
        ...


@dataclass(frozen=True)
class Lag:
    """The number of later scans, or seconds, that a smoothed estimate takes into account.

    Parameters
    ----------
    scans : int
        Used if `seconds` is None.
    seconds : float or None
        For radars without common stamps: a scan is smoothed once the newest one is at least this
        much later.
    """

    scans: int
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
