"""Coverage of a radar: its field of view, and the detection probability by range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from ..arrays import FloatArray
from ..types import FULL_TURN, Coverage

WHOLE_TURN = Coverage(-np.pi, FULL_TURN)
# Tolerance with which a sector counts as a whole turn, radians: degrees in files are rounded.
TURN_TOLERANCE = 1e-9


def sector_probability(
    azimuth: FloatArray, sector: Coverage, azimuth_std: FloatArray | float = 0.0
) -> FloatArray:
    """Return the probability that an azimuth is measured inside a sector, elementwise.

    Parameters
    ----------
    azimuth : array
        True azimuths, radians.
    azimuth_std : array or float
        Standard deviation of the measured azimuth, radians; 0 for all, or positive. A target
        near the edge of a sector is reported in it or in the next one by chance.
    """
    if sector.width > FULL_TURN - TURN_TOLERANCE:
        return np.ones_like(azimuth)
    offset = np.mod(azimuth - sector.start, FULL_TURN)
    if np.ndim(azimuth_std) == 0 and azimuth_std == 0.0:
        return (offset <= sector.width).astype(np.float64)
    share = np.zeros_like(offset)
    for shifted in (offset, offset - FULL_TURN):
        share += ndtr(shifted / azimuth_std) - ndtr((shifted - sector.width) / azimuth_std)
    return share


@dataclass(frozen=True)
class Visibility:
    """A radar's field of view, and its detection probability if it is given.

    Parameters
    ----------
    min_range, max_range : float
        Limits of the range in which targets are detected, metres.
    fov : Coverage
        Azimuths of the field of view.
    blind : tuple of Coverage
        Obstructed azimuths within the field of view.
    ranges, probabilities : tuples of K floats
        Detection probability by range, metres; linear between the entries and constant outside.
        Empty if it follows from the classes' signal-to-noise ratios.
    """

    max_range: float
    min_range: float = 0.0
    fov: Coverage = WHOLE_TURN
    blind: tuple[Coverage, ...] = ()
    ranges: tuple[float, ...] = ()
    probabilities: tuple[float, ...] = ()

    @property
    def given(self) -> bool:
        """Whether the detection probability is given."""
        return len(self.probabilities) > 0

    def probability(self, distance: FloatArray) -> FloatArray:
        """Return the given detection probability at these ranges, metres, elementwise."""
        return np.interp(distance, self.ranges, self.probabilities)

    def sees(self, measured: FloatArray) -> FloatArray:
        """Return 1 for each (range, azimuth) row in the field of view and 0 else, shape (N,)."""
        distance, azimuth = measured[:, 0], measured[:, 1]
        seen = ((distance >= self.min_range) & (distance <= self.max_range)).astype(np.float64)
        seen *= sector_probability(azimuth, self.fov)
        for sector in self.blind:
            seen *= 1.0 - sector_probability(azimuth, sector)
        return seen
