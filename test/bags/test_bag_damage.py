import random

import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader

from phd_jdtc_ros.bags.reader import BagReader
from robustness.hostile_input.bags import outcome

TRIALS = 150


def summary(path):
    reader = BagReader(path)
    return reader.types, reader.counts, reader.start_ns, reader.end_ns


def hidden(source, data, original, file):
    """Return how a damaged copy of a bag misleads its reader, or None."""
    file.write_bytes(data)
    found, error = outcome(file)
    if error is not None and not error.corrupt:
        return f"not called corrupt: {error}"
    if error is not None and "\n" in str(error):
        return f"more than a line: {error}"
    rest = iter(original)
    if not all(entry in rest for entry in found):  # an ordered part of what was recorded
        return "other messages than recorded"
    if error is None and len(found) < len(original):
        return f"only {len(found)} of {len(original)} messages and no error"
    if error is None and summary(file) != summary(source):
        return "another summary than recorded"
    return None


def hidden_flips(source, original, offsets, rng, file):
    """Return where a flipped byte misleads the reader, and how."""
    whole = source.read_bytes()
    wrong = {}
    for offset in offsets:
        data = bytearray(whole)
        data[offset] ^= rng.randrange(1, 256)
        wrong[offset] = hidden(source, data, original, file)
    return {offset: how for offset, how in wrong.items() if how}


def index_offsets(file):
    """Return the offsets of the bytes of a summary's records that are no schemas."""
    data = file.read_bytes()
    end = len(data) - 8
    position = int.from_bytes(data[end - 20 : end - 12], "little")  # the footer's summary_start
    offsets = []
    while position < end:
        size = 9 + int.from_bytes(data[position + 1 : position + 9], "little")
        if data[position] != Opcode.SCHEMA:
            offsets += range(position, position + size)
        position += size
    return offsets


@pytest.fixture(params=["one_chunk", "small_chunks"])
def source(request, bag, small_chunks):
    return small_chunks if request.param == "small_chunks" else bag / "recording_0.mcap"


def test_reader_never_hides_a_truncation(source, original, tmp_path):
    whole = source.read_bytes()
    rng = random.Random(11)
    tail = range(len(whole) - 40, len(whole))
    wrong = {}
    for length in {*range(48), *tail, *(rng.randrange(len(whole)) for _ in range(TRIALS))}:
        file = tmp_path / "cut.mcap"
        wrong[length] = hidden(source, whole[:length], original, file)
        if not wrong[length] and outcome(file)[1] is None:
            wrong[length] = "no error"
    assert not {length: how for length, how in wrong.items() if how}


def test_reader_never_hides_a_flipped_byte(source, original, tmp_path):
    rng = random.Random(12)
    size = source.stat().st_size
    offsets = [rng.randrange(size) for _ in range(TRIALS)]
    assert not hidden_flips(source, original, offsets, rng, tmp_path / "flipped.mcap")


def test_reader_never_hides_a_flipped_byte_of_the_index(source, original, tmp_path):
    rng = random.Random(13)
    offsets = rng.sample(index_offsets(source), 2 * TRIALS)
    assert not hidden_flips(source, original, offsets, rng, tmp_path / "flipped.mcap")


@pytest.mark.parametrize("damage", ["a flipped byte", "its end"])
def test_reader_yields_the_whole_chunks_before_damage(small_chunks, original, tmp_path, damage):
    with small_chunks.open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    data, middle = bytearray(small_chunks.read_bytes()), chunks[len(chunks) // 2]
    place = middle.chunk_start_offset + middle.chunk_length // 2
    if damage == "its end":
        del data[place:]
    else:
        data[place] ^= 0x10
    (tmp_path / "damaged.mcap").write_bytes(data)
    found, error = outcome(tmp_path / "damaged.mcap")
    assert error is not None
    assert error.corrupt
    whole = [entry for entry in original if entry.log_time_ns < middle.message_start_time]
    assert len(whole) > 3
    assert found[: len(whole)] == whole
