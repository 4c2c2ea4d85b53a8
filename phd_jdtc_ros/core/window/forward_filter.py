"""The forward filter of an engine, and the state that it keeps from scan to scan."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Generic, NamedTuple

import numpy as np

from ..arrays import IntArray
from ..attributes.memory import AttributeMemory
from ..models.sensor_memory import SensorMemory
from ..models.tracker_model import TrackerModel
from ..snapshot import MAX_STAMP_NS, Snapshot, from_snapshot, integers, to_snapshot
from ..tracks.labels import MAX_SCANS
from ..types import Scan
from .entries import Entry, LinkT, RowsT, UnsweptRows
from .sensor_snapshot import sensors_from_snapshot, sensors_to_snapshot
from .swept import swept_births
from .window_snapshot import unswept_from_snapshot, unswept_to_snapshot


def _ignore(stage: str) -> None:
    """Ignore the end of a stage."""


class Progress(NamedTuple):
    """The filter's part of a snapshot, without its sets."""

    scan_index: Annotated[int, integers("", 0, MAX_SCANS)]  # Index of the next scan
    birth: Annotated[IntArray, integers("B", 0, MAX_SCANS)]  # Birth terms, (B,)
    # Time of an antenna's last pass over each birth term, (B,).
    born_ns: Annotated[IntArray, integers("B", 0, MAX_STAMP_NS)]
    # Stamps of the sets that later scans continue, (Q,).
    unswept_ns: Annotated[IntArray, integers("Q", 0, MAX_STAMP_NS, key="current_ns")]


@dataclass(frozen=True)
class Filtered(Generic[RowsT, LinkT]):
    """The result of one step of a filter."""

    # The set after the update with all radars, from which the filtered targets are extracted.
    updated: RowsT
    entry: Entry[RowsT, LinkT]  # The entry to keep: the reduced set, and its link to earlier sets
    # Earlier entries that the step has changed; they replace those of the same stamps.
    replaced: tuple[Entry[RowsT, LinkT], ...] = ()


@dataclass
class ForwardFilter(ABC, Generic[RowsT, LinkT]):
    """A filter over scans, with the sets that later scans continue."""

    STATE: ClassVar[tuple[str, ...]] = (
        "unswept",
        "stamp_ns",
        "_born_ns",
        "_scan_index",
        "attributes",
        "sensors",
    )

    model: TrackerModel
    # Called with the name of each stage of a step when it ends, for timing.
    on_stage_end: Callable[[str], None] = field(default=_ignore, kw_only=True)
    # The stamps ascend; the last element has all rows of the last scan's set.
    unswept: list[UnsweptRows[RowsT, LinkT]] = field(init=False, repr=False)
    stamp_ns: int | None = field(init=False, repr=False)
    _born_ns: dict[int, int] = field(init=False, repr=False)
    _scan_index: int = field(init=False, repr=False)
    sensors: SensorMemory = field(init=False, repr=False)
    # None if no radar reports identities or heights.
    attributes: AttributeMemory | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.reset()

    @property
    def scan_index(self) -> int:
        """Index of the next scan; see `labels`."""
        return self._scan_index

    @property
    def labelled(self) -> bool:
        """Whether the rows of one label are at most one target."""
        return True

    @property
    def learned_model(self) -> TrackerModel:
        """The model, with the learned values of its sensors."""
        return self.sensors.with_learned_sensors(self.model)

    @property
    def learned_figures(self) -> Mapping[str, float]:
        """Learned detection probabilities and noise; see `SensorMemory.figures`."""
        return self.sensors.figures(self.model.radars)

    @abstractmethod
    def step(self, scan: Scan, linked: bool) -> Filtered[RowsT, LinkT]:
        """Predict and update with every radar; if `linked`, link the new set to earlier ones.

        Labels that no antenna swept in this scan are unchanged, see `swept`. Implementations pass
        the new set to `_keep`.

        Raises
        ------
        ValueError
            If the stamp is not later than the previous one, see `_interval`.
        """

    def reset(self) -> None:
        """Return to the initial state."""
        self.unswept, self.stamp_ns, self._born_ns, self._scan_index = [], None, {}, 0
        self.sensors = SensorMemory.of(self.model, self.labelled)
        attribute_model = self.model.attributes
        self.attributes = None if attribute_model is None else AttributeMemory(attribute_model)

    def start_from(self, stamp_ns: int, stored: RowsT) -> None:
        """Use `stored` as the set of an earlier scan."""
        self.stamp_ns, self.unswept = stamp_ns, [UnsweptRows(Entry(stamp_ns, stored))]

    def to_snapshot(self, snapshot: Snapshot) -> None:
        """Store the filter's state, except for the sets themselves, in a snapshot."""
        progress = Progress(
            self._scan_index,
            np.array([*self._born_ns], dtype=np.int64),
            np.array([*self._born_ns.values()], dtype=np.int64),
            np.array([rows.entry.stamp_ns for rows in self.unswept], dtype=np.int64),
        )
        to_snapshot(progress, snapshot, "filter")
        for rows in self.unswept:
            unswept_to_snapshot(rows, snapshot)
        sensors_to_snapshot(self.sensors, self.model.radars, snapshot)
        if self.attributes is not None:
            self.attributes.to_snapshot(snapshot)

    def from_snapshot(self, snapshot: Snapshot, entries: Mapping[int, Entry[RowsT, LinkT]]) -> None:
        """Restore the filter's state from a snapshot.

        Parameters
        ----------
        entries : mapping of stamp to Entry
            The sets that the snapshot holds.

        Raises
        ------
        ValueError
            If the snapshot does not fit this filter.
        """
        progress, latest = from_snapshot(Progress, snapshot, "filter", {}), snapshot.stamp_ns
        stamps = progress.unswept_ns.tolist()
        for stamp_ns in stamps:
            if stamp_ns not in entries:
                raise ValueError(f"filter.current_ns: {stamp_ns} is none of the stored sets")
        if stamps[-1:] != ([] if latest is None else [latest]):
            raise ValueError(f"filter.current_ns: the last stamp must be {latest}")
        self.unswept = [unswept_from_snapshot(snapshot, entries[stamp]) for stamp in stamps]
        self.sensors = sensors_from_snapshot(snapshot, self.model.radars, self.labelled)
        if self.model.attributes is not None:
            self.attributes = AttributeMemory.from_snapshot(snapshot, self.model.attributes)
        born = zip(progress.birth.tolist(), progress.born_ns.tolist(), strict=True)
        self.stamp_ns, self._scan_index, self._born_ns = latest, progress.scan_index, dict(born)

    def _interval(self, scan: Scan) -> float:
        """Return the seconds since the previous scan; raises ValueError if not positive."""
        dt = self._since(self.stamp_ns, scan.stamp_ns)
        if dt <= 0.0:
            raise ValueError(f"scan.stamp_ns: {scan.stamp_ns} is not later than {self.stamp_ns}")
        return dt

    def _since(self, earlier_ns: int | None, stamp_ns: int) -> float:
        """Return the seconds since an earlier stamp; the nominal interval if there is none."""
        if earlier_ns is None:
            return self.model.modes.interval_s
        return (stamp_ns - earlier_ns) * 1e-9

    def _births(self, scan: Scan) -> list[tuple[int, float]]:
        """Return the birth terms that an antenna passed, and the time since its previous pass."""
        births = []
        for index in swept_births(scan, self.model):
            previous_ns = self._born_ns.get(index, self.stamp_ns)
            births.append((index, self._since(previous_ns, scan.stamp_ns)))
            self._born_ns = {**self._born_ns, index: scan.stamp_ns}
        return births

    def _keep(
        self, entry: Entry[RowsT, LinkT], remaining: Sequence[UnsweptRows[RowsT, LinkT]]
    ) -> None:
        """Continue from the set of a scan, and from the rows that it did not sweep."""
        self.unswept = [*remaining, UnsweptRows(entry)]
        self.sensors.forget_ended(rows.row_label for rows in self.unswept)
        self.stamp_ns, self._scan_index = entry.stamp_ns, self._scan_index + 1
