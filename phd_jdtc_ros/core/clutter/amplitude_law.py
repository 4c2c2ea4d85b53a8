"""The law of the amplitudes of clutter: noise, land or sea as configured, or as a radar learns it.

A law is a density over all envelopes; a radar reports those above its threshold. What clutter of an
amplitude is like decides what a single detection proves. The tail of noise falls with exp(-a^2/2),
so against `Rayleigh` a false detection that is a few decibels higher is a certain target. `Learned`
cannot be that wrong: its density is the predictive one of what it has seen.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated, NamedTuple, Protocol

import numpy as np
from scipy.special import log_ndtr

from ..arrays import FloatArray, read_only
from ..snapshot import floats
from ..targets.amplitude_density import SMALLEST_AMPLITUDE, log_clutter_density

# Level in dB, 10 log10(a^2 / 2), which is the SNR of which an envelope a would be typical.
DB = 10.0 / np.log(10.0)
# Cells of the learned law, dB; amplitudes outside count as those of the first or the last cell.
LOWEST_DB, HIGHEST_DB, CELL_DB = -20.0, 80.0, 0.5
CELLS = round((HIGHEST_DB - LOWEST_DB) / CELL_DB)
# Each detection counts for amplitudes about as far as this from its own, dB.
KERNEL_DB = 0.4
# Before the first detection it is known as much of noise as so many of its detections would tell.
PRIOR_NOISE = 20.0
# Share of clutter that may have any level, whatever has been learned.
ANYTHING = 0.1
# False detections that the learned law remembers.
MEMORY = 200.0
# Rounding may leave a little more than that.
MOST_COUNT = 1.001 * MEMORY


class ClutterAmplitude(Protocol):
    """A distribution of the envelopes of clutter."""

    def log_density(self, amplitude: FloatArray) -> FloatArray:
        """Return the logarithm of the density of envelopes; NaN where they are; shape kept."""
        ...

    def log_share(self, threshold: float, above: float = 0.0) -> float:
        """Return the log probability that an envelope exceeds a threshold if it is `above` one."""
        ...


@dataclass(frozen=True)
class Rayleigh:
    """Envelopes of noise or of what adds up from many reflectors.

    Parameters
    ----------
    level : float
        Mean square of the envelope in units of the noise's; 1 is noise.
    """

    level: float = 1.0

    def log_density(self, amplitude: FloatArray) -> FloatArray:
        """Return the logarithm of the density of envelopes; shape kept."""
        scale = np.sqrt(self.level)
        density: FloatArray = log_clutter_density(amplitude / scale) - np.log(scale)
        return density

    def log_share(self, threshold: float, above: float = 0.0) -> float:
        """Return log P(a > threshold | a > above)."""
        return -0.5 * (threshold**2 - above**2) / self.level


NOISE = Rayleigh()


@dataclass(frozen=True)
class LogNormal:
    """Envelopes of land or sea seen with a narrow beam: their level in dB is Gaussian.

    Parameters
    ----------
    median_db, std_db : float
        Of the level; the median of noise is at -1.6 dB.
    """

    median_db: float
    std_db: float

    def log_density(self, amplitude: FloatArray) -> FloatArray:
        """Return the logarithm of the density of envelopes; shape kept."""
        a = np.maximum(amplitude, SMALLEST_AMPLITUDE)
        off = (level_db(a) - self.median_db) / self.std_db
        density: FloatArray = (
            -0.5 * off**2 - np.log(np.sqrt(2.0 * np.pi) * self.std_db) + np.log(2.0 * DB / a)
        )
        return density

    def log_share(self, threshold: float, above: float = 0.0) -> float:
        """Return log P(a > threshold | a > above)."""
        return self._log_tail(threshold) - self._log_tail(above)

    def _log_tail(self, threshold: float) -> float:
        if threshold <= 0.0:
            return 0.0
        off = (level_db(np.array(threshold)) - self.median_db) / self.std_db
        return float(log_ndtr(-off))


@dataclass(frozen=True, eq=False)
class Learned:
    """The law as the detections that no target claims tell it, one cell for each half decibel.

    Parameters
    ----------
    threshold : float
        Of the radar; noise above it is what is expected at first.
    count : array of shape (CELLS,)
        Detections remembered by cell of level; at most `MEMORY` in all.

    Notes
    -----
    The shares of the cells have a Dirichlet prior of `PRIOR_NOISE` detections of noise above the
    threshold, and so the predictive density (prior + count) / sum. That is `1 - ANYTHING` of the
    law; the rest is uniform over 100 dB. The density of a level is therefore at least 0.001 per dB,
    and as that of a Rayleigh target is at most 0.085 per dB, and 0.05 if its class's band is 20 dB
    wide, the amplitude of one detection speaks for such a target by 50 to 1 at most, and for any by
    85 to 1. However high it is, it confirms no target without its place or a second detection.
    """

    threshold: float
    count: Annotated[FloatArray, floats("K", 0.0, MOST_COUNT)] = field(
        default_factory=lambda: np.zeros(CELLS)
    )
    _mass: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "count", read_only(self.count))
        cells = _cells(self.threshold)
        told = cells.prior + self.count @ cells.kernel
        mass = (1.0 - ANYTHING) * told / told.sum() + ANYTHING * cells.uniform
        object.__setattr__(self, "_mass", read_only(mass))

    def log_density(self, amplitude: FloatArray) -> FloatArray:
        """Return the logarithm of the predictive density of envelopes; shape kept."""
        a = np.maximum(amplitude, SMALLEST_AMPLITUDE)
        edges = _cells(self.threshold).edges_db
        cell = np.searchsorted(edges, level_db(a), side="right") - 1
        per_db = np.log(self._mass / np.diff(edges))
        density: FloatArray = per_db[np.clip(cell, 0, CELLS - 1)] + np.log(2.0 * DB / a)
        return np.where(np.isnan(a), a, density)

    def log_share(self, threshold: float, above: float = 0.0) -> float:
        """Return log P(a > threshold | a > above)."""
        return self._log_tail(threshold) - self._log_tail(above)

    def after(self, amplitude: FloatArray, weight: FloatArray) -> Learned:
        """Return the law after further detections.

        Parameters
        ----------
        amplitude : array of shape (M,)
            NaN where it is unknown; these tell nothing.
        weight : array of shape (M,)
            Probability that no target is the source of each detection.

        Notes
        -----
        Earlier detections fade with every later one, by their weights, so that what is remembered
        does not depend on how a turn is cut into scans, and a radar with little clutter remembers
        it longer.
        """
        known = np.isfinite(amplitude)
        level = level_db(np.maximum(amplitude[known], SMALLEST_AMPLITUDE))
        cell = np.clip(((level - LOWEST_DB) / CELL_DB).astype(np.int64), 0, CELLS - 1)
        new = np.bincount(cell, weights=weight[known], minlength=CELLS)
        total = float(new.sum())
        if total == 0.0:
            return self
        kept = np.exp(-total / MEMORY)
        return Learned(self.threshold, self.count * kept + new * (1.0 - kept) * MEMORY / total)

    def _log_tail(self, threshold: float) -> float:
        if threshold <= 0.0:
            return 0.0
        below = np.concatenate([[0.0], np.cumsum(self._mass)])
        level = float(level_db(np.array(threshold)))
        tail = 1.0 - float(np.interp(level, _cells(self.threshold).edges_db, below))
        return float(np.log(max(tail, np.finfo(float).tiny)))


def level_db(amplitude: FloatArray) -> FloatArray:
    """Return the level 10 log10(a^2 / 2) of envelopes, dB; shape kept."""
    level: FloatArray = DB * np.log(0.5 * amplitude**2)
    return level


class _Cells(NamedTuple):
    """The cells of a learned law.

    Parameters
    ----------
    edges_db : array of shape (CELLS + 1,)
        That of the threshold's cell is the threshold itself.
    prior : array of shape (CELLS,)
        Detections that the prior counts as.
    uniform : array of shape (CELLS,)
        Share of each cell in the range of levels.
    kernel : array of shape (CELLS, CELLS)
        By which share a detection of each cell counts in each other one; rows sum to one.
        Detections above the threshold count above it only.
    """

    edges_db: FloatArray
    prior: FloatArray
    uniform: FloatArray
    kernel: FloatArray


@lru_cache(maxsize=64)
def _cells(threshold: float) -> _Cells:
    """Return the cells for a threshold."""
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
    share = np.exp(-0.5 * ((centre[:, None] - centre) / KERNEL_DB) ** 2) * width
    reported = 10.0 ** (centre / 10.0) >= least
    share *= reported[:, None] == reported
    kernel = share / share.sum(axis=1, keepdims=True)
    return _Cells(*map(read_only, (edges, prior, uniform, kernel)))
