import pytest
import yaml
from full_disk import largest_file
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from samples import STAMP_NS, plain
from small_bags import MARKERS, POSES, RADAR, SECOND, TOPICS, made, read_all, types, write

from msg_adapters.encoding import interfaces, names
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.bags.writer import BagWriter, Topic


def test_writer_gives_the_same_uncompressed_bytes_for_the_same_messages(bag, tmp_path):
    again = write(tmp_path / "recording", made())
    for path in bag.iterdir():
        assert (again / path.name).read_bytes() == path.read_bytes()
    with (bag / "recording_0.mcap").open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    assert {chunk.compression for chunk in chunks} == {""}


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
    assert len(summary.schemas) == 3  # One a type, not one a topic


@pytest.mark.parametrize("kind", ["directory", "file"])
def test_writer_refuses_what_exists_and_leaves_it_alone(tmp_path, kind):
    path = tmp_path / "taken"
    path.mkdir() if kind == "directory" else path.write_text("mine")
    with pytest.raises(BagError, match="already exists") as caught:
        BagWriter(path)
    assert not caught.value.corrupt
    assert str(path) in str(caught.value)
    assert path.read_text() == "mine" if kind == "file" else not list(path.iterdir())


def test_writer_refuses_impossible_directories_and_messages_when_closed(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match="cannot be written: Not a directory") as caught:
        BagWriter(tmp_path / "file" / "bag")
    assert not caught.value.corrupt
    bag = BagWriter(tmp_path / "bag")
    bag.add_topic(TOPICS[0])
    bag.close()
    with pytest.raises(BagError, match=r"cannot be written: closed$"):
        bag.write(RADAR, b"", STAMP_NS)


def test_writer_finishes_the_bag_when_its_block_fails(tmp_path):
    def fail():
        with BagWriter(tmp_path / "bag") as bag:
            bag.add_topic(TOPICS[0])
            bag.write(RADAR, interfaces.encode(made()[0][1]), STAMP_NS)
            raise KeyError("reason")

    with pytest.raises(KeyError, match="reason"):
        fail()
    assert len(read_all(tmp_path / "bag")) == 1


def test_writer_turns_a_full_disk_into_one_error_that_later_writes_repeat(tmp_path):
    said = []
    with largest_file(200_000), BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(Topic("/cloud", names.CLOUD))
        for index in range(10):
            try:
                bag.write("/cloud", b"x" * 100_000, index)
            except BagError as error:
                said.append(str(error))
    first, *others = said
    reason = first.removeprefix(f"{tmp_path / 'bag'}: cannot be written: ")
    assert reason != first
    again = f"{tmp_path / 'bag'}: cannot be written: closed after an error: {reason}"
    assert set(others) == {again}


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
