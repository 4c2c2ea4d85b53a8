import numpy as np
import pytest
from scenes import intensity

from phd_jdtc_ros.core.state_space import PLANAR
from phd_jdtc_ros.core.window.entries import Entry, UnsweptRows

ORIGIN = np.array([3, 3, 5, 9, 9, 9])


def entry():
    state = np.zeros((6, len(PLANAR)))
    state[:, PLANAR.position[0]] = [1.0, 3.0, 0.0, 4.0, 4.0, 10.0]
    state[:, PLANAR.velocity[1]] = [5.0, 5.0, 7.0, 0.0, 0.0, 0.0]
    weight = np.array([0.3, 0.1, 0.5, 0.2, 0.2, 0.2])
    return Entry(7, intensity(state, weight, mode=np.array([0, 1, 0, 1, 1, 0]), row_label=ORIGIN))


def test_parted_rows_are_those_of_the_entry_and_hold_all_of_them():
    inside, outside = UnsweptRows(entry()).split(np.isin(ORIGIN, [3, 9]))
    assert inside.rows.tolist() == [0, 1, 3, 4, 5]
    assert outside.rows.tolist() == [2]
    again, rest = inside.split(ORIGIN == 9)
    assert (again.rows.tolist(), rest.rows.tolist()) == ([3, 4, 5], [0, 1])
    assert again.source.size == len(again) == 3


@pytest.mark.parametrize("rows", [None, np.array([0, 2])])
def test_parted_keeps_rows_that_are_all_of_one_kind(rows):
    current = UnsweptRows(entry(), rows)
    assert current.split(np.ones(6, dtype=bool)) == (current, None)
    assert current.split(np.zeros(6, dtype=bool)) == (None, current)


def test_current_rows_are_a_set_with_their_origins_and_their_mass():
    current = UnsweptRows(entry(), np.array([1, 2, 5]))
    np.testing.assert_array_equal(current.row_label, [3, 5, 9])
    np.testing.assert_array_equal(current.stored.row_label, current.row_label)
    classes = np.array([0, 1]), 2
    np.testing.assert_allclose(current.class_mass(*classes), [0.7, 0.1])
    np.testing.assert_allclose(current.class_mass(*classes), current.stored.class_mass(*classes))


def test_extents_are_those_of_each_origin_and_computed_once():
    held = entry()
    extents = held.extents
    np.testing.assert_array_equal(extents.label, [3, 5, 9])
    np.testing.assert_array_equal(extents.label[extents.target], ORIGIN)
    expected = [
        [1.5, 0.0, 0.0, 5.0, np.sqrt(0.75), 0.0],
        [0.0, 0.0, 0.0, 7.0, 0.0, 0.0],
        [6.0, 0.0, 0.0, 0.0, np.sqrt(8.0), 0.0],
    ]
    np.testing.assert_allclose(extents.moments, expected)
    assert held.extents is extents
