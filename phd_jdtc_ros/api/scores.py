"""Compares tracks with the truth."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.core.types import COASTING, TRACK_STATES
from phd_jdtc_ros.evaluation.comparison import ALL, PairedScan, PointSet
from phd_jdtc_ros.evaluation.run_scores import RunScores
from phd_jdtc_ros.evaluation.true_tracks import TrueTracks
from phd_jdtc_ros.quoting import short

from .tables import (
    MOST_METRES,
    Columns,
    Table,
    columns_of,
    numbers,
    place_of,
    require_column,
    rows_by_stamp,
    stamps_ns,
    with_column,
)

# Largest order p of OSPA and GOSPA.
MOST_ORDER = 100.0


def evaluate(
    truth: Table,
    tracks: Table,
    *,
    cutoff: float,
    order: float = 2.0,
    times: npt.ArrayLike | None = None,
) -> dict[str, Any]:
    """Compare tracks with the truth.

    Parameters
    ----------
    truth : table
        The targets: ``time``, ``label`` (numbers or names; None or NaN without one), ``x`` and
        ``y`` (metres); optionally ``vx`` and ``vy`` (metres per second), ``class`` and ``height``.
    tracks : table
        From `Tracker.track`, or from another tracker with the columns of `truth`. A label of 0 is
        none here; in the truth only if several targets of one time have it.
    cutoff : float
        c of OSPA and GOSPA, metres: the distance at which an estimate no longer belongs to a
        target, a multiple of the standard deviation of a position.
    order : float
        p of OSPA and GOSPA.
    times : array or None
        Times of the comparison, seconds: the times of all scans, so that scans without tracks count
        too. None for the times of `truth`. The truth is interpolated between its times.

    Returns
    -------
    dict
        The metrics of ``docs/metrics.md``, such as ``ospa``, each a number or None if it is
        undefined; and ``scans``, the number of times.

    Raises
    ------
    ValueError
        If a table is invalid, the truth does not span a time, or tracks have other times.
    """
    if not (_is_number(cutoff) and cutoff > 0.0):
        raise ValueError(f"cutoff: {short(repr(cutoff))} given, must be a number above 0")
    if not (_is_number(order) and 1.0 <= order <= MOST_ORDER):
        raise ValueError(f"order: {short(repr(order))} given, must be from 1 to {MOST_ORDER:g}")
    true, found = columns_of(truth), columns_of(tracks)
    for table, columns in (("truth", true), ("tracks", found)):
        _require_finite(table, columns)
    true = _with_numbers(true, zero_is_label=not _zero_is_shared(true))
    found = _with_numbers(found, zero_is_label=False)
    names = _class_names(true, found)
    samples, estimates = _by_stamp(true, names), _by_stamp(found, names)
    known = TrueTracks()
    for stamp_ns, points in samples.items():
        known.add(stamp_ns, points)
    stamps = sorted(samples)
    if times is not None:
        column = {"times": np.atleast_1d(np.asarray(times))}
        stamps = np.unique(stamps_ns(column, "times")).tolist()
    astray = sorted(estimates.keys() - {*stamps})
    if astray:
        raise ValueError(
            f"tracks: {len(astray)} of {len(estimates)} times, such as {astray[0] / 1e9}, are not "
            "times of the comparison; give times: those of all scans, or np.unique of the tracks'"
        )
    run = RunScores(len(names), cutoff, order)
    none = _points({name: column[:0] for name, column in found.items()}, names)
    for stamp_ns in stamps:
        targets = known.at(stamp_ns)
        if targets is None:
            raise ValueError(f"truth: unknown at {stamp_ns / 1e9} s, must span all times")
        run.add(PairedScan.of(stamp_ns, targets, estimates.get(stamp_ns, none), cutoff))
    return {**run.figures()[ALL], "scans": run.scans}


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and math.isfinite(value)


def _require_finite(table: str, columns: Columns) -> None:
    """Raise `ValueError` if a position is unknown or absurd."""
    for name in ("x", "y"):
        unknown = ~(np.abs(numbers(columns, name)) <= MOST_METRES)
        if unknown.any():
            row = int(np.argmax(unknown))
            raise ValueError(
                f"{table}: {name} is {short(str(columns[name][row]))!r} in "
                f"{place_of(columns, row)}, must be finite, at most {MOST_METRES:g} m"
            )


def _class_names(*tables: Columns) -> list[str]:
    """Return the names of all classes; a single name if a table has no classes."""
    if not all("class" in table for table in tables):
        return ["target"]
    names = np.concatenate([table["class"].astype(np.str_) for table in tables])
    return [str(name) for name in np.unique(names)]


def _by_stamp(table: Columns, class_names: list[str]) -> dict[int, PointSet]:
    stamp_ns = stamps_ns(table)
    points = _points(table, class_names)
    return {int(stamp_ns[rows[0]]): points.only(rows) for rows in rows_by_stamp(stamp_ns)}


def _points(table: Columns, class_names: list[str]) -> PointSet:
    x, y = numbers(table, "x"), numbers(table, "y")
    count = len(x)
    class_id = np.zeros(count, dtype=np.int64)
    if len(class_names) > 1:
        class_id = np.searchsorted(class_names, table["class"].astype(np.str_))
    velocity = None
    if {"vx", "vy"} <= table.keys():
        velocity = np.stack([numbers(table, "vx"), numbers(table, "vy")], axis=1)
    return PointSet(
        np.stack([x, y], axis=1),
        class_id,
        table.get("label"),
        velocity,
        table["covariance"][:, :2, :2] if "covariance" in table else None,
        numbers(table, "height") if "height" in table else None,
        require_column(table, "state") == TRACK_STATES[COASTING] if "state" in table else None,
    )


def _zero_is_shared(truth: Columns) -> bool:
    """Return whether several targets of one time have the label 0, which is none then."""
    zero = np.isin(truth["label"].astype(np.str_), ("0", "0.0")) if "label" in truth else ()
    times = require_column(truth, "time")[np.flatnonzero(zero)]
    return len(np.unique(times)) < len(times)


def _with_numbers(table: Columns, *, zero_is_label: bool) -> Columns:
    """Return a table whose labels, if it has any, are numbers from 1; 0 for a row without one."""
    if "label" not in table:
        return table
    label = table["label"]
    if label.dtype.kind == "O":  # a data frame with names, and nothing where a row has none
        label = np.array(["" if each is None or each != each else str(each) for each in label])
    texts = label.dtype.kind == "U"  # a CSV file has texts
    none = label == "" if texts else label != label
    if not zero_is_label:
        none |= label == ("0" if texts else 0)
    _, number = np.unique(label, return_inverse=True)
    return with_column(table, "label", np.where(none, 0, number.reshape(-1) + 1))
