# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The forward filter (Sec. IV-C, Steps 1 to 3): predict, update with every radar, resample."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from ..models.tracker_model import TrackerModel
from ..snapshot import MOST_STAMP_NS, Snapshot, whole
from ..types import Scan
from . import backward_kernel, snapshot
from .budget import ParticleBudget
from .correction import Corrector
from .entry import Current, Entry
from .guidance import places
from .initiation import informed
from .particle_set import Aged, ParticleSet
from .prediction import predict
from .resampling import resample
from .touch import births_passed, parted
from .update import update_scan

# Second word of the seed, so that the filter's stream is independent of all others. With a shared
# stream, a simulation with the same seed would be correlated with the filter.
FILTER_STREAM = 2
# Origins are numbered by scan and must fit 64 bits: 6000 years of a scan a second.
MOST_SCANS = 1 << 37


def _ignore(part: str) -> None:
    """Do nothing when a part is done."""


@dataclass(frozen=True)
class Filtered:
    """The result of one step of the filter.

    Parameters
    ----------
    updated : ParticleSet
        After the update with all radars; the filtered targets are extracted from it.
    entry : Entry
        What is kept: the set after resampling, and its link to earlier sets.
    earlier : tuple of Entry
        Those it is linked to; their newborn targets may have been drawn again, see `initiation`.
    """

    updated: ParticleSet
    entry: Entry
    earlier: tuple[Entry, ...]


@dataclass
class ForwardFilter:
    """The filter over scans; keeps the sets that later scans continue and the random generator.

    Parameters
    ----------
    model : TrackerModel
    corrector : Corrector
    budget : ParticleBudget
    seed : int
    done : callable
        Called with the name of each part of a step when it is done; for timing.
    """

    model: TrackerModel
    corrector: Corrector
    budget: ParticleBudget
    seed: int
    done: Callable[[str], None] = _ignore
    current: list[Current] = field(init=False, repr=False)
    stamp_ns: int | None = field(init=False, repr=False)
    _born_ns: dict[int, int] = field(init=False, repr=False)
    _rng: np.random.Generator = field(init=False, repr=False)
    _scan_index: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Return to the initial state; the random generator starts from the seed again."""
        self.current, self.stamp_ns, self._born_ns = [], None, {}
        self._rng = np.random.default_rng([self.seed, FILTER_STREAM])
        self._scan_index = 0

    def start_from(self, stamp_ns: int, stored: ParticleSet) -> None:
        """Use `stored` as the set of an earlier scan."""
        self.stamp_ns, self.current = stamp_ns, [Current(Entry(stamp_ns, stored))]

    def step(self, scan: Scan, linked: bool) -> Filtered:
        """Predict, update with every radar and resample; if `linked`, build the backward kernel.

        Origins that no antenna passed in this scan are left as they are.

        Raises
        ------
        ValueError
            If the stamp is not later than the previous one.

        Notes
        -----
        Sec. IV-C, Steps 1 to 3, and the kernel of Step 4.
        """
        model, corrector, index, rng = self.model, self.corrector, self._scan_index, self._rng
        dt = self._since(self.stamp_ns, scan.stamp_ns)
        if dt <= 0.0:
            raise ValueError(f"scan.stamp_ns: {scan.stamp_ns} is not later than {self.stamp_ns}")
        touched, others = parted(self.current, scan, model, corrector)
        seen = places(scan, model)
        if corrector.labelled:
            touched = informed(touched, scan.stamp_ns, seen, model, rng)
        budget = self.budget.beside(sum(rows.copies for rows in others))
        earlier = [
            Aged(rows.particles, self._since(rows.entry.stamp_ns, scan.stamp_ns))
            for rows in touched
        ]
        births = self._births(scan)
        predicted = predict(earlier, births, seen, model, corrector, budget, index, rng)
        self.done("predict")
        updated, newborns = update_scan(predicted, scan, model, corrector, dt, index, rng)
        self.done("update")
        stored = resample(updated, model.modes, budget, rng)
        self.done("resample")
        link = None
        if linked and earlier:
            link = backward_kernel.build_joint(earlier, stored, model, corrector, newborns)
            self.done("transition")
        sources = tuple(rows.source for rows in touched)
        entry = Entry(scan.stamp_ns, stored, sources, link)
        self.current = [*others, Current(entry)]
        self.stamp_ns, self._scan_index = scan.stamp_ns, index + 1
        return Filtered(updated, entry, tuple(rows.entry for rows in touched))

    @property
    def stored(self) -> ParticleSet:
        """The set of the last scan; empty before the first."""
        if not self.current:
            return ParticleSet.empty(len(self.model.modes.space))
        return self.current[-1].entry.stored

    def put(self, into: Snapshot) -> None:
        """Store the filter's state, except for the sets themselves, in a snapshot."""
        into.facts["filter"] = {
            "scan_index": self._scan_index,
            "rng": self._rng.bit_generator.state,
            "born_ns": [list(pair) for pair in self._born_ns.items()],
            "current_ns": [rows.entry.stamp_ns for rows in self.current],
        }
        for rows in self.current:
            if rows.rows is not None:
                into.arrays[f"current.{rows.entry.stamp_ns}"] = rows.rows

    def take(self, stored: Snapshot, entries: Mapping[int, Entry]) -> None:
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
            current.append(snapshot.take_current(stored, entries[stamp_ns]))
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
        self._rng.bit_generator.state = facts["rng"]
        self.current, self.stamp_ns, self._scan_index = current, latest, index
        self._born_ns = born

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
