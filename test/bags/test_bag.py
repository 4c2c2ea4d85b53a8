import random
import subprocess
import sys
import textwrap

import lz4.frame
import pytest
import yaml
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk, ChunkIndex
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from samples import STAMP_NS, plain, truth
from small_bags import MARKERS, POSES, RADAR, SECOND, TOPICS, chunked, made, outcome, write

from msg_adapters import interfaces, names
from msg_adapters import truth as truth_adapter
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.reader import BagMessage, BagReader
from phd_jdtc_ros.bags.writer import BagWriter

TRIALS = 150


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return write(tmp_path_factory.mktemp("bags") / "recording", made())


@pytest.fixture(scope="module")
def original(bag):
    return list(BagReader(bag).messages())


@pytest.fixture(scope="module")
def small_chunks(bag, tmp_path_factory):
    return chunked(tmp_path_factory.mktemp("bags") / "small", bag)


def failure(path):
    """Return the error that opening a bag or reading all of it ends with."""
    with pytest.raises(BagError) as caught:
        list(BagReader(path).messages())
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    return caught.value


# ------------------------------------------------------------------------------- writing


def test_writer_makes_missing_parents(tmp_path):
    write(tmp_path / "a" / "b", made())
    assert (tmp_path / "a" / "b" / "b_0.mcap").is_file()


def test_writer_gives_the_same_bytes_for_the_same_messages(bag, tmp_path):
    again = write(tmp_path / "recording", made())
    for path in bag.iterdir():
        assert (again / path.name).read_bytes() == path.read_bytes()


def test_writer_is_read_by_an_independent_reader(bag):
    with Reader(bag) as reader:
        topics = {(c.topic, c.msgtype, c.msgcount) for c in reader.connections}
        stamps = [(c.topic, stamp) for c, stamp, _ in reader.messages()]
        assert reader.message_count == 14
        assert reader.start_time == STAMP_NS
        assert reader.compression_format is None or reader.compression_format == ""
    assert topics == {
        (RADAR, names.CLOUD, 6),
        (names.TRUTH, names.CLOUD, 6),
        (POSES, names.POSES, 1),
        (MARKERS, names.MARKERS, 1),
    }
    assert stamps == [(topic, log_time) for topic, _, log_time in made()]


def test_writer_messages_are_understood_by_an_independent_reader(bag):
    # AnyReader takes the definitions from the bag itself.
    with AnyReader([bag]) as reader:
        found = [
            plain(reader.deserialize(data, connection.msgtype))
            for connection, _, data in reader.messages()
        ]
    sent = [interfaces.decode(data.data, dict(types())[data.topic]) for data in read_all(bag)]
    assert found == [plain(message) for message in sent]


def types():
    return [(topic.name, topic.type_name) for topic in TOPICS]


def read_all(path):
    return list(BagReader(path).messages())


def test_writer_metadata_is_what_rosbag2_writes(bag):
    document = yaml.safe_load((bag / "metadata.yaml").read_text())
    assert list(document) == ["rosbag2_bagfile_information"]
    found = document["rosbag2_bagfile_information"]
    topics = found.pop("topics_with_message_count")
    start = {"nanoseconds_since_epoch": STAMP_NS}
    duration = {"nanoseconds": 20 * SECOND + 1}
    assert found == {
        "version": 9,
        "storage_identifier": "mcap",
        "duration": duration,
        "starting_time": start,
        "message_count": 14,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": ["recording_0.mcap"],
        "files": [
            {
                "path": "recording_0.mcap",
                "starting_time": start,
                "duration": duration,
                "message_count": 14,
            }
        ],
        "custom_data": None,
        "ros_distro": "jazzy",
    }
    assert [topic["message_count"] for topic in topics] == [6, 6, 1, 1]
    endless = {"sec": 9223372036, "nsec": 854775807}
    assert topics[3]["topic_metadata"] == {
        "name": MARKERS,
        "type": names.MARKERS,
        "serialization_format": "cdr",
        "offered_qos_profiles": [
            {
                "history": "keep_last",
                "depth": 1,
                "reliability": "reliable",
                "durability": "transient_local",
                "deadline": endless,
                "lifespan": endless,
                "liveliness": "automatic",
                "liveliness_lease_duration": endless,
                "avoid_ros_namespace_conventions": False,
            }
        ],
        "type_description_hash": interfaces.type_hash(names.MARKERS),
    }
    profiles = [topic["topic_metadata"]["offered_qos_profiles"][0] for topic in topics]
    assert [profile["depth"] for profile in profiles] == [50, 50, 10, 1]
    assert {profile["durability"] for profile in profiles[:3]} == {"volatile"}


def test_writer_puts_type_hash_and_qos_into_the_channels(bag):
    with (bag / "recording_0.mcap").open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2"
    channels = {channel.topic: channel for channel in summary.channels.values()}
    assert channels.keys() == dict(types()).keys()
    for topic in TOPICS:
        channel = channels[topic.name]
        schema = summary.schemas[channel.schema_id]
        assert channel.message_encoding == "cdr"
        assert channel.metadata["topic_type_hash"] == interfaces.type_hash(topic.type_name)
        assert yaml.safe_load(channel.metadata["offered_qos_profiles"]) == topic.offered_qos
        assert (schema.name, schema.encoding) == (topic.type_name, "ros2msg")
        assert schema.data.decode() == interfaces.definition(topic.type_name)
    assert len(summary.schemas) == 3  # one a type, not one a topic


def test_writer_does_not_compress(bag):
    with (bag / "recording_0.mcap").open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    assert {chunk.compression for chunk in chunks} == {""}


@pytest.mark.parametrize("kind", ["directory", "file"])
def test_writer_refuses_what_exists_and_leaves_it_alone(tmp_path, kind):
    path = tmp_path / "taken"
    path.mkdir() if kind == "directory" else path.write_text("mine")
    with pytest.raises(BagError, match="already exists") as caught:
        BagWriter(path)
    assert not caught.value.corrupt
    assert str(path) in str(caught.value)
    assert path.read_text() == "mine" if kind == "file" else not list(path.iterdir())


def test_writer_explains_why_it_cannot_make_the_directory(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match="cannot be written: Not a directory") as caught:
        BagWriter(tmp_path / "file" / "bag")
    assert not caught.value.corrupt


def test_writer_finishes_the_bag_when_its_block_fails(tmp_path):
    def fail():
        with BagWriter(tmp_path / "bag") as bag:
            bag.add_topic(TOPICS[0])
            bag.write(RADAR, interfaces.encode(made()[0][1]), STAMP_NS)
            raise KeyError("reason")

    with pytest.raises(KeyError, match="reason"):
        fail()
    assert len(read_all(tmp_path / "bag")) == 1


def printed(script, path):
    """Return what a script prints, which is run with a path by a process of its own."""
    command = [sys.executable, "-c", textwrap.dedent(script), str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return done.stdout


def test_writer_turns_a_full_disk_into_one_error_that_later_writes_repeat(tmp_path):
    script = """
        import resource, sys
        from pathlib import Path
        from phd_jdtc_ros.bags.errors import BagError
        from phd_jdtc_ros.bags.writer import BagWriter, Topic
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
        with BagWriter(Path(sys.argv[1])) as bag:
            bag.add_topic(Topic("/cloud", "sensor_msgs/msg/PointCloud2"))
            for index in range(10):
                try:
                    bag.write("/cloud", b"x" * 100_000, index)
                except BagError as error:
                    print(error)
    """
    first, *others = printed(script, tmp_path / "bag").splitlines()
    reason = first.removeprefix(f"{tmp_path / 'bag'}: cannot be written: ")
    assert reason != first
    again = f"{tmp_path / 'bag'}: cannot be written: closed after an error: {reason}"
    assert set(others) == {again}


def test_writer_refuses_messages_when_it_is_closed(tmp_path):
    bag = BagWriter(tmp_path / "bag")
    bag.add_topic(TOPICS[0])
    bag.close()
    with pytest.raises(BagError, match=r"cannot be written: closed$"):
        bag.write(RADAR, b"", STAMP_NS)


@pytest.mark.parametrize("topics", [TOPICS, ()], ids=["topics", "nothing"])
def test_a_bag_of_no_messages_is_a_bag(tmp_path, topics):
    path = write(tmp_path / "empty", [], topics)
    reader = BagReader(path)
    assert list(reader.messages()) == []
    assert reader.counts.total() == 0
    assert reader.types == {topic.name: topic.type_name for topic in topics}
    with Reader(path) as independent:
        assert independent.message_count == 0
        assert len(independent.connections) == len(topics)


# ------------------------------------------------------------------------------- reading


@pytest.mark.parametrize("part", ["directory", "file"])
def test_reader_takes_a_directory_or_its_file(bag, original, part):
    path = bag if part == "directory" else bag / "recording_0.mcap"
    reader = BagReader(path)
    assert list(reader.messages()) == original
    assert reader.types == dict(types())
    assert reader.counts == {RADAR: 6, names.TRUTH: 6, POSES: 1, MARKERS: 1}
    assert reader.start_ns == STAMP_NS
    assert reader.end_ns == STAMP_NS + 20 * SECOND + 1


def test_reader_yields_what_was_written(bag):
    assert read_all(bag) == [
        BagMessage(topic, log_time, interfaces.encode(message))
        for topic, message, log_time in made()
    ]


def test_reader_yields_only_the_topics_asked_for(bag, original):
    found = list(BagReader(bag).messages([POSES, RADAR]))
    assert found == [entry for entry in original if entry.topic in (POSES, RADAR)]
    assert len(found) == 7


def test_reader_yields_in_order_of_log_time_whatever_the_order_of_writing(tmp_path, original):
    shuffled = made()
    random.Random(3).shuffle(shuffled)
    path = write(tmp_path / "recording", shuffled)
    assert read_all(path) == original
    assert read_all(chunked(tmp_path / "small", path)) == original


def test_reader_keeps_the_order_of_writing_within_one_log_time(tmp_path):
    payload = [interfaces.encode(truth_adapter.to_msg(truth(n), "map")) for n in range(4)]
    entries = [(topic, data, STAMP_NS) for data in payload for topic in (names.TRUTH, RADAR)]
    path = write(tmp_path / "bag", entries, TOPICS[:2])
    assert [(entry.topic, entry.data) for entry in read_all(path)] == [e[:2] for e in entries]


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_reader_reads_what_other_recorders_compress(bag, original, tmp_path, compression):
    assert read_all(chunked(tmp_path / "other", bag, compression=compression)) == original


def test_reader_can_be_read_twice(bag, original):
    reader = BagReader(bag)
    assert list(reader.messages()) == list(reader.messages()) == original


def test_require_passes_what_is_there(bag):
    BagReader(bag).require({RADAR: names.CLOUD, POSES: names.POSES})


def test_require_names_every_topic_that_is_missing_or_of_another_type(bag):
    with pytest.raises(BagError) as caught:
        BagReader(bag).require({"/no": names.CLOUD, POSES: names.CLOUD, RADAR: names.CLOUD})
    assert not caught.value.corrupt
    assert str(caught.value) == (
        f"{bag}: /no is missing, must be {names.CLOUD}; "
        f"{POSES} is {names.POSES}, must be {names.CLOUD}"
    )


def test_reader_rejects_a_missing_path(tmp_path):
    error = failure(tmp_path / "none")
    assert "no such bag" in str(error)
    assert not error.corrupt


@pytest.mark.parametrize("count", [0, 2])
def test_reader_of_a_directory_must_hold_one_file(bag, tmp_path, count):
    data = (bag / "recording_0.mcap").read_bytes()
    for index in range(count):
        (tmp_path / f"{index}.mcap").write_bytes(data)
    error = failure(tmp_path)
    assert f"contains {count} MCAP files, must contain one" in str(error)
    assert not error.corrupt


def test_reader_rejects_a_file_of_another_kind(bag):
    error = failure(bag / "metadata.yaml")
    assert "is not an MCAP file" in str(error)
    assert not error.corrupt


@pytest.mark.parametrize("content", [b"", b"text", b"\x00" * 1000, b"\x89MCAP0\r\n"])
def test_reader_rejects_a_file_that_only_has_the_name_as_damaged(tmp_path, content):
    (tmp_path / "foreign.mcap").write_bytes(content)
    assert failure(tmp_path / "foreign.mcap").corrupt


# ------------------------------------------------------------------------------- damage


def summary(path):
    """Return a bag's metadata."""
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


BOMB_SIZE = 2**29


def packed(compression):
    """Return `BOMB_SIZE` bytes, one record of an unknown kind, compressed."""
    head = b"\x80" + (BOMB_SIZE - 9).to_bytes(8, "little")
    if compression == "zstd":
        packer = zstandard.ZstdCompressor(level=1).compressobj(size=BOMB_SIZE)
        begin, pack, end = b"", packer.compress, packer.flush
    else:
        packer = lz4.frame.LZ4FrameCompressor()
        begin, pack, end = packer.begin(), packer.compress, packer.flush
    parts = [begin, pack(head + bytes(2**20 - 9))]
    parts += [pack(bytes(2**20)) for _ in range(BOMB_SIZE // 2**20 - 1)]
    return b"".join([*parts, end()])


def bomb(file, compression, declared):
    """Write a bag whose only chunk is small and unpacks to `BOMB_SIZE` bytes."""
    data = packed(compression)
    with file.open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start("ros2")
        definition = interfaces.definition(names.CLOUD).encode()
        schema = writer.register_schema(names.CLOUD, "ros2msg", definition)
        writer.register_channel(RADAR, "cdr", schema)
        offset = stream.tell()
        record = RecordBuilder()
        Chunk(compression, data, 2, 1, 0, declared).write(record)
        chunk = record.end()
        stream.write(chunk)
        writer._Writer__chunk_indices.append(
            ChunkIndex(len(chunk), offset, compression, len(data), 2, 0, {}, 1, declared)
        )
        writer.finish()


@pytest.mark.parametrize("declared", [BOMB_SIZE, 1000], ids=["honest", "lying"])
@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_reader_of_a_bomb_stays_within_its_memory(tmp_path, compression, declared):
    file = tmp_path / "bomb.mcap"
    bomb(file, compression, declared)
    assert file.stat().st_size < BOMB_SIZE // 100
    script = r"""
        import re, sys
        from pathlib import Path
        from phd_jdtc_ros.bags.errors import BagError
        from phd_jdtc_ros.bags.reader import BagReader
        try:
            print(len(list(BagReader(Path(sys.argv[1])).messages())))
        except BagError as error:
            print(error.corrupt)
        # Unlike ru_maxrss, which a child inherits, this is the process's own peak.
        print(re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[1])
    """
    found, kilobytes = printed(script, file).split()
    assert int(kilobytes) <= 256 * 1024
    assert found == "True"
