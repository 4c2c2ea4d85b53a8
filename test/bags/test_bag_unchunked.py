"""Bags whose messages are not in chunks, as rosbag2's preset `fastwrite` records them."""

import random

import pytest
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Message
from mcap.writer import IndexType, Writer
from samples import STAMP_NS
from small_bags import MARKERS, RADAR, TOPICS, made, write

from msg_adapters.encoding import interfaces, names
from phd_jdtc_ros.bags import reader as bag_module
from phd_jdtc_ros.bags import salvage
from phd_jdtc_ros.bags.reader import BagMessage, BagReader
from robustness.hostile_input.bags import outcome

HEAD = 31  # A message has opcode, length, channel, sequence, two times
LENGTH = slice(1, 9)
TRIALS = 150


def started(stream, **options):
    """Return a writer with all topics, and the topics' channels."""
    writer = Writer(stream, **options)
    writer.start("ros2")
    channels = {}
    for topic in TOPICS:
        definition = interfaces.definition(topic.type_name).encode()
        schema = writer.register_schema(topic.type_name, "ros2msg", definition)
        channels[topic.name] = writer.register_channel(topic.name, "cdr", schema)
    return writer, channels


def recorded(file, entries, **options):
    """Write messages; without options as `fastwrite` does: no chunks, no checksums."""
    options = options or {"use_chunking": False, "enable_crcs": False}
    with file.open("wb") as stream:
        writer, channels = started(stream, **options)
        writer.add_metadata("rosbag2", {"serialized_metadata": "version: 9"})  # So does rosbag2
        for topic, message, log_time in entries:
            data = message if isinstance(message, bytes) else interfaces.encode(message)
            writer.add_message(channels[topic], log_time, data, log_time)
        writer.finish()
    return file


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("unchunked") / "fast.mcap", made())


@pytest.fixture(scope="module")
def messages():
    return [BagMessage(topic, time, interfaces.encode(message)) for topic, message, time in made()]


def places(file):
    """Return where the messages begin and end."""
    data, position, found = file.read_bytes(), 8, []
    while data[position] != Opcode.DATA_END:
        end = position + 9 + int.from_bytes(data[position + 1 : position + 9], "little")
        if data[position] == Opcode.MESSAGE:
            found.append((position, end))
        position = end
    return found


def read(data, path):
    path.write_bytes(data)
    return outcome(path)


def flipped(data, offset, mask):
    changed = bytearray(data)
    changed[offset] ^= mask
    return bytes(changed)


def test_reader_reads_files_without_chunks_by_topic(file, messages, tmp_path):
    with_chunks = BagReader(write(tmp_path / "bag", made()))
    reader = BagReader(file)
    assert list(reader.messages()) == list(with_chunks.messages()) == messages
    assert (reader.types, reader.counts) == (with_chunks.types, with_chunks.counts)
    assert (reader.start_ns, reader.end_ns) == (with_chunks.start_ns, with_chunks.end_ns)
    found = list(BagReader(file).messages([RADAR]))
    assert found == [message for message in messages if message.topic == RADAR]


@pytest.mark.parametrize("run_size", [1, 1000, salvage.RUN_SIZE])
def test_reader_without_chunks_yields_by_log_time(messages, tmp_path, monkeypatch, run_size):
    monkeypatch.setattr(salvage, "RUN_SIZE", run_size)
    shuffled = made()
    random.Random(3).shuffle(shuffled)
    found, error = outcome(recorded(tmp_path / "shuffled.mcap", shuffled))
    assert (found, error) == (messages, None)


def test_reader_refuses_more_disorder_than_its_memory_holds(tmp_path, monkeypatch):
    entries = [(RADAR, bytes(500), STAMP_NS + index) for index in range(12)]
    in_order = [BagMessage(RADAR, time, data) for _, data, time in entries]
    monkeypatch.setattr(salvage, "RUN_SIZE", 1100)  # Two messages
    monkeypatch.setattr(bag_module, "MAX_WAITING", 3500)  # Four messages
    for name, order in {
        "sorted": entries,
        "one late": [*entries[1:], entries[0]],
        "backwards": entries[::-1],
    }.items():
        assert outcome(recorded(tmp_path / f"{name}.mcap", order)) == (in_order, None), name
    # Every run has one message among the first of all and one among the last.
    turned = [entry for pair in zip(entries, entries[::-1], strict=True) for entry in pair][:12]
    found, error = outcome(recorded(tmp_path / "turned.mcap", turned))
    assert not error.corrupt
    assert "its messages are too far out of order" in str(error)
    assert found == in_order[: len(found)]


def test_reader_reads_messages_beside_chunks(messages, tmp_path):
    file = tmp_path / "mixed.mcap"
    with file.open("wb") as stream:
        writer, channels = started(stream, chunk_size=500)
        for index, (topic, message, time) in enumerate(made()):
            data = interfaces.encode(message)
            if index % 3:
                writer.add_message(channels[topic], time, data, time)
                continue
            record = RecordBuilder()
            Message(channels[topic], time, data, time, 0).write(record)
            stream.write(record.end())
            statistics = writer._Writer__statistics
            statistics.message_count += 1
            statistics.channel_message_counts[channels[topic]] += 1
            statistics.message_start_time = STAMP_NS
        writer.finish()
    assert outcome(file) == (messages, None)


def test_reader_reads_chunks_that_no_index_lists(messages, tmp_path):
    file = recorded(tmp_path / "bare.mcap", made(), chunk_size=500, index_types=IndexType.NONE)
    assert outcome(file) == (messages, None)


def test_reader_reads_every_whole_message_of_a_truncated_file(file, messages, tmp_path):
    data, ends = file.read_bytes(), [end for _, end in places(file)]
    begin = places(file)[0][0]
    rng = random.Random(21)
    near = [end + step for end in ends for step in (-1, 0, 1, 8, 9, 10, 22, 23)]
    for length in [*near, *(rng.randrange(begin, len(data)) for _ in range(TRIALS))]:
        found, error = read(data[:length], tmp_path / "cut.mcap")
        assert found == messages[: sum(end <= length for end in ends)], length
        assert error.corrupt
        assert "\n" not in str(error)


def assert_others_are_read(whole, index, data, path):
    """Check that only a message may be missing or changed, and that a missing one is reported."""
    found, error = read(data, path)
    rest = iter(found)
    assert all(message in rest for message in whole[:index] + whole[index + 1 :])
    assert len(found) <= len(whole)
    if len(found) < len(whole):
        assert error.corrupt
        assert f"it declares {len(whole)} messages, {len(found)} can be read" in str(error)


@pytest.mark.parametrize("index", [1, 5, 13])
def test_reader_loses_no_other_message_to_a_damaged_head(file, messages, tmp_path, index):
    data, begin = file.read_bytes(), places(file)[index][0]
    for offset in range(HEAD):
        for mask in (0x01, 0x03, 0x40, 0x80, 0xFF):
            changed = flipped(data, begin + offset, mask)
            assert_others_are_read(messages, index, changed, tmp_path / "flipped.mcap")


def test_reader_loses_no_other_message_to_a_flipped_byte(file, messages, tmp_path):
    data, rng = file.read_bytes(), random.Random(22)
    for _ in range(TRIALS):
        index = rng.randrange(len(messages))
        offset = rng.randrange(*places(file)[index])
        changed = flipped(data, offset, rng.randrange(1, 256))
        assert_others_are_read(messages, index, changed, tmp_path / "flipped.mcap")


def test_reader_never_hides_a_damaged_length(file, messages, tmp_path):
    data, (begin, _) = file.read_bytes(), places(file)[4]
    for offset in range(LENGTH.start, LENGTH.stop):
        found, error = read(flipped(data, begin + offset, 0x55), tmp_path / "flipped.mcap")
        assert found == messages[:4] + messages[5:]
        assert error.corrupt


# The same number of messages: one of them in another topic, or at a time outside of the recording.
@pytest.mark.parametrize(("offset", "mask"), [(9, 0x03), (15 + 6, 0x10)])
def test_reader_never_hides_another_channel_or_time(file, messages, tmp_path, offset, mask):
    data, (begin, _) = file.read_bytes(), places(file)[4]
    found, error = read(flipped(data, begin + offset, mask), tmp_path / "flipped.mcap")
    assert len(found) == len(messages)
    assert "its statistics do not match its messages" in str(error)


@pytest.mark.parametrize("keep_end", [True, False])
def test_reader_finds_the_next_message_behind_lost_bytes(file, messages, tmp_path, keep_end):
    data, (begin, _) = file.read_bytes(), places(file)[4]
    end = len(data) if keep_end else places(file)[-1][0]
    lost = data[: begin + 40] + data[begin + 65 : end]
    found, error = read(lost, tmp_path / "lost.mcap")
    rest = messages[:4] + messages[5:]
    assert found == (rest if keep_end else rest[:-1])
    assert error.corrupt


def test_reader_without_a_summary_leaves_out_a_channel_it_cannot_read(file, messages, tmp_path):
    data = file.read_bytes()[: places(file)[-1][0]]
    path = tmp_path / "damaged.mcap"
    found, error = read(flipped(data, data.index(RADAR.encode()) - 1, 0x40), path)
    assert found == [message for message in messages[:-1] if message.topic != RADAR]
    assert error.corrupt
    assert BagReader(path).start_ns == found[0].log_time_ns
    assert BagReader(path).types.keys() == {message.topic for message in found} | {MARKERS}


def test_reader_without_a_summary_reads_behind_a_false_length(file, messages, tmp_path):
    data = file.read_bytes()[: places(file)[-1][0]]
    last = data.index(MARKERS.encode()) - 4 - 2 - 2 - 9  # The channel's record
    assert data[last] == Opcode.CHANNEL
    found, error = read(flipped(data, last + 1, 0x80), tmp_path / "damaged.mcap")
    assert found == messages[:-1]
    assert error.corrupt


def test_reader_refuses_only_the_message_that_is_too_large(messages, tmp_path, monkeypatch):
    monkeypatch.setattr(salvage, "MAX_CHUNK", 20_000)
    entries = made()
    entries.insert(4, (RADAR, bytes(20_000), STAMP_NS))
    found, error = outcome(recorded(tmp_path / "large.mcap", entries))
    assert found == messages
    assert error.corrupt
    assert f"a message of {20_000 + HEAD} bytes, at most 20000 are allowed" in str(error)


def test_reader_rejects_a_summary_with_other_channels(file, tmp_path):
    data = file.read_bytes()
    topic = names.TRUTH.encode()
    at = data.rindex(topic)
    assert at > data.index(topic)
    found, error = read(flipped(data, at, 0x01), tmp_path / "flipped.mcap")
    assert len(found) == len(made())
    assert error.corrupt
    assert "define a channel or a type differently" in str(error)
