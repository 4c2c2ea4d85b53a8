# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The particle engine: the filter, the fixed-lag window, extraction and track numbers."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..engine import Lag, Step
from ..models.tracker_model import TrackerModel
from ..snapshot import MOST_STAMP_NS, Snapshot, whole
from ..track_numbers import TrackNumbers
from ..types import Estimates, Scan
from . import snapshot
from .backward_kernel import Transition
from .extraction import Extraction
from .filter import ForwardFilter
from .particle_set import ParticleSet
from .smoother import DeathTerm, backward_pass

# Second word of the seed of extraction; the filter's is `filter.FILTER_STREAM`.
EXTRACTION_STREAM = 1
# Messages have 32 bits for a track's number; half of them are left for what is still to come.
MOST_TRACKS = 1 << 31


@dataclass
class ParticleEngine:
    """Sequential Monte Carlo filter with a fixed-lag backward smoother over the general mode.

    Parameters
    ----------
    forward : ForwardFilter
    lag : Lag
    death_term : DeathTerm
    extraction : Extraction
    existence_threshold : float
        Existence probability above which a target is reported.

    Notes
    -----
    Sec. IV-C: Steps 1 to 3 in `forward`, Step 4 in `smoother`, Steps 5 and 6 in `extraction`.
    """

    forward: ForwardFilter
    lag: Lag
    death_term: DeathTerm
    extraction: Extraction
    existence_threshold: float
    _tracks: TrackNumbers = field(init=False, repr=False)
    _stamps: list[int] = field(init=False, repr=False)
    _stored: list[ParticleSet] = field(init=False, repr=False)
    _links: list[Transition] = field(init=False, repr=False)  # between consecutive stored sets
    _rng: np.random.Generator = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Return to the initial state; the random generators start from the seed again."""
        self.forward.reset()
        self._tracks = TrackNumbers()
        self._stamps, self._stored, self._links = [], [], []
        # A generator of its own, so that the filter's draws do not depend on the extraction.
        self._rng = np.random.default_rng([self.forward.seed, EXTRACTION_STREAM])

    def step(self, scan: Scan) -> Step:
        """Filter one scan and smooth the stamps whose lag is reached; see `Engine.step`."""
        modes = self.forward.model.modes
        step = self.forward.step(scan, linked=bool(self._stored))
        filtered = self._targets(step.updated, scan.stamp_ns, 0)
        if step.link is not None:
            self._links.append(step.link)
        self._stamps.append(scan.stamp_ns)
        self._stored.append(step.stored)
        smoothed = []
        while self.lag.reached(self._stamps):
            smoothed.append(self._smooth_oldest())
        self._tracks.forget_all_but([step.stored.label, *(kept.label for kept in self._stored)])
        return Step(
            filtered=filtered,
            smoothed=tuple(smoothed),
            class_mass=step.updated.class_mass(modes.class_of, len(modes.classes)),
            figures={
                "particles": len(step.stored),
                "effective_sample_size": step.stored.effective_sample_size,
                "effective_share": step.updated.effective_share,
                "orphans": step.link.orphans if step.link else 0,
            },
        )

    def retune(self, model: TrackerModel, existence_threshold: float) -> None:
        """Use another model and threshold from the next scan on; see `Engine.retune`.

        The stored sets and the links between them stay as the previous model made them.
        """
        self.forward.model = model
        self.existence_threshold = existence_threshold

    def flush(self) -> tuple[Estimates, ...]:
        """Return the estimates of the window, smoothed with the scans that it holds, and reset."""
        rest = self._smooth_rest()
        self.reset()
        return rest

    def interrupt(self) -> tuple[Estimates, ...]:
        """Do as `flush`, but use no track number a second time; see `Engine.interrupt`."""
        rest, count = self._smooth_rest(), self._tracks.count
        self.reset()
        self._tracks = TrackNumbers(count=count)
        return rest

    def snapshot(self) -> Snapshot:
        """Return all that the engine holds; see `Engine.snapshot`."""
        held = Snapshot(self.forward.stamp_ns)
        self.forward.put(held)
        held.facts["smoother"] = {
            "stamps_ns": list(self._stamps),
            "tracks": self._tracks.facts,
            "rng": self._rng.bit_generator.state,
        }
        for index, stored in enumerate(self._stored):
            snapshot.put_particles(held, f"stored.{index}", stored)
        for index, link in enumerate(self._links):
            snapshot.put_transition(held, f"link.{index}", link)
        return held

    def restore(self, snapshot: Snapshot) -> None:
        """Continue from a snapshot; see `Engine.restore`."""
        self.reset()
        try:
            self._take(snapshot)
        except Exception as error:  # of any kind: nobody knows what a foreign one holds
            self.reset()
            raise ValueError(f"snapshot: {type(error).__name__}: {error}") from error

    def _take(self, held: Snapshot) -> None:
        facts = held.facts["smoother"]
        stamps = [whole("stamps_ns", stamp, 0, MOST_STAMP_NS) for stamp in facts["stamps_ns"]]
        if any(b <= a for a, b in itertools.pairwise(stamps)):
            raise ValueError("stamps_ns: must increase")
        if stamps and stamps[-1] != held.stamp_ns:
            raise ValueError(f"stamps_ns: end at {stamps[-1]}, expected {held.stamp_ns}")
        modes, most = self.forward.model.modes, self.forward.budget.most
        stored = [
            snapshot.take_particles(held, f"stored.{k}", modes, most) for k in range(len(stamps))
        ]
        links = [
            snapshot.take_transition(held, f"link.{k}", earlier, later)
            for k, (earlier, later) in enumerate(itertools.pairwise(stored))
        ]
        tracks = _track_numbers(facts["tracks"])
        self.forward.take(held)
        self._rng.bit_generator.state = facts["rng"]
        self._tracks = tracks
        self._stamps, self._stored, self._links = stamps, stored, links

    def _smooth_rest(self) -> tuple[Estimates, ...]:
        """Smooth all stored sets with the scans that the window holds, and empty it."""
        rest = []
        while self._stored:
            rest.append(self._smooth_oldest())
        return tuple(rest)

    def _smooth_oldest(self) -> Estimates:
        """Smooth the oldest stored set with all later ones, and remove it from the window."""
        *_, smoothed = backward_pass(self._stored, self._links, self.death_term)
        self.forward.done("backward")
        stamp_ns, lag = self._stamps[0], len(self._stored) - 1
        del self._stamps[0], self._stored[0], self._links[:1]
        return self._targets(smoothed, stamp_ns, lag)

    def _targets(self, particles: ParticleSet, stamp_ns: int, lag: int) -> Estimates:
        """Extract the targets of an intensity and number their tracks."""
        modes, threshold = self.forward.model.modes, self.existence_threshold
        estimates = self.extraction(particles, modes, stamp_ns, lag, threshold, self._rng)
        self.forward.done("extraction")
        return self._tracks.numbered(estimates)


def _track_numbers(facts: Any) -> TrackNumbers:
    """Return stored track numbers; raises ValueError if they are none."""
    count = whole("tracks.count", facts["count"], 0, MOST_TRACKS)
    number = {
        whole("label", label, 0, snapshot.MOST_INDEX + 1): whole("track", given, 1, count)
        for label, given in facts["number"]
    }
    return TrackNumbers(number, count)
