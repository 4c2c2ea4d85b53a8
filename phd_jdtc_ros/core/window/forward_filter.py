"""The forward filter: predict, update with every radar, reduce; and the state that it keeps."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, NamedTuple

import numpy as np

from ..arrays import IntArray, contains
from ..factors.state import Factors
from ..gaussian.bounds import Bounds
from ..gaussian.dynamics import Dynamics
from ..gaussian.entries import Entry, Link, UnsweptRows
from ..gaussian.extraction import extract, most_probable_motion
from ..gaussian.mixture import Mixture
from ..gaussian.new_targets import Place, births, placed, spawn
from ..gaussian.prediction import AgedMixture, survivors
from ..gaussian.reduction import Branched, reduce_hypotheses
from ..gaussian.update import GaussianSteps
from ..models.tracker_model import TrackerModel
from ..sensors.view import View
from ..snapshot import MAX_STAMP_NS, Snapshot, from_snapshot, integers, to_snapshot
from ..tracks.confirmation import TrackStates
from ..tracks.track_numbers import MAX_SCANS
from ..types import Estimates, Scan
from .swept import partition_swept, swept_births
from .update import after_scan, layer_of, update_scan
from .window_snapshot import unswept_from_snapshot, unswept_to_snapshot


class Progress(NamedTuple):
    """The filter's part of a snapshot, without its sets."""

    scan_index: Annotated[int, integers("", 0, MAX_SCANS)]  # Index of the next scan
    birth: Annotated[IntArray, integers("B", 0, MAX_SCANS)]  # Birth terms, (B,)
    # Time of an antenna's last pass over each birth term, (B,).
    born_ns: Annotated[IntArray, integers("B", 0, MAX_STAMP_NS)]
    # Stamps of the sets that later scans continue, (Q,).
    unswept_ns: Annotated[IntArray, integers("Q", 0, MAX_STAMP_NS, key="current_ns")]
    entries_kept: Annotated[int, integers("", 0)]  # See `Factors.entries_kept`


@dataclass
class ForwardFilter:
    """The filter over scans, with the mixtures that later scans continue."""

    STATE: ClassVar[tuple[str, ...]] = ("unswept", "stamp_ns", "_born_ns", "_scan_index", "factors")

    model: TrackerModel
    bounds: Bounds
    # Called with the name of each stage of a step when it ends, for timing.
    on_stage_end: Callable[[str], None] = field(default=lambda _: None, kw_only=True)
    # The stamps ascend; the last element has all rows of the last scan's set.
    unswept: list[UnsweptRows] = field(init=False, repr=False)
    stamp_ns: int | None = field(init=False, repr=False)
    _born_ns: dict[int, int] = field(init=False, repr=False)
    _scan_index: int = field(init=False, repr=False)
    factors: Factors = field(init=False, repr=False)
    places: tuple[Place, ...] = field(init=False, default=())  # Where targets begin next scan
    approximate: int = field(init=False, default=0)  # Clusters associated approximately, last step
    floored: int = field(init=False, default=0)  # Covariances raised to their least, last step
    _dynamics: Dynamics | None = field(init=False, default=None, repr=False)
    _looking: list[View] = field(init=False, repr=False)  # `views` after the last update

    def __post_init__(self) -> None:
        self.reset()

    @property
    def scan_index(self) -> int:
        """Index of the next scan; see `labels`."""
        return self._scan_index

    @property
    def dynamics(self) -> Dynamics:
        """The motion modes and cells of the model in use."""
        if self._dynamics is None or self._dynamics.model is not self.model:
            self._dynamics = Dynamics(self.model)
        return self._dynamics

    @property
    def views(self) -> list[View]:
        """What the factors expect of each sensor, at its configured pose."""
        return [self.factors.of_place(sensor) for sensor in self.model.radars]

    @property
    def _configured_factors(self) -> Factors:
        """The factors before anything is learned; sensors without any have an empty tuple."""
        model, remembers = self.model, self.model.detection_births.enabled
        by_sensor = {radar.name: model.factors.get(radar.name, ()) for radar in model.radars}
        configured = Factors.configured(by_sensor, model.attributes, remembers)
        layer = layer_of(model)
        return configured if layer is None else configured.changed(reports=layer)

    @property
    def learned_figures(self) -> Mapping[str, float]:
        """What was learned about the sensors; see `Factors.figures`."""
        return self.factors.figures(self.model.radars)

    def step(self, scan: Scan, linked: bool) -> Entry:
        """Predict, update with every radar and reduce; if `linked`, link to earlier mixtures.

        Labels that no antenna swept in this scan are unchanged, see `swept`. Raise `ValueError` if
        the stamp is not later than the previous one, or no sensor reported.
        """
        dynamics, index = self.dynamics, self._scan_index
        dt = self._since(self.stamp_ns, scan.stamp_ns)
        if dt <= 0.0:
            raise ValueError(f"scan.stamp_ns: {scan.stamp_ns} is not later than {self.stamp_ns}")
        # Births would count the time from a look of nobody.
        if scan.detections and not any(report is not None for report in scan.detections):
            raise ValueError(f"scan.detections: no sensor reported at {scan.stamp_ns} ns")
        reports = self.model.reports(scan)
        swept, others = partition_swept(self.unswept, reports, scan.stamp_ns, self.model)
        aged = [
            AgedMixture(rows.stored, self._since(rows.entry.stamp_ns, scan.stamp_ns))
            for rows in swept
        ]
        parts: list[Mixture] = []
        moves = None
        if aged:
            *parts, moves = survivors(aged, dynamics)
        if born := self._births(reports, scan.stamp_ns):
            parts.append(births(born, dynamics, index))
        if self.places:
            parts.append(placed(self.places, dynamics, index))
            self.places = ()
        if self.model.spawn.rate > 0.0:
            parts.append(spawn(aged, dynamics, index, self.bounds.least_existence))
        predicted = Mixture.concatenate(parts or [dynamics.nothing])
        self.on_stage_end("predict")
        parent = np.arange(len(predicted))
        parent[len(parts[0]) if aged else 0 :] = -1
        parts.clear()  # The update needs the memory.
        branched = Branched(predicted, parent)
        if (layer := self.factors.reports) is not None and scan.self_reports is not None:
            layer = layer.with_reports(scan.self_reports, scan.stamp_ns)
            self.factors = self.factors.changed(reports=layer)
        steps = GaussianSteps(dynamics, self.bounds)
        updated = update_scan(branched, reports, steps, dt, index, self.factors)
        self.factors, self.approximate = updated.factors, updated.approximate
        self.on_stage_end("update")
        self._looking = self.views
        stored, ancestry, self.floored = reduce_hypotheses(updated.rows, self._bounds_of_newborn())
        self.on_stage_end("reduce")
        link = Link(moves, ancestry) if linked and moves is not None else None
        entry = Entry(scan.stamp_ns, stored, tuple(rows.source for rows in swept), link)
        self._keep(entry, others)
        if (layer := self.factors.reports) is not None:
            living = (rows.row_label for rows in self.unswept)
            self.factors = self.factors.changed(
                reports=after_scan(layer, stored, living, scan.stamp_ns)
            )
        return entry

    def report(self, states: TrackStates, scan: Scan) -> Estimates:
        """Return the reported targets of the latest scan; see `TrackStates.report_filtered`.

        Those that no sensor has seen for long have their most probable motion.
        """
        stored = self.unswept[-1].stored
        unswept_ns = [rows.entry.stamp_ns for rows in self.unswept]
        estimates = extract(stored, self.dynamics, scan.stamp_ns, 0, states.rule.least)
        self.on_stage_end("extraction")
        of_tracks = stored.sums.label, unswept_ns, scan, self.model, self._looking
        reported = states.report_filtered(estimates, *of_tracks)
        if not states.unseen.size:
            return reported
        unseen = contains(states.unseen, reported.track_id)
        return most_probable_motion(reported, stored, unseen, self.bounds.merge_distance)

    def reset(self) -> None:
        """Return to the initial state."""
        self.unswept, self.stamp_ns, self._born_ns, self._scan_index = [], None, {}, 0
        self.places = ()
        self.factors = self._configured_factors

    def to_snapshot(self, snapshot: Snapshot) -> None:
        """Store the filter's state, except for the sets themselves, in a snapshot."""
        progress = Progress(
            self._scan_index,
            np.array([*self._born_ns], dtype=np.int64),
            np.array([*self._born_ns.values()], dtype=np.int64),
            np.array([rows.entry.stamp_ns for rows in self.unswept], dtype=np.int64),
            self.factors.entries_kept,
        )
        to_snapshot(progress, snapshot, "filter")
        for rows in self.unswept:
            unswept_to_snapshot(rows, snapshot)
        self.factors.to_snapshot(self.model.radars, snapshot)

    def from_snapshot(self, snapshot: Snapshot, entries: Mapping[int, Entry]) -> None:
        """Restore the filter's state from a snapshot, whose sets are `entries` by stamp.

        Raise `ValueError` if the snapshot does not fit this filter.
        """
        progress, latest = from_snapshot(Progress, snapshot, "filter", {}), snapshot.stamp_ns
        stamps = progress.unswept_ns.tolist()
        for stamp_ns in stamps:
            if stamp_ns not in entries:
                raise ValueError(f"filter.current_ns: {stamp_ns} is none of the stored sets")
        if stamps[-1:] != ([] if latest is None else [latest]):
            raise ValueError(f"filter.current_ns: the last stamp must be {latest}")
        self.unswept = [unswept_from_snapshot(snapshot, entries[stamp]) for stamp in stamps]
        factors = self._configured_factors.restored(snapshot, self.model.radars)
        self.factors = factors.changed(entries_kept=progress.entries_kept)
        born = zip(progress.birth.tolist(), progress.born_ns.tolist(), strict=True)
        self.stamp_ns, self._scan_index, self._born_ns = latest, progress.scan_index, dict(born)

    def _since(self, earlier_ns: int | None, stamp_ns: int) -> float:
        """Return the seconds since an earlier stamp; the nominal interval if there is none."""
        if earlier_ns is None:
            return self.model.modes.interval_s
        return (stamp_ns - earlier_ns) * 1e-9

    def _births(self, reports: Sequence[View], stamp_ns: int) -> list[tuple[int, float]]:
        """Return the birth terms that an antenna passed, and the time since its previous pass."""
        births = []
        for index in swept_births(reports, self.model):
            previous_ns = self._born_ns.get(index, self.stamp_ns)
            births.append((index, self._since(previous_ns, stamp_ns)))
            self._born_ns = {**self._born_ns, index: stamp_ns}
        return births

    def _keep(self, entry: Entry, remaining: Sequence[UnsweptRows]) -> None:
        """Continue from the set of a scan, and from the rows that it did not sweep."""
        self.unswept = [*remaining, UnsweptRows(entry)]
        self.factors = self.factors.of_living(rows.row_label for rows in self.unswept)
        self.stamp_ns, self._scan_index = entry.stamp_ns, self._scan_index + 1

    def _bounds_of_newborn(self) -> Bounds:
        """Return bounds that do not drop every new target; see `least_newborn_mass`."""
        model = self.model
        if not model.detection_births.enabled:
            return self.bounds
        least = min(map(model.least_newborn_mass, self._looking), default=math.inf)
        if least >= model.detection_births.least_mass:
            return self.bounds
        return replace(self.bounds, least_existence=min(self.bounds.least_existence, least))
