# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The forward filter: predict, update with every radar, resample, scan after scan."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..models.tracker_model import TrackerModel
from ..types import Scan
from . import backward_kernel
from .backward_kernel import Transition
from .budget import ParticleBudget
from .particle_set import ParticlePHD
from .prediction import predict
from .resampling import resample
from .snapshot import Snapshot
from .update import update_scan

# Second word of the seed, so that no other purpose shares these draws.
FILTER_STREAM = 2


@dataclass(frozen=True)
class Filtered:
    """What one scan made of the intensity.

    Parameters
    ----------
    updated : ParticlePHD
        After all radars; the filtered targets are read off it.
    stored : ParticlePHD
        Resampled.
    link : Transition or None
        From the stored set of the scan before; None on the first scan and where nobody smooths.
    """

    updated: ParticlePHD
    stored: ParticlePHD
    link: Transition | None


@dataclass
class ForwardFilter:
    """The PHD filter over scans; keeps the last stored set and the random generator.

    Parameters
    ----------
    model : TrackerModel
    budget : ParticleBudget
    seed : int
    """

    model: TrackerModel
    budget: ParticleBudget
    seed: int
    _latest: tuple[int, ParticlePHD] | None = field(init=False, repr=False)
    _rng: np.random.Generator = field(init=False, repr=False)
    _scan_index: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything; the random generator starts from the seed again."""
        self._latest = None
        # Marked as the filter's: a simulation of the same seed must not share its draws.
        self._rng = np.random.default_rng([self.seed, FILTER_STREAM])
        self._scan_index = 0

    def step(self, scan: Scan, linked: bool) -> Filtered:
        """Predict, update with every radar, resample; build the link backward if wanted.

        Raises
        ------
        ValueError
            If the stamp is not later than the one before.
        """
        model, rng = self.model, self._rng
        earlier, dt = self._earlier(scan.stamp_ns)
        predicted = predict(earlier, model, self.budget, dt, self._scan_index, rng)
        updated, found = update_scan(predicted, scan, model, dt, self._scan_index, rng)
        stored = resample(updated, model.modes, self.budget, rng)
        first = self._latest is None
        link = None
        if linked and not first:
            link = backward_kernel.build(earlier, stored, model, dt, found)
        self._latest = (scan.stamp_ns, stored)
        self._scan_index += 1
        return Filtered(updated, stored, link)

    def put(self, snapshot: Snapshot) -> None:
        """Store what the filter holds."""
        snapshot.facts["filter"] = {
            "stamp_ns": None if self._latest is None else self._latest[0],
            "scan_index": self._scan_index,
            "rng": self._rng.bit_generator.state,
        }
        if self._latest is not None:
            snapshot.put_particles("latest", self._latest[1])

    def take(self, snapshot: Snapshot) -> None:
        """Go on from what was stored."""
        facts = snapshot.facts["filter"]
        latest = None
        if facts["stamp_ns"] is not None:
            latest = (int(facts["stamp_ns"]), snapshot.particles("latest"))
        self._rng.bit_generator.state = facts["rng"]
        self._latest, self._scan_index = latest, int(facts["scan_index"])

    def _earlier(self, stamp_ns: int) -> tuple[ParticlePHD, float]:
        """Return the stored set of the scan before and the interval since, in seconds."""
        if self._latest is None:
            return ParticlePHD.empty(self.model.state_size), self.model.modes.interval_s
        latest_ns, stored = self._latest
        if stamp_ns <= latest_ns:
            raise ValueError(f"scan.stamp_ns: {stamp_ns} is not later than {latest_ns}")
        return stored, (stamp_ns - latest_ns) * 1e-9
