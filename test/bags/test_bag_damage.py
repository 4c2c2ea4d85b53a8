import random

import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from small_bags import TOPICS, chunked, made, write

from phd_jdtc_ros.bags import salvage
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
    if not all(entry in rest for entry in found):  # An ordered part of what was recorded
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
    position = int.from_bytes(data[end - 20 : end - 12], "little")  # The footer's summary_start
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


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return a file of many chunks, its messages and its chunks' indices."""
    directory = tmp_path_factory.mktemp("salvage")
    file = chunked(directory / "small", write(directory / "recording", made()))
    with file.open("rb") as stream:
        parts = make_reader(stream).get_summary().chunk_indexes
    assert len(parts) > 5
    return file, list(BagReader(file).messages()), parts


def read(data, path):
    path.write_bytes(data)
    found, error = outcome(path)
    assert error is not None
    assert error.corrupt
    assert "\n" not in str(error)
    return found, str(error)


def without(messages, chunk):
    """Return the messages outside a chunk's times."""
    begin, end = chunk.message_start_time, chunk.message_end_time
    return [message for message in messages if not begin <= message.log_time_ns <= end]


@pytest.mark.parametrize("offset", range(8))
def test_reader_reads_everything_behind_a_damaged_beginning(whole, tmp_path, offset):
    file, messages, _ = whole
    data = bytearray(file.read_bytes())
    data[offset] ^= 0x40
    found, error = read(data, tmp_path / "damaged.mcap")
    assert found == messages
    assert "does not begin as an MCAP file does" in error


@pytest.mark.parametrize("byte", range(1, 9))
def test_reader_finds_the_next_chunk_behind_a_length_that_makes_no_sense(whole, tmp_path, byte):
    file, messages, parts = whole
    # Cut short it has no summary to go by; the last chunk goes with it.
    data = bytearray(file.read_bytes()[: parts[-1].chunk_start_offset])
    data[parts[2].chunk_start_offset + byte] ^= 0x55
    found, _ = read(data, tmp_path / "damaged.mcap")
    rest = without(messages, parts[-1])
    # If the length became a little longer, the damaged chunk can be read too.
    assert [message for message in found if message in without(rest, parts[2])] == without(
        rest, parts[2]
    )
    assert set(found) <= set(rest)


def test_reader_finds_the_next_chunk_behind_lost_bytes(whole, tmp_path):
    file, messages, parts = whole
    data = file.read_bytes()
    lost = parts[2].chunk_start_offset + 40
    found, _ = read(data[:lost] + data[lost + 25 :], tmp_path / "damaged.mcap")
    assert found == without(messages, parts[2])


def test_reader_counts_what_is_lost_against_the_statistics(whole, tmp_path):
    file, messages, parts = whole
    data = bytearray(file.read_bytes())
    data[parts[2].chunk_start_offset + parts[2].chunk_length // 2] ^= 0x10
    found, error = read(data, tmp_path / "damaged.mcap")
    assert f"1 of {len(parts)} chunks are lost" in error
    assert f"it declares {len(messages)} messages, {len(found)} can be read" in error


@pytest.mark.parametrize(("offset", "length"), [(0, 0), (0, 50), (10**9, 50), (8, 20)])
def test_unpack_refuses_what_is_no_chunk(whole, offset, length):
    with whole[0].open("rb") as stream, pytest.raises(salvage.DamageError, match="should be"):
        salvage.unpack(stream, offset, length)


def test_reader_gives_up_on_a_file_made_to_be_searched_for_ever(tmp_path, monkeypatch):
    # Heads of chunks whose lengths agree, one inside the other, and none that can be unpacked.
    step, count = 57, 3 * salvage._MOST_SEARCHES
    heads = []
    for index in range(count):
        data = step * (count - index) - step
        lengths = (40 + data).to_bytes(8, "little"), data.to_bytes(8, "little")
        heads.append(b"\x06" + lengths[0] + bytes(24) + b"\1\0\0\0" + bytes(4) + lengths[1])
        heads.append(bytes(step - len(heads[-1])))
    file = tmp_path / "endless.mcap"
    file.write_bytes(b"\x89MCAP0\r\n" + b"".join(heads) + b"\xff" * 9)
    tried = []
    unpack = salvage.unpack
    monkeypatch.setattr(salvage, "unpack", lambda *given: (tried.append(given), unpack(*given))[1])
    found, error = outcome(file)
    assert found == []
    assert error.corrupt
    assert len(tried) == salvage._MOST_SEARCHES + 1


@pytest.mark.parametrize("cut", [0, 36], ids=["whole", "without its footer"])
def test_files_that_were_joined_are_read_as_one_recording(tmp_path, cut):
    one, other = made()[:6], made()[6:]
    # The channels have the same ids and different topics.
    swapped = [(TOPICS[1].name if t == TOPICS[0].name else t, m, s) for t, m, s in other]
    bags = write(tmp_path / "one", one), write(tmp_path / "two", swapped, TOPICS[::-1])
    first, second = (next(bag.glob("*.mcap")).read_bytes() for bag in bags)
    joined = tmp_path / "joined.mcap"
    joined.write_bytes(first[: len(first) - cut] + second)
    found, error = outcome(joined)
    assert error is None
    assert found == [*outcome(bags[0])[0], *outcome(bags[1])[0]]
    joined.write_bytes(first + bytes(5000))
    found, error = outcome(joined)
    assert found == outcome(bags[0])[0]
    assert "5000 of its bytes are lost" in str(error)
