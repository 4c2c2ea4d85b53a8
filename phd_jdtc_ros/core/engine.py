"""The tracker's engine: scans in, filtered and lagged smoothed estimates out.

This is the one place that holds state: the window of stored sets with their cached transitions,
and the random generator.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from . import filter as phd_filter
from . import transition
from .detection_birth import Newborn
from .extraction import Extraction
from .filter import ParticleBudget, TrackerModel
from .smoother import DeathTerm, backward_pass
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
    _found: tuple[Newborn, ...] = field(init=False, repr=False)
    _rng: np.random.Generator = field(init=False, repr=False)
    _scan_index: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything; the random generator starts from the seed again."""
        self._latest = None
        self._found = ()
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
        found = self._found
        predicted = phd_filter.predict(
            earlier, model, self.budget, dt, self._scan_index, rng, found
        )
        updated, self._found = phd_filter.update_scan(predicted, scan, model, dt)
        stored = phd_filter.resample(updated, model.modes, self.budget, rng)
        first = self._latest is None
        link = None
        if linked and not first:
            link = transition.build(earlier, stored, model, dt, found)
        self._latest = (scan.stamp_ns, stored)
        self._scan_index += 1
        return Filtered(updated, stored, link)

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
    """

    forward: ForwardFilter
    lag: Lag
    death_term: DeathTerm
    extraction: Extraction
    _stamps: list[int] = field(init=False, repr=False)
    _stored: list[ParticlePHD] = field(init=False, repr=False)
    _links: list[Transition] = field(init=False, repr=False)  # one between every two stored sets
    _rng: np.random.Generator = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything; the random generators start from the seed again."""
        self.forward.reset()
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
        filtered = self.extraction(found.updated, modes, scan.stamp_ns, 0, self._rng)
        if found.link is not None:
            self._links.append(found.link)
        self._stamps.append(scan.stamp_ns)
        self._stored.append(found.stored)
        smoothed = []
        while self.lag.reached(self._stamps):
            smoothed.append(self._smooth_oldest())
        return Step(
            filtered=filtered,
            smoothed=tuple(smoothed),
            class_mass=found.updated.class_mass(modes.class_of, len(modes.classes)),
            particles=len(found.stored),
            effective_sample_size=found.stored.effective_sample_size,
            orphans=found.link.orphans if found.link else 0,
        )

    def flush(self) -> tuple[Estimates, ...]:
        """Return the estimates of the window, smoothed as far as it goes, and reset."""
        rest = []
        while self._stored:
            rest.append(self._smooth_oldest())
        self.reset()
        return tuple(rest)

    def _smooth_oldest(self) -> Estimates:
        """Smooth the oldest stored set with all that follow, and drop it from the window."""
        *_, smoothed = backward_pass(self._stored, self._links, self.death_term)
        stamp_ns, lag = self._stamps[0], len(self._stored) - 1
        del self._stamps[0], self._stored[0], self._links[:1]
        modes = self.forward.model.modes
        return self.extraction(smoothed, modes, stamp_ns, lag, self._rng)
