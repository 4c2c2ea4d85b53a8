"""Declared fields on their way into a snapshot and back."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import hypothesis.extra.numpy as arrays
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from runs import stored_and_read

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.snapshot import (
    Snapshot,
    covariances,
    floats,
    from_snapshot,
    integers,
    to_snapshot,
)


class Value(NamedTuple):
    """A value with a field of every kind."""

    count: Annotated[int, integers("", 0, 9)]
    revolutions: Annotated[float, floats("", 0.0, 2.5)]
    row: Annotated[IntArray, integers("T", 0, ascending=True)]
    mode: Annotated[IntArray, integers("T", -1, below="O")]
    mean: Annotated[FloatArray, floats("TD", -1.0, 1.0)]
    covariance: Annotated[FloatArray, covariances("TDD", 2.0)]
    cells: Annotated[FloatArray | None, floats("O", 0.0, 1.0)]
    note: Any = None


SIZES = {"D": 2, "O": 3}


def value(rows=2, cells=None):
    return Value(
        3,
        1.5,
        np.arange(rows),
        np.full(rows, 2),
        np.zeros((rows, 2)),
        np.tile(np.eye(2), (rows, 1, 1)),
        cells,
        "not stored",
    )


def stored(of):
    snapshot = Snapshot(None)
    to_snapshot(of, snapshot, "it")
    return stored_and_read(snapshot)


def read(snapshot):
    return from_snapshot(Value, snapshot, "it", SIZES, note="given")


@given(
    st.integers(0, 9),
    st.floats(0.0, 2.5),
    arrays.arrays(np.float64, st.tuples(st.integers(0, 4), st.just(2)), elements=st.floats(-1, 1)),
    st.booleans(),
)
def test_value_comes_back_bit_by_bit_but_for_what_is_given(count, revolutions, mean, has_cells):
    cells = np.array([0.0, 0.5, 1.0]) if has_cells else None
    before = value(len(mean), cells)._replace(count=count, revolutions=revolutions, mean=mean)
    after = read(stored(before))
    assert (after.count, after.revolutions, after.note) == (count, revolutions, "given")
    assert type(after.count) is int
    for name in ("row", "mode", "mean", "covariance", "cells"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))


@pytest.mark.parametrize(("width", "order"), [("<4", "C"), (">8", "C"), ("<8", "F")])
def test_arrays_of_other_types_become_those_of_compiled_functions(width, order):
    snapshot = stored(value())
    for name, array in snapshot.arrays.items():
        if array.ndim:
            other = f"{width[0]}{array.dtype.kind}{width[1]}"
            snapshot.arrays[name] = np.asarray(array, other, order)
    after, before = read(snapshot), value()
    for name in ("row", "mode", "mean", "covariance"):
        found, expected = getattr(after, name), getattr(before, name)
        assert found.dtype == expected.dtype
        assert found.dtype.isnative
        assert found.flags.c_contiguous
        np.testing.assert_array_equal(found, expected)


def test_names_are_those_of_the_fields_that_are_declared_and_there():
    snapshot = stored(value())
    assert set(snapshot.arrays) == {
        f"it.{name}" for name in ("count", "revolutions", "row", "mode", "mean", "covariance")
    }
    assert snapshot.names_below("it") == {name.split(".")[1] for name in snapshot.arrays}


@pytest.mark.parametrize(
    ("name", "forged", "reason"),
    [
        ("count", 10, r"it.count: 10 given outside \[0, 9\]"),
        ("count", 1.0, "it.count: float64 given, expected whole numbers"),
        ("count", [1], r"it.count: shape \(1,\), expected \(\)"),
        ("revolutions", np.nan, r"it.revolutions: nan given outside \[0, 2.5\]"),
        ("revolutions", "1.5", "it.revolutions: <U3 given, expected floats"),
        ("row", [1, 1], "it.row: must increase"),
        ("row", [0, -1], "it.row: a number is not finite, or outside"),
        ("row", [0, 1, 2], r"it.mode: shape \(2,\), expected \(3\)"),
        ("mode", [0, 3], r"it.mode: a number is not finite, or outside \[-1, 2\]"),
        ("mean", [[0.0, 0.0], [0.0, np.nan]], "it.mean: a number is not finite"),
        ("mean", np.zeros((2, 3)), r"it.mean: shape \(2, 3\), expected \(2, 2\)"),
        ("covariance", np.tile([[1.0, 2.0], [2.0, 1.0]], (2, 1, 1)), "it.covariance: not a cov"),
        ("covariance", np.tile([[1.0, 0.5], [-0.5, 1.0]], (2, 1, 1)), "it.covariance: not a cov"),
        ("covariance", np.tile([[0.0, 0.1], [0.1, 1.0]], (2, 1, 1)), "it.covariance: not a cov"),
        ("covariance", np.tile(-np.eye(2), (2, 1, 1)), "it.covariance: not a cov"),
        ("covariance", np.tile(5.0 * np.eye(2), (2, 1, 1)), "it.covariance: a number is not"),
    ],
)
def test_what_the_tracker_cannot_have_stored_is_refused(name, forged, reason):
    snapshot = stored(value())
    snapshot.arrays[f"it.{name}"] = np.array(forged)
    with pytest.raises(ValueError, match=reason):
        read(snapshot)


@pytest.mark.parametrize("name", ["count", "row", "covariance"])
def test_missing_array_is_named(name):
    snapshot = stored(value())
    del snapshot.arrays[f"it.{name}"]
    with pytest.raises(ValueError, match=f"^it.{name}: missing$"):
        read(snapshot)


def test_variances_of_zero_are_allowed():
    before = value()._replace(covariance=np.zeros((2, 2, 2)))
    np.testing.assert_array_equal(read(stored(before)).covariance, 0.0)
