import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from unfolded import columns_of

from phd_jdtc_ros.report.page.packing import Columns, pack

# Differences of these have 31 bits and a sign.
WHOLE = st.lists(st.integers(-(2**30), 2**30 - 1), max_size=40)


@given(WHOLE, WHOLE)
def test_columns_are_read_back_as_they_were(first, second):
    columns = Columns()
    columns.add("first", first)
    columns.add("second", second)

    found = columns_of(columns.text(), columns.index)

    assert found["first"].tolist() == first
    assert found["second"].tolist() == second


def test_columns_of_steady_motion_take_less_than_a_byte_an_entry():
    columns = Columns()
    columns.add("x", 250 * np.arange(10_000))

    assert len(columns.text()) < 1_000


def test_packed_is_the_same_for_the_same_bytes():
    assert pack(b"a page" * 100) == pack(b"a page" * 100)
