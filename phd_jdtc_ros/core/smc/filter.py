# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The forward filter (Sec. IV-C, Steps 1 to 3): predict, update with every radar, resample."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..models.tracker_model import TrackerModel
from ..snapshot import MOST_STAMP_NS, Snapshot, whole
from ..types import Scan
from . import backward_kernel, snapshot
from .backward_kernel import Transition
from .budget import ParticleBudget
from .correction import Corrector
from .particle_set import ParticleSet
from .prediction import predict
from .resampling import resample
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
    stored : ParticleSet
        After resampling.
    link : Transition or None
        Backward kernel to the stored set of the previous scan; None on the first scan and without
        smoothing.
    """

    updated: ParticleSet
    stored: ParticleSet
    link: Transition | None


@dataclass
class ForwardFilter:
    """The filter over scans; keeps the last stored set and the random generator.

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
    _latest: tuple[int, ParticleSet] | None = field(init=False, repr=False)
    _rng: np.random.Generator = field(init=False, repr=False)
    _scan_index: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Return to the initial state; the random generator starts from the seed again."""
        self._latest = None
        self._rng = np.random.default_rng([self.seed, FILTER_STREAM])
        self._scan_index = 0

    def start_from(self, stamp_ns: int, stored: ParticleSet) -> None:
        """Use `stored` as the set of an earlier scan."""
        self._latest = (stamp_ns, stored)

    def step(self, scan: Scan, linked: bool) -> Filtered:
        """Predict, update with every radar and resample; if `linked`, build the backward kernel.

        Raises
        ------
        ValueError
            If the stamp is not later than the previous one.

        Notes
        -----
        Sec. IV-C, Steps 1 to 3, and the kernel of Step 4.
        """
        model, corrector, index, rng = self.model, self.corrector, self._scan_index, self._rng
        earlier, dt = self._earlier(scan.stamp_ns)
        predicted = predict(earlier, model, corrector, self.budget, dt, index, rng)
        self.done("predict")
        updated, newborns = update_scan(predicted, scan, model, corrector, dt, index, rng)
        self.done("update")
        stored = resample(updated, model.modes, self.budget, rng)
        self.done("resample")
        link = None
        if linked and self._latest is not None:
            link = backward_kernel.build(earlier, stored, model, corrector, dt, newborns)
            self.done("transition")
        self._latest, self._scan_index = (scan.stamp_ns, stored), index + 1
        return Filtered(updated, stored, link)

    @property
    def stamp_ns(self) -> int | None:
        """Stamp of the last scan; None before the first."""
        return None if self._latest is None else self._latest[0]

    @property
    def stored(self) -> ParticleSet:
        """The last stored set; empty before the first scan."""
        if self._latest is None:
            return ParticleSet.empty(len(self.model.modes.space))
        return self._latest[1]

    def put(self, into: Snapshot) -> None:
        """Store the filter's state in a snapshot."""
        into.facts["filter"] = {
            "scan_index": self._scan_index,
            "rng": self._rng.bit_generator.state,
        }
        if self._latest is not None:
            snapshot.put_particles(into, "latest", self._latest[1])

    def take(self, stored: Snapshot) -> None:
        """Restore the filter's state from a snapshot.

        Raises
        ------
        ValueError
            If the snapshot is not of such a filter.
        """
        facts = stored.facts["filter"]
        latest = None
        if stored.stamp_ns is not None:
            latest = (
                whole("stamp_ns", stored.stamp_ns, 0, MOST_STAMP_NS),
                snapshot.take_particles(stored, "latest", self.model.modes, self.budget.most),
            )
        index = whole("scan_index", facts["scan_index"], 0, MOST_SCANS)
        self._rng.bit_generator.state = facts["rng"]
        self._latest, self._scan_index = latest, index

    def _earlier(self, stamp_ns: int) -> tuple[ParticleSet, float]:
        """Return the stored set of the previous scan and the interval since, in seconds."""
        if self.stamp_ns is None:
            return self.stored, self.model.modes.interval_s
        if stamp_ns <= self.stamp_ns:
            raise ValueError(f"scan.stamp_ns: {stamp_ns} is not later than {self.stamp_ns}")
        return self.stored, (stamp_ns - self.stamp_ns) * 1e-9
