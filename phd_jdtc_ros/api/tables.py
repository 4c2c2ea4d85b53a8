"""Converts users' tables to columns, and estimates to a table."""

from __future__ import annotations

import csv
import os
import re
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, time, timezone
from itertools import takewhile
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.types import TRACK_STATES, Estimates
from phd_jdtc_ros.quoting import short

Column: TypeAlias = "npt.NDArray[Any]"
Columns: TypeAlias = "dict[str, Column]"
# A mapping, a data frame, a structured array, or the path of a CSV file.
Table: TypeAlias = Any

# Latest time that 64 bits of nanoseconds can count, seconds.
LATEST_S = 9.2e9
# Times are refused if their resolution is more than half of the usual step, and of the second one
# of these; steps longer than the first one are no scans.
LONGEST_STEP_S, SHORTEST_STEP_S = 2.0, 0.06
UNITS = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds"}
# No coordinate of a target is larger, metres.
MOST_METRES = 1e9
# A date, perhaps with a time, and its offset from UTC in hours and minutes. NumPy would take other
# texts too, some of them with a warning.
_DATE = re.compile(
    r"(\d{4}-\d\d(?:-\d\d)?(?:[T ]\d\d(?::\d\d(?::(\d\d)(?:[.,]\d+)?)?)?)?) ?"
    r"(?:Z|UTC|([+-])(\d\d):?(\d\d)?)?"
)
# A time of day, of which a leap second is the next one.
_TIME_OF_DAY = re.compile(r"(?:[01]?\d|2[0-4]):[0-5]\d:(?:[0-5]\d|60)(?:[.,]\d+)?")


class Located(dict[str, Column]):
    """Columns that know where their rows come from."""

    def __init__(self, columns: Columns, places: IntArray, path: Path | None = None) -> None:
        super().__init__(columns)
        self.places = places  # Lines of a file, or rows of a larger table, from 1 on
        self.path = path  # The file; None for rows of a table


def rows_of(columns: Columns, rows: IntArray) -> Columns:
    """Return some rows of columns."""
    own = {name: column[rows] for name, column in columns.items()}
    if isinstance(columns, Located):
        return Located(own, columns.places[rows], columns.path)
    return Located(own, rows + 1)


def with_column(columns: Columns, name: str, column: Column) -> Columns:
    """Return columns with another one of a name."""
    changed = {**columns, name: column}
    if isinstance(columns, Located):
        return Located(changed, columns.places, columns.path)
    return changed


def place_of(columns: Columns, row: int) -> str:
    """Return the words for the place of a row, as the user counts."""
    if not isinstance(columns, Located):
        return f"row {row + 1}"
    number = columns.places[row]
    return f"row {number}" if columns.path is None else f"line {number} of {columns.path}"


def columns_of(table: Table) -> Columns:
    """Return a table's columns by name, all of equal length; a CSV file has a header line.

    Raise `ValueError` if it is not a `Table`, or its columns differ in length.
    """
    if isinstance(table, (str, os.PathLike)):
        return _read_csv(Path(table))
    dtype = getattr(table, "dtype", None)
    names = dtype.names if isinstance(dtype, np.dtype) else _names(table)
    if names is None:
        if parts := getattr(table, "_fields", ()):  # As of `Tracks`, which are two tables
            raise ValueError(
                f"{type(table).__name__} given, must be one of its tables: {' or '.join(parts)}"
            )
        raise ValueError(
            f"{type(table).__name__} given, must have named columns: a mapping of name to column, "
            "a data frame, a structured array or the path of a CSV file; an array of rows is "
            'dict(zip(("time", "range", "azimuth"), array.T))'
        )
    columns = {str(name): _column_of(table[name]) for name in names}
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"columns must have equal lengths, have {short(str(lengths))}")
    return columns


def _column_of(values: Any) -> Column:
    """Return a column; texts that a data frame stores as objects become an array of texts."""
    column = np.atleast_1d(np.asarray(values))
    if isinstance(values, np.ma.MaskedArray) and column.dtype.kind in "biuf":
        column = np.where(np.ma.getmaskarray(values), np.nan, column)
    are_texts = column.dtype.kind == "S" or (
        column.dtype.kind == "O" and all(isinstance(each, str) for each in column.flat)
    )
    return column.astype(np.str_) if are_texts else column


def _names(table: Table) -> list[Any] | None:
    found = getattr(table, "columns", None)  # Data frames
    if found is None and isinstance(table, Mapping):
        found = table.keys()
    return None if found is None else list(found)


def _read_csv(path: Path) -> Columns:
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.reader(stream)
            numbered = [(reader.line_num, row) for row in reader if row]
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path}: {error}; must be a CSV file in UTF-8") from error
    if not numbered:
        raise ValueError(f"{path}: is empty, must have a line of names and lines of values")
    lines, rows = zip(*_without_comments(numbered), strict=True)
    names = [name.strip() for name in rows[0]]
    if len(names) == 1 and (other := re.search("[;\t ]", names[0])):
        raise ValueError(f"{path}: {other[0]!r} in line {lines[0]}, must be names and commas")
    # Several columns may have no name, because such columns are not used.
    repeated = [name for name, count in Counter(names).items() if name and count > 1]
    if repeated:
        raise ValueError(f"{path}: {', '.join(map(repr, repeated))} names several columns")
    for line, row in zip(lines, rows, strict=True):
        if len(row) != len(names):
            raise ValueError(f"{path}: line {line} has {len(row)} values, must have {len(names)}")
    values = np.array(rows[1:], dtype=np.str_).reshape(-1, len(names))
    columns = {name: np.char.strip(values[:, index]) for index, name in enumerate(names)}
    return Located(columns, np.array(lines[1:], dtype=np.int64), path)


def _without_comments(numbered: list[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """Return lines of a file without the comments above the names.

    The last comment is the names themselves where it has ``time`` and the line below has not: so
    does `numpy.savetxt` write them.
    """
    comments = [*takewhile(lambda each: each[1][0].lstrip().startswith("#"), numbered)]
    if not comments:
        return numbered
    line, (first, *others) = comments[-1]
    names, rest = [first.lstrip(" #"), *others], numbered[len(comments) :]
    has_time, below = (
        "time" in map(str.strip, each) for each in (names, rest[0][1] if rest else ())
    )
    return [(line, names), *rest] if not rest or (has_time and not below) else rest


def numbers(columns: Columns, name: str, column: Column | None = None) -> FloatArray:
    """Return a column, or what has been made of it, as numbers; empty texts become NaN.

    Raise `ValueError` if the column is missing or contains a value that is not a number.
    """
    column = require_column(columns, name) if column is None else column
    if column.ndim > 1:
        raise ValueError(f"{name}: shape {column.shape}, must be one number per row")
    if column.dtype.kind in "US":
        column = np.where(column == "", "nan", column)
    if column.dtype.kind in "mMcV":
        raise ValueError(f"{name}: {column.dtype} given, must be one number per row")
    try:
        return column.astype(np.float64)
    except (TypeError, ValueError):
        raise _invalid(name, column, columns, float, "a number") from None


def require_column(columns: Columns, name: str, advice: str = "") -> Column:
    """Return a column that must be present; raise `ValueError`, with advice, if it is missing."""
    if name not in columns:
        present = short(", ".join(columns)) or "none"
        raise ValueError(f"{name}: the column is missing, the columns are {present}{advice}")
    return columns[name]


def stamps_ns(columns: Columns, name: str = "time") -> IntArray:
    """Return a column of times in nanoseconds from seconds, dates, or texts of either.

    Times are rounded to microseconds, so that seconds since 1970 as floats are reproduced. Texts
    such as 10:07:03.5 are times of day, which go on at midnight.

    Raise `ValueError` if the column is missing or contains a value that is not a time.
    """
    column = require_column(columns, name, f"; rename that of the times to {name}")
    if column.dtype.kind in "US" and not _all_numbers(column):
        of_day = [*filter(None, map(_TIME_OF_DAY.fullmatch, column.tolist()))]
        is_date = len(of_day) < len(column)
        column = _dates(name, columns) if is_date else np.array([*map(_of_day, of_day)])
    elif column.dtype.kind == "O":
        column = np.array([_since_1970(value) for value in column.tolist()], dtype=object)
    elif column.dtype.kind == "m":
        column = column / np.timedelta64(1, "s")
    unit = ""
    if column.dtype.kind == "M":
        micros = column.astype("datetime64[us]").astype(np.int64)
        bad = (micros < 0) | (micros > LATEST_S * 1e6)
    else:
        seconds = numbers(columns, name, column)
        bad = ~((seconds >= 0.0) & (seconds <= LATEST_S))
        if len(seconds) and not bad.any():
            _require_fine(name, column, seconds)
            seconds = _unrolled(name, columns, seconds)
        unit = _unit(float(seconds[np.argmax(bad)])) if bad.any() else ""
        micros = np.rint(np.where(bad, 0.0, seconds) * 1e6).astype(np.int64)
    if bad.any():
        row = int(np.argmax(bad))
        raise ValueError(
            f"{name}: {str(column[row])!r} in {place_of(columns, row)}, must be a time from 0 s "
            f"on, at most {LATEST_S:.0f} s: seconds or a date since 1970{unit}"
        )
    return 1000 * micros


def _of_day(found: re.Match[str]) -> float:
    """Return the seconds of a `_TIME_OF_DAY`."""
    hour, minute, second = map(float, found[0].replace(",", ".").split(":"))
    return 3600.0 * hour + 60.0 * minute + second


def _unit(number: float) -> str:
    """Return the words for what a number is as a time since 1970; empty if it is none."""
    for factor, unit in UNITS.items():
        # Times since 1970 of which the unit is sought are later.
        if 3e8 < number / factor < LATEST_S:
            return f"; probably these are {unit}: divide them by {factor:.0f}"
    # Minutes, seconds or milliseconds may be the last digits.
    date = r"(?:19|20)\d\d(?:0[1-9]|1[0-2])[0-3]\d[0-2]\d[0-5]\d(?:\d\d(?:\d{3})?)?"
    if re.fullmatch(date, f"{number:.0f}"):
        return "; probably these are the digits of dates: write them as 2026-01-31T12:00:00"
    return ""


def _are_digits(seconds: FloatArray) -> bool:
    """Return whether times are the digits of a clock: hours, minutes and seconds in one number.

    Then they leave out what is from 60 on in each hundred, and step over it as over any time. The
    last digits may be hundredths or thousandths; hours and minutes alone look as minutes and
    seconds do.
    """
    plain = np.unique(seconds)
    for unit in (1.0, 100.0, 1000.0):
        hours, rest = np.divmod(plain / unit, 10_000.0)
        minutes, second = np.divmod(rest, 100.0)
        if not ((hours <= 24.0) & (minutes < 60.0) & (second < 60.0)).all():
            continue
        read = 3600.0 * hours + 60.0 * minutes + second
        # After the last time of a day comes the first one.
        steps = np.diff(read, append=read[0] + 86_400.0)
        larger = np.diff(plain / unit, append=plain[0] / unit + 240_000.0) > 1.001 * steps + 1.0
        # Steps are as usual there, and much shorter than what is left out.
        most = min(2.0 * float(np.quantile(steps, 0.9)), 10.0)
        if np.mean(steps[larger] <= most) >= 0.5:
            return True
    return False


def _require_fine(name: str, column: Column, seconds: FloatArray) -> None:
    """Raise `ValueError` if times are rounded as coarsely as they follow, or digits of a clock."""
    latest, steps = seconds.max(), np.diff(np.unique(seconds))
    usual = float(np.median(steps)) if len(steps) else LONGEST_STEP_S
    if len(steps) and _are_digits(seconds):
        raise ValueError(
            f"{name}: {seconds[0]:.15g} in the first row, and none is 60 to 99 after a multiple of "
            "100: probably hours, minutes and seconds in one number; must be seconds, dates, or "
            "times of day such as 10:07:03.5"
        )
    single = float(np.spacing(np.float32(latest)))
    # Doubles that are all of single precision, from 5e8 s on, have been of that type before, unless
    # they are a few round numbers.
    surely_coarse_s = 32.0
    if column.dtype.kind == "f" and column.dtype.itemsize < 8:
        resolution, given = float(np.spacing(column.max())), str(column.dtype)
    elif (
        surely_coarse_s < single
        and usual < 100.0 * single
        and (np.float32(seconds) == seconds).all()
    ):
        resolution, given = single, "float32, whatever the column's type is now"
    else:
        return
    if resolution > 0.5 * min(max(usual, SHORTEST_STEP_S), LONGEST_STEP_S):
        raise ValueError(
            f"{name}: rounded to {resolution:g} s, because {latest:.0f} s is of type {given}: must "
            "be of type float64 from the start, dates, or seconds from a time nearby"
        )


def _unrolled(name: str, columns: Columns, seconds: FloatArray) -> FloatArray:
    """Return times that go on where a clock began again, with a warning."""
    # Seconds, or milliseconds, after which times of a clock begin again.
    clocks = {
        86_400.0: "seconds of the day",
        604_800.0: "seconds of the GPS week",
        86_400e3: "milliseconds of the day",
        604_800e3: "milliseconds of the GPS week",
    }
    steps = np.diff(seconds)
    for turn, what in clocks.items():
        large = steps[np.abs(steps) > 0.5 * turn]
        if not (large < 0.0).any() or seconds.max() > turn + 1.0:  # One is a leap second.
            continue
        found = np.unwrap(seconds, period=turn)
        # The clock began again only if the step back is a whole turn of it within this share, and
        # all times together are less than half a turn, or a turn if it is the only such step.
        whole = (np.abs(np.abs(large) - turn) < turn / 24.0).all()
        most = (0.5 if len(large) > 1 else 1.0) * turn
        if whole and found.min() >= 0.0 and np.ptp(found) < most:
            row = int(np.argmin(steps)) + 1
            warnings.warn(
                f"{name}: steps back by {-steps[row - 1]:g} in {place_of(columns, row)}; taken for "
                f"{what}, so that times go on after {turn:.0f}, to {found.max():.0f}",
                stacklevel=5,
            )
            return found
    return seconds


def rows_by_stamp(stamps: IntArray) -> list[IntArray]:
    """Return the rows of each stamp, by ascending stamp."""
    order = np.argsort(stamps, kind="stable")
    starts = np.flatnonzero(np.diff(stamps[order], prepend=-1))
    return np.split(order, starts[1:]) if len(order) else []


def _since_1970(value: Any) -> Any:
    """Convert a date of Python or pandas to seconds since 1970; the default time zone is UTC."""
    if isinstance(value, time):
        return 3600.0 * value.hour + 60.0 * value.minute + value.second + 1e-6 * value.microsecond
    if not isinstance(value, datetime) or value != value:  # NaT of pandas is a datetime.
        return value
    return (value if value.tzinfo else value.replace(tzinfo=timezone.utc)).timestamp()


def _all_numbers(column: Column) -> bool:
    """Return whether all texts are numbers or empty."""
    try:
        np.where(column == "", "nan", column).astype(np.float64)
    except ValueError:
        return False
    return True


def _dates(name: str, columns: Columns) -> Column:
    """Convert texts to dates, with a Z, an offset such as +02:00, or UTC by default."""
    column = columns[name]

    def date(text: str) -> np.datetime64:
        if (found := _DATE.fullmatch(text)) is None:
            raise ValueError
        local, second, sign, hours, minutes = found.groups("0")
        leap = second == "60"  # A leap second is the next one
        if leap:
            local = local[: found.start(2)] + "59" + local[found.end(2) :]
        ahead = np.timedelta64(int(f"{sign}1") * (60 * int(hours) + int(minutes)), "m")
        return np.datetime64(local.replace(",", "."), "ns") - ahead + np.timedelta64(int(leap), "s")

    try:
        return np.array([date(text) for text in column.tolist()], dtype="datetime64[ns]")
    except ValueError:
        usual = float if _all_numbers(column[:1]) else date
        what = (
            "seconds, a date such as 2026-01-31T12:00:00.5, or a time of day such as 12:00:00.5, "
            "as all in its column"
        )
        raise _invalid(name, column, columns, usual, what) from None


def _invalid(
    name: str, column: Column, columns: Columns, convert: Callable[[Any], Any], what: str
) -> ValueError:
    """Return the error that names the first value of a column that `convert` rejects."""
    for row, value in enumerate(column.tolist()):
        try:
            convert(value)
        except (TypeError, ValueError):
            place = place_of(columns, row)
            return ValueError(f"{name}: {short(repr(value))} in {place}, must be {what}")
    return ValueError(f"{name}: {column.dtype} given, must be {what}")


def table_of(found: Sequence[Estimates], class_names: Sequence[str], told: bool = False) -> Column:
    """Return estimates as a structured array with a row per estimate, in the given order.

    There are columns of self-reports if the tracker is `told` any.
    The docstring of `Tracker` describes the columns.
    """
    dtype = [
        ("time", np.float64),
        ("label", np.int64),
        ("class", f"U{max(map(len, class_names))}"),
        ("class_probability", np.float64),
        ("probability", np.float64),
        ("state", f"U{max(map(len, TRACK_STATES))}"),
        ("x", np.float64),
        ("y", np.float64),
        ("vx", np.float64),
        ("vy", np.float64),
        ("height", np.float64),
        ("code", np.int64),
        ("address", np.int64),
        ("covariance", np.float64, (4, 4)),
        ("z", np.float64),
        ("vz", np.float64),
        ("covariance_space", np.float64, (6, 6)),
    ]
    if told:
        dtype += [("source", "U48"), ("alone", np.bool_), ("reason", "U80")]
        dtype += [(name, np.float64) for name in ("owned", "dark", "silent", "doubtful")]
    return structured_array(dtype, [(len(each), _columns(each, class_names)) for each in found])


def structured_array(dtype: Any, parts: Sequence[tuple[int, Mapping[str, Any]]]) -> Column:
    """Return a structured array of parts: the number of rows, and columns or single values."""
    table = np.zeros(sum(count for count, _ in parts), dtype=dtype)
    begin = 0
    for count, columns in parts:
        for name, column in columns.items():
            table[begin : begin + count][name] = column
        begin += count
    return table


def _columns(found: Estimates, class_names: Sequence[str]) -> Mapping[str, Any]:
    axes, known = [*found.space.position, *found.space.velocity], found.known_attributes
    said: dict[str, Any] = {}
    if (reports := found.reports) is not None:
        rows = range(len(found))
        said = {
            "source": [reports.source_text(row) for row in rows],
            "alone": reports.alone == 1,
            "reason": [reports.reason_text(row, found.stamp_ns) for row in rows],
            **{name: getattr(reports, name) for name in ("owned", "dark", "silent", "doubtful")},
        }
    return {
        **said,
        "time": found.stamp_ns / 1e9,
        "label": found.track_id,
        "class": np.array(class_names)[found.class_id],
        "class_probability": found.class_probability[np.arange(len(found)), found.class_id],
        "probability": found.weight,
        "state": np.array(TRACK_STATES)[found.track_state],
        **dict(zip(("x", "y", "vx", "vy"), found.state[:, axes].T, strict=True)),
        "covariance": found.covariance[:, axes][:, :, axes],
        "height": known.height[:, 0],
        "code": known.code,
        "address": known.address,
        "z": known.height[:, 0],
        "vz": known.height[:, 1],
        "covariance_space": found.covariance_in_space,
    }
