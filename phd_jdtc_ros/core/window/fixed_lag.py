"""The engine: a forward filter with a fixed-lag smoother, a schedule and track numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from ..arrays import FloatArray, IntArray, contains
from ..compilation import compile_for
from ..engine import EngineState, Lag, OnFiltered, Paths, Reprocessed, Step, ignore_filtered
from ..gaussian.entries import Entry, UnsweptRows, trim
from ..gaussian.new_targets import Place
from ..gaussian.paths import Samples, moved, sample
from ..gaussian.smoothing.lineages import Lineages
from ..gaussian.smoothing.smoother import extract_at
from ..models.tracker_model import TrackerModel
from ..snapshot import (
    MAX_STAMP_NS,
    Snapshot,
    from_snapshot,
    restore_shared,
    shared_state,
    to_snapshot,
)
from ..tracks import renumbering
from ..tracks.common_stamp import Schedule, predict
from ..tracks.confirmation import TrackStates
from ..tracks.reporting_rule import ReportingRule
from ..tracks.track_numbers import NoNumbers, Reach, TrackNumbers
from ..types import Estimates, Scan
from ..types.clutter_raster import ClutterRaster
from .forward_filter import ForwardFilter
from .window_snapshot import window_from_snapshot, window_to_snapshot

# Key of the track numbers in a saved state.
NUMBERS = "numbers"


@dataclass
class GaussianEngine:
    """Gaussian mixtures of labelled targets with a fixed-lag backward smoother.

    It implements the protocol `Engine`.
    """

    STATE: ClassVar[tuple[str, ...]] = (
        *("forward", "_states", "_window", "_filtered", "_stamps", "_published_ns"),
    )

    forward: ForwardFilter
    lag: Lag
    schedule: Schedule
    rule: ReportingRule  # When tracks are reported
    _states: TrackStates = field(init=False, repr=False)
    _tracks: TrackNumbers = field(init=False, repr=False)
    _window: list[Entry] = field(init=False, repr=False)
    # Rows of each scan that no later scan has swept, and their filtered targets, by stamp; and
    # their expected number of targets of each class, once a later scan needs it.
    _filtered: dict[int, tuple[UnsweptRows, Estimates, FloatArray | None]] = field(
        init=False, repr=False
    )
    _stamps: list[int] = field(init=False, repr=False)  # With pending smoothed estimates
    # Lineages of the window of the last step, which the next step extends.
    _lineages: Lineages = field(init=False, default_factory=Lineages, repr=False)
    # Stamps of the latest filtered and smoothed estimates; -1 before the first.
    _published_ns: tuple[int, int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        compile_for(len(self.forward.model.modes.space))
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        self.forward.reset()
        self._tracks, self._states = TrackNumbers(), TrackStates(self.rule)
        self._window, self._filtered, self._stamps = [], {}, []
        self._published_ns = -1, -1

    def step(self, scan: Scan, on_filtered: OnFiltered = ignore_filtered) -> Step:
        """Filter one scan and smooth the stamps whose lag is reached; see `Engine.step`."""
        filtered = []
        if self.forward.stamp_ns is not None:
            due = self.schedule.between(self.forward.stamp_ns, scan.stamp_ns)
            filtered = [self._filtered_at(stamp_ns) for stamp_ns in due]
        entry = self.forward.step(scan, linked=self.lag.positive)
        window = self._window = [*self._window, entry]
        total = self._note_filtered(scan)
        if not self.schedule.period_ns:
            filtered.append(self._filtered_at(scan.stamp_ns))
        self._stamps = [*self._stamps, *[estimates.stamp_ns for estimates in filtered]]
        if filtered:
            self._published_ns = filtered[-1].stamp_ns, self._published_ns[1]
            on_filtered(tuple(filtered))
        smoothed = []
        while self.lag.reached(self._stamps):
            smoothed.append(self._smooth_oldest())
        if self._window is not window:
            self._forget_dropped(scan.stamp_ns)
        figures = {
            "hypotheses": len(entry.stored),
            "origins": len(entry.label),
            "approximate_clusters": self.forward.approximate,
            "floored_covariances": self.forward.floored,
            **self.forward.learned_figures,
        }
        return Step(tuple(filtered), tuple(smoothed), total, figures)

    def clutter_raster(self) -> ClutterRaster | None:
        """Return the learned clutter density; see `Engine.clutter_raster`."""
        return self.forward.factors.clutter_raster(self.forward.model.radars)

    @property
    def track_count(self) -> int:
        """The latest track number; see `Engine.track_count`."""
        return self._tracks.count

    def start_track(self, position: tuple[float, float], velocity: tuple[float, float]) -> None:
        """Begin a track with the next scan; see `Engine.start_track`."""
        self.forward.places += (Place(position, velocity),)

    def paths(
        self, tracks: IntArray, interval_s: float, steps: int, count: int, rng: np.random.Generator
    ) -> Paths | None:
        """Return paths of some tracks; see `Engine.paths`."""
        dynamics, number, wanted = self.forward.dynamics, self._tracks.in_use, {*tracks.tolist()}
        modes, now_ns = dynamics.model.modes, self.forward.stamp_ns or 0
        found: list[int] = []
        parts: list[Samples] = []
        for rows in self.forward.unswept:
            mixture, own = rows.stored, []
            for label in mixture.sums.label.tolist():
                track = number.get(label + 1, 0)
                if track in wanted:
                    # Two labels of one aircraft share a number; one of them will do.
                    wanted.remove(track)
                    found.append(track)
                    own.append(sample(mixture, label, dynamics, count, rng))
            if own:
                age_s = (now_ns - rows.entry.stamp_ns) * 1e-9
                parts.append(moved(Samples.concatenate(own), age_s, modes, rng))
        place = np.full((len(found), count, steps + 1, 3), np.nan)
        if not found:
            return Paths(np.zeros(0, dtype=np.int64), place)
        axes, samples = list(modes.space.place), Samples.concatenate(parts)
        for step in range(steps + 1):
            samples = moved(samples, interval_s if step else 0.0, modes, rng)
            place[:, :, step, : len(axes)] = samples.state[:, axes].reshape(len(found), count, -1)
        order = np.argsort(found)
        return Paths(np.array(found)[order], place[order])

    def retune(self, model: TrackerModel, rule: ReportingRule) -> None:
        """Use another model and rule from the next scan on; see `Engine.retune`.

        Stored sets and links are not recomputed with the new model.
        """
        self.forward.model = model
        factors = self.forward.factors
        self.forward.factors = factors.retuned(
            model.factors, model.attributes, model.receivers, model.noise_density
        )
        self.rule = self._states.rule = rule

    def flush(self) -> tuple[Estimates, ...]:
        """Return the pending estimates, smoothed with the scans of the window, and begin again."""
        count = self._tracks.count
        pending = tuple(self._smooth_oldest() for _ in self._stamps)
        self.reset()
        self._tracks.count = count
        return pending

    def interrupt(self) -> tuple[Estimates, ...]:
        """Flush, and let known aircraft keep their numbers; see `Engine.interrupt`."""
        aircraft = self._tracks.aircraft
        pending = self.flush()
        self._tracks.aircraft = aircraft
        return pending

    def save_state(self) -> EngineState:
        """Return the engine's state; see `Engine.save_state`."""
        state = {**shared_state(self), NUMBERS: self._tracks.in_use}
        return EngineState(self.forward.stamp_ns, self.forward.model, self.rule, state)

    def reprocess(self, scans: Sequence[tuple[EngineState, Scan]]) -> Reprocessed:
        """Step scans again; see `Engine.reprocess`.

        Filtered estimates of an out-of-sequence stamp are not published: later ones already are.
        """
        state_before, targets_before = self.save_state(), self._latest_targets()
        numbers, state = self._tracks, scans[0][0].state
        filtered_ns, smoothed_ns = self._published_ns
        restore_shared(self, state)
        first, self._tracks = self.forward.scan_index, NoNumbers()
        states, steps = [], []
        for saved_state, scan in scans:
            self.retune(saved_state.model, saved_state.rule)
            states.append(self.save_state())
            steps.append(self.step(scan))
        self.retune(state_before.model, state_before.rule)
        targets_after = self._latest_targets()
        numbers_after = renumbering.continue_numbers(
            state[NUMBERS], numbers.in_use, targets_before, targets_after, first
        )
        self._tracks = TrackNumbers(numbers_after, numbers.count, numbers.aircraft)
        reach = Reach.of(self.forward.model)
        filtered, smoothed = [], []
        for step in steps:
            if self.schedule.period_ns:
                due = [estimates for estimates in step.filtered if estimates.stamp_ns > filtered_ns]
                filtered += [self._tracks.assign(estimates, reach) for estimates in due]
            due = [estimates for estimates in step.smoothed if estimates.stamp_ns > smoothed_ns]
            smoothed += [self._tracks.assign(estimates, reach) for estimates in due]
        tracks_in_use = {NUMBERS: self._tracks.in_use}
        states = [replace(saved, state={**saved.state, **tracks_in_use}) for saved in states]
        self._tracks.forget_all_but(entry.label for entry in self._window)
        return Reprocessed(tuple(states), tuple(filtered), tuple(smoothed))

    def snapshot(self) -> Snapshot:
        """Return the engine's state; see `Engine.snapshot`."""
        stored = Snapshot(self.forward.stamp_ns)
        self.forward.to_snapshot(stored)
        self._states.to_snapshot(stored)
        self._tracks.to_snapshot(stored)
        window_to_snapshot(self._stamps, self._window, stored)
        for stamp_ns, (_, estimates, _) in self._filtered.items():
            to_snapshot(estimates, stored, f"filtered.{stamp_ns}")
        return stored

    def restore(self, snapshot: Snapshot) -> None:
        """Continue from a snapshot; see `Engine.restore`."""
        self.reset()
        try:
            self._from_snapshot(snapshot)
        except Exception as error:  # A foreign snapshot may cause any.
            self.reset()
            raise ValueError(f"snapshot: {type(error).__name__}: {error}") from error

    def _from_snapshot(self, stored: Snapshot) -> None:
        self._stamps, entries = window_from_snapshot(
            stored, self.forward.dynamics, self.forward.bounds.most
        )
        self.forward.from_snapshot(stored, entries)
        self._states.from_snapshot(stored)
        self._tracks = TrackNumbers.from_snapshot(stored)
        self._window = list(entries.values())
        modes = self.forward.model.modes
        sizes = {"D": len(modes.space), "C": len(modes.classes)}
        for rows in self.forward.unswept:
            stamp_ns, constants = rows.entry.stamp_ns, {"lag": 0, "space": modes.space}
            targets = from_snapshot(
                Estimates, stored, f"filtered.{stamp_ns}", sizes, stamp_ns=stamp_ns, **constants
            )
            self._filtered[stamp_ns] = rows, _targets_of(rows, targets), None

    def _forget_dropped(self, stamp_ns: int) -> None:
        """Forget the targets that are in no entry of the window any more."""
        factors = self.forward.factors
        carried = () if factors.reports is None else (factors.reports.labels,)
        self._tracks.forget_all_but((*carried, *(entry.label for entry in self._window)))
        if factors.transponders is not None or factors.reports is not None:
            oldest_ns = self._stamps[0] if self._stamps else stamp_ns
            labels = [entry.label for entry in self._window]
            self.forward.factors = factors.of_labels(labels, oldest_ns)

    def _note_filtered(self, scan: Scan) -> FloatArray:
        """Store the filtered targets of a scan, and drop earlier ones of the rows that it swept.

        Return the expected number of targets of each class, (C,).
        """
        modes = self.forward.model.modes
        *earlier, latest = self.forward.unswept
        reported = self.forward.report(self._states, scan)
        previous, self._filtered = self._filtered, {}
        total = np.zeros(len(modes.classes))
        for rows in earlier:
            unchanged, targets, mass = previous[rows.entry.stamp_ns]
            # Most rows have not changed since the last scan.
            if rows is not unchanged:
                targets, mass = _targets_of(rows, targets), None
            mass = rows.class_mass() if mass is None else mass
            total += mass
            self._filtered[rows.entry.stamp_ns] = rows, targets, mass
        self._filtered[scan.stamp_ns] = latest, reported, None
        return total + latest.stored.class_mass()

    def _filtered_at(self, stamp_ns: int) -> Estimates:
        targets = self._predict_targets(stamp_ns)
        self._states.note(targets)
        return self._describe_and_number(targets, smoothed=False)

    def _empty(self, stamp_ns: int, lag: int) -> Estimates:
        modes = self.forward.model.modes
        return Estimates.empty(stamp_ns, lag, len(modes.classes), modes.space)

    def _latest_targets(self) -> Estimates:
        """Return the latest targets at the last scan's stamp; `track_id` is still label + 1."""
        stamp_ns = self.forward.stamp_ns
        return self._empty(0, 0) if stamp_ns is None else self._predict_targets(stamp_ns)

    def _predict_targets(self, stamp_ns: int) -> Estimates:
        """Return the latest targets predicted to a stamp; `track_id` is still label + 1."""
        parts = [targets for _, targets, _ in self._filtered.values()]
        estimates, time_ns = Estimates.concatenate(parts, 0)
        return predict(estimates, time_ns, stamp_ns, self.forward.model.modes)

    def _describe_and_number(self, estimates: Estimates, smoothed: bool) -> Estimates:
        """Return targets with their attributes, and with track numbers instead of labels."""
        if (transponders := self.forward.factors.transponders) is not None:
            estimates = transponders.describe(estimates, smoothed)
        if (reports := self.forward.factors.reports) is not None:
            estimates = reports.describe(estimates, smoothed)
        if self.forward.model.height_prior is not None:
            if (pressure := self.forward.factors.pressure) is not None:
                estimates = estimates.with_pressure(pressure.mean, pressure.std)
            estimates = estimates.with_heights(self.forward.model.largest_height_std)
        known = estimates.attributes is not None
        return self._tracks.assign(estimates, Reach.of(self.forward.model) if known else None)

    def _smooth_oldest(self) -> Estimates:
        """Return the targets at the oldest pending stamp, smoothed with all later scans.

        Entries that no later stamp needs are then dropped from the window.
        """
        stamp_ns, lag = self._stamps[0], len(self._stamps) - 1
        least = self.rule.least_smoothed
        self._lineages.extend(self._window)
        around = self._lineages.smooth(stamp_ns, least)
        self.forward.on_stage_end("backward")
        estimates = extract_at(self._lineages, around, self.forward.dynamics, stamp_ns, lag, least)
        self.forward.on_stage_end("extraction")
        estimates = self._states.report_smoothed(estimates)
        self._published_ns = self._published_ns[0], stamp_ns
        self._stamps = self._stamps[1:]
        following = self._stamps[0] if self._stamps else MAX_STAMP_NS
        self._states.forget_before(following)
        self._window = trim(self._window, self.forward.unswept, following)
        described = self._describe_and_number(estimates, smoothed=True)
        self._lineages.drop_before(self._window[0].stamp_ns)  # The next scan needs the memory.
        return described


def _targets_of(rows: UnsweptRows, targets: Estimates) -> Estimates:
    """Return those of an entry's filtered targets whose rows are still unswept."""
    if rows.rows is None:
        return targets
    label = rows.row_label  # A copy, because it is of selected rows
    label.sort()
    return targets.select(contains(label, targets.track_id - 1))
