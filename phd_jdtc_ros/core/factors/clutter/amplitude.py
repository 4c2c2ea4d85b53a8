"""Amplitude distributions of clutter: that of noise, or learned per radar.

A law is a density over all envelopes; a radar reports the envelopes above its threshold. The
clutter's density at an amplitude decides how strong the evidence of a single detection is. The tail
of noise falls with exp(-a^2/2), so that against `view.NoiseEnvelopes` a false detection a few
decibels higher is almost certainly a target. `Learned` bounds this error by a predictive density.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Annotated, ClassVar, NamedTuple

import numpy as np

from ...arrays import FloatArray, read_only, zeros_field
from ...sensors.sensor import Sensor
from ...sensors.view import View
from ...snapshot import Snapshot, floats
from ...targets.amplitude_density import (
    DB_PER_NEPER,
    SMALLEST_AMPLITUDE,
    level_db,
)
from ..factor import Factor, Look

# Lowest and highest level of the learned law's cells, dB; other amplitudes count in the nearest
# cell.
LOWEST_DB = -20.0
HIGHEST_DB = 80.0
# Width of these cells, dB.
CELL_DB = 0.5
CELLS = round((HIGHEST_DB - LOWEST_DB) / CELL_DB)
# Weight of the prior, which is noise, as a number of detections.
PRIOR_NOISE = 20.0
# Share of the law that is uniform over all levels.
UNIFORM_SHARE = 0.1
# Memory of the learned law, as a number of false detections.
MEMORY = 200.0
# Upper bound accepted in a snapshot: rounding may slightly exceed the memory.
MAX_COUNT = 1.001 * MEMORY


@dataclass(frozen=True, eq=False)
class Learned(Factor):
    """Histogram, in half decibels, of the levels of detections that no target claims.

    The shares of the cells have a Dirichlet prior of `PRIOR_NOISE` detections of noise above the
    threshold, and therefore the predictive density (prior + count) / sum. It has the weight `1 -
    UNIFORM_SHARE`; the rest of the law is uniform over 100 dB. The density of a level is at least
    0.001 per dB. The density of a Rayleigh target is at most 0.085 per dB, and 0.05 if its class's
    band is 20 dB wide. The likelihood ratio of one amplitude is therefore at most 85, and 50 for
    such a class: no amplitude confirms a target without its position or a second detection.
    """

    NAME: ClassVar[str] = "clutter"
    SIZES: ClassVar[Mapping[str, int]] = {"K": CELLS}

    threshold: float  # Detection threshold of the radar; the prior is noise above it
    # Remembered detections by cell of level, (CELLS,); at most `MEMORY` in all.
    count: Annotated[FloatArray, floats("K", 0.0, MAX_COUNT)] = zeros_field(CELLS)

    def expect(self, view: View) -> View:
        """Return the report with the law."""
        return view.changed(clutter_amplitude=self)

    def learn(self, look: Look) -> Learned:
        """Learn from the amplitudes of unclaimed detections."""
        amplitude = look.view.detections.amplitude
        if amplitude is None or not look.view.complete:
            return self
        return self.after(amplitude, look.unclaimed)

    def restored(self, snapshot: Snapshot, name: str, sensor: Sensor) -> Learned:
        """Return the stored law; see `Factor.restored`."""
        law = super().restored(snapshot, name, sensor)
        if law.count.sum() > MAX_COUNT:
            raise ValueError(f"{name}.count: {law.count.sum():.4g} detections, at most {MEMORY:g}")
        return law

    @cached_property
    def _mass(self) -> FloatArray:
        """Probability of each cell, shape (CELLS,)."""
        cells = _cells(self.threshold)
        total = cells.prior + self.count @ cells.kernel
        mass: FloatArray = (1.0 - UNIFORM_SHARE) * total / total.sum()
        return mass + UNIFORM_SHARE * cells.uniform

    def log_density(self, amplitude: FloatArray) -> FloatArray:
        """Return the log predictive density of envelopes, elementwise."""
        a = np.maximum(amplitude, SMALLEST_AMPLITUDE)
        edges = _cells(self.threshold).edges_db
        cell = np.searchsorted(edges, level_db(a), side="right") - 1
        per_db = np.log(self._mass / np.diff(edges))
        density: FloatArray = per_db[np.clip(cell, 0, CELLS - 1)] + np.log(2.0 * DB_PER_NEPER / a)
        return np.where(np.isnan(a), a, density)

    def log_share(self, threshold: float, above: float = 0.0) -> float:
        """Return log P(a > threshold | a > above)."""
        return self._log_tail(threshold) - self._log_tail(above)

    def after(self, amplitude: FloatArray, weight: FloatArray) -> Learned:
        """Return the law after further detections, (M,); those with unknown amplitudes are ignored.

        `weight` has the probability that no target is the source of each detection.

        Earlier detections fade by the weights of later ones. The memory is therefore independent
        of the division of a revolution into scans, and lasts longer for a radar with little
        clutter.
        """
        is_known = np.isfinite(amplitude)
        level = level_db(np.maximum(amplitude[is_known], SMALLEST_AMPLITUDE))
        cell = np.clip(((level - LOWEST_DB) / CELL_DB).astype(np.int64), 0, CELLS - 1)
        new_count = np.bincount(cell, weights=weight[is_known], minlength=CELLS)
        total = float(new_count.sum())
        if total == 0.0:
            return self
        retention = np.exp(-total / MEMORY)
        return Learned(
            self.threshold, self.count * retention + new_count * (1.0 - retention) * MEMORY / total
        )

    def _log_tail(self, threshold: float) -> float:
        if threshold <= 0.0:
            return 0.0
        below = np.concatenate([[0.0], np.cumsum(self._mass)])
        level = float(level_db(np.array(threshold)))
        tail = 1.0 - float(np.interp(level, _cells(self.threshold).edges_db, below))
        return float(np.log(max(tail, np.finfo(float).tiny)))


class _Cells(NamedTuple):
    """The cells of a learned law."""

    # Edges of the cells, dB, (CELLS + 1,); the lower edge of the threshold's cell is the threshold.
    edges_db: FloatArray
    prior: FloatArray  # Weight of the prior, in detections, (CELLS,)
    uniform: FloatArray  # Share of each cell in the range of levels, (CELLS,)
    # Share with which a detection in each cell counts in every cell, (CELLS, CELLS); rows sum to
    # one. Detections above the threshold count only above it.
    kernel: FloatArray


@lru_cache(maxsize=64)
def _cells(threshold: float) -> _Cells:
    """Return cells of the level, dB, of which an edge is at the threshold."""
    edges = np.linspace(LOWEST_DB, HIGHEST_DB, CELLS + 1)
    if threshold > 0.0:
        level = float(level_db(np.array(threshold)))
        cell = int(np.searchsorted(edges, level, side="right")) - 1
        if 0 < cell < CELLS:
            edges[cell] = level
    width, centre = np.diff(edges), 0.5 * (edges[:-1] + edges[1:])
    least = 0.5 * threshold**2
    tail = np.exp(least - np.maximum(10.0 ** (edges / 10.0), least))
    tail[0], tail[-1] = 1.0, 0.0
    prior, uniform = PRIOR_NOISE * (tail[:-1] - tail[1:]), width / (HIGHEST_DB - LOWEST_DB)
    # Width of the kernel with which a detection counts for neighbouring levels, dB.
    kernel_db = 0.4
    share = np.exp(-0.5 * ((centre[:, None] - centre) / kernel_db) ** 2) * width
    reported = 10.0 ** (centre / 10.0) >= least
    share *= reported[:, None] == reported
    kernel = share / share.sum(axis=1, keepdims=True)
    return _Cells(*map(read_only, (edges, prior, uniform, kernel)))
