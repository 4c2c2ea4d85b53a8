"""The metrics of a study: `evaluation`'s, and further ones that use the whole simulated run."""

from __future__ import annotations

import math
from abc import abstractmethod

import numpy as np

from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray
from phd_jdtc_ros.evaluation import run_scores
from phd_jdtc_ros.evaluation.accumulator import Accumulator, Group, Metric, Values, share
from phd_jdtc_ros.evaluation.comparison import Comparison, PairedScan
from phd_jdtc_ros.evaluation.metrics import assign, ospa
from phd_jdtc_ros.simulation.scenario import truth_after

from .tracker import SimulatedRun

STUDY = Group("studies")
# Order p and cut-off c (metres) of two further OSPA metrics, for all targets only.
OTHER_ORDER, OTHER_CUTOFF = 1.0, 300.0
# Number of first scans in which a target is young: a tracker without known birth places needs them
# to start a track.
YOUNG_SCANS = 5
# An estimate closer than this to a reflector counts as false there, unless a target is as close,
# metres; the first revolutions, in which reflectors are unknown, do not count.
ON_REFLECTOR, LEARNING_REVOLUTIONS = 100.0, 20


class RunAccumulator(Accumulator):
    """Values of scans of a simulated run.

    `cutoff` and `order` are c, metres, and p; `age` has the age of each target in scans, (T,), by
    scan, and `cpu_ms` is the CPU time per revolution, milliseconds, NaN if unknown.
    """

    def __init__(
        self, cutoff: float, order: float, run: SimulatedRun, age: list[IntArray], cpu_ms: float
    ) -> None:
        super().__init__(cutoff, order)
        self.run, self.age, self.cpu_ms = run, age, cpu_ms
        self.index = -1
        self._values: Values = ()

    def update(self, scan: PairedScan) -> None:
        """Take the next scan."""
        self.index += 1
        self._values = self.of_scan(scan)

    @abstractmethod
    def of_scan(self, scan: PairedScan) -> Values:
        """Return the values of all targets of the next scan."""

    def values(self, part: Comparison) -> Values:
        """Return the values of all targets; None for a class."""
        return self._values if part.whole else (None,) * len(self.names)


class OtherOspa(RunAccumulator):
    """OSPA with `OTHER_ORDER`, and OSPA with `OTHER_CUTOFF`."""

    names = ("ospa_p1", "ospa_c300")

    def of_scan(self, scan: PairedScan) -> Values:
        """Return both distances, metres."""
        positions = scan.truth.position, scan.estimate.position
        return (
            ospa(*positions, self.cutoff, OTHER_ORDER).distance,
            ospa(*positions, OTHER_CUTOFF, self.order).distance,
        )


class OspaAfterBirth(RunAccumulator):
    """OSPA without young targets and the estimates paired with them."""

    names = ("ospa_after_5",)
    metrics = (
        Metric(
            key="ospa_after_5",
            heading="OSPA after 5 scans",
            unit="m",
            definition="Mean OSPA without the targets in their first five scans and without the "
            "estimates that are paired with them. Scans in which all existing targets are in their "
            "first five are left out.",
            group=STUDY,
        ),
    )

    def of_scan(self, scan: PairedScan) -> Values:
        """Store the compared points, from which every set's value is computed."""
        young = self.age[self.index] < YOUNG_SCANS
        target, estimate = scan.pairs
        everything = np.arange(len(scan.estimate))
        self._old = scan.truth.only(np.flatnonzero(~young))
        self._rest = scan.estimate.only(np.delete(everything, estimate[young[target]]))
        return ()

    def values(self, part: Comparison) -> Values:
        """Return the distance, metres; NaN if all existing targets are young."""
        old, rest = self._old, self._rest
        if part.class_id is not None:
            old, rest = old.of_class(part.class_id), rest.of_class(part.class_id)
        if len(part.truth) and not len(old):
            return (math.nan,)
        return (ospa(old.position, rest.position, self.cutoff, self.order).distance,)


class MedianError(RunAccumulator):
    """The median error of the pairs' positions."""

    names = ("median_error",)
    metrics = (
        Metric(
            key="median_error",
            heading="median error",
            unit="m",
            definition="Median distance of the pairs of a scan, its mean over the scans.",
            group=STUDY,
        ),
    )

    def of_scan(self, scan: PairedScan) -> Values:
        """Return the median, metres; NaN without pairs."""
        error = scan.truth.position[scan.pairs[0]] - scan.estimate.position[scan.pairs[1]]
        return (float(np.median(np.hypot(*error.T))) if len(error) else math.nan,)


class Promptness(RunAccumulator):
    """Number of targets in scan `PROMPT_SCANS` of their life, and of those paired by then."""

    # A target should be reported by this scan of its life, counted from 1.
    PROMPT_SCANS = 4

    names = ("begun", "prompt")
    metrics = (
        Metric(
            key="reported_within_4",
            heading="reported within 4 scans",
            form=".1%",
            figure=share("prompt", "begun"),
            definition="Share of the targets that are paired with an estimate in one of their "
            "first four scans, by position alone, closer than c; of targets that exist so long.",
            group=STUDY,
        ),
    )
    _paired: frozenset[int] = frozenset()

    def of_scan(self, scan: PairedScan) -> Values:
        """Return both numbers."""
        label = self.run.truth[self.index].track_id
        self._paired |= {*label[scan.pairs[0]].tolist()}
        begun = label[self.age[self.index] == self.PROMPT_SCANS - 1].tolist()
        return len(begun), sum(each in self._paired for each in begun)


class CpuTime(RunAccumulator):
    """The CPU time per revolution, equal for all revolutions of a run."""

    names = ("cpu_ms",)
    metrics = (
        Metric(
            key="cpu_ms",
            heading="CPU per revolution",
            unit="ms",
            form=".0f",
            definition="CPU time per revolution of the antenna, filter and smoother together.",
            group=STUDY,
        ),
    )

    def of_scan(self, scan: PairedScan) -> Values:
        """Return the CPU time, milliseconds."""
        return (self.cpu_ms,)


class ReflectorsAndDelays(RunAccumulator):
    """Estimates of reflectors, and targets found late.

    ``five_scans_old`` counts targets at the end of their first `YOUNG_SCANS` scans, and ``late``
    the ones among them without an estimate in any of these scans. The revolution in which a target
    appears does not count, because the antenna may have passed before.
    """

    names = ("on_reflectors", "late", "five_scans_old")
    metrics = (
        Metric(
            key="on_reflectors",
            heading="on reflectors",
            form=".3f",
            definition="Mean number per revolution, after the first twenty, of estimates within "
            "100 m of a reflector such as a quay, and farther than that from every target.",
            group=STUDY,
        ),
        Metric(
            key="late",
            heading="found late",
            form=".1%",
            figure=share("late", "five_scans_old"),
            definition="Share of the targets to which no estimate within 200 m was assigned in "
            "their first five scans or revolutions.",
            group=STUDY,
        ),
    )
    _seen: frozenset[int] = frozenset()
    _before: frozenset[int] = frozenset()

    def of_scan(self, scan: PairedScan) -> Values:
        """Return the numbers."""
        truth, estimates, age = self.run.truth[self.index], scan.estimate, self.age[self.index]
        scenario = self.run.scenario
        turning = any(radar.rotation_s > 0.0 for radar in scenario.radars)
        # Targets of the first revolution already existed before it.
        unseen = age < self.index if turning else 0
        grown = {*truth.track_id[age - unseen >= YOUNG_SCANS].tolist()} - self._before
        self._before |= grown
        late = len(grown - self._seen)
        # A target counts as found if an estimate is within this distance, metres.
        target, _ = assign(truth.position, estimates.position, 200.0)
        self._seen |= {*truth.track_id[target].tolist()}
        points = [point for kind in scenario.reflectors for point in kind.points]
        on_reflectors = math.nan
        if points and self.index >= LEARNING_REVOLUTIONS:
            everything = truth_after(scenario, (truth.stamp_ns - scenario.start_ns) * 1e-9)
            near = _near(estimates.position, np.array(points))
            own = _near(estimates.position, everything.position)
            on_reflectors = float(np.count_nonzero(near & ~own))
        return on_reflectors, late, len(grown)


def _near(position: FloatArray, places: FloatArray) -> BoolArray:
    """Return which positions are within `ON_REFLECTOR` of a place; shapes (N, 2) and (K, 2)."""
    away = np.hypot(*(position[:, None] - places).transpose(2, 0, 1))
    near: BoolArray = (away < ON_REFLECTOR).any(axis=1)
    return near


OF_STUDY = (OtherOspa, OspaAfterBirth, MedianError, Promptness, CpuTime, ReflectorsAndDelays)
ACCUMULATORS: tuple[type[Accumulator], ...] = (*run_scores.ACCUMULATORS, *OF_STUDY)
VALUES = tuple(name for each in ACCUMULATORS for name in each.names)


def new_accumulators(
    cutoff: float, order: float, run: SimulatedRun, cpu_ms: float
) -> list[Accumulator]:
    """Return accumulators of all values of a run."""
    age = _ages(run)
    return [
        *(each(cutoff, order) for each in run_scores.ACCUMULATORS),
        *(each(cutoff, order, run, age, cpu_ms) for each in OF_STUDY),
    ]


def _ages(run: SimulatedRun) -> list[IntArray]:
    """Return the age of each target in scans, by scan."""
    first: dict[int, int] = {}
    ages = []
    for scan, truth in enumerate(run.truth):
        of_scan = [scan - first.setdefault(label, scan) for label in truth.track_id.tolist()]
        ages.append(np.array(of_scan, dtype=np.int64))
    return ages
