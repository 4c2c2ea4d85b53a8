"""What every forward filter keeps from scan to scan, whatever its rows are."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic

from ..attributes.memory import AttributeMemory
from ..attributes.stored import put_attributes, take_attributes
from ..models.clutter_learning import ClutterMemory
from ..models.tracker_model import TrackerModel
from ..snapshot import MOST_STAMP_NS, Snapshot, whole
from ..types import Scan
from . import window_snapshot
from .clutter_snapshot import put_clutter, take_clutter
from .entries import Current, Entry, LinkT, RowsT
from .swept import births_passed

# Origins are numbered by scan and must fit 64 bits: 6000 years of a scan a second.
MOST_SCANS = 1 << 37


def _ignore(part: str) -> None:
    """Do nothing when a part is done."""


@dataclass(frozen=True)
class Filtered(Generic[RowsT, LinkT]):
    """The result of one step of a filter.

    Parameters
    ----------
    updated : Rows
        After the update with all radars; the filtered targets are extracted from it.
    entry : Entry
        What is kept: the set after its reduction, and its link to earlier sets.
    earlier : tuple of Entry
        Those it is linked to, which the step may have replaced by others of the same stamps.
    """

    updated: RowsT
    entry: Entry[RowsT, LinkT]
    earlier: tuple[Entry[RowsT, LinkT], ...]


@dataclass
class ForwardFilter(ABC, Generic[RowsT, LinkT]):
    """A filter over scans; keeps the sets that later scans continue.

    Parameters
    ----------
    model : TrackerModel
    done : callable
        Called with the name of each part of a step when it is done; for timing.
    """

    model: TrackerModel
    done: Callable[[str], None] = field(default=_ignore, kw_only=True)
    # By ascending stamp; the last one is all of the last scan's set.
    current: list[Current[RowsT, LinkT]] = field(init=False, repr=False)
    stamp_ns: int | None = field(init=False, repr=False)
    _born_ns: dict[int, int] = field(init=False, repr=False)
    _scan_index: int = field(init=False, repr=False)
    clutter: ClutterMemory = field(init=False, repr=False)
    # None where no radar reports identities or heights.
    attributes: AttributeMemory | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.reset()

    @property
    def scan_index(self) -> int:
        """Index of the next scan; see `labels`."""
        return self._scan_index

    @property
    def mapped_model(self) -> TrackerModel:
        """The model, with the maps of clutter that its radars have learned."""
        return self.clutter.mapped(self.model)

    @abstractmethod
    def step(self, scan: Scan, linked: bool) -> Filtered[RowsT, LinkT]:
        """Predict and update with every radar; if `linked`, link the new set to earlier ones.

        Origins that no antenna passed in this scan are left as they are, see `swept`. The new set
        is handed to `_keep`.

        Raises
        ------
        ValueError
            If the stamp is not later than the previous one, see `_interval`.
        """

    def reset(self) -> None:
        """Return to the initial state."""
        self.current, self.stamp_ns, self._born_ns, self._scan_index = [], None, {}, 0
        self.clutter = ClutterMemory()
        known = self.model.attributes
        self.attributes = None if known is None else AttributeMemory(known)

    def hold(self) -> dict[str, Any]:
        """Return the filter's state, for `recall`; the sets are not copied."""
        return {
            "current": tuple(self.current),
            "stamp_ns": self.stamp_ns,
            "born_ns": dict(self._born_ns),
            "scan_index": self._scan_index,
            "clutter": self.clutter.copy(),
            "attributes": None if self.attributes is None else self.attributes.copy(),
        }

    def recall(self, held: Mapping[str, Any]) -> None:
        """Return to a state that was held."""
        self.current, self.stamp_ns = list(held["current"]), held["stamp_ns"]
        self._born_ns, self._scan_index = dict(held["born_ns"]), held["scan_index"]
        self.clutter = held["clutter"].copy()
        known = held["attributes"]
        self.attributes = None if known is None else known.copy()

    def start_from(self, stamp_ns: int, stored: RowsT) -> None:
        """Use `stored` as the set of an earlier scan."""
        self.stamp_ns, self.current = stamp_ns, [Current(Entry(stamp_ns, stored))]

    def put(self, into: Snapshot) -> None:
        """Store the filter's state, except for the sets themselves, in a snapshot."""
        into.facts["filter"] = {
            "scan_index": self._scan_index,
            "born_ns": [list(pair) for pair in self._born_ns.items()],
            "current_ns": [rows.entry.stamp_ns for rows in self.current],
        }
        for rows in self.current:
            window_snapshot.put_current(into, rows)
        put_clutter(into, self.clutter, self.model.radars)
        if self.attributes is not None:
            put_attributes(into, self.attributes)

    def take(self, stored: Snapshot, entries: Mapping[int, Entry[RowsT, LinkT]]) -> None:
        """Restore the filter's state from a snapshot.

        Parameters
        ----------
        stored : Snapshot
        entries : mapping of stamp to Entry
            The sets that the snapshot holds.

        Raises
        ------
        ValueError
            If the snapshot is not of such a filter.
        """
        facts = stored.facts["filter"]
        current = []
        for stamp_ns in facts["current_ns"]:
            if stamp_ns not in entries:
                raise ValueError(f"current_ns: {stamp_ns} is none of the stored sets")
            current.append(window_snapshot.take_current(stored, entries[stamp_ns]))
        latest = None
        if stored.stamp_ns is not None:
            latest = whole("stamp_ns", stored.stamp_ns, 0, MOST_STAMP_NS)
        if (latest is None) != (not current) or (current and current[-1].entry.stamp_ns != latest):
            raise ValueError(f"current_ns: do not end at {latest}")
        index = whole("scan_index", facts["scan_index"], 0, MOST_SCANS)
        born = {
            whole("birth", term, 0, MOST_SCANS): whole("born_ns", stamp, 0, MOST_STAMP_NS)
            for term, stamp in facts["born_ns"]
        }
        clutter = take_clutter(stored, self.model.radars)
        attributes = None
        if self.model.attributes is not None:
            attributes = take_attributes(stored, self.model.attributes)
        self.current, self.stamp_ns, self._scan_index = current, latest, index
        self.clutter, self.attributes = clutter, attributes
        self._born_ns = born

    def _interval(self, scan: Scan) -> float:
        """Return the seconds from the previous scan to this one; raises ValueError if it is not."""
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
        """Return the birth terms that an antenna passed, and the time since it last did."""
        births = []
        for index in births_passed(scan, self.model):
            earlier = self._born_ns.get(index, self.stamp_ns)
            births.append((index, self._since(earlier, scan.stamp_ns)))
            self._born_ns[index] = scan.stamp_ns
        return births

    def _keep(self, entry: Entry[RowsT, LinkT], others: Sequence[Current[RowsT, LinkT]]) -> None:
        """Continue from the set of a scan, and from the rows that it did not touch."""
        self.current = [*others, Current(entry)]
        self.stamp_ns, self._scan_index = entry.stamp_ns, self._scan_index + 1
