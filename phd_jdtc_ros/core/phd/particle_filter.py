"""The recursion of particles (Sec. IV-C): the steps of a scan in order."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..arrays import FloatArray, sum_by
from ..models.tracker_model import TrackerModel
from ..types import Estimates, Scan
from . import kernel, smoothing
from .correction import correct
from .engine import Stepped
from .extraction import Extraction, estimates, moments_of_particles
from .kernel import Kernel
from .particles import Particles
from .prediction import predict
from .resampling import ParticleBudget, resample
from .smoothing import DeathTerm

# Second word of the seed, for the filter and for the extraction. It makes the two random streams
# independent of each other, and of a simulation's with the same seed.
FILTER_STREAM, EXTRACTION_STREAM = 2, 1


@dataclass
class ParticleFilter:
    """The SMC-PHD filter and smoother; implements `engine.Recursion`.

    With `smoothing.printed_death_term` and `extraction.clusters` these two are as printed.
    """

    model: TrackerModel
    budget: ParticleBudget
    seed: int
    death_term: DeathTerm
    extraction: Extraction
    _scans: int = field(init=False, repr=False)  # Scans since the start
    _rng: np.random.Generator = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Return to the initial state; the random generator starts from the seed again."""
        self._scans = 0
        self._rng = np.random.default_rng([self.seed, FILTER_STREAM])

    def step(
        self, earlier: Particles | None, scan: Scan, dt: float, linked: bool
    ) -> Stepped[Particles, Kernel]:
        """Predict, correct with every radar, resample; if `linked`, build the backward kernel."""
        model, rng, start = self.model, self._rng, Particles.empty(len(self.model.modes.space))
        found = predict(earlier or start, model, self.budget, dt, self._scans, rng)
        for report in model.expected(scan):
            found = correct(found, report, model.modes)
        stored = resample(found, model.modes, self.budget, rng)
        self._scans += 1
        link = kernel.build(earlier, stored, model, dt) if linked and earlier is not None else None
        figures = {
            "particles": len(stored),
            "effective_sample_size": stored.effective_sample_size,
            "orphans": link.orphans if link else 0,
        }
        return Stepped(found, stored, link, figures)

    def backward_step(self, stored: Particles, link: Kernel, later: Particles) -> Particles:
        """Return a stored set with smoothed weights, given the smoothed next one."""
        return smoothing.backward_step(stored, link, later, self.death_term)

    def extract(self, found: Particles, stamp_ns: int, lag: int, threshold: float) -> Estimates:
        """Return the targets of a set; they do not depend on other extractions."""
        modes = self.model.modes
        rng = np.random.default_rng([self.seed, EXTRACTION_STREAM, lag, stamp_ns])
        groups = self.extraction(found, modes, threshold, rng)
        moments_of = moments_of_particles(found, modes)
        return estimates(groups, found.mode, modes, moments_of, stamp_ns, lag)

    def class_mass(self, found: Particles) -> FloatArray:
        """Return the expected number of targets of each class, shape (C,)."""
        modes = self.model.modes
        return sum_by(modes.class_of[found.mode], found.weight, len(modes.classes))
