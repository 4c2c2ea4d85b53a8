"""The scores of one run: values per lag, scan and set."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.evaluation.accumulators.distances import confusion_matrix
from phd_jdtc_ros.evaluation.comparison import PairedScan, PointSet, set_names
from phd_jdtc_ros.evaluation.run_scores import ScanComparer

from ..tracker import SimulatedRun, Tracks
from .definition import CUTOFF, ORDER, Variant
from .metrics import VALUES, new_accumulators


class Scores(NamedTuple):
    """The scores of one variant in one or several runs."""

    lags: tuple[int, ...]
    sets: tuple[str, ...]  # ``all`` and, for trackers with classes, one ``class_k`` per class
    time_s: FloatArray  # Time since the first scan, seconds, (scans,)
    values: FloatArray  # NaN for missing values, (..., lags, scans, sets, VALUES)
    # Number of pairs by [true class, estimated class], (..., lags, scans, C, C); None for trackers
    # without classes.
    taken_for: IntArray | None = None


def score(
    run: SimulatedRun,
    tracks: Tracks,
    variant: Variant,
    classes: int,
    cutoff: float = CUTOFF,
    cpu_ms: float = math.nan,
) -> Scores:
    """Return the scores of a variant at the lags that its tracker supports.

    The cutoff is c of OSPA and GOSPA, metres, and `cpu_ms` the CPU time per revolution,
    milliseconds, NaN if unknown. Values are rounded to a thousandth, so that files are short and
    values are read back exactly. The values of gaps count the gaps that ended in the scan; all gaps
    end in the last scan.
    """
    lags = tuple(lag for lag in variant.lags if lag in tracks)
    if not lags:
        raise ValueError(f"lags: {variant.lags} requested, the tracker has {sorted(tracks)}")
    scans = len(run.truth)
    estimated = classes if variant.kind.classes else 0
    sets = set_names(estimated)
    values = np.full((len(lags), scans, len(sets), len(VALUES)), np.nan)
    taken_for = np.zeros((len(lags), scans, estimated, estimated), dtype=np.int64)
    for row, lag in enumerate(lags):
        comparer = ScanComparer(estimated, new_accumulators(cutoff, ORDER, run, cpu_ms))
        for index, (truth, points) in enumerate(zip(run.truth, tracks[lag], strict=True)):
            scan = PairedScan.of(truth.stamp_ns, PointSet.of(truth), points, cutoff)
            found = comparer.compare(scan)
            if index == scans - 1:
                found = comparer.final_values()
            values[row, index] = [list(of_set.values()) for of_set in found.values()]
            matrix = confusion_matrix(scan.pairs, truth.class_id, points.class_id, estimated)
            taken_for[row, index] = matrix[:estimated, :estimated]
    stamps = np.array([truth.stamp_ns - run.truth[0].stamp_ns for truth in run.truth])
    return Scores(lags, sets, stamps * 1e-9, np.round(values, 3), taken_for if estimated else None)
