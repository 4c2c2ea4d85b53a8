"""Consistency of covariances: whether positions are as precise as the estimates say.

The squared Mahalanobis distance of a target's true position from its estimate is chi-square
distributed with two degrees of freedom if the covariance is right. Half of it, the normalised
estimation error squared (NEES) per axis, then has an exponential distribution of mean 1.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray

from .totals import Totals
from .track_ages import NO_AGE

if TYPE_CHECKING:
    from .scan_scores import Comparison

# A Mahalanobis distance above this is outside; 1.1 % of the pairs are if the covariance is right.
BOUND = 3.0
EXPECTED_OUTSIDE = float(np.exp(-0.5 * BOUND**2))


class Ages(NamedTuple):
    """A group of ages of a track, in scans since its number was first reported.

    Parameters
    ----------
    name : str
        In the keys of values and figures; empty for the group of all pairs.
    first, last : int
        The ages, both included.
    """

    name: str
    first: int
    last: int

    @property
    def text(self) -> str:
        """The group in a heading."""
        return self.name.replace("_up", "+").replace("_", "-")

    def key(self, value: str) -> str:
        """Return the key of a value or figure of the group."""
        return f"{value}_age_{self.name}" if self.name else value


OLDEST = 2**31
EVERY_AGE = Ages("", NO_AGE, OLDEST)
AGES = (Ages("0_4", 0, 4), Ages("5_9", 5, 9), Ages("10_up", 10, OLDEST))
AGE_GROUPS = (EVERY_AGE, *AGES)
# Values of a scan: number of judged pairs, the sum of their NEES / 2, and those outside the bound.
PAIRS, NEES, OUTSIDE = "judged_pairs", "nees_sum", "outside"


def values(ages: Ages) -> dict[str, Callable[[Comparison], float | None]]:
    """Return the functions of a scan that give the values of a group of ages, by name."""

    def square(scan: Comparison) -> FloatArray:
        among = (ages.first <= scan.age) & (scan.age <= ages.last)
        return scan.mahalanobis2[among & np.isfinite(scan.mahalanobis2)]

    return {
        ages.key(PAIRS): lambda scan: len(square(scan)),
        ages.key(NEES): lambda scan: 0.5 * float(square(scan).sum()),
        ages.key(OUTSIDE): lambda scan: int(np.count_nonzero(square(scan) > BOUND**2)),
    }


def band(pairs: int) -> tuple[float, float] | None:
    """Return the 95 % band of the mean NEES / 2 of right covariances; None for no pairs.

    Notes
    -----
    The sum of n independent values has a gamma distribution of shape n. Those of one track are not
    independent of each other from scan to scan, so that over a run the band is the narrowest.
    """
    # Imported here because readers of the table of metrics alone do not need it.
    from scipy.special import gammaincinv

    if not pairs:
        return None
    low, high = (float(gammaincinv(pairs, share)) / pairs for share in (0.025, 0.975))
    return low, high


def figures(totals: Totals) -> dict[str, Any]:
    """Return the consistency of a run in the form of `metrics.json`.

    Parameters
    ----------
    totals : Totals
        The first row is that of all targets.

    Returns
    -------
    dict
        ``pairs`` that were judged; ``nees``, divided by 2, and its ``nees_band_95`` for so many
        pairs; ``outside_3_sigma``. ``by_age`` has the same for each group of ages. A figure of no
        pairs is None.
    """
    found = _of_ages(totals, EVERY_AGE)
    found["by_age"] = {ages.text: _of_ages(totals, ages) for ages in AGES}
    return found


def _of_ages(totals: Totals, ages: Ages) -> dict[str, Any]:
    pairs, nees, outside = (float(totals.sum(ages.key(n))[0]) for n in (PAIRS, NEES, OUTSIDE))
    limits = band(int(pairs))
    return {
        "pairs": int(pairs),
        "nees": nees / pairs if pairs else None,
        "nees_band_95": None if limits is None else list(limits),
        "outside_3_sigma": outside / pairs if pairs else None,
    }
