"""Compares tracks with the truth, and simulates both detections and truth, all as tables."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Mapping, Sequence
from itertools import chain
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros import resources
from phd_jdtc_ros.columns import identities, sent_columns
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.types import COASTING, TRACK_STATES, Truth
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.evaluation.comparison import ALL, PairedScan, PointSet, TrueTracks
from phd_jdtc_ros.evaluation.run_scores import RunScores
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.quoting import short
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.scenario import Scenario, paper_scenario
from phd_jdtc_ros.simulation.turning_antenna import SimulatedReport, check_sites, truth_and_reports

from .reports import TIME
from .tables import (
    MOST_METRES,
    Column,
    Columns,
    Table,
    columns_of,
    numbers,
    place_of,
    require_column,
    rows_by_stamp,
    stamps_ns,
    structured_array,
    with_column,
)


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

    Warns
    -----
    UserWarning
        If some rows have no label, or that of another row of their time, or if the targets of the
        truth have different times.
    """
    # Largest order p of OSPA and GOSPA.
    most_order = 100.0
    if not (_is_number(cutoff) and cutoff > 0.0):
        raise ValueError(f"cutoff: {short(repr(cutoff))} given, must be a number above 0")
    if not (_is_number(order) and 1.0 <= order <= most_order):
        raise ValueError(f"order: {short(repr(order))} given, must be from 1 to {most_order:g}")
    true, found = columns_of(truth), columns_of(tracks)
    for table, columns in (("truth", true), ("tracks", found)):
        _require_finite(table, columns)
    true = _with_numbers(true, zero_is_label=not _zero_is_shared(true))
    found = _with_numbers(found, zero_is_label=False)
    for text in (_apart(true), _without_identity(true)):
        if text:
            warnings.warn(f"truth: {text}", stacklevel=2)
    if text := _without_identity(found):
        warnings.warn(f"tracks: {text}", stacklevel=2)
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
    """Raise `ValueError` if a time or position is missing, or a position is unknown or absurd."""
    for name in ("time", "x", "y"):
        require_column(columns, name, f"; {table} must have it")
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
    if label.dtype.kind == "O":  # A data frame may have names, and nothing for a row without.
        label = np.array(["" if each is None or each != each else str(each) for each in label])
    texts = label.dtype.kind == "U"  # Those of a CSV file are.
    none = label == "" if texts else label != label
    if not zero_is_label:
        none |= label == ("0" if texts else 0)
    _, number = np.unique(label, return_inverse=True)
    return with_column(table, "label", np.where(none, 0, number.reshape(-1) + 1))


def _apart(truth: Columns) -> str:
    """Return the sentence about targets that have times of their own; empty if they share them.

    A target counts as absent where another one has a time and it has none.
    """
    if "label" not in truth or not len(truth["label"]):
        return ""
    _, at = np.unique(stamps_ns(truth), return_inverse=True)
    own = [at[truth["label"] == label] for label in np.unique(truth["label"])]
    present = [len(np.unique(times)) / (1 + np.ptp(times)) for times in own]
    if np.median(present) > 0.6:
        return ""
    return (
        f"most targets have no row at many of the {at.max() + 1} times, and count as absent there; "
        "interpolate all of them to common times"
    )


def _without_identity(table: Columns) -> str:
    """Return the sentence about rows whose labels say nothing, among others; empty if none do.

    The labels are those of `_with_numbers`. A table without any label says that none are known.
    """
    label = table.get("label")
    if label is None or not label.any():
        return ""
    pairs = np.column_stack([stamps_ns(table), label])
    _, first, row = np.unique(pairs, axis=0, return_index=True, return_inverse=True)
    again = first[row.reshape(-1)] != np.arange(len(label))
    for wrong, what in ((label == 0, "no label"), (again, "the label of another one of its time")):
        if wrong.any():
            return (
                f"{np.count_nonzero(wrong)} of {len(label)} rows, such as "
                f"{place_of(table, int(np.argmax(wrong)))}, with {what}; figures of identities, "
                "such as identity_switches, are None"
            )
    return ""


class Simulated(NamedTuple):
    """A simulated run, with structured arrays."""

    # Plots of all radars in the order of time, as `Tracker` accepts them; a scan without detections
    # is a row with NaN.
    detections: Column
    truth: Column  # ``time label class x y vx vy height``, as `evaluate` accepts it
    parameters: dict[str, Any]  # All parameters of a `Tracker` for these radars, by dotted name


def simulate(
    scenario: Mapping[str, Any] | str | os.PathLike[str] | None = None, *, seed: int
) -> Simulated:
    """Simulate radars and targets.

    Parameters
    ----------
    scenario : mapping, str, path or None
        A scenario as in ``docs/scenarios.md``, the path of such a file, or the name of a shipped
        scenario such as ``one_radar``; None for the reference scenario.
    seed : int
        Equal seeds give equal tables, which match the output of the executable ``simulate``.

    Raises
    ------
    ConfigError
        A ValueError with all faults of the scenario.
    """
    if not isinstance(seed, (int, np.integer)) or seed < 0:
        raise ConfigError(f"seed: {short(repr(seed))} given, must be a whole number from 0 on")
    document = _document(scenario)
    config = _config(from_arguments.scenario_parameters(document))
    radars = polar_radars(config.model.radars)
    run = paper_scenario(radars) if document is None else scenario_file.resolve(document, radars)
    if run.platform is not None:
        raise ConfigError("platform: given, must be absent, because tables have no poses")
    check_sites(config.radars)
    names = [kind.name for kind in config.model.modes.classes]
    truths, reports = truth_and_reports(run, config.radars, seed)
    return Simulated(
        _detections(reports, config.radars), _truth(truths, run, names), dict(config.values)
    )


def _document(scenario: Mapping[str, Any] | str | os.PathLike[str] | None) -> Any:
    if scenario is None or isinstance(scenario, Mapping):
        return scenario
    path = resources.scenario(scenario)
    if len(path.parts) == 1 and not path.suffix and not os.path.exists(path):
        shipped = sorted(file.stem for file in resources.find(resources.SCENARIOS).glob("*.yaml"))
        raise ConfigError(
            f"scenario: {short(repr(str(path)))} given, must be a mapping, the path of a file, "
            f"or one of {', '.join(shipped)}"
        )
    return yaml_files.load(path)


def _config(parameters: Mapping[str, Any]) -> TrackerConfig:
    """Return a configuration with absolute detection times, as in tables."""
    config = resolve(parameters, SystemPlane)
    given = {"fields.time": TIME, "fields.sector": ""}
    given |= {"units.time_reference": "epoch", "units.time": "s"}
    timed = [radar.name for radar in config.radars if radar.fields.time]
    changes = {f"{name}.{key}": value for name in timed for key, value in given.items()}
    return resolve({**config.values, **changes}, SystemPlane)


def _detections(reports: Sequence[SimulatedReport], inputs: Sequence[RadarParameters]) -> Column:
    """Return reports as a table with the columns of all radars."""
    own = [sent_columns.names_of(radar.fields).values() for radar in inputs]
    names = [name for name in dict.fromkeys(chain.from_iterable(own)) if name != TIME]
    dtype = [
        (TIME, np.float64),
        ("radar", f"U{max(len(radar.name) for radar in inputs)}"),
        *((name, np.float64) for name in names),
    ]
    parts = []
    for index, stamp_ns, found, _ in reports:
        radar = inputs[index]
        sent = sent_columns.of(found, stamp_ns, radar) if len(found) else {}
        time = sent[TIME] if radar.fields.time and sent else stamp_ns / 1e9
        columns = {
            name: _number(sent[name]) if name in own[index] and sent else np.nan for name in names
        }
        parts.append((max(len(found), 1), {TIME: time, "radar": radar.name, **columns}))
    return structured_array(dtype, parts)


def _number(column: Column) -> Column:
    """Return a column as floats, with NaN for absent codes and addresses."""
    none = column == identities.NONE if column.dtype == np.uint32 else np.zeros(len(column), bool)
    return np.where(none, np.nan, column.astype(np.float64))


def _truth(truths: Sequence[Truth], run: Scenario, class_names: Sequence[str]) -> Column:
    highest = max([-1, *(target.class_id for target in run.targets)])
    names = [*class_names, *(f"class_{k}" for k in range(len(class_names), highest + 1))]
    dtype = [
        *((TIME, np.float64), ("label", np.int64), ("class", f"U{max(map(len, names))}")),
        *((name, np.float64) for name in ("x", "y", "vx", "vy", "height")),
    ]
    parts = []
    for each in truths:
        (x, y), (vx, vy) = each.position.T, each.velocity.T
        height = np.nan if each.height is None else each.height[:, 0]
        columns = each.stamp_ns / 1e9, each.track_id, np.array(names)[each.class_id]
        values = (*columns, x, y, vx, vy, height)
        parts.append((len(each.track_id), {n: v for (n, _), v in zip(dtype, values, strict=True)}))
    return structured_array(dtype, parts)
