"""The scores of one run: values per lag, scan and set."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.evaluation.metric_table import COUNTED, PUBLISHED, values_of
from phd_jdtc_ros.evaluation.metrics import assign, ospa
from phd_jdtc_ros.evaluation.scan_scores import (
    ALL,
    Comparison,
    PairedScan,
    PointSet,
    ScanComparer,
    set_names,
)
from phd_jdtc_ros.evaluation.surveillance import confusion_matrix
from phd_jdtc_ros.simulation.scenario import truth_after

from ..runs import SimulatedRun, Tracks
from .definition import CUTOFF, ORDER, Variant
from .kinds import PEERS

# Order p and cut-off c (metres) of further OSPA for all targets only.
OTHER_ORDER, OTHER_CUTOFF = 1.0, 300.0
# A target is young in its first scans, which a tracker without known birth places needs to start a
# track.
YOUNG_SCANS = 5
# Scans in which a target is to be reported, its first one included.
PROMPT_SCANS = 4
# Values of the metric table, and further ones of the study.
OF_STUDY = (
    *("ospa_p1", "ospa_c300", "ospa_after_5", "median_error", "begun", "prompt", "cpu_ms"),
    *("on_reflectors", "late", "five_scans_old"),
)
# Estimates nearer than this to a reflector are of it, unless a target is as near; metres. In the
# first turns nobody knows where reflectors are.
ON_REFLECTOR, LEARNING_TURNS = 100.0, 20
# An estimate within this distance of a target is of it, metres.
FOUND = 200.0
VALUES = (*PUBLISHED, *COUNTED, "identity_switches", "seen_switches", *OF_STUDY)
BEGUN = [VALUES.index(name) for name in ("begun", "prompt")]


class Scores(NamedTuple):
    """The scores of one variant in one or several runs.

    Parameters
    ----------
    lags : tuple of int
    sets : tuple of str
        ``all`` and, for trackers with classes, one ``class_k`` per class.
    time_s : array of shape (scans,)
        Time since the first scan, seconds.
    values : array of shape (..., lags, scans, sets, VALUES)
        NaN where there is no such value.
    taken_for : int array of shape (..., lags, scans, C, C) or None
        [true class, estimated class]: number of pairs. None for trackers without classes.
    """

    lags: tuple[int, ...]
    sets: tuple[str, ...]
    time_s: FloatArray
    values: FloatArray
    taken_for: IntArray | None = None


def score(
    run: SimulatedRun,
    tracks: Tracks,
    variant: Variant,
    classes: int,
    cutoff: float = CUTOFF,
    cpu_ms: float = math.nan,
) -> Scores:
    """Return the scores of a variant at those of its lags that its tracker has.

    Parameters
    ----------
    run : SimulatedRun
    tracks : Tracks
    variant : Variant
    classes : int
    cutoff : float
        c of OSPA and GOSPA, metres.
    cpu_ms : float
        CPU time per turn, milliseconds; NaN if it is not known.

    Notes
    -----
    Values are rounded to a thousandth, so that a file of them is short and reading is exact.

    - The values of gaps are of the gaps that ended in the scan; all gaps end in the last scan.
    - ``ospa_p1`` and ``ospa_c300`` are OSPA of all targets with `OTHER_ORDER` and `OTHER_CUTOFF`.
    - ``median_error`` is the median distance of the pairs, metres, of all targets.
    - ``begun`` is the number of targets in their scan number `PROMPT_SCANS`, and ``prompt`` that of
      those of them that have been paired.
    - ``cpu_ms`` is the tracker's CPU time per turn, the same for all turns of a run.
    - ``on_reflectors``, ``late`` and ``five_scans_old`` are those of `_coastal`.
    - ``ospa_after_5`` is OSPA without the targets in their first `YOUNG_SCANS` scans and without
      the estimates paired with them; NaN if all existing targets are young.
    """
    lags = tuple(lag for lag in variant.lags if lag in tracks)
    if not lags:
        raise ValueError(f"lags: {variant.lags} wanted, the tracker has {sorted(tracks)}")
    scans = len(run.truth)
    estimated = 0 if variant.kind in PEERS else classes  # peers do not estimate classes
    sets = set_names(estimated)
    values = np.full((len(lags), scans, len(sets), len(VALUES)), np.nan)
    taken_for = np.zeros((len(lags), scans, estimated, estimated), dtype=np.int64)
    age = _ages(run)
    young = [ages < YOUNG_SCANS for ages in age]
    for row, lag in enumerate(lags):
        comparer = ScanComparer(estimated, cutoff, ORDER)
        paired: set[int] = set()
        for index, (truth, points) in enumerate(zip(run.truth, tracks[lag], strict=True)):
            scan = PairedScan.of(truth.stamp_ns, PointSet.of(truth), points, cutoff)
            compared = comparer.compare(scan)
            if index == scans - 1:
                compared = comparer.ended(compared)
            values[row, index] = _scan_values(scan, compared, young[index], cutoff)
            paired.update(truth.track_id[scan.pairs[0]].tolist())
            begun = truth.track_id[age[index] == PROMPT_SCANS - 1].tolist()
            prompt = [label for label in begun if label in paired]
            values[row, index, 0, BEGUN] = len(begun), len(prompt)
            matrix = confusion_matrix(scan.pairs, truth.class_id, points.class_id, estimated)
            taken_for[row, index] = matrix[:estimated, :estimated]
        for name, column in _coastal(run, tracks[lag], age).items():
            values[row, :, 0, VALUES.index(name)] = column
    values[:, :, 0, VALUES.index("cpu_ms")] = cpu_ms
    stamps = np.array([truth.stamp_ns - run.truth[0].stamp_ns for truth in run.truth])
    return Scores(lags, sets, stamps * 1e-9, np.round(values, 3), taken_for if estimated else None)


def _ages(run: SimulatedRun) -> list[IntArray]:
    """Return for every scan since how many scans each of its targets exists."""
    first: dict[int, int] = {}
    ages = []
    for scan, truth in enumerate(run.truth):
        of_scan = [scan - first.setdefault(label, scan) for label in truth.track_id.tolist()]
        ages.append(np.array(of_scan, dtype=np.int64))
    return ages


def _coastal(
    run: SimulatedRun, found: Sequence[PointSet], age: Sequence[IntArray]
) -> dict[str, FloatArray]:
    """Return by scan how many estimates are of reflectors, and how many targets are found late.

    Those are of ``five_scans_old`` targets, which end their first `YOUNG_SCANS` scans, the ones
    without an estimate in any of these, ``late``. An antenna that turns may have passed before a
    target appeared: the turn in which it does is not counted.
    """
    scans, seen = len(run.truth), set[int]()
    late, old, on_reflectors = np.zeros(scans), np.zeros(scans), np.full(scans, np.nan)
    before: set[int] = set()
    points = [point for kind in run.scenario.reflectors for point in kind.points]
    turning = any(radar.rotation_s > 0.0 for radar in run.scenario.radars)
    for index, (truth, estimates) in enumerate(zip(run.truth, found, strict=True)):
        # Those that are there from the first turn on were so before it.
        unseen = age[index] < index if turning else 0
        grown = set(truth.track_id[age[index] - unseen >= YOUNG_SCANS].tolist()) - before
        before |= grown
        old[index], late[index] = len(grown), len(grown - seen)
        target, _ = assign(truth.position, estimates.position, FOUND)
        seen |= set(truth.track_id[target].tolist())
        if points and index >= LEARNING_TURNS:
            everything = truth_after(run.scenario, (truth.stamp_ns - run.scenario.start_ns) * 1e-9)
            near = _near(estimates.position, np.array(points))
            own = _near(estimates.position, everything.position)
            on_reflectors[index] = np.count_nonzero(near & ~own)
    return {"on_reflectors": on_reflectors, "late": late, "five_scans_old": old}


def _near(position: FloatArray, places: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which positions are within `ON_REFLECTOR` of a place; shapes (N, 2) and (K, 2)."""
    away = np.hypot(*(position[:, None] - places).transpose(2, 0, 1))
    near: npt.NDArray[np.bool_] = (away < ON_REFLECTOR).any(axis=1)
    return near


def _scan_values(
    scan: PairedScan,
    compared: Mapping[str, Comparison],
    young: npt.NDArray[np.bool_],
    cutoff: float,
) -> FloatArray:
    """Return the values of one scan, shape (sets, VALUES)."""
    positions = scan.truth.position, scan.estimate.position
    rows = {key: values_of(comparison) for key, comparison in compared.items()}
    if len(rows) == 1:
        # The tracker does not estimate classes.
        rows[ALL]["right_class"] = None
    rows[ALL]["ospa_p1"] = ospa(*positions, cutoff, OTHER_ORDER).distance
    rows[ALL]["ospa_c300"] = ospa(*positions, OTHER_CUTOFF, ORDER).distance
    rows[ALL]["median_error"] = _median_error(compared[ALL])
    for key, distance in _ospa_without(scan, young, len(rows) - 1, cutoff).items():
        rows[key]["ospa_after_5"] = distance
    return np.array([[row.get(name) for name in VALUES] for row in rows.values()], dtype=float)


def _median_error(scan: Comparison) -> float:
    """Return the median distance of the pairs, NaN if there is none."""
    error = scan.paired_truth.position - scan.paired_estimate.position
    return float(np.median(np.hypot(*error.T))) if len(error) else math.nan


def _ospa_without(
    scan: PairedScan, young: npt.NDArray[np.bool_], classes: int, cutoff: float
) -> dict[str, float]:
    """Return the OSPA of each set without young targets and the estimates paired with them."""
    target, estimate = scan.pairs
    truth = scan.truth
    old = truth.only(np.flatnonzero(~young))
    rest = scan.estimate.only(np.delete(np.arange(len(scan.estimate)), estimate[young[target]]))
    sets = [(truth, old, rest)]
    sets += [(truth.of_class(k), old.of_class(k), rest.of_class(k)) for k in range(classes)]
    return {
        key: math.nan
        if len(existing) and not len(t)
        else ospa(t.position, e.position, cutoff, ORDER).distance
        for key, (existing, t, e) in zip(set_names(classes), sets, strict=True)
    }
