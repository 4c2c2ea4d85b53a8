"""Entries of a window, and their rows that a sector sweeps."""

import numpy as np
import pytest
from sweep import configuration

from phd_jdtc_ros.core.gaussian.entries import Entry, UnsweptRows
from phd_jdtc_ros.core.gaussian.mixture import Mixture
from phd_jdtc_ros.core.state_space import PLANAR
from phd_jdtc_ros.core.types import FULL_TURN, UNKNOWN_COVERAGE, Coverage, Detections, Scan
from phd_jdtc_ros.core.window.swept import partition_swept, swept_births

ORIGIN = np.array([3, 3, 5, 9, 9, 9])
MODEL = configuration().model
SECOND = 1_000_000_000
# Three targets 50 km away, to the east, the north and the west.
PLACES = np.array([[50e3, 0.0], [0.0, 50e3], [-50e3, 0.0]])


def mixture(state, weight, row_label, class_id, variance=0.0):
    """Return rows of one mode and two classes, each of one class."""
    count = len(state)
    shares = np.zeros((count, 1, 2))
    shares[np.arange(count), 0, class_id] = weight
    covariance = np.zeros((count, 1, len(PLANAR), len(PLANAR)))
    for axis in PLANAR.position:
        covariance[:, 0, axis, axis] = variance
    return Mixture(row_label, shares, state[:, None], covariance, np.ones((count, 2, 1)))


def entry():
    state = np.zeros((6, len(PLANAR)))
    state[:, PLANAR.position[0]] = [1.0, 3.0, 0.0, 4.0, 4.0, 10.0]
    state[:, PLANAR.velocity[1]] = [5.0, 5.0, 7.0, 0.0, 0.0, 0.0]
    weight = np.array([0.3, 0.1, 0.5, 0.2, 0.2, 0.2])
    return Entry(7, mixture(state, weight, ORIGIN, [0, 1, 0, 1, 1, 0]))


def test_split_rows_are_those_of_the_entry_and_contain_all_of_them():
    inside, outside = UnsweptRows(entry()).split(np.isin(ORIGIN, [3, 9]))
    assert inside.rows.tolist() == [0, 1, 3, 4, 5]
    assert outside.rows.tolist() == [2]
    again, rest = inside.split(ORIGIN == 9)
    assert (again.rows.tolist(), rest.rows.tolist()) == ([3, 4, 5], [0, 1])
    assert again.source.size == len(again) == 3


@pytest.mark.parametrize("rows", [None, np.array([0, 2])])
def test_split_keeps_rows_that_are_all_of_one_kind(rows):
    current = UnsweptRows(entry(), rows)
    assert current.split(np.ones(6, dtype=bool)) == (current, None)
    assert current.split(np.zeros(6, dtype=bool)) == (None, current)


def test_current_rows_are_a_set_with_their_origins_and_their_mass():
    current = UnsweptRows(entry(), np.array([1, 2, 5]))
    np.testing.assert_array_equal(current.row_label, [3, 5, 9])
    np.testing.assert_array_equal(current.stored.row_label, current.row_label)
    np.testing.assert_allclose(current.class_mass(), [0.7, 0.1])
    np.testing.assert_allclose(current.class_mass(), current.stored.class_mass())


def test_extents_are_those_of_each_origin_and_computed_once():
    stored_entry = entry()
    extents = stored_entry.extents
    np.testing.assert_array_equal(extents.label, [3, 5, 9])
    np.testing.assert_array_equal(extents.label[extents.target], ORIGIN)
    expected = [
        [1.5, 0.0, 0.0, 5.0, np.sqrt(0.75), 0.0],
        [0.0, 0.0, 0.0, 7.0, 0.0, 0.0],
        [6.0, 0.0, 0.0, 0.0, np.sqrt(8.0), 0.0],
    ]
    np.testing.assert_allclose(extents.moments, expected)
    assert stored_entry.extents is extents


def current(stamp_s=0.0, spread=50.0):
    state = np.zeros((3, len(PLANAR)))
    state[:, list(PLANAR.position)] = PLACES
    stored = mixture(state, np.ones(3), np.arange(3), 0, spread**2)
    return UnsweptRows(Entry(round(stamp_s * SECOND), stored))


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
def test_partition_takes_the_targets_near_the_sector(start, width, expected):
    swept_rows, others = partition_swept([current()], scan(1.0, start, width), MODEL)
    assert origins_of(swept_rows) == expected
    assert origins_of(others) == [row_label for row_label in range(3) if row_label not in expected]


def test_partition_takes_both_sides_and_dispersed_targets():
    edge = Coverage(0.0, 0.3), Coverage(-0.3, 0.3)
    for sector in edge:
        swept_rows, _ = partition_swept([current()], scan(1.0, sector.start, sector.width), MODEL)
        assert origins_of(swept_rows) == [0]
    swept_rows, _ = partition_swept([current(spread=20e3)], scan(1.0, 0.5, 0.2), MODEL)
    assert 0 in origins_of(swept_rows)


@pytest.mark.parametrize("coverage", [Coverage(-0.2, 0.4), UNKNOWN_COVERAGE])
def test_partition_takes_targets_near_a_detection_outside_the_coverage(coverage):
    late = np.array([[50e3, 3.14], [20e3, -2.0]])
    report = Detections(late, None, time_s=np.array([-0.4, -0.4]), coverage=coverage)
    swept_rows, others = partition_swept([current()], Scan(SECOND, (report,)), MODEL)
    assert 2 in origins_of(swept_rows)
    assert 1 in origins_of(others)


def test_partition_takes_everything_without_coverage_or_after_a_long_time():
    rows = [current()]
    assert partition_swept(rows, scan(1.0, None, None), MODEL) == (rows, [])
    swept_rows, others = partition_swept([current()], scan(6.5, 0.3, 0.1), MODEL)
    assert origins_of(swept_rows) == [0, 1, 2]
    assert others == []


def test_partition_takes_targets_in_the_field_of_view_of_a_sensor_alone():
    field = {"east.fov_deg": [-30.0, 30.0], "east.max_range": 60e3}
    model = configuration({"sensors": ["radar", "east"], **field}).model
    whole = Detections(np.zeros((0, 2)), None)
    swept_rows, others = partition_swept([current()], Scan(SECOND, (None, whole)), model)
    assert (origins_of(swept_rows), origins_of(others)) == ([0], [1, 2])
    rows = [current()]
    assert partition_swept(rows, Scan(SECOND, (whole, whole)), model) == (rows, [])
    # A sensor that looks alone for long must not keep the others from their predictions.
    late, rest = partition_swept([current()], Scan(60 * SECOND, (None, whole)), model)
    assert (origins_of(late), rest) == ([0, 1, 2], [])


def test_partition_can_be_repeated():
    swept_rows, others = partition_swept([current()], scan(1.0, -0.2, 0.4), MODEL)
    again, rest = partition_swept(others, scan(1.5, 1.3, 0.6), MODEL)
    assert (origins_of(swept_rows), origins_of(again), origins_of(rest)) == ([0], [1], [2])
    assert again[0].source.rows.tolist() == [1]


def test_births_passed_are_those_in_the_sector():
    given = {"births": ["east", "north"], "north.rates": [0.1], "east.rates": [0.1]}
    given |= {"east.position": [50e3, 0.0], "north.position": [0.0, 50e3]}
    model = configuration(given).model
    assert swept_births(scan(1.0, -0.2, 0.4), model) == [0]
    assert swept_births(scan(1.0, 1.4, 0.4), model) == [1]
    assert swept_births(scan(1.0, None, None), model) == [0, 1]
