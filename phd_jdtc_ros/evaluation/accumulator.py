"""What a metric is: an accumulator, which gives values of every scan, and figures made of them.

A new metric is a name and a value of an `Accumulator`, and a row of its `metrics`. One that needs
what was before, such as tracks, keeps that in `update`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, TypeAlias

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray

from .comparison import Comparison, LabelledPoints, PairedScan
from .totals import Totals, ratio

# The figure of every run of the totals, NaN where it has no meaning.
Figure: TypeAlias = "Callable[[Totals], FloatArray]"
# In the order of an accumulator's `names`; None for a scan or a set without such a value.
Values: TypeAlias = "tuple[float | None, ...]"


class Group(NamedTuple):
    """Metrics that stand in one table.

    Parameters
    ----------
    title : str
    of_sets : bool
        Whether they are of every class too, and not of all targets only.
    """

    title: str
    of_sets: bool = True


OSPA, GOSPA, SURVEILLANCE = Group("OSPA"), Group("GOSPA"), Group("surveillance figures")
NEES = Group("NEES / 2 of positions, by age in scans")
OUTSIDE = Group("positions outside 3 sigma, by age in scans")
# These need labels of all targets and estimates.
TRACKS = Group("tracks", of_sets=False)
WHOLE, CLASSES = Group("all targets", of_sets=False), Group("classes", of_sets=False)


@dataclass(frozen=True)
class Metric:
    """A figure of a run.

    Parameters
    ----------
    key : str
        Its key in `metrics.json` and in a study's summary.
    heading : str
        Heading of its column.
    unit, form : str
        Unit, empty if there is none, and Python format specification.
    of_run : callable of Totals
    definition : str
        One or two sentences.
    group : Group
    headline : bool
        Whether that of all smoothed estimates stands at the top of `metrics.json` too.
    """

    key: str
    heading: str
    unit: str
    form: str
    of_run: Figure
    definition: str
    group: Group
    headline: bool = False

    def text(self, value: float) -> str:
        """Return a figure as text, with its unit; lengths below a metre have two digits."""
        form = "#.2g" if self.unit == "m" and 5e-4 <= abs(value) < 0.995 else self.form
        return f"{value:{form}} {self.unit}".rstrip()


def mean(name: str) -> Figure:
    """Return the figure that is the mean of a value over the scans that have it."""
    return lambda run: run.mean(name)


def share(part: str, whole: str) -> Figure:
    """Return the figure that is the ratio of two values' sums over the run."""
    return lambda run: ratio(run.sum(part), run.sum(whole))


def root_mean(squares: str, number: str) -> Figure:
    """Return the figure that is a root mean square, from the squares' sum and number per scan."""
    return lambda run: np.sqrt(share(squares, number)(run))


def if_any(name: str, figure: Figure) -> Figure:
    """Return a figure that has no meaning in runs in which the sum of a value is zero."""
    return lambda run: np.where(run.sum(name) > 0, figure(run), np.nan)


class Accumulator:
    """Values of every scan of a run, in order, and the metrics that are figures of them.

    Parameters
    ----------
    cutoff, order : float
        c, metres, and p.

    Attributes
    ----------
    names : tuple of str
        Of its values.
    published, plotted : tuple of str
        Those that the evaluator publishes per scan and set, and as single numbers.
    metrics : tuple of Metric
    """

    names: ClassVar[tuple[str, ...]]
    published: ClassVar[tuple[str, ...]] = ()
    plotted: ClassVar[tuple[str, ...]] = ()
    metrics: ClassVar[tuple[Metric, ...]] = ()

    def __init__(self, cutoff: float, order: float) -> None:
        self.cutoff, self.order = cutoff, order

    def update(self, scan: PairedScan) -> None:
        """Take the next scan, whose values are asked for after it."""

    def values(self, part: Comparison) -> Values:
        """Return the values of a set at the newest scan."""
        raise NotImplementedError


class LabelAccumulator(Accumulator):
    """Values of scans whose targets and estimates all have labels; of all targets only."""

    def __init__(self, cutoff: float, order: float) -> None:
        super().__init__(cutoff, order)
        self._newest_ns: int | None = None
        self._values: Values = ()

    def update(self, scan: PairedScan) -> None:
        """Take the next scan; what was before is forgotten without labels, and if time goes back.

        A scan without labels has no values.
        """
        truth, estimate = scan.truth.labelled(), scan.estimate.labelled()
        back = self._newest_ns is not None and scan.stamp_ns < self._newest_ns
        if truth is None or estimate is None:
            self.clear()
            self._values = (None,) * len(self.names)
            return
        if back:
            self.clear()
        self._newest_ns = scan.stamp_ns
        self._values = self.add(truth, estimate, scan)

    def clear(self) -> None:
        """Forget what was before."""
        raise NotImplementedError

    def add(self, truth: LabelledPoints, estimate: LabelledPoints, scan: PairedScan) -> Values:
        """Take the next scan; return its values."""
        raise NotImplementedError

    def values(self, part: Comparison) -> Values:
        """Return the values of all targets; None for a class."""
        return self._values if part.whole else (None,) * len(self.names)
