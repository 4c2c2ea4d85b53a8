import numpy as np
import pytest
from scenes import intensity
from sweep import configuration

from phd_jdtc_ros.core.types import FULL_TURN, UNKNOWN_COVERAGE, Coverage, Detections, Scan
from phd_jdtc_ros.core.window.entries import Entry, UnsweptRows
from phd_jdtc_ros.core.window.swept import partition_swept, swept_births

MODEL = configuration().model
SECOND = 1_000_000_000
# Three targets 50 km away, to the east, the north and the west.
PLACES = np.array([[50e3, 0.0], [0.0, 50e3], [-50e3, 0.0]])


def current(stamp_s=0.0, spread=50.0):
    rng = np.random.default_rng(0)
    state = np.zeros((60, 5))
    state[:, [0, 2]] = PLACES.repeat(20, axis=0) + spread * rng.standard_normal((60, 2))
    row_label = np.arange(3).repeat(20)
    return UnsweptRows(
        Entry(round(stamp_s * SECOND), intensity(state, np.full(60, 0.05), row_label=row_label))
    )


def scan(stamp_s, start, width):
    coverage = None if start is None else Coverage(start, width)
    report = Detections(np.zeros((0, 2)), None, coverage=coverage)
    return Scan(round(stamp_s * SECOND), (report,))


def origins_of(rows):
    return sorted({int(o) for part in rows for o in part.row_label})


@pytest.mark.parametrize(
    ("start", "width", "expected"),
    [
        (-0.2, 0.4, [0]),
        (1.3, 2.1, [1, 2]),
        (3.0, 0.3, [2]),
        (0.3, 0.9, []),
        (0.0, FULL_TURN, [0, 1, 2]),
    ],
)
def test_parted_takes_the_targets_near_the_sector(start, width, expected):
    touched, others = partition_swept([current()], scan(1.0, start, width), MODEL, True)
    assert origins_of(touched) == expected
    assert origins_of(others) == [row_label for row_label in range(3) if row_label not in expected]


def test_parted_takes_both_sides_and_spread_out_targets():
    edge = Coverage(0.0, 0.3), Coverage(-0.3, 0.3)
    for sector in edge:
        touched, _ = partition_swept(
            [current()], scan(1.0, sector.start, sector.width), MODEL, True
        )
        assert origins_of(touched) == [0]
    touched, _ = partition_swept([current(spread=20e3)], scan(1.0, 0.5, 0.2), MODEL, True)
    assert 0 in origins_of(touched)


@pytest.mark.parametrize("coverage", [Coverage(-0.2, 0.4), UNKNOWN_COVERAGE])
def test_parted_takes_who_is_near_a_detection_outside_of_what_was_covered(coverage):
    late = np.array([[50e3, 3.14], [20e3, -2.0]])
    report = Detections(late, None, time_s=np.array([-0.4, -0.4]), coverage=coverage)
    touched, others = partition_swept([current()], Scan(SECOND, (report,)), MODEL, True)
    assert 2 in origins_of(touched)
    assert 1 in origins_of(others)


def test_parted_takes_everything_without_coverage_labels_or_news():
    rows = [current()]
    assert partition_swept(rows, scan(1.0, None, None), MODEL, True) == (rows, [])
    assert partition_swept(rows, scan(1.0, 0.3, 0.1), MODEL, False) == (rows, [])
    touched, others = partition_swept([current()], scan(6.5, 0.3, 0.1), MODEL, True)
    assert origins_of(touched) == [0, 1, 2]
    assert others == []


def test_parted_takes_who_is_in_the_field_of_a_sensor_without_the_other_ones():
    field = {"east.fov_deg": [-30.0, 30.0], "east.max_range": 60e3}
    model = configuration({"sensors": ["radar", "east"], **field}).model
    whole = Detections(np.zeros((0, 2)), None)
    touched, others = partition_swept([current()], Scan(SECOND, (None, whole)), model, True)
    assert (origins_of(touched), origins_of(others)) == ([0], [1, 2])
    rows = [current()]
    assert partition_swept(rows, Scan(SECOND, (whole, whole)), model, True) == (rows, [])
    # A sensor that looks alone for long must not keep the others from their predictions.
    late, rest = partition_swept([current()], Scan(60 * SECOND, (None, whole)), model, True)
    assert (origins_of(late), rest) == ([0, 1, 2], [])


def test_parted_rows_can_be_parted_again():
    touched, others = partition_swept([current()], scan(1.0, -0.2, 0.4), MODEL, True)
    again, rest = partition_swept(others, scan(1.5, 1.3, 0.6), MODEL, True)
    assert (origins_of(touched), origins_of(again), origins_of(rest)) == ([0], [1], [2])
    assert again[0].source.rows.tolist() == list(range(20, 40))


def test_births_passed_are_those_in_the_sector():
    given = {"births": ["east", "north"], "north.rates": [0.1], "east.rates": [0.1]}
    given |= {"east.position": [50e3, 0.0], "north.position": [0.0, 50e3]}
    model = configuration(given).model
    assert swept_births(scan(1.0, -0.2, 0.4), model) == [0]
    assert swept_births(scan(1.0, 1.4, 0.4), model) == [1]
    assert swept_births(scan(1.0, None, None), model) == [0, 1]
