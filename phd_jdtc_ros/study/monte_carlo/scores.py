# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The scores of one run: what is compared with the truth, scan by scan and set by set."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.evaluation.metrics import assign, ospa
from phd_jdtc_ros.core.evaluation.scan_scores import Pairs, PointSet, Score, set_scores
from phd_jdtc_ros.core.evaluation.surveillance import Gap, GapFinder, Gaps, confusion_matrix

from ..runs import SimulatedRun, Tracks
from .definition import Variant
from .kinds import PEERS

# OSPA's and GOSPA's c (metres) and p; and OSPA's other ones, for all targets only.
CUTOFF, ORDER = 1000.0, 2.0
OTHER_ORDER, OTHER_CUTOFF = 1.0, 300.0
# In its first scans a target is young: a tracker that is not told where targets appear needs them.
YOUNG_SCANS = 5

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
    "ospa_after_5",
    "missed",
    "position_rms",
    "gaps",
    "long_gaps",
    "missed_in_long_gaps",
    "longest_gap_s",
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
    taken_for : int array of shape (..., lags, scans, C, C) or None
        How many targets of a class, the first of the two, have an estimate of a class, the
        second. None for trackers that do not tell classes.
    """

    lags: tuple[int, ...]
    sets: tuple[str, ...]
    time_s: FloatArray
    values: FloatArray
    taken_for: IntArray | None = None


def score(run: SimulatedRun, tracks: Tracks, variant: Variant, classes: int) -> Scores:
    """Return the scores of those lags of a variant that its tracker has.

    Notes
    -----
    Rounded to a millimetre, so that a file of them is short and reads back as it was.

    - ``pairs`` are targets of the set with an estimate assigned by position alone, closer than the
      cutoff; ``right_class`` those among them whose estimate has their class; ``position_rms`` is
      the root mean square of their distances in metres, NaN without one.
    - ``missed`` is of GOSPA; with OSPA's parts and the numbers all the rest of it follows.
    - ``ospa_after_5`` is OSPA without the targets in the first `YOUNG_SCANS` scans of their life
      and without the estimates assigned to them as above; NaN where all living targets are young.
    - ``gaps``, ``long_gaps``, ``missed_in_long_gaps`` and ``longest_gap_s`` are of the gaps in the
      set's targets' lives that ended with a scan, see `Gaps`; the last scan ends all.
    """
    lags = tuple(lag for lag in variant.lags if lag in tracks)
    if not lags:
        raise ValueError(f"lags: {variant.lags} wanted, the tracker has {sorted(tracks)}")
    told = 0 if variant.kind in PEERS else classes
    sets = (ALL, *(f"class_{k}" for k in range(told)))
    values = np.full((len(lags), len(run.scans), len(sets), len(VALUES)), np.nan)
    taken_for = np.zeros((len(lags), len(run.scans), told, told), dtype=np.int64)
    young = _young(run)
    for row, lag in enumerate(lags):
        gaps = GapFinder()
        for scan, (truth, found) in enumerate(zip(run.truth, tracks[lag], strict=True)):
            targets = PointSet(truth.position, truth.class_id, truth.track_id)
            pairs = assign(targets.position, found.position, CUTOFF)
            seen = np.zeros(len(targets), dtype=np.bool_)
            seen[pairs[0]] = True
            ended = gaps.add(truth.stamp_ns, truth.track_id, truth.class_id, seen)
            if scan == len(run.scans) - 1:
                ended += gaps.under_way()
            values[row, scan] = _scan_values(targets, found, pairs, young[scan], ended, sets)
            matrix = confusion_matrix(pairs, truth.class_id, found.class_id, told)
            taken_for[row, scan] = matrix[:told, :told]
    stamps = np.array([truth.stamp_ns - run.truth[0].stamp_ns for truth in run.truth])
    return Scores(lags, sets, stamps * 1e-9, np.round(values, 3), taken_for if told else None)


def _young(run: SimulatedRun) -> list[npt.NDArray[np.bool_]]:
    """Return for every scan which of its targets are in the first scans of their life."""
    first: dict[int, int] = {}
    young = []
    for scan, truth in enumerate(run.truth):
        ages = [scan - first.setdefault(label, scan) for label in truth.track_id.tolist()]
        young.append(np.array(ages, dtype=np.int64) < YOUNG_SCANS)
    return young


def _scan_values(
    truth: PointSet,
    found: PointSet,
    pairs: Pairs,
    young: npt.NDArray[np.bool_],
    gaps: list[Gap],
    sets: tuple[str, ...],
) -> FloatArray:
    """Return the values of one scan, shape (sets, VALUES)."""
    target, estimate = pairs
    classes = len(sets) - 1
    right = truth.class_id[target] == found.class_id[estimate]
    rows = {}
    for key, entry in set_scores(truth, found, pairs, classes, CUTOFF, ORDER).items():
        own = [gap for gap in gaps if key in (ALL, f"class_{gap.class_id}")]
        rows[key] = {**_distances(entry), **_gap_values(Gaps().plus(own)), "right_class": math.nan}
        if classes:
            chosen = (
                right
                if key == ALL
                else right[truth.class_id[target] == int(key.removeprefix("class_"))]
            )
            rows[key]["right_class"] = int(chosen.sum())
    rows[ALL]["ospa_p1"] = ospa(truth.position, found.position, CUTOFF, OTHER_ORDER).distance
    rows[ALL]["ospa_c300"] = ospa(truth.position, found.position, OTHER_CUTOFF, ORDER).distance
    for key, distance in _ospa_without(truth, found, pairs, young, classes).items():
        rows[key]["ospa_after_5"] = distance
    return np.array([[rows[key].get(name, math.nan) for name in VALUES] for key in sets])


def _distances(entry: Score) -> dict[str, float]:
    return {
        "ospa": entry.ospa.distance,
        "localization": entry.ospa.localization,
        "cardinality": entry.ospa.cardinality,
        "n_true": entry.n_true,
        "n_est": entry.n_est,
        "pairs": entry.pairs,
        "missed": entry.gospa.missed,
        "position_rms": math.sqrt(entry.square_error / entry.pairs) if entry.pairs else math.nan,
    }


def _gap_values(gaps: Gaps) -> dict[str, float]:
    return {
        "gaps": gaps.number,
        "long_gaps": gaps.long,
        "missed_in_long_gaps": gaps.missed_in_long,
        "longest_gap_s": gaps.longest_s,
    }


def _ospa_without(
    truth: PointSet,
    found: PointSet,
    pairs: Pairs,
    young: npt.NDArray[np.bool_],
    classes: int,
) -> dict[str, float]:
    """Return the OSPA of each set without young targets and the estimates assigned to them."""
    target, estimate = pairs
    theirs = estimate[young[target]]
    old = truth.only(np.flatnonzero(~young))
    left = found.only(np.delete(np.arange(len(found)), theirs))
    sets = {ALL: (truth, old, left)}
    for k in range(classes):
        sets[f"class_{k}"] = (truth.of_class(k), old.of_class(k), left.of_class(k))
    return {
        key: math.nan
        if len(living) and not len(t)
        else ospa(t.position, e.position, CUTOFF, ORDER).distance
        for key, (living, t, e) in sets.items()
    }
