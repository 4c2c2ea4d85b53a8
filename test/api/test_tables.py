"""Tables of users as columns."""

from datetime import datetime, timedelta, timezone

import numpy as np
import pytest

from phd_jdtc_ros.api.parameters import Parameters
from phd_jdtc_ros.api.reports import reports_of
from phd_jdtc_ros.api.tables import columns_of, numbers, rows_of, stamps_ns


class Frame:
    """What of a data frame is used."""

    def __init__(self, **columns):
        self._columns = columns
        self.columns = list(columns)

    def __getitem__(self, name):
        return self._columns[name]


STRUCTURED = np.array([(1.0, 2.0), (3.0, 4.0)], dtype=[("time", float), ("range", float)])


@pytest.mark.parametrize(
    "table",
    [
        {"time": [1, 3], "range": (2.0, 4.0)},
        Frame(time=[1, 3], range=[2.0, 4.0]),
        STRUCTURED,
        STRUCTURED.view(np.recarray),
    ],
    ids=["mapping", "data frame", "structured array", "record array"],
)
def test_columns_of_takes_what_has_named_columns(table):
    columns = columns_of(table)

    assert numbers(columns, "time").tolist() == [1.0, 3.0]
    assert numbers(columns, "range").tolist() == [2.0, 4.0]


def test_columns_of_reads_csv_with_spaces_empty_cells_and_no_rows(tmp_path):
    path = tmp_path / "detections.csv"
    path.write_text("\ufefftime, range ,note\n1.5, 20,a\n\n2.5,,\n", encoding="utf-8")

    columns = columns_of(path)

    assert list(columns) == ["time", "range", "note"]
    assert numbers(columns, "time").tolist() == [1.5, 2.5]
    np.testing.assert_array_equal(numbers(columns, "range"), [20.0, np.nan])
    path = tmp_path / "detections.csv"
    path.write_text("time,range\n")

    assert numbers(columns_of(path), "range").tolist() == []


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (np.zeros((3, 2)), "ndarray given, must have named columns"),
        ([1, 2], "list given, must have named columns"),
        ({"time": [1.0], "range": [1.0, 2.0]}, "equal lengths"),
    ],
)
def test_columns_of_reports_what_does_not_fit(table, said):
    with pytest.raises(ValueError, match=said):
        columns_of(table)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b"", "is empty"),
        (b"time,range\n1,2\n3\n", "line 3 has 1 values, must have 2"),
        (b"time,range,range,,\n1,2,3,,\n", "'range' names several columns"),
        ("time,d\u00e9tection\n".encode("latin-1"), ".*; must be a CSV file in UTF-8"),
        ("time,range\n".encode("utf-16"), ".*; must be a CSV file in UTF-8"),
        (b"x" * 200_000, "field larger than field limit .*; must be a CSV file in UTF-8"),
    ],
)
def test_csv_that_is_no_table_is_named_with_its_row(tmp_path, text, said):
    path = tmp_path / "detections.csv"
    path.write_bytes(text)

    with pytest.raises(ValueError, match=f"detections.csv: {said}"):
        columns_of(path)


NINE = "".join(f"1700000000.{k},north,2.0\n" for k in range(9))


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (NINE + "soon,north,2.0\n", "time: 'soon' in line 12 of .*csv, must be seconds or a date"),
        (NINE + "2026-01-01,north,2.0\n", "time: '2026-01-01' in line 12 of .*csv, must be"),
        (NINE + ",north,2.0\n", "time: '' in line 12 of .*csv, must be a time from 0 s on"),
        (NINE + "-1,north,2.0\n", "time: '-1' in line 12 of .*csv, must be a time from 0 s on"),
        (NINE + "1.0,south,x\n", "range: 'x' in line 12 of .*csv, must be a number"),
        (NINE + "1.0,east,2.0\n", "radar: 'east' in line 12 of .*csv, must be one of north, south"),
    ],
)
def test_values_of_a_csv_are_named_by_their_lines(tmp_path, lines, said):
    path = tmp_path / "detections.csv"
    path.write_text("time,radar,range,azimuth\n\n" + lines.replace("\n", ",0.0\n"))
    config = Parameters.of({"sensors": ["north", "south"]}).config(incomplete=True)

    with pytest.raises(ValueError, match=said):
        reports_of(columns_of(path), config)


def test_rows_of_one_radar_are_named_by_the_rows_of_the_whole_table():
    table = columns_of({"range": ["1.0", "2.0", "far"]})
    with pytest.raises(ValueError, match="range: 'far' in row 3, must be a number"):
        numbers(rows_of(table, np.array([0, 2])), "range")


@pytest.mark.parametrize(
    ("column", "said"),
    [
        (["1.0", "far"], "range: 'far' in row 2, must be a number"),
        ([1.0, None, "x"], "range: None in row 2, must be a number"),
        (np.zeros((2, 2)), r"range: shape \(2, 2\), must be one number per row"),
    ],
)
def test_numbers_names_the_value_that_is_none(column, said):
    with pytest.raises(ValueError, match=said):
        numbers(columns_of({"range": column}), "range")


def test_numbers_names_the_columns_that_there_are():
    with pytest.raises(
        ValueError, match="azimuth: the column is missing, the columns are time, rng"
    ):
        numbers(columns_of({"time": [1.0], "rng": [2.0]}), "azimuth")


@pytest.mark.parametrize(
    "column",
    [
        [1_700_000_000.25],
        ["1700000000.25"],
        ["2023-11-14T22:13:20.250Z"],
        ["2023-11-14 22:13:20.25"],
        np.array(["2023-11-14T22:13:20.250"], dtype=object),
        np.array(["2023-11-14T22:13:20.250"], dtype="datetime64[ms]"),
        [datetime(2023, 11, 14, 22, 13, 20, 250_000)],
        [datetime(2023, 11, 15, 0, 13, 20, 250_000, timezone(timedelta(hours=2)))],
    ],
    ids=[
        "seconds",
        "text",
        "ISO 8601",
        "with a space",
        "data frame",
        "dates",
        "Python's",
        "with a zone",
    ],
)
def test_stamps_are_seconds_or_dates(column):
    assert stamps_ns(columns_of({"time": column})).tolist() == [1_700_000_000_250_000_000]


def test_stamps_of_seconds_since_1970_are_the_same_again():
    rng = np.random.default_rng(1)
    once = stamps_ns({"time": 1.7e9 + 1e4 * rng.random(10_000)})

    assert (stamps_ns({"time": once / 1e9}) == once).all()


@pytest.mark.parametrize("time", [np.nan, -1.0, np.inf, 1e10, "yesterday", "", "1960-01-01"])
def test_stamps_name_what_is_no_time(time):
    with pytest.raises(ValueError, match=r"time: .* in row 2, must be"):
        stamps_ns(columns_of({"time": [1.0 if isinstance(time, float) else "2026-01-01", time]}))
