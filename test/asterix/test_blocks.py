from collections import Counter

import asterix_records as made
import pytest

from phd_jdtc_ros.asterix.blocks import TRAILERS, BlockReader

GOOD = made.plots(made.plot(1.0, 5.0))
TRAILER = b"\xee\xff\x00\x01abcd"


@pytest.fixture
def reader():
    return BlockReader(Counter())


def test_trailer_of_every_datagram_is_no_fault(reader):
    for _ in range(10):
        assert len(list(reader.messages(GOOD + TRAILER))) == 1
    assert not +reader.counts
    assert reader.known_trailers() == {8: 10}


def test_rests_of_other_lengths_beside_trailers_are_faults(reader):
    for size in (8, 8, 8, 8, 5, 11):
        list(reader.messages(GOOD + TRAILER[:4] + bytes(size - 4)))
    assert reader.counts == {"block_truncated": 2}


def test_few_rests_are_faults(reader):
    for _ in range(TRAILERS - 1):
        list(reader.messages(GOOD + TRAILER))
    assert reader.counts == {"block_truncated": TRAILERS - 1}
    assert reader.known_trailers() == {}


@pytest.mark.parametrize("data", [GOOD + GOOD[:8], TRAILER], ids=["cut blocks", "nothing else"])
def test_rests_that_are_no_trailers_are_faults(reader, data):
    for _ in range(10):
        list(reader.messages(data))
    assert reader.counts == {"block_truncated": 10}


def test_records_are_counted_by_category_whether_read_or_not(reader):
    status = b"\x41" + (9).to_bytes(2, "big") + b"\x80\x01\x02" * 2
    list(reader.messages(made.plots(made.plot(1.0, 5.0), made.plot(2.0, 5.0)) + status))
    assert reader.categories == {48: 2, 65: 2}
    assert reader.counts == {"other_category": 1}


def test_unknown_category_is_counted_by_its_blocks(reader):
    list(reader.messages(b"\xff\x00\x05ab" * 3))
    assert reader.categories == {255: 3}
