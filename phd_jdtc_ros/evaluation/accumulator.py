"""The base of metrics: an accumulator computes values of every scan and figures from their totals.

A new metric is a name and a value of an `Accumulator`, and a row of its `metrics`. A metric that
depends on earlier scans, such as those of tracks, keeps its state in `update`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, TypeAlias

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray

from .comparison import Comparison, LabelledPoints, PairedScan


@dataclass(frozen=True)
class Totals:
    """Totals of scan values, for several runs or sets at once."""

    names: tuple[str, ...]  # Names of the V values
    scans: int  # Number of scans per run
    known: IntArray  # Number of scans that have the value, (..., V)
    sums: FloatArray  # Sum over those scans, (..., V)
    maxima: FloatArray  # Maximum over those scans, (..., V)

    @staticmethod
    def of(names: tuple[str, ...], values: FloatArray) -> Totals:
        """Return the totals of values of shape (..., scans, V), NaN for missing values."""
        known = np.isfinite(values)
        return Totals(
            names,
            values.shape[-2],
            known.sum(axis=-2),
            np.where(known, values, 0.0).sum(axis=-2),
            np.where(known, values, -np.inf).max(axis=-2, initial=-np.inf),
        )

    def plus(self, more: Totals) -> Totals:
        """Return the totals over the scans of both."""
        return Totals(
            self.names,
            self.scans + more.scans,
            self.known + more.known,
            self.sums + more.sums,
            np.maximum(self.maxima, more.maxima),
        )

    def mean(self, name: str) -> FloatArray:
        """Return the mean over the scans that have the value, shape (...); NaN without any."""
        column = self.names.index(name)
        return ratio(self.sums[..., column], self.known[..., column])

    def sum(self, name: str) -> FloatArray:
        """Return the sum over the scans, shape (...); NaN unless all scans have the value."""
        column = self.names.index(name)
        return np.where(self.known[..., column] == self.scans, self.sums[..., column], np.nan)

    def maximum(self, name: str) -> FloatArray:
        """Return the maximum over the scans, shape (...); NaN unless all scans have the value."""
        column = self.names.index(name)
        known = (self.known[..., column] == self.scans) & (self.scans > 0)
        return np.where(known, self.maxima[..., column], np.nan)


def ratio(over: FloatArray, under: FloatArray | IntArray | int) -> FloatArray:
    """Return the ratios, NaN where the denominator is not positive."""
    undefined = np.full(np.shape(over), np.nan)
    result: FloatArray = np.divide(over, under, out=undefined, where=np.asarray(under) > 0)
    return result


# A function that computes one figure from totals, for each run; NaN where undefined.
Figure: TypeAlias = "Callable[[Totals], FloatArray]"
# Values of a scan and set, ordered as an accumulator's `names`; None for a missing value.
Values: TypeAlias = "tuple[float | None, ...]"


class Group(NamedTuple):
    """The metrics of one table."""

    title: str
    # True if the metrics exist for every class too, not only for all targets.
    of_sets: bool = True


OSPA, GOSPA, SURVEILLANCE = Group("OSPA"), Group("GOSPA"), Group("surveillance figures")
NEES = Group("NEES / 2 of positions, by age in scans")
OUTSIDE = Group("positions outside 3 sigma, by age in scans")
# Metrics that need labels of all targets and estimates.
TRACKS = Group("tracks", of_sets=False)
SPACE = Group("space", of_sets=False)
WHOLE, CLASSES = Group("all targets", of_sets=False), Group("classes", of_sets=False)


@dataclass(frozen=True)
class Metric:
    """A figure of a run."""

    key: str  # Key in `metrics.json` and in a study's summary
    heading: str  # Heading of the column
    definition: str  # One or two sentences
    group: Group
    figure: Figure | None = None  # None for the mean of the value `key` over the scans that have it
    unit: str = ""  # Empty for a number without a unit
    form: str = ".1f"  # Python format specification
    # True if the figure of all smoothed estimates is repeated at the top of `metrics.json`.
    headline: bool = False

    def of_run(self, run: Totals) -> FloatArray:
        """Return the figure of each run from its totals; NaN where undefined."""
        return run.mean(self.key) if self.figure is None else self.figure(run)

    def text(self, value: float) -> str:
        """Return a figure as text, with its unit; lengths below a metre have two digits."""
        form = "#.2g" if self.unit == "m" and 5e-4 <= abs(value) < 0.995 else self.form
        return f"{value:{form}} {self.unit}".rstrip()


def share(part: str, whole: str) -> Figure:
    """Return a figure: the ratio of two values' sums over the run."""
    return lambda run: ratio(run.sum(part), run.sum(whole))


def root_mean(squares: str, number: str) -> Figure:
    """Return a figure: a root mean square, from the squares' sum and number per scan."""
    return lambda run: np.sqrt(share(squares, number)(run))


def if_any(name: str, figure: Figure) -> Figure:
    """Return a figure that is undefined in runs in which the sum of a value is zero."""
    return lambda run: np.where(run.sum(name) > 0, figure(run), np.nan)


class Accumulator(ABC):
    """Computes values of every scan of a run, in order, and defines the metrics derived from them.

    `cutoff` and `order` are c, metres, and p of OSPA and GOSPA. `names` are those of the values;
    the evaluator publishes those in `published` per scan and set, and those in `plotted` as single
    numbers.
    """

    names: ClassVar[tuple[str, ...]]
    published: ClassVar[tuple[str, ...]] = ()
    curves: ClassVar[tuple[str, ...]] = ()
    metrics: ClassVar[tuple[Metric, ...]] = ()

    def __init__(self, cutoff: float, order: float) -> None:
        self.cutoff, self.order = cutoff, order

    def update(self, scan: PairedScan) -> None:
        """Add the next scan to the state; `values` is called afterwards."""
        return

    @abstractmethod
    def values(self, part: Comparison) -> Values:
        """Return the values of a set in the newest scan."""


class LabelAccumulator(Accumulator):
    """Values of scans whose targets and estimates all have labels; for all targets only."""

    def __init__(self, cutoff: float, order: float) -> None:
        super().__init__(cutoff, order)
        self._newest_ns: int | None = None
        self._values: Values = ()

    def update(self, scan: PairedScan) -> None:
        """Add the next scan; missing labels and a jump back in time reset the state.

        A scan without labels has no values.
        """
        truth, estimate = scan.truth.with_labels(), scan.estimate.with_labels()
        if truth is None or estimate is None:
            self.clear()
            self._values = (None,) * len(self.names)
            return
        if self._newest_ns is not None and scan.stamp_ns < self._newest_ns:
            self.clear()
        self._newest_ns = scan.stamp_ns
        self._values = self.add(truth, estimate, scan)

    @abstractmethod
    def clear(self) -> None:
        """Reset the state."""

    @abstractmethod
    def add(self, truth: LabelledPoints, estimate: LabelledPoints, scan: PairedScan) -> Values:
        """Add the next scan; return its values."""

    def values(self, part: Comparison) -> Values:
        """Return the values of all targets; None for a class."""
        return self._values if part.whole else (None,) * len(self.names)
