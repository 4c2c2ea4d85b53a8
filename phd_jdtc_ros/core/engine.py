# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The tracker's engine: scans in, filtered and lagged smoothed estimates out.

This is the one place that holds state: the window of stored sets with their cached transitions,
and the random generator.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from . import filter as phd_filter
from . import transition
from .extraction import Extraction
from .model import ParticleBudget, TrackerModel
from .prediction import predict
from .smoother import DeathTerm, backward_pass
from .snapshot import Snapshot
from .track_numbers import TrackNumbers
from .transition import Transition
from .types import Estimates, FloatArray, ParticlePHD, Scan

# Second words of the seeds, so that what is drawn for one purpose says nothing of another.
EXTRACTION_STREAM, FILTER_STREAM = 1, 2


@dataclass(frozen=True)
class Step:
    """What one scan brought.

    Parameters
    ----------
    filtered : Estimates
    smoothed : tuple of Estimates
        Those whose lag is reached: with a lag in scans one, none while the window fills.
    class_mass : array of shape (C,)
        Expected number of targets of each class after the update.
    particles : int
        Rows of the stored set.
    effective_sample_size : float
        Of the stored set.
    orphans : int
        See `Transition`.
    """

    filtered: Estimates
    smoothed: tuple[Estimates, ...]
    class_mass: FloatArray
    particles: int
    effective_sample_size: float
    orphans: int


class Engine(Protocol):
    """What a node needs of a tracker, whatever it is made of."""

    def step(self, scan: Scan) -> Step:
        """Take in one scan; stamps must increase."""
        ...

    def flush(self) -> tuple[Estimates, ...]:
        """Return the smoothed estimates still held back, oldest first, and reset."""
        ...

    def interrupt(self) -> tuple[Estimates, ...]:
        """Do as `flush`, but give tracks found from now on numbers that no other has had."""
        ...

    def retune(self, model: TrackerModel, existence_threshold: float) -> None:
        """Go by another model of equal structure and another threshold from the next scan on."""
        ...

    def reset(self) -> None:
        """Forget everything, as if newly made."""
        ...


@dataclass(frozen=True)
class Lag:
    """How long estimates are held back for smoothing.

    Parameters
    ----------
    scans : int
        Used unless `seconds` is set.
    seconds : float or None
        For radars without a common scan: a stamp is smoothed once one at least this much later
        has come.
    """

    scans: int
    seconds: float | None = None

    def reached(self, stamps_ns: list[int]) -> bool:
        """Return whether the first of the window's ascending stamps has waited long enough."""
        if self.seconds is None:
            return len(stamps_ns) > self.scans
        return stamps_ns[-1] - stamps_ns[0] >= self.seconds * 1e9


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
        updated, found = phd_filter.update_scan(predicted, scan, model, dt, self._scan_index, rng)
        stored = phd_filter.resample(updated, model.modes, self.budget, rng)
        first = self._latest is None
        link = None
        if linked and not first:
            link = transition.build(earlier, stored, model, dt, found)
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


@dataclass
class FixedLagSmoother:
    """SMC PHD filter with a fixed-lag backward smoother over the general mode.

    Parameters
    ----------
    forward : ForwardFilter
    lag : Lag
    death_term : DeathTerm
    extraction : Extraction
    existence_threshold : float
        Probability of existence above which a target is reported.
    """

    forward: ForwardFilter
    lag: Lag
    death_term: DeathTerm
    extraction: Extraction
    existence_threshold: float
    _tracks: TrackNumbers = field(init=False, repr=False)
    _stamps: list[int] = field(init=False, repr=False)
    _stored: list[ParticlePHD] = field(init=False, repr=False)
    _links: list[Transition] = field(init=False, repr=False)  # one between every two stored sets
    _rng: np.random.Generator = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything; the random generators start from the seed again."""
        self.forward.reset()
        self._tracks = TrackNumbers()
        self._stamps, self._stored, self._links = [], [], []
        # Its own, so that the filter's draws do not depend on how targets are read off.
        self._rng = np.random.default_rng([self.forward.seed, EXTRACTION_STREAM])

    def step(self, scan: Scan) -> Step:
        """Filter one scan and smooth the stamps whose lag is reached.

        Raises
        ------
        ValueError
            If the stamp is not later than the one before.
        """
        modes = self.forward.model.modes
        found = self.forward.step(scan, linked=bool(self._stored))
        filtered = self._targets(found.updated, scan.stamp_ns, 0)
        if found.link is not None:
            self._links.append(found.link)
        self._stamps.append(scan.stamp_ns)
        self._stored.append(found.stored)
        smoothed = []
        while self.lag.reached(self._stamps):
            smoothed.append(self._smooth_oldest())
        self._tracks.forget_all_but([found.stored.label, *(phd.label for phd in self._stored)])
        return Step(
            filtered=filtered,
            smoothed=tuple(smoothed),
            class_mass=found.updated.class_mass(modes.class_of, len(modes.classes)),
            particles=len(found.stored),
            effective_sample_size=found.stored.effective_sample_size,
            orphans=found.link.orphans if found.link else 0,
        )

    def retune(self, model: TrackerModel, existence_threshold: float) -> None:
        """Go by another model of the same structure, and another threshold, from the next scan on.

        What is kept from scan to scan, the stored sets and the links between them, was made with
        what held then, and stays.
        """
        self.forward.model = model
        self.existence_threshold = existence_threshold

    def flush(self) -> tuple[Estimates, ...]:
        """Return the estimates of the window, smoothed as far as it goes, and reset."""
        rest = self._smooth_rest()
        self.reset()
        return rest

    def interrupt(self) -> tuple[Estimates, ...]:
        """Do as `flush`, but give tracks found from now on numbers that no other has had.

        For a gap in a time that goes on: whoever follows tracks by their numbers must not take a
        new target for an old one.
        """
        rest, given = self._smooth_rest(), self._tracks.count
        self.reset()
        self._tracks = TrackNumbers(count=given)
        return rest

    def snapshot(self) -> Snapshot:
        """Return all that the tracker holds; it shares its arrays, which nobody changes."""
        snapshot = Snapshot()
        self.forward.put(snapshot)
        snapshot.facts["smoother"] = {
            "stamps_ns": list(self._stamps),
            "tracks": self._tracks.facts,
            "rng": self._rng.bit_generator.state,
        }
        for index, phd in enumerate(self._stored):
            snapshot.put_particles(f"stored.{index}", phd)
        for index, link in enumerate(self._links):
            snapshot.put_link(f"link.{index}", link)
        return snapshot

    def restore(self, snapshot: Snapshot) -> None:
        """Go on from a snapshot as if the tracker had never stopped.

        Parameters
        ----------
        snapshot : Snapshot
            Of a tracker with the same configuration.

        Raises
        ------
        ValueError
            If it is not one of a tracker; the tracker is reset then.
        """
        self.reset()
        try:
            self._take(snapshot)
        except (KeyError, TypeError, ValueError) as error:
            self.reset()
            raise ValueError(f"snapshot: {error}") from error

    def _take(self, snapshot: Snapshot) -> None:
        facts = snapshot.facts["smoother"]
        stored = [snapshot.particles(f"stored.{k}") for k in range(len(facts["stamps_ns"]))]
        links = [
            snapshot.link(f"link.{k}", earlier, later)
            for k, (earlier, later) in enumerate(itertools.pairwise(stored))
        ]
        tracks = facts["tracks"]
        self.forward.take(snapshot)
        self._rng.bit_generator.state = facts["rng"]
        self._tracks = TrackNumbers({int(k): int(n) for k, n in tracks["number"]}, tracks["count"])
        self._stamps, self._stored, self._links = list(facts["stamps_ns"]), stored, links

    def _smooth_rest(self) -> tuple[Estimates, ...]:
        """Smooth the window as far as it goes, and empty it."""
        rest = []
        while self._stored:
            rest.append(self._smooth_oldest())
        return tuple(rest)

    def _smooth_oldest(self) -> Estimates:
        """Smooth the oldest stored set with all that follow, and drop it from the window."""
        *_, smoothed = backward_pass(self._stored, self._links, self.death_term)
        stamp_ns, lag = self._stamps[0], len(self._stored) - 1
        del self._stamps[0], self._stored[0], self._links[:1]
        return self._targets(smoothed, stamp_ns, lag)

    def _targets(self, phd: ParticlePHD, stamp_ns: int, lag: int) -> Estimates:
        """Read the targets off an intensity and number their tracks."""
        modes, threshold = self.forward.model.modes, self.existence_threshold
        found = self.extraction(phd, modes, stamp_ns, lag, threshold, self._rng)
        return self._tracks.numbered(found)
