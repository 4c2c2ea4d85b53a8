"""The scores of one run: what is compared with the truth, scan by scan and set by set."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.core.evaluation import PointSet
from phd_jdtc_ros.core.metrics import assign, ospa
from phd_jdtc_ros.core.motion import POSITION
from phd_jdtc_ros.core.types import FloatArray

from ..runs import SimulatedRun, Tracks
from .definition import Variant
from .kinds import PEERS

# OSPA's c (metres) and p; and the other ones, for all targets only.
CUTOFF, ORDER = 1000.0, 2.0
OTHER_ORDER, OTHER_CUTOFF = 1.0, 300.0

ALL = "all"
VALUES = (
    "ospa",
    "localization",
    "cardinality",
    "n_true",
    "n_est",
    "pairs",
    "right_class",
    "ospa_p1",
    "ospa_c300",
)


class Scores(NamedTuple):
    """One variant's scores of one run, or several.

    Parameters
    ----------
    lags : tuple of int
    sets : tuple of str
        ``all`` and, for trackers that tell classes, one ``class_k`` a class.
    time_s : array of shape (scans,)
        From the first scan.
    values : array of shape (..., lags, scans, sets, VALUES)
        NaN where there is no such value.
    """

    lags: tuple[int, ...]
    sets: tuple[str, ...]
    time_s: FloatArray
    values: FloatArray


def score(run: SimulatedRun, tracks: Tracks, variant: Variant, classes: int) -> Scores:
    """Return the scores of those lags of a variant that its tracker has.

    Notes
    -----
    Rounded to a millimetre, so that a file of them is short and reads back as it was. ``pairs``
    are targets of the set with an estimate assigned by position alone, closer than the cutoff;
    ``right_class`` those among them whose estimate has their class.
    """
    lags = tuple(lag for lag in variant.lags if lag in tracks)
    if not lags:
        raise ValueError(f"lags: {variant.lags} wanted, the tracker has {sorted(tracks)}")
    classified = variant.kind not in PEERS
    sets = (ALL, *(f"class_{k}" for k in range(classes if classified else 0)))
    values = np.full((len(lags), len(run.scans), len(sets), len(VALUES)), np.nan)
    for row, lag in zip(values, lags, strict=True):
        for scan, (truth, found) in enumerate(zip(run.truth, tracks[lag], strict=True)):
            targets = PointSet(truth.state[:, list(POSITION)], truth.class_id)
            row[scan] = _scan_scores(targets, found, len(sets), classified)
    stamps = np.array([truth.stamp_ns - run.truth[0].stamp_ns for truth in run.truth])
    return Scores(lags, sets, stamps * 1e-9, np.round(values, 3))


def _scan_scores(truth: PointSet, found: PointSet, sets: int, classified: bool) -> FloatArray:
    """Return the values of one scan, shape (sets, VALUES)."""
    target, estimate = assign(truth.position, found.position, CUTOFF)
    right = truth.class_id[target] == found.class_id[estimate]
    whole = _set_scores(truth, found, right, classified)
    whole["ospa_p1"] = ospa(truth.position, found.position, CUTOFF, OTHER_ORDER).distance
    whole["ospa_c300"] = ospa(truth.position, found.position, OTHER_CUTOFF, ORDER).distance
    rows = [whole]
    for k in range(sets - 1):
        own = right[truth.class_id[target] == k]
        rows.append(_set_scores(truth.of_class(k), found.of_class(k), own, classified))
    return np.array([[row.get(name, math.nan) for name in VALUES] for row in rows])


def _set_scores(
    truth: PointSet, found: PointSet, right: npt.NDArray[np.bool_], classified: bool
) -> dict[str, float]:
    """Return a set's values, given for each of its pairs whether it has the right class."""
    distance = ospa(truth.position, found.position, CUTOFF, ORDER)
    return {
        "ospa": distance.distance,
        "localization": distance.localization,
        "cardinality": distance.cardinality,
        "n_true": len(truth),
        "n_est": len(found),
        "pairs": len(right),
        "right_class": int(right.sum()) if classified else math.nan,
    }
