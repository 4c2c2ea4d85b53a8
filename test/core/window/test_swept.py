"""Entries of a window, and their rows that a sector sweeps."""

import numpy as np
import pytest
from sweep import configuration

from phd_jdtc_ros.core.gaussian.entries import Entry, UnsweptRows
from phd_jdtc_ros.core.gaussian.mixture import Mixture
from phd_jdtc_ros.core.state_space import PLANAR
from phd_jdtc_ros.core.types import FULL_TURN, UNKNOWN_COVERAGE, Coverage, Detections, Scan
from phd_jdtc_ros.core.window import swept

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


def current(stamp_s=0.0, spread=50.0):
    state = np.zeros((3, len(PLANAR)))
    state[:, list(PLANAR.position)] = PLACES
    stored = mixture(state, np.ones(3), np.arange(3), 0, spread**2)
    return UnsweptRows(Entry(round(stamp_s * SECOND), stored))


def scan(stamp_s, start, width):
    coverage = None if start is None else Coverage(start, width)
    report = Detections(np.zeros((0, 2)), None, coverage=coverage)
    return Scan(round(stamp_s * SECOND), (report,))


def partition(rows, scan, model=MODEL):
    return swept.partition_swept(rows, model.reports(scan), scan.stamp_ns, model)


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
    swept_rows, others = partition([current()], scan(1.0, start, width))
    assert origins_of(swept_rows) == expected
    assert origins_of(others) == [row_label for row_label in range(3) if row_label not in expected]


def test_partition_takes_both_sides_and_dispersed_targets():
    edge = Coverage(0.0, 0.3), Coverage(-0.3, 0.3)
    for sector in edge:
        swept_rows, _ = partition([current()], scan(1.0, sector.start, sector.width))
        assert origins_of(swept_rows) == [0]
    swept_rows, _ = partition([current(spread=20e3)], scan(1.0, 0.5, 0.2))
    assert 0 in origins_of(swept_rows)


@pytest.mark.parametrize("coverage", [Coverage(-0.2, 0.4), UNKNOWN_COVERAGE])
def test_partition_takes_targets_near_a_detection_outside_the_coverage(coverage):
    late = np.array([[50e3, 3.14], [20e3, -2.0]])
    report = Detections(late, None, time_s=np.array([-0.4, -0.4]), coverage=coverage)
    swept_rows, others = partition([current()], Scan(SECOND, (report,)))
    assert 2 in origins_of(swept_rows)
    assert 1 in origins_of(others)


def test_partition_takes_everything_without_coverage_or_after_a_long_time():
    rows = [current()]
    assert partition(rows, scan(1.0, None, None)) == (rows, [])
    swept_rows, others = partition([current()], scan(6.5, 0.3, 0.1))
    assert origins_of(swept_rows) == [0, 1, 2]
    assert others == []


def test_partition_takes_targets_in_the_field_of_view_of_a_sensor_alone():
    field = {"east.fov_deg": [-30.0, 30.0], "east.max_range": 60e3}
    model = configuration({"sensors": ["radar", "east"], **field}).model
    whole = Detections(np.zeros((0, 2)), None)
    swept_rows, others = partition([current()], Scan(SECOND, (None, whole)), model)
    assert (origins_of(swept_rows), origins_of(others)) == ([0], [1, 2])
    rows = [current()]
    assert partition(rows, Scan(SECOND, (whole, whole)), model) == (rows, [])
    # A sensor that looks alone for long must not keep the others from their predictions.
    late, rest = partition([current()], Scan(60 * SECOND, (None, whole)), model)
    assert (origins_of(late), rest) == ([0, 1, 2], [])


def test_partition_can_be_repeated():
    swept_rows, others = partition([current()], scan(1.0, -0.2, 0.4))
    again, rest = partition(others, scan(1.5, 1.3, 0.6))
    assert (origins_of(swept_rows), origins_of(again), origins_of(rest)) == ([0], [1], [2])
    assert again[0].source.rows.tolist() == [1]


def test_births_passed_are_those_in_the_sector():
    given = {"births": ["east", "north"], "north.rates": [0.1], "east.rates": [0.1]}
    given |= {"east.position": [50e3, 0.0], "north.position": [0.0, 50e3]}
    model = configuration(given).model
    assert swept.swept_births(model.reports(scan(1.0, -0.2, 0.4)), model) == [0]
    assert swept.swept_births(model.reports(scan(1.0, 1.4, 0.4)), model) == [1]
    assert swept.swept_births(model.reports(scan(1.0, None, None)), model) == [0, 1]
