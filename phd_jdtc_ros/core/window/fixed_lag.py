"""The fixed-lag engine around a forward filter: window, schedule and track numbers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Generic, NamedTuple

import numpy as np

from ..arrays import IntArray
from ..engine import EngineState, Lag, Reprocessed, Step
from ..models.clutter_raster import ClutterRaster, raster
from ..models.tracker_model import TrackerModel
from ..snapshot import MOST_STAMP_NS, Snapshot, from_snapshot, integers, to_snapshot
from ..tracks import renumbering
from ..tracks.common_stamp import Schedule, at_stamp, predict
from ..tracks.confirmation import TrackStates
from ..tracks.known_aircraft import Reach
from ..tracks.reporting_rule import ReportingRule
from ..tracks.track_numbers import NoNumbers, TrackNumbers
from ..types import Estimates, Scan
from .entries import Entry, LinkT, RowsT
from .forward_filter import MOST_SCANS, Filtered, ForwardFilter

NO_ROWS = np.zeros(0, dtype=np.int64)


class Window(NamedTuple):
    """The window's part of a snapshot.

    Parameters
    ----------
    stamps_ns : int array of shape (Q,)
        Stamps whose smoothed estimates are pending.
    entries : int
        Number of sets.
    """

    stamps_ns: Annotated[IntArray, integers("Q", 0, MOST_STAMP_NS, ascending=True)]
    entries: Annotated[int, integers("", 0, MOST_SCANS)]


@dataclass(frozen=True)
class Part(Generic[RowsT]):
    """Some targets of a set, for extraction.

    Parameters
    ----------
    rows : int array or None
        The rows of these targets; None for all rows.
    stamp_ns : int
        Stamp of the set's scan.
    """

    stored: RowsT
    rows: IntArray | None
    stamp_ns: int


@dataclass
class FixedLagEngine(ABC, Generic[RowsT, LinkT]):
    """A forward filter with a fixed-lag smoother; implements the protocol `Engine`.

    An engine is a subclass that implements the extraction of targets, the backward pass over the
    window, and the storage of an entry.

    Parameters
    ----------
    rule : ReportingRule
        When tracks are reported.
    """

    forward: ForwardFilter[RowsT, LinkT]
    lag: Lag
    schedule: Schedule
    rule: ReportingRule
    _states: TrackStates = field(init=False, repr=False)
    _tracks: TrackNumbers = field(init=False, repr=False)
    _window: list[Entry[RowsT, LinkT]] = field(init=False, repr=False)
    # Filtered targets of each scan with rows that no later scan has swept, by stamp.
    _filtered: dict[int, Estimates] = field(init=False, repr=False)
    _stamps: list[int] = field(init=False, repr=False)  # with pending smoothed estimates
    # Stamps of the latest filtered and smoothed estimates; -1 before the first.
    _given_ns: tuple[int, int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.reset()

    @abstractmethod
    def _extract(self, stored: RowsT, stamp_ns: int, lag: int, threshold: float) -> Estimates:
        """Return the targets of a set, filtered (lag 0) or smoothed.

        Targets with an existence probability above the threshold are returned. The `track_id` of a
        labelled target is its label plus one, of others 0.
        """

    def _extract_all(self, parts: Sequence[Part[RowsT]], lag: int) -> tuple[Estimates, IntArray]:
        """Return the targets of several sets at any existence probability, and each one's time."""
        every = []
        for part in parts:
            found = self._extract(part.stored, part.stamp_ns, lag, 0.0)
            if part.rows is not None:
                alive = np.isin(found.track_id - 1, part.stored.origin[part.rows])
                found = found.take(np.flatnonzero(alive))
            every.append(found)
        return Estimates.concatenate(every, lag)

    @abstractmethod
    def _backward(self, window: Sequence[Entry[RowsT, LinkT]]) -> Iterable[RowsT]:
        """Return the smoothed sets of a window, newest first; the window is oldest first.

        A source outside the window has left it.
        """

    @abstractmethod
    def _figures(self, step: Filtered[RowsT, LinkT]) -> Mapping[str, float]:
        """Return the diagnostics of a step."""

    @abstractmethod
    def _entry_to_snapshot(self, entry: Entry[RowsT, LinkT], stored: Snapshot, name: str) -> None:
        """Store an entry under a name; see `window_snapshot.sources_to_snapshot`."""

    @abstractmethod
    def _entry_from_snapshot(
        self, stored: Snapshot, name: str, earlier: Mapping[int, Entry[RowsT, LinkT]]
    ) -> Entry[RowsT, LinkT]:
        """Return a stored entry, given the entries stored before it, by stamp.

        A source outside these entries has left the window. A snapshot that does not fit this engine
        raises an exception with the reason.
        """

    def reset(self) -> None:
        """Return to the initial state."""
        self.forward.reset()
        self._tracks, self._states = TrackNumbers(), TrackStates(self.rule)
        self._window, self._filtered, self._stamps = [], {}, []
        self._given_ns = -1, -1

    def step(self, scan: Scan) -> Step:
        """Filter one scan and smooth the stamps whose lag is reached; see `Engine.step`."""
        modes = self.forward.model.modes
        filtered = []
        if self.forward.stamp_ns is not None:
            due = self.schedule.between(self.forward.stamp_ns, scan.stamp_ns)
            filtered = [self._filtered_at(stamp_ns) for stamp_ns in due]
        step = self.forward.step(scan, linked=self.lag.positive)
        replaced = {entry.stamp_ns: entry for entry in step.earlier}
        earlier = [replaced.get(entry.stamp_ns, entry) for entry in self._window]
        self._window = [*earlier, step.entry]
        self._note_filtered(step.updated, scan)
        if not self.schedule.period_ns:
            filtered.append(self._filtered_at(scan.stamp_ns))
        self._stamps = [*self._stamps, *(estimates.stamp_ns for estimates in filtered)]
        if filtered:
            self._given_ns = filtered[-1].stamp_ns, self._given_ns[1]
        smoothed = []
        while self.lag.reached(self._stamps):
            smoothed.append(self._smooth_oldest())
        labels = [entry.stored.label for entry in self._window]
        self._tracks.forget_all_but(labels)
        if self.forward.attributes is not None:
            oldest_ns = self._stamps[0] if self._stamps else scan.stamp_ns
            self.forward.attributes.forget_all_but(labels, oldest_ns)
        classes = modes.class_of, len(modes.classes)
        mass = [rows.class_mass(*classes) for rows in self.forward.current[:-1]]
        mass.append(step.updated.class_mass(*classes))
        total = np.sum(mass, axis=0)
        return Step(tuple(filtered), tuple(smoothed), total, self._figures(step))

    def clutter_raster(self) -> ClutterRaster | None:
        """Return the learned clutter density; see `Engine.clutter_raster`."""
        return raster(self.forward.clutter.maps, self.forward.model.radars)

    def retune(self, model: TrackerModel, rule: ReportingRule) -> None:
        """Use another model and rule from the next scan on; see `Engine.retune`.

        Stored sets and links are not recomputed with the new model.
        """
        self.forward.model = model
        if self.forward.attributes is not None and model.attributes is not None:
            self.forward.attributes.model = model.attributes
        self.rule = self._states.rule = rule

    def flush(self) -> tuple[Estimates, ...]:
        """Return the pending estimates, smoothed with the scans of the window, and reset."""
        rest = self._smooth_rest()
        self.reset()
        return rest

    def interrupt(self) -> tuple[Estimates, ...]:
        """Flush without reuse of track numbers; see `Engine.interrupt`."""
        rest, before = self._smooth_rest(), self._tracks
        self.reset()
        self._tracks = TrackNumbers(count=before.count, aircraft=before.aircraft)
        return rest

    def save_state(self) -> EngineState:
        """Return the engine's state; see `Engine.save_state`."""
        return EngineState(self.forward.stamp_ns, self.forward.model, self.rule, self._state())

    def reprocess(self, scans: Sequence[tuple[EngineState, Scan]]) -> Reprocessed:
        """Step scans again; see `Engine.reprocess`.

        Filtered estimates of an out-of-sequence stamp are not published: later ones already are.
        """
        before, now = self.save_state(), self._latest_targets()
        numbers, given = self._tracks, self._given_ns
        self._load_state(scans[0][0].state)
        first, earlier = self.forward.scan_index, self._tracks.in_use
        self._tracks = NoNumbers()
        states, steps = [], []
        for tuned, scan in scans:
            self.retune(tuned.model, tuned.rule)
            states.append(self.save_state())
            steps.append(self.step(scan))
        self.retune(before.model, before.rule)
        latest = self._latest_targets()
        known = renumbering.continue_numbers(earlier, numbers.in_use, now, latest, first)
        self._tracks, reach = TrackNumbers(known, numbers.count, numbers.aircraft), self._reach
        filtered, smoothed = [], []
        for step in steps:
            if self.schedule.period_ns:
                due = [found for found in step.filtered if found.stamp_ns > given[0]]
                filtered += [self._tracks.assign(found, reach) for found in due]
            due = [found for found in step.smoothed if found.stamp_ns > given[1]]
            smoothed += [self._tracks.assign(found, reach) for found in due]
        own = {"numbers": self._tracks.in_use}
        states = [replace(each, state={**each.state, **own}) for each in states]
        self._tracks.forget_all_but([entry.stored.label for entry in self._window])
        return Reprocessed(tuple(states), tuple(filtered), tuple(smoothed))

    def _state(self) -> dict[str, Any]:
        """Return the engine's own state, for `_load_state`; see `EngineState`."""
        return {
            "filter": self.forward.save_state(),
            "tracks": self._states.save_state(),
            "numbers": self._tracks.in_use,
            "window": self._window,
            "filtered": self._filtered,
            "stamps": self._stamps,
            "given": self._given_ns,
        }

    def _load_state(self, state: Mapping[str, Any]) -> None:
        """Return to a saved state."""
        self.forward.load_state(state["filter"])
        self._states.load_state(state["tracks"])
        self._tracks = TrackNumbers(dict(state["numbers"]))
        self._window, self._stamps = state["window"], state["stamps"]
        self._filtered, self._given_ns = state["filtered"], state["given"]

    def snapshot(self) -> Snapshot:
        """Return the engine's state; see `Engine.snapshot`."""
        stored = Snapshot(self.forward.stamp_ns)
        self.forward.to_snapshot(stored)
        self._states.to_snapshot(stored)
        self._tracks.to_snapshot(stored)
        window = Window(np.array(self._stamps, dtype=np.int64), len(self._window))
        to_snapshot(window, stored, "window")
        for index, entry in enumerate(self._window):
            self._entry_to_snapshot(entry, stored, f"stored.{index}")
        for stamp_ns, estimates in self._filtered.items():
            to_snapshot(estimates, stored, f"filtered.{stamp_ns}")
        return stored

    def restore(self, snapshot: Snapshot) -> None:
        """Continue from a snapshot; see `Engine.restore`."""
        self.reset()
        try:
            self._from_snapshot(snapshot)
        except Exception as error:  # a foreign snapshot may cause any exception
            self.reset()
            raise ValueError(f"snapshot: {type(error).__name__}: {error}") from error

    def _from_snapshot(self, stored: Snapshot) -> None:
        kept, latest = from_snapshot(Window, stored, "window", {}), stored.stamp_ns
        if latest is not None and not (type(latest) is int and 0 <= latest <= MOST_STAMP_NS):
            raise ValueError(f"stamp_ns: {str(latest)[:40]} given, must be a stamp, nanoseconds")
        if len(kept.stamps_ns) and (latest is None or kept.stamps_ns[-1] > latest):
            raise ValueError(f"window.stamps_ns: end at {kept.stamps_ns[-1]}, after {latest}")
        entries: dict[int, Entry[RowsT, LinkT]] = {}
        for index in range(kept.entries):
            entry = self._entry_from_snapshot(stored, f"stored.{index}", entries)
            if entries and entry.stamp_ns <= max(entries):
                raise ValueError(f"stored.{index}.stamp_ns: must increase")
            entries[entry.stamp_ns] = entry
        self.forward.from_snapshot(stored, entries)
        self._states.from_snapshot(stored)
        self._tracks = TrackNumbers.from_snapshot(stored)
        self._stamps, self._window = kept.stamps_ns.tolist(), list(entries.values())
        modes = self.forward.model.modes
        sizes = {"D": len(modes.space), "C": len(modes.classes)}
        for rows in self.forward.current:
            at, given = rows.entry.stamp_ns, {"lag": 0, "space": modes.space}
            self._filtered[at] = from_snapshot(
                Estimates, stored, f"filtered.{at}", sizes, stamp_ns=at, **given
            )

    def _note_filtered(self, updated: RowsT, scan: Scan) -> None:
        """Store the filtered targets of a scan, and drop those of scans that are fully replaced."""
        current = {rows.entry.stamp_ns for rows in self.forward.current}
        found = self._extract_timed(updated, scan.stamp_ns, 0, self.rule.least)
        reported = self._states.report_filtered(
            found, updated.label, current, scan, self.forward.mapped_model
        )
        every = {**self._filtered, scan.stamp_ns: reported}
        self._filtered = {stamp: kept for stamp, kept in every.items() if stamp in current}

    def _filtered_at(self, stamp_ns: int) -> Estimates:
        """Return the targets to publish for a stamp."""
        whole = self._predict_targets(stamp_ns)
        self._states.note(whole)
        return self._describe_and_number(whole, smoothed=False)

    def _empty(self, stamp_ns: int, lag: int) -> Estimates:
        modes = self.forward.model.modes
        return Estimates.empty(stamp_ns, lag, len(modes.classes), modes.space)

    def _latest_targets(self) -> Estimates:
        """Return the latest targets at the stamp of the last scan; tracks are labels."""
        stamp_ns = self.forward.stamp_ns
        return self._empty(0, 0) if stamp_ns is None else self._predict_targets(stamp_ns)

    def _predict_targets(self, stamp_ns: int) -> Estimates:
        """Return the latest targets predicted to a stamp; tracks are labels."""
        parts = []
        for rows in self.forward.current:
            targets = self._filtered[rows.entry.stamp_ns]
            if rows.rows is not None:
                alive = np.isin(targets.track_id - 1, rows.origin)
                targets = targets.take(np.flatnonzero(alive))
            parts.append(targets)
        found, time_ns = Estimates.concatenate(parts, 0)
        return predict(found, time_ns, stamp_ns, self.forward.model.modes)

    def _describe_and_number(self, found: Estimates, smoothed: bool) -> Estimates:
        """Return targets with their attributes, and with track numbers in the place of labels."""
        if self.forward.attributes is not None:
            found = self.forward.attributes.describe(found, smoothed)
        return self._tracks.assign(found, self._reach)

    @property
    def _reach(self) -> Reach | None:
        """Search limits for aircraft that lost their track; None if no radar reports identities."""
        return Reach.of(self.forward.model)

    def _smooth_rest(self) -> tuple[Estimates, ...]:
        """Smooth all pending stamps with the scans of the window."""
        rest = []
        while self._stamps:
            rest.append(self._smooth_oldest())
        return tuple(rest)

    def _smooth_oldest(self) -> Estimates:
        """Return the targets at the oldest pending stamp, smoothed with all later scans.

        Entries that no later stamp needs are then dropped from the window.
        """
        stamp_ns, lag = self._stamps[0], len(self._stamps) - 1
        modes, threshold = self.forward.model.modes, self.rule.least_smoothed
        alive = self._alive_at(stamp_ns)
        backward = list(self._backward(self._window))[::-1]
        self.forward.done("backward")
        smoothed = dict(zip((entry.stamp_ns for entry in self._window), backward, strict=True))
        if alive.keys() == {stamp_ns}:
            found = self._extract_timed(smoothed[stamp_ns], stamp_ns, lag, threshold)
        elif held := self._interpolation_stamps(stamp_ns, alive):
            parts = [Part(smoothed[part_ns], alive.get(part_ns), part_ns) for part_ns in held]
            every, time_ns = self._extract_all(parts, lag)
            found = at_stamp(every, time_ns, stamp_ns, threshold, modes)
            self.forward.done("extraction")
        else:
            found = self._empty(stamp_ns, lag)
        found = self._states.report_smoothed(found)
        self._given_ns = self._given_ns[0], stamp_ns
        self._stamps = self._stamps[1:]
        self._trim()
        return self._describe_and_number(found, smoothed=True)

    def _alive_at(self, stamp_ns: int) -> dict[int, IntArray | None]:
        """Return the entries with targets at a stamp, by their stamps, and the rows of these.

        Only rows after the stamp continue these rows, if any do; None stands for all rows.
        """
        sources = [rows.source for rows in self.forward.current]
        for entry in self._window:
            if entry.stamp_ns > stamp_ns:
                sources += entry.sources
        alive: dict[int, IntArray | None] = {}
        earlier = {entry.stamp_ns for entry in self._window if entry.stamp_ns <= stamp_ns}
        for source in sources:
            if source.stamp_ns in earlier:
                others, rows = alive.get(source.stamp_ns, NO_ROWS), source.rows
                some = None if others is None or rows is None else np.append(others, rows)
                alive[source.stamp_ns] = some
        return alive

    def _interpolation_stamps(self, stamp_ns: int, alive: Collection[int]) -> list[int]:
        """Return the stamps of the entries to interpolate between, ascending."""
        return [
            entry.stamp_ns
            for entry in self._window
            if entry.stamp_ns in alive
            or (
                entry.stamp_ns > stamp_ns
                and any(source.stamp_ns in alive for source in entry.sources)
            )
        ]

    def _trim(self) -> None:
        """Drop entries that neither the filter nor a pending stamp needs."""
        following = self._stamps[0] if self._stamps else MOST_STAMP_NS
        self._states.forget_before(following)
        needed = {*self._alive_at(following)}
        needed |= {entry.stamp_ns for entry in self._window if entry.stamp_ns >= following}
        self._window = [
            entry if any(source.stamp_ns in needed for source in entry.sources) else entry.unlinked
            for entry in self._window
            if entry.stamp_ns in needed
        ]

    def _extract_timed(self, stored: RowsT, stamp_ns: int, lag: int, threshold: float) -> Estimates:
        """Extract the targets of a set; their tracks are labels."""
        estimates = self._extract(stored, stamp_ns, lag, threshold)
        self.forward.done("extraction")
        return estimates
