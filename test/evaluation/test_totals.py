import numpy as np
import pytest

from phd_jdtc_ros.evaluation.accumulator import Totals, ratio

NAMES = ("a", "b")
# Two runs of three scans; b is missing in one scan of the first run.
VALUES = np.array([[[1.0, 2.0], [3.0, np.nan], [5.0, -4.0]], [[1.0, 8.0], [1.0, -9.0], [4.0, 1.0]]])


@pytest.fixture
def totals():
    return Totals.of(NAMES, VALUES)


def test_totals_are_of_each_run_with_means_of_the_scans_that_have_the_value(totals):
    np.testing.assert_array_equal(totals.sum("a"), [9.0, 6.0])
    np.testing.assert_array_equal(totals.mean("a"), [3.0, 2.0])
    np.testing.assert_array_equal(totals.maximum("a"), [5.0, 4.0])
    np.testing.assert_array_equal(totals.mean("b"), [-1.0, 0.0])
    np.testing.assert_array_equal(totals.sum("b"), [np.nan, 0.0])
    np.testing.assert_array_equal(totals.maximum("b"), [np.nan, 8.0])


def test_totals_add_up(totals):
    parts = [Totals.of(NAMES, VALUES[:, scan : scan + 1]) for scan in range(3)]
    together = parts[0].plus(parts[1]).plus(parts[2])
    assert together.scans == 3
    for name in NAMES:
        for figure in (Totals.mean, Totals.sum, Totals.maximum):
            np.testing.assert_array_equal(figure(together, name), figure(totals, name))


def test_totals_of_no_scan_and_ratios_to_nothing_are_not_known():
    none = Totals.of(NAMES, np.zeros((0, 2)))
    assert none.sum("a") == 0.0
    assert np.isnan(none.mean("a"))
    assert np.isnan(none.maximum("a"))
    np.testing.assert_array_equal(ratio(np.array([1.0, 0.0]), np.array([4, 0])), [0.25, np.nan])
