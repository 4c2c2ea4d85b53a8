"""Tables of users, of scenarios, and of tracks beside the truth."""

from datetime import datetime, time, timedelta, timezone

import crossing
import numpy as np
import pytest

from msg_adapters.incoming.readers import reader_of
from phd_jdtc_ros import evaluate, simulate
from phd_jdtc_ros.api.parameters import Parameters
from phd_jdtc_ros.api.reports import reports_of
from phd_jdtc_ros.api.tables import columns_of, numbers, rows_of, stamps_ns
from phd_jdtc_ros.api.tracker import Tracks
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.parameter_files import from_arguments

STRUCTURED = np.array([(1.0, 2.0), (3.0, 4.0)], dtype=[("time", float), ("range", float)])
NINE = "".join(f"1700000000.{k},north,2.0\n" for k in range(9))
TRUTH = crossing.truth()


class Frame:
    """What of a data frame is used."""

    def __init__(self, **columns):
        self._columns = columns
        self.columns = list(columns)

    def __getitem__(self, name):
        return self._columns[name]


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
        (
            Tracks(np.zeros(0), np.zeros(0)),
            "Tracks given, must be one of its tables: filtered or smoothed",
        ),
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
        (b"time;range\n1,5;2,5\n", "';' in line 1, must be names and commas"),
        (b"# radar 1\ntime range\n1 2\n", "' ' in line 2, must be names and commas"),
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


@pytest.mark.parametrize(
    "above",
    [
        "# radar 1, 2026-01-31\n# metres, radians\ntime,range",
        " # by hand\n\n#time,range",
        "# time,range",  # As by numpy.savetxt
    ],
)
def test_comments_above_the_names_of_a_csv_are_no_names(tmp_path, above):
    path = tmp_path / "detections.csv"
    path.write_text(f"{above}\n1,2\n,x\n")
    columns = columns_of(path)
    assert [*columns] == ["time", "range"]
    line = 2 + above.count("\n") + 1
    with pytest.raises(ValueError, match=f"range: 'x' in line {line} of"):
        numbers(columns, "range")


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (NINE + "soon,north,2.0\n", "time: 'soon' in line 12 of .*csv, must be seconds, a date"),
        (NINE + "2026-01-01,north,2.0\n", "time: '2026-01-01' in line 12 of .*csv, must be"),
        (NINE + ",north,2.0\n", "time: '' in line 12 of .*csv, must be a time from 0 s on"),
        (NINE + "-1,north,2.0\n", "time: '-1' in line 12 of .*csv, must be a time from 0 s on"),
        (NINE + "1e10,north,2.0\n", "time: '1e10' in line 12 of .*csv, .* at most 9200000000 s"),
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


@pytest.mark.parametrize(
    "column",
    [
        [1_700_000_000.25],
        ["1700000000.25"],
        ["2023-11-14T22:13:20.250Z"],
        ["2023-11-14 22:13:20.25"],
        ["2023-11-14 22:13:20.25 UTC"],
        ["2023-11-15T00:13:20.25+02:00"],
        ["2023-11-14 17:13:20.250-0500"],
        [np.timedelta64(1_700_000_000_250, "ms")],
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
        "with UTC",
        "with an offset",
        "behind UTC",
        "since 1970",
        "data frame",
        "dates",
        "Python's",
        "with a zone",
    ],
)
@pytest.mark.filterwarnings("error")
def test_stamps_are_seconds_or_dates(column):
    assert stamps_ns(columns_of({"time": column})).tolist() == [1_700_000_000_250_000_000]


@pytest.mark.parametrize(
    "times",
    [
        ["9:59:59.5", "23:59:59,25", "24:00:00", "23:59:60"],
        [b"9:59:59.5", b"23:59:59.25", b"24:00:00", b"23:59:60"],
        [time(9, 59, 59, 500_000), time(23, 59, 59, 250_000), 86_400, 86_400.0],
    ],
    ids=["texts", "bytes", "objects"],
)
def test_times_of_day_are_seconds_of_the_day(times):
    found = stamps_ns(columns_of({"time": times}))
    assert (found / 1e9).tolist() == [35_999.5, 86_399.25, 86_400.0, 86_400.0]


@pytest.mark.parametrize(("begin", "count"), [("23:59:58", 3), ("18:00:00", 20 * 3600)])
def test_times_of_day_go_on_after_midnight(begin, count):
    first = sum(
        int(part) * size for part, size in zip(begin.split(":"), (3600, 60, 1), strict=True)
    )
    day = [divmod(divmod(second % 86_400, 60)[0], 60) for second in range(first, first + count)]
    texts = [f"{h:02d}:{m:02d}:{(first + k) % 60:02d}" for k, (h, m) in enumerate(day)]
    with pytest.warns(UserWarning, match="seconds of the day, so that times go on after 86400"):
        found = stamps_ns(columns_of({"time": texts}))
    assert (found == (first + np.arange(count)) * 10**9).all()


def test_leap_second_is_the_next_one():
    times = ["2016-12-31T23:59:59", "2016-12-31T23:59:60.5Z", "2017-01-01"]
    found = stamps_ns(columns_of({"time": times}))
    assert (np.diff(found) / 1e9).tolist() == [1.5, -0.5]


@pytest.mark.parametrize("text", ["10:07:03 AM", "2026-01-31 12:00:00 CET", "31.01.2026"])
@pytest.mark.filterwarnings("error")
def test_dates_of_other_forms_are_named(text):
    with pytest.raises(ValueError, match=r"time: '.*' in row 1, must be seconds, a date such as"):
        stamps_ns(columns_of({"time": [text]}))


def test_stamps_of_seconds_since_1970_are_the_same_again():
    rng = np.random.default_rng(1)
    once = stamps_ns({"time": 1.7e9 + 1e4 * rng.random(10_000)})
    assert (stamps_ns({"time": once / 1e9}) == once).all()


@pytest.mark.parametrize("time", [np.nan, -1.0, np.inf, 1e10, "yesterday", "", "1960-01-01"])
def test_stamps_name_what_is_no_time(time):
    with pytest.raises(ValueError, match=r"time: .* in row 2, must be"):
        stamps_ns(columns_of({"time": [1.0 if isinstance(time, float) else "2026-01-01", time]}))


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_times_that_were_of_single_precision_are_refused(kind):
    time = (1.7e9 + np.arange(300.0)).astype(np.float32).astype(kind)
    with pytest.raises(ValueError, match=r"time: rounded to 128 s, .* must be of type float64"):
        stamps_ns({"time": time})


@pytest.mark.parametrize("unit", [1.0, 100.0, 1000.0], ids=["s", "hundredths", "milliseconds"])
@pytest.mark.parametrize(
    ("begin", "end", "step"),
    [(36_000, 36_600, 0.5), (36_000, 36_600, 6), (35_980, 36_020, 1), (86_380, 86_420, 1)],
)
def test_digits_of_a_clock_in_one_number_are_named(begin, end, step, unit):
    clock = np.arange(begin, end, step) % 86_400.0
    minutes, seconds = np.divmod(clock, 60.0)
    digits = minutes // 60 * 10_000 + minutes % 60 * 100 + seconds
    with pytest.raises(ValueError, match="hours, minutes and seconds in one number"):
        stamps_ns({"time": unit * digits})


@pytest.mark.parametrize("step", [0.5, 1.0, 4.0, 20.0, 60.0, 100.0])
def test_times_with_a_pause_are_no_digits_of_a_clock(step):
    times = np.arange(0.0, 50.0, step)
    for pause in (10.0, 30.0, 51.0, 70.0, 4050.0, 9950.0):
        paused = np.concatenate([times, times[-1] + pause + times])
        assert (stamps_ns({"time": paused}) == 1e9 * paused).all()


def test_digits_of_a_date_are_named():
    with pytest.raises(ValueError, match="digits of dates: write them as 2026-01-31T12:00:00"):
        stamps_ns({"time": np.array([20260131100703, 20260131100704])})


def test_a_few_round_times_are_not_of_single_precision():
    times = np.array([1e9, 1e9 + 86_400.0])
    assert np.array_equal(np.float32(times), times)
    assert (stamps_ns({"time": times}) == 1e9 * times).all()


@pytest.mark.parametrize(
    ("turn", "what"), [(86400.0, "seconds of the day"), (604800.0, "seconds of the GPS week")]
)
def test_times_of_a_clock_that_begins_again_go_on(turn, what):
    seconds = turn - 30.0 + np.arange(60.0)
    with pytest.warns(
        UserWarning, match=f"steps back by {turn - 1.0:.0f} in row 31; taken for {what}"
    ):
        found = stamps_ns({"time": seconds % turn})
    assert (found == 1e9 * seconds).all()


def test_times_that_step_back_by_less_are_as_they_were(recwarn):
    seconds = np.concatenate([np.arange(50e3, 50.1e3), np.arange(1e3, 1.1e3)])
    assert (stamps_ns({"time": seconds}) == 1e9 * seconds).all()
    assert not recwarn


def test_times_in_another_unit_since_1970_are_named():
    for factor, unit in ((1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")):
        time = (factor * (1.7e9 + np.arange(3.0))).astype(np.int64)
        with pytest.raises(ValueError, match=f"probably these are {unit}: divide them by"):
            stamps_ns({"time": time})


def test_columns_of_takes_masked_values_for_unknown_ones():
    masked = np.ma.masked_array([1.0, 1e20, 3.0], mask=[False, True, False])
    np.testing.assert_array_equal(columns_of({"x": masked})["x"], [1.0, np.nan, 3.0])


def test_numbers_refuses_dates():
    with pytest.raises(ValueError, match=r"x: datetime64\[s\] given, must be one number per row"):
        numbers(columns_of({"x": np.array([1, 2], dtype="datetime64[s]")}), "x")


def test_label_zero_of_the_truth_is_a_label():
    late = TRUTH["time"] >= 30.0
    swapped = {**TRUTH, "label": np.where(late, 3 - TRUTH["label"], TRUTH["label"])}
    for label in (TRUTH["label"] - 1, (TRUTH["label"] - 1).astype(int).astype(np.str_)):
        found = evaluate({**TRUTH, "label": label}, swapped, cutoff=50.0)
        assert found["identity_switches"] == 2
    # Labels that several targets of one time share are none.
    none = {**TRUTH, "label": np.zeros(len(late))}
    assert evaluate(none, swapped, cutoff=50.0)["identity_switches"] is None


@pytest.mark.parametrize("table", ["truth", "tracks"])
def test_a_row_without_a_label_of_its_own_is_named(table):
    for label, said in (
        (np.where(np.arange(len(TRUTH["time"])) == 4, np.nan, TRUTH["label"]), "no label"),
        (np.where(np.arange(len(TRUTH["time"])) < 2, 1.0, TRUTH["label"]), "the label of another"),
    ):
        tables = {"truth": TRUTH, "tracks": TRUTH, table: {**TRUTH, "label": label}}
        with pytest.warns(UserWarning, match=f"{table}: 1 of .* rows, such as row .*, with {said}"):
            assert evaluate(**tables, cutoff=50.0)["identity_switches"] is None


def test_targets_of_the_truth_with_times_of_their_own_are_named():
    own = np.where(TRUTH["label"] == 1, TRUTH["time"], TRUTH["time"] + 0.3)
    none = {name: column[:0] for name, column in TRUTH.items()}
    with pytest.warns(UserWarning, match="truth: most targets have no row at many of the"):
        evaluate({**TRUTH, "time": own}, none, cutoff=50.0)


def test_tables_without_any_label_are_not_named(recwarn):
    without = {name: column for name, column in TRUTH.items() if name != "label"}
    evaluate(without, {**TRUTH, "label": np.zeros(len(TRUTH["time"]))}, cutoff=50.0)
    assert not recwarn


def test_evaluate_of_the_truth_finds_no_error_and_of_no_tracks_the_cutoff():
    found = evaluate(TRUTH, TRUTH, cutoff=100.0)
    assert found["scans"] == crossing.LAST
    assert found["ospa"] == found["missed"] == found["false"] == 0.0
    assert found["identity_switches"] == 0
    assert found["class_accuracy"] == 1.0
    none = {name: column[:0] for name, column in TRUTH.items()}
    found = evaluate(TRUTH, none, cutoff=100.0)
    assert found["ospa"] == pytest.approx(100.0)
    assert found["missed"] == 2.0


def test_evaluate_counts_swaps_and_wrong_classes():
    late = TRUTH["time"] >= 30.0
    swapped = {**TRUTH, "label": np.where(late, 3 - TRUTH["label"], TRUTH["label"])}
    assert evaluate(TRUTH, swapped, cutoff=50.0)["identity_switches"] == 2
    true = {**TRUTH, "class": np.where(TRUTH["label"] == 1, "ship", "boat")}
    found = {**TRUTH, "class": np.full(len(TRUTH["time"]), "boat")}
    assert evaluate(true, found, cutoff=50.0)["class_accuracy"] == 0.5


def test_evaluate_takes_names_as_labels_and_counts_times_without_tracks():
    named = {**TRUTH, "label": np.where(TRUTH["label"] == 1, "CLX123", "DLH4")}
    assert evaluate(named, TRUTH, cutoff=50.0)["identity_switches"] == 0
    some = {name: column[TRUTH["time"] < 30.0] for name, column in TRUTH.items()}
    assert evaluate(TRUTH, some, cutoff=100.0)["missed"] == pytest.approx(1.0)


def test_label_zero_or_none_is_no_track_in_numbers_and_in_texts():
    one = {name: column[TRUTH["label"] == 1] for name, column in TRUTH.items()}
    label = np.where(one["time"] < 30.0, 1, 0)
    some = pytest.warns(UserWarning, match="rows, such as row 21, with no label")
    with some:
        numbers = evaluate(TRUTH, {**one, "label": label}, cutoff=50.0)
    assert numbers["identity_switches"] is None
    for unlike in (
        label.astype(np.str_),
        np.where(label == 0, np.nan, 1.0),
        np.where(label == 0, None, "DLH4"),
        np.where(label == 0, np.nan, np.array("DLH4", dtype=object)),
    ):
        with some:
            assert evaluate(TRUTH, {**one, "label": unlike}, cutoff=50.0) == numbers


def test_evaluate_interpolates_the_truth_at_given_times():
    between = {**TRUTH, "time": TRUTH["time"] + 0.25}
    for axis in "xy":
        between[axis] = TRUTH[axis] + 0.25 * TRUTH[f"v{axis}"]
    rows = between["time"] < TRUTH["time"][-1]
    between = {name: column[rows] for name, column in between.items()}
    found = evaluate(TRUTH, between, cutoff=100.0, times=np.unique(between["time"]))
    assert found["ospa"] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("change", "arguments", "said"),
    [
        ({"time": TRUTH["time"] + 0.5}, {}, "tracks: 40 of 40 times, such as 10.5"),
        ({}, {"times": [*TRUTH["time"], 100.0]}, "truth: unknown at 100.0 s"),
        ({}, {"cutoff": 0.0}, "cutoff: 0.0 given, must be a number above 0"),
        ({}, {"cutoff": "x"}, "cutoff: 'x' given, must be a number above 0"),
        ({}, {"order": 0.5}, "order: 0.5 given, must be from 1 to 100"),
        ({"y": np.where(TRUTH["time"] == 11.0, np.nan, 0.0)}, {}, "tracks: y is 'nan' in row 3, "),
    ],
)
def test_evaluate_reports_what_does_not_fit(change, arguments, said):
    with pytest.raises(ValueError, match=said):
        evaluate(TRUTH, {**TRUTH, **change}, **{"cutoff": 100.0, **arguments})


def recorded(bag):
    """Return the stamps and clouds of a bag's radars as a table of ranges and azimuths."""
    config = from_arguments.config_of(from_arguments.load(bag / "parameters.yaml"))
    radars = {radar.topic: radar for radar in config.inputs}
    rows = []
    for entry in BagReader(bag).messages(list(radars)):
        radar = radars[entry.topic]
        found = reader_of(radar).from_cdr(entry.data, radar).detections
        rows += [(entry.stamp_ns / 1e9, radar.name, *row) for row in found.measurement.tolist()]
    return rows


def test_simulate_gives_what_the_shipped_bag_has(request):
    found = simulate("one_radar", seed=0).detections
    expected = recorded(request.config.rootpath / "bags" / "one_radar")
    assert len(found) == len(expected)
    assert found["time"].tolist() == [row[0] for row in expected]
    assert found["radar"].tolist() == [row[1] for row in expected]
    measured = np.stack([found["range"], found["azimuth"]], axis=1)
    np.testing.assert_allclose(measured, [row[2:] for row in expected], rtol=2e-7)


def test_simulate_without_a_scenario_is_the_reference_scenario():
    run = simulate(seed=3)
    assert np.unique(run.detections["radar"]).tolist() == ["radar_1", "radar_2"]
    assert np.unique(run.truth["label"]).tolist() == [1, 2, 3, 4]
    assert len(np.unique(run.truth["time"])) == 80


def test_simulate_takes_a_document():
    target = {
        "class_id": 0,
        "snr_db": 30.0,
        "position": [-2000.0, 500.0],
        "velocity": [20.0, 0.0],
        "first_scan": 0,
        "last_scan": 9,
    }
    run = simulate({"scans": 10, "targets": [target]}, seed=3)
    assert run.truth["x"].tolist() == [-2000.0 + 120.0 * scan for scan in range(10)]


def test_simulate_gives_a_scan_without_detections_a_row():
    run = simulate(
        {
            "scans": 5,
            "targets": [],
            "parameters": {"sensors": ["only"], "only": {"clutter_rate": 0.0}},
        },
        seed=3,
    )
    assert run.detections["time"].tolist() == [1000.0 + 6.0 * scan for scan in range(5)]
    assert np.isnan(run.detections["range"]).all()


def test_simulate_gives_plots_of_turning_antennas_their_own_times():
    run = simulate("terminal_radar", seed=1)
    assert run.parameters["approach.fields.time"] == "time"
    assert len(np.unique(run.detections["time"])) > 0.99 * len(run.detections)


@pytest.mark.parametrize(
    ("scenario", "said"),
    [
        ("coastal_ship", "platform: given, must be absent"),
        ("no_such", "scenario: 'no_such' given, must be .* one of .*approach_hour, automotive, "),
        ("no_such.yaml", "no_such.yaml: cannot be read"),
        ({"scans": -1}, "scans: -1"),
    ],
)
def test_simulate_reports_what_does_not_fit(scenario, said):
    with pytest.raises(ConfigError, match=said):
        simulate(scenario, seed=0)


@pytest.mark.parametrize("seed", [-1, "x", 1.5])
def test_simulate_names_a_seed_that_is_none(seed):
    with pytest.raises(ConfigError, match=r"seed: .* given, must be a whole number from 0 on"):
        simulate("one_radar", seed=seed)
