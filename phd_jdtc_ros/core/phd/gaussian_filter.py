"""The recursion in closed form: the steps of a scan in order."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..arrays import FloatArray, IntArray, sum_by
from ..models.tracker_model import TrackerModel
from ..types import Estimates, Scan
from . import gaussian_smoothing
from .engine import Stepped
from .extraction import estimates, groups_above
from .gaussian_mixture import Mixture, Updated, correct, moments, predict, reduce
from .gaussian_smoothing import Lineage, trace


@dataclass
class GaussianFilter:
    """The Gaussian mixture PHD filter and smoother; implements `engine.Recursion`."""

    model: TrackerModel
    _scans: int = field(init=False, default=0, repr=False)  # Scans since the start

    def reset(self) -> None:
        """Return to the initial state."""
        self._scans = 0

    def step(
        self, earlier: Mixture | None, scan: Scan, dt: float, linked: bool
    ) -> Stepped[Mixture, Lineage]:
        """Predict, correct with every radar, and merge; if `linked`, trace the lineage."""
        modes = self.model.modes
        start = Mixture.empty(len(modes.space)) if earlier is None else earlier
        predicted = predict(start, self.model, dt, self._scans)
        updated = Updated(predicted.mixture, np.arange(len(predicted.mixture)))
        for report in self.model.expected(scan):
            updated = correct(updated, report, modes)
        stored, row = reduce(updated.mixture, modes)
        self._scans += 1
        link = None
        if linked and earlier is not None:
            survival = modes.survival(dt)[earlier.mode]
            link = trace(earlier, predicted, updated, stored, row, survival)
        return Stepped(stored, stored, link, {"gaussians": len(stored)})

    def backward_step(self, stored: Mixture, link: Lineage, later: Mixture) -> Mixture:
        """Return the smoothed mixture, given the smoothed next one."""
        return gaussian_smoothing.backward_step(stored, link, later)

    def extract(self, found: Mixture, stamp_ns: int, lag: int, threshold: float) -> Estimates:
        """Return the components, and the (origin, class) groups of the Poisson part, as targets.

        They are those whose mass is above the threshold; see `extraction.components`.
        """
        modes, rows = self.model.modes, np.arange(len(found))
        first = int(found.component.max(initial=-1)) + 1
        unexplained = first + found.origin * len(modes.classes) + modes.class_of[found.mode]
        key = np.where(found.component < 0, unexplained, found.component)
        groups = groups_above(threshold, key, rows, found.weight)

        def moments_of(
            row: IntArray, group: IntArray, weight: FloatArray
        ) -> tuple[FloatArray, FloatArray]:
            leader = np.zeros(int(group.max(initial=-1)) + 1, dtype=np.int64)
            leader[group] = row
            columns = found.mean[row], found.covariance[row], group
            return moments(weight, *columns, near=found.mean[leader])[1:]

        return estimates(groups, found.mode, modes, moments_of, stamp_ns, lag)

    def class_mass(self, found: Mixture) -> FloatArray:
        """Return the expected number of targets of each class, shape (C,)."""
        modes = self.model.modes
        return sum_by(modes.class_of[found.mode], found.weight, len(modes.classes))
