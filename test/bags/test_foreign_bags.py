"""Recordings of other kinds: each is named, and the command that is given converts it."""

import bz2
import lzma
import shlex
import shutil
import subprocess
import sys

import pytest
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.convert.converter import convert
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_typestore
from small_bags import RADAR, chunked, made

from msg_adapters.encoding import interfaces, names
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.nodes import playback
from phd_jdtc_ros.tools import recorded_plots
from robustness.hostile_input.bags import outcome


def refused(path):
    """Return the one line that a recording is refused with."""
    with pytest.raises(BagError) as caught:
        BagReader(path)
    assert not caught.value.corrupt
    assert "\n" not in str(caught.value)
    return str(caught.value)


def converted(fault, directory):
    """Run the `rosbags-convert` that a fault gives; return the bag that it makes."""
    command = shlex.split(fault[fault.index("rosbags-convert") :])
    code = "from rosbags.convert.cli import main; main()"
    subprocess.run([sys.executable, "-c", code, *command[1:]], cwd=directory, check=True)
    return directory / command[command.index("--dst") + 1]


@pytest.mark.parametrize("part", ["directory", "file"])
def test_a_bag_in_sqlite_is_named_with_the_commands_that_convert_it(bag, tmp_path, part):
    source = tmp_path / "in sqlite"
    typestore = get_typestore(Stores.ROS2_JAZZY)
    convert([bag], source, "sqlite3", 9, None, "file", typestore, typestore, (), (), (), ())
    (database,) = source.glob("*.db3")
    fault = refused(source if part == "directory" else database)
    assert fault.startswith(f"{database}: is a bag in SQLite")
    assert f"ros2 bag convert -i {shlex.quote(str(source))} -o convert.yaml" in fault
    found = list(BagReader(converted(fault, tmp_path)).messages())
    assert [m.log_time_ns for m in found] == [time for _, _, time in made()]


@pytest.mark.parametrize(
    ("program", "pack"),
    [("zstd", zstandard.compress), ("bzip2", bz2.compress), ("xz", lzma.compress)],
)
@pytest.mark.parametrize("part", ["directory", "file"])
def test_a_bag_compressed_as_a_file_is_named_with_the_command_that_unpacks_it(
    bag, tmp_path, part, program, pack
):
    whole = (bag / "recording_0.mcap").read_bytes()
    packed = tmp_path / f"recording_0.mcap.{program}"
    packed.write_bytes(pack(whole))
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {}")
    fault = refused(tmp_path if part == "directory" else packed)
    assert fault.startswith(f"{packed}: is compressed as a file")
    command = fault[fault.index(f"{program} -dc") :]
    if shutil.which(program) is None:
        pytest.skip(f"{program} is not installed")
    subprocess.run(["sh", "-c", command], check=True)
    assert (tmp_path / "recording_0.mcap").read_bytes() == whole


def test_a_ros_1_bag_is_named_with_the_command_that_converts_it(tmp_path):
    typestore = get_typestore(Stores.ROS1_NOETIC)
    file = tmp_path / "old.bag"
    text = typestore.types["std_msgs/msg/String"](data="a")
    with Ros1Writer(file) as written:
        connection = written.add_connection("/chatter", "std_msgs/msg/String", typestore=typestore)
        data = typestore.serialize_ros1(text, "std_msgs/msg/String")
        written.write(connection, 1, data)
    fault = refused(file)
    assert fault.startswith(f"{file}: is a ROS 1 bag")
    assert BagReader(converted(fault, tmp_path)).types == {"/chatter": "std_msgs/msg/String"}


def foreign(file, encoding, schema=("sensor_msgs/PointCloud2", "ros1msg"), data=b"{}", topic=RADAR):
    with file.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        key = writer.register_schema(*schema, b"") if schema else 0
        writer.add_message(writer.register_channel(topic, encoding, key), 1, data, 1)
        writer.finish()
    return file


@pytest.mark.parametrize(
    ("encoding", "schema", "said"),
    [
        ("ros1", ("sensor_msgs/PointCloud2", "ros1msg"), "a ROS 1 message (sensor_msgs/PointCloud"),
        ("protobuf", ("foxglove.PointCloud", "protobuf"), "a protobuf message (foxglove.Point"),
        ("json", ("Scan", "jsonschema"), "a JSON message (Scan); no command converts it"),
        ("json", None, "a JSON message without a type; no command converts it"),
        ("cbor", None, "of cbor encoding without a type; no command converts it"),
        ("cdr", None, "of cdr encoding without a type; no command converts it"),
    ],
)
def test_a_topic_of_another_encoding_is_named_as_such(tmp_path, encoding, schema, said):
    reader = BagReader(foreign(tmp_path / "foreign.mcap", encoding, schema))
    with pytest.raises(BagError) as required:
        reader.require({RADAR: names.CLOUD})
    with pytest.raises(BagError) as played:
        playback.select(reader, [])
    with pytest.raises(BagError) as wanted:
        playback.select(reader, [RADAR])
    with pytest.raises(BagError) as recognised:
        recorded_plots.recognised_radars(reader)
    for error in (required, played, wanted, recognised):
        assert f"{RADAR} is {said}" in str(error.value).replace(f"{RADAR}: is", f"{RADAR} is")
        assert "missing" not in str(error.value)
        assert "\n" not in str(error.value)


# ---------------------------------------------------------------------- without an end

NO_SUMMARY = {
    "index_types": IndexType.NONE,
    "use_statistics": False,
    "repeat_channels": False,
    "repeat_schemas": False,
    "use_summary_offsets": False,
}


@pytest.mark.parametrize("use_chunking", [True, False])
@pytest.mark.parametrize("enable_crcs", [True, False])
def test_a_finished_file_without_a_summary_is_whole(bag, tmp_path, use_chunking, enable_crcs):
    messages, file = list(BagReader(bag).messages()), tmp_path / "plain.mcap"
    with file.open("wb") as stream:
        options = {"use_chunking": use_chunking, "enable_crcs": enable_crcs, "chunk_size": 300}
        writer = Writer(stream, compression=CompressionType.NONE, **options, **NO_SUMMARY)
        writer.start("ros2")
        channels = {}
        for topic, kind in BagReader(bag).types.items():
            definition = interfaces.definition(kind).encode()
            schema = writer.register_schema(kind, "ros2msg", definition)
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        for entry in messages:
            writer.add_message(channels[entry.topic], entry.log_time_ns, entry.data, 0)
        writer.finish()
    assert int.from_bytes(file.read_bytes()[-28:-20], "little") == 0  # A summary would be there
    assert outcome(file) == (messages, None)
    data = file.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) // 2] + data[-37:])
    assert outcome(tmp_path / "cut.mcap")[1].corrupt


def test_a_file_that_ends_between_two_chunks_is_unfinished(bag, tmp_path):
    file = chunked(tmp_path / "small", bag)
    messages, data = list(BagReader(bag).messages()), file.read_bytes()
    with file.open("rb") as stream:
        parts = make_reader(stream).get_summary().chunk_indexes
    killed = tmp_path / "killed.mcap"
    killed.write_bytes(data[: parts[3].chunk_start_offset])
    found, error = outcome(killed)
    assert error.corrupt
    assert found == [m for m in messages if m.log_time_ns < parts[3].message_start_time]
    assert str(error) == (
        f"{killed}: was not finished, as when a recorder is killed: the {len(found)} messages in "
        "it are intact, later ones are lost"
    )


def test_a_file_cut_in_a_chunk_counts_the_lost_bytes(bag, tmp_path):
    file = chunked(tmp_path / "small", bag)
    with file.open("rb") as stream:
        parts = make_reader(stream).get_summary().chunk_indexes
    killed = tmp_path / "killed.mcap"
    killed.write_bytes(file.read_bytes()[: parts[3].chunk_start_offset + 77])
    assert "is damaged: it is truncated; 77 of its bytes are lost" in str(outcome(killed)[1])
