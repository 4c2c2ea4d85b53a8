"""Plain recordings that are damaged, padded, or have blocks of other categories."""

import random
from collections import Counter

import asterix_records as made
import pytest

from phd_jdtc_ros.asterix import framing
from phd_jdtc_ros.asterix.framing import LARGEST_BLOCK
from phd_jdtc_ros.transport.network import RecordingError

SEEN = [(20.0 * k, 10.0 + k) for k in range(18)]


@pytest.fixture(scope="module")
def blocks():
    return [*made.revolutions(3, seen=SEEN)]


def read(data):
    """Return the blocks, and the counts; every byte is in one of them."""
    counts = Counter()
    found = [each.data for each in framing.datagrams(data, None, counts)]
    skipped = counts["bytes_skipped"] + counts["padding_bytes"]
    assert sum(map(len, found)) + skipped == len(data)
    return found, +counts


def foreign(category, content):
    return bytes([category]) + (len(content) + 3).to_bytes(2, "big") + content


def lost(found, blocks):
    return [block for block in blocks if block not in {*found}]


@pytest.mark.parametrize("size", [3, 70, 2000, 5000, 60_000])
def test_blocks_of_every_category_are_followed_by_their_length(blocks, size):
    rng = random.Random(size)
    categories = {*range(1, 256)} if size < 100 else {4, 16, 129, 240, 253}
    others = iter([foreign(category, rng.randbytes(size)) for category in categories])
    data = [part for block in blocks for part in (block, next(others, b"")) if part]
    data += others
    assert read(b"".join(data)) == (data, {})


@pytest.mark.parametrize("size", [2, 4, 8, 512])
def test_zeros_between_blocks_are_padding(blocks, size):
    found, counts = read(b"".join(block + bytes(-len(block) % size) for block in blocks))
    assert found == blocks
    assert {*counts} == {"padding_bytes"}


def test_recording_may_begin_and_end_within_a_block(blocks):
    whole = b"".join(blocks)
    for begin in range(1, len(blocks[0]) + len(blocks[1])):
        found, counts = read(whole[begin:-2])
        assert found == blocks[1 if begin <= len(blocks[0]) else 2 : -1]
        assert counts["recording_cut"] == 1


@pytest.mark.parametrize("with_others", [False, True])
@pytest.mark.parametrize("damage", ["lost", "inserted", "changed"])
def test_one_wrong_byte_loses_at_most_its_own_block(blocks, damage, with_others):
    rng = random.Random(damage)
    parts = blocks
    if with_others:
        others = [
            foreign(rng.choice([9, 16, 253]), rng.randbytes(rng.randrange(1, 90))) for _ in blocks
        ]
        parts = [part for pair in zip(blocks, others, strict=True) for part in pair]
    whole = b"".join(parts)
    for _ in range(60):
        at = rng.randrange(len(whole))
        byte = {"lost": b"", "inserted": bytes([rng.randrange(256), whole[at]])}.get(
            damage, bytes([whole[at] ^ rng.randrange(1, 256)])
        )
        found, _ = read(whole[:at] + byte + whole[at + 1 :])
        begin = 0
        for own in parts:
            if begin <= at < begin + len(own):
                break
            begin += len(own)
        assert {*lost(found, blocks)} <= {own}


def test_garbage_between_blocks_is_counted_and_takes_none_of_them(blocks):
    rng = random.Random(3)
    for _ in range(40):
        at, garbage = rng.randrange(1, len(blocks)), rng.randbytes(rng.randrange(1, 400))
        found, _ = read(b"".join([*blocks[:at], garbage, *blocks[at:]]))
        assert lost(found, blocks) == []


@pytest.mark.parametrize(
    "header", [b"\x00\x00\x09", b"\x30\x00\x00", b"\x30\x00\x02", b"\xfd\xff\xff"]
)
def test_impossible_headers_are_skipped(blocks, header):
    data = [*blocks[:9], header + bytes(6), *blocks[9:]]
    found, counts = read(b"".join(data))
    assert found == blocks
    assert counts == {"bytes_skipped": 9, "resynchronised": 1}


def test_block_whose_length_is_wrong_does_not_hide_the_blocks_behind_it(blocks):
    # The wrong length leads exactly to the begin of another block.
    at = next(k for k, block in enumerate(blocks) if block[0] == 48)
    reach = sum(map(len, blocks[at : at + 5]))
    wrong = blocks[at][:1] + reach.to_bytes(2, "big") + blocks[at][3:]
    found, counts = read(b"".join([*blocks[:at], wrong, *blocks[at + 1 :]]))
    assert found == [*blocks[:at], *blocks[at + 1 :]]
    assert counts["bytes_skipped"] == len(wrong)


@pytest.mark.parametrize("inside", [1, 3])
def test_blocks_within_a_foreign_block_are_its_content(blocks, inside):
    other = foreign(253, b"".join(blocks[:inside]))
    data = [*blocks[:9], other, *blocks[9:]]
    assert read(b"".join(data)) == (data, {})


def test_malformed_records_do_not_damage_a_recording(blocks):
    broken = made.plots(made.plot(1.0, 5.0))
    broken = b"\x30" + (len(broken) + 0).to_bytes(2, "big") + b"\x00" * (len(broken) - 3)
    data = [part for block in blocks for part in (block, broken, broken)]
    assert read(b"".join(data)) == (data, {})


@pytest.mark.parametrize("filling", [b"\0", b"\xff", b"\x30\0", b"0123456789\n", None])
def test_a_long_damage_is_passed_in_one_sweep(blocks, filling):
    size = 300_000
    garbage = (
        random.Random(0).randbytes(size) if filling is None else filling * (size // len(filling))
    )
    found, _ = read(b"".join([*blocks, garbage, *blocks]))
    assert len([each for each in found if each in {*blocks}]) >= 2 * len(blocks)


@pytest.mark.parametrize("text", [b"time,x,y\n0.1,5.0,6.0\n" * 5000, bytes(100_000), b"\x30" * 300])
def test_files_without_blocks_are_refused(text):
    with pytest.raises(RecordingError):
        read(text)


def test_blocks_are_usual_up_to_an_ethernet_packet():
    assert 1472 < LARGEST_BLOCK < 4096
