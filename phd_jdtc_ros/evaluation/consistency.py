"""Consistency of covariances: whether the errors of positions match the stated covariances.

The squared Mahalanobis distance of a target's true position from its estimate is chi-square
distributed with two degrees of freedom if the covariance is right. Half of it, the normalised
estimation error squared (NEES) per axis, then has an exponential distribution of mean 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray

from .accumulator import NEES as NEES_TABLE
from .accumulator import OUTSIDE as OUTSIDE_TABLE
from .accumulator import Accumulator, Group, Metric, Totals, Values, share
from .comparison import Comparison, PairedScan

NO_AGE = -1
# A track number that is not reported for this many scans is removed.
FORGOTTEN = 10

# Bound of the Mahalanobis distance; with right covariances 1.1 % of the pairs are outside.
BOUND = 3.0
EXPECTED_OUTSIDE = float(np.exp(-0.5 * BOUND**2))


class TrackAges:
    """Counts the scans since each track number was first reported, scan by scan.

    A number that is not reported for `FORGOTTEN` scans is removed, and counts as new if it returns.
    """

    def __init__(self) -> None:
        self._scan = 0
        self._newest_ns: int | None = None
        self._first: dict[int, int] = {}
        self._last: dict[int, int] = {}

    def add(self, stamp_ns: int, track_id: IntArray | None, size: int) -> IntArray:
        """Add the next scan; return the age of each of its estimates.

        A new run begins if the stamp is earlier than the previous scan's. The age is `NO_AGE` for
        unlabelled estimates, of track_id 0; `track_id` is None if all are unlabelled.
        """
        if self._newest_ns is not None and stamp_ns < self._newest_ns:
            self._first, self._last = {}, {}
        self._newest_ns = stamp_ns
        self._scan += 1
        labels: Sequence[int] = [0] * size if track_id is None else track_id.tolist()
        known = [label for label in labels if label]
        for label in known:
            self._first.setdefault(label, self._scan)
            self._last[label] = self._scan
        for label in [n for n, last in self._last.items() if self._scan - last > FORGOTTEN]:
            del self._first[label], self._last[label]
        ages = [self._scan - self._first[label] if label else NO_AGE for label in labels]
        return np.array(ages, dtype=np.int64)


def mahalanobis2(error: FloatArray, covariance: FloatArray | None) -> FloatArray:
    """Return the squared Mahalanobis distances of errors of position, metres, (P, 2); shape (P,).

    The covariances, m^2, (P, 2, 2), may be unknown. The distance is NaN without one that is finite
    and positive definite.
    """
    if covariance is None:
        return np.full(len(error), np.nan)
    (xx, xy), (_, yy) = covariance.transpose(1, 2, 0)
    x, y = error.T
    with np.errstate(over="ignore", invalid="ignore"):
        determinant = xx * yy - xy**2
        usable = (xx > 0.0) & (determinant > 0.0) & np.isfinite(determinant)
        square = (yy * x**2 - 2.0 * xy * x * y + xx * y**2) / np.where(usable, determinant, 1.0)
    return np.where(usable, square, np.nan)


class Ages(NamedTuple):
    """A group of track ages, in scans since the number was first reported."""

    name: str  # Part of the keys of values and figures; empty for the group of all pairs
    first: int  # Lowest age
    last: int  # Highest age, inclusive

    @property
    def text(self) -> str:
        """Text of the group in a heading."""
        return self.name.replace("_up", "+").replace("_", "-")

    def key(self, value: str) -> str:
        """Return the key of a value or figure of the group."""
        return f"{value}_age_{self.name}" if self.name else value


OLDEST = 2**31
EVERY_AGE = Ages("", NO_AGE, OLDEST)
AGES = (Ages("0_4", 0, 4), Ages("5_9", 5, 9), Ages("10_up", 10, OLDEST))
AGE_GROUPS = (EVERY_AGE, *AGES)
# Values of a scan: number of evaluated pairs, sum of their NEES / 2, and number outside the bound.
PAIRS, NEES, OUTSIDE = "judged_pairs", "nees_sum", "outside"


def band(pairs: int) -> tuple[float, float] | None:
    """Return the 95 % band of the mean NEES / 2 for right covariances; None without pairs.

    The sum of n independent values has a gamma distribution of shape n. Successive values of one
    track are correlated, so that the true band over a run is wider.
    """
    # This is imported here because the table of metrics alone does not need it.
    from scipy.special import gammaincinv

    if not pairs:
        return None
    low, high = (float(gammaincinv(pairs, share)) / pairs for share in (0.025, 0.975))
    return low, high


def figures(totals: Totals) -> dict[str, Any]:
    """Return the consistency of a run in the form of `metrics.json`.

    Row 0 of the totals is the set of all targets. The result has ``pairs``, the number of evaluated
    pairs; ``nees``, divided by 2, with its ``nees_band_95`` for this number of pairs; and
    ``outside_3_sigma``. ``by_age`` has the same for each group of ages. A figure without pairs is
    None.
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


def _by_age(
    heading: str, short: str, definition: str, key: str, part: str, form: str, group: Group
) -> tuple[Metric, ...]:
    """Return a figure per evaluated pair: for all ages, and for each group of ages."""
    texts = [
        (heading, definition),
        *((f"{short} age {ages.text}", _text_of(heading, ages)) for ages in AGES),
    ]
    return tuple(
        Metric(ages.key(key), head, text, group, share(ages.key(part), ages.key(PAIRS)), form=form)
        for ages, (head, text) in zip(AGE_GROUPS, texts, strict=True)
    )


def _text_of(heading: str, ages: Ages) -> str:
    last = "or more" if ages.last == OLDEST else f"to {ages.last}"
    return (
        f"{heading[0].upper()}{heading[1:]} of the estimates whose track number was first reported "
        f"{ages.first} {last} scans before."
    )


NEES_BY_AGE = _by_age(
    "NEES",
    "NEES",
    "Normalised estimation error squared of the position, divided by 2: the mean over the pairs of "
    "half the squared Mahalanobis distance of the true position from the estimate. It is 1 if the "
    "covariances are right, and larger if they are too small. Estimates without a positive "
    "definite covariance are left out.",
    "nees",
    NEES,
    "#.3g",
    NEES_TABLE,
)
OUTSIDE_BY_AGE = _by_age(
    "outside 3 sigma",
    "outside",
    "Share of the pairs with a covariance in which the Mahalanobis distance of the position is "
    f"above {BOUND:g}. It is {EXPECTED_OUTSIDE:.1%} if the covariances are "
    "right and the errors are normal.",
    "outside_3_sigma",
    OUTSIDE,
    ".1%",
    OUTSIDE_TABLE,
)


class Consistency(Accumulator):
    """The Mahalanobis distances of the pairs, by age of the track."""

    names = tuple(ages.key(name) for ages in AGE_GROUPS for name in (PAIRS, NEES, OUTSIDE))
    metrics = (*NEES_BY_AGE, *OUTSIDE_BY_AGE)

    def __init__(self, cutoff: float, order: float) -> None:
        super().__init__(cutoff, order)
        self._ages = TrackAges()
        self._age = np.zeros(0, dtype=np.int64)

    def update(self, scan: PairedScan) -> None:
        """Take the next scan."""
        self._age = self._ages.add(scan.stamp_ns, scan.estimate.track_id, len(scan.estimate))

    def values(self, part: Comparison) -> Values:
        """Return the pairs, the sum of NEES / 2 and the pairs outside the bound, of each group."""
        error = part.paired_truth.position - part.paired_estimate.position
        square = mahalanobis2(error, part.paired_estimate.covariance)
        known, age = np.isfinite(square), self._age[part.pairs[1]]
        found: list[float] = []
        for ages in AGE_GROUPS:
            own = square[(ages.first <= age) & (age <= ages.last) & known]
            outside = int(np.count_nonzero(own > BOUND**2))
            found += [len(own), 0.5 * float(own.sum()), outside]
        return tuple(found)
