"""Bags of several files, and the forms in which recorders write intact files."""

import itertools
import shutil

import pytest
import yaml
import zstandard
from mcap.writer import CompressionType, IndexType, Writer
from small_bags import made, read_all, types, write

from msg_adapters.encoding import interfaces
from phd_jdtc_ros import resources
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.tools.asterix import bridge
from robustness.hostile_input.bags import outcome


def metadata(directory, names):
    document = {"rosbag2_bagfile_information": {"relative_file_paths": names}}
    (directory / "metadata.yaml").write_text(yaml.safe_dump(document))


@pytest.fixture
def split(tmp_path):
    """Three parts, of which the first two overlap in time, and their metadata."""
    entries, directory = made(), tmp_path / "split"
    directory.mkdir()
    for number, own in enumerate((entries[:8:2], entries[1:8:2], entries[8:])):
        part = write(tmp_path / f"part{number}", own) / f"part{number}_0.mcap"
        shutil.move(part, directory / f"split_{number}.mcap")
    metadata(directory, [f"split_{number}.mcap" for number in range(3)])
    return directory


@pytest.mark.parametrize("listed", [True, False])
def test_parts_are_read_as_one_recording(split, bag, original, listed):
    if not listed:
        (split / "metadata.yaml").unlink()
    found, whole = BagReader(split), BagReader(bag)
    assert list(found.messages()) == original
    assert (found.types, found.counts) == (whole.types, whole.counts)
    assert (found.start_ns, found.end_ns) == (whole.start_ns, whole.end_ns)
    until_ns = original[5].log_time_ns
    assert list(found.messages(until_ns=until_ns)) == original[:6]
    assert read_all(split / "split_2.mcap") == original[8:]


def test_missing_part_is_named_after_the_others_are_read(split, original):
    (split / "split_1.mcap").unlink()
    found, error = outcome(split)
    assert found == original[:8:2] + original[8:]
    assert error.corrupt
    assert str(error) == f"{split}: its metadata lists files that are missing: split_1.mcap"


def test_damaged_part_is_named_after_the_others_are_read(split, original):
    (split / "split_0.mcap").write_bytes(b"")
    found, error = outcome(split)
    assert found == original[1:8:2] + original[8:]
    assert error.corrupt
    assert str(error).startswith(f"{split / 'split_0.mcap'}: is damaged: ")


def test_hidden_companions_are_no_parts(split, original):
    (split / "metadata.yaml").unlink()
    (split / "._split_0.mcap").write_bytes(b"a resource fork")
    assert read_all(split) == original


def test_metadata_lists_the_parts_unless_it_is_of_other_files(split, original):
    shutil.copy(split / "split_0.mcap", split / "copy.mcap")
    assert read_all(split) == original
    (split / "copy.mcap").unlink()
    for text in ("a: [", "rosbag2_bagfile_information: 3", "[" * 5000):
        (split / "metadata.yaml").write_text(text)
        assert read_all(split) == original
    metadata(split, ["split/split_0.mcap", "../split_0.mcap"])
    assert read_all(split) == original[:8:2]


def test_parts_that_were_compressed_are_read_once_they_are_unpacked(split, original):
    names = [f"split_{number}.mcap" for number in range(3)]
    for name in names:
        packed = zstandard.compress((split / name).read_bytes())
        (split / f"{name}.zstd").write_bytes(packed)
    metadata(split, [f"{name}.zstd" for name in names])
    assert read_all(split) == original
    (split / names[1]).unlink()
    with pytest.raises(BagError, match=r"split_1\.mcap\.zstd: is compressed as a file; "):
        BagReader(split)


@pytest.mark.parametrize("name", ["R.MCAP", "recording"])
@pytest.mark.parametrize("part", ["directory", "file"])
def test_name_of_a_file_need_not_end_in_small_letters(bag, original, tmp_path, name, part):
    path = tmp_path / name
    shutil.copy(bag / "recording_0.mcap", path)
    if (name, part) == ("recording", "directory"):
        metadata(tmp_path, [name])
    assert read_all(tmp_path if part == "directory" else path) == original


# ------------------------------------------------------- as other recorders write


SWITCHES = ("use_statistics", "repeat_channels", "repeat_schemas", "use_summary_offsets")


def recorded(file, messages, prepare=bytes, **options):
    """Write messages as the MCAP library does, their data prepared by a function."""
    with file.open("wb") as stream:
        writer = Writer(stream, chunk_size=300, compression=CompressionType.NONE, **options)
        writer.start("ros2")
        channels = {}
        for topic, kind in types():
            definition = interfaces.definition(kind).encode()
            schema = writer.register_schema(kind, "ros2msg", definition)
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        for entry in messages:
            writer.add_message(
                channels[entry.topic], entry.log_time_ns, prepare(entry.data), entry.log_time_ns
            )
        writer.finish()
    return file


@pytest.mark.parametrize("use_chunking", [True, False])
def test_every_record_of_a_summary_is_optional(original, tmp_path, use_chunking):
    for given in itertools.product([True, False], repeat=len(SWITCHES)):
        for index_types in (IndexType.ALL, IndexType.NONE, IndexType.MESSAGE):
            options = dict(zip(SWITCHES, given, strict=True))
            file = tmp_path / "optional.mcap"
            recorded(file, original, use_chunking=use_chunking, index_types=index_types, **options)
            assert outcome(file) == (original, None), (options, index_types)
            assert BagReader(file).counts.total() == len(original)
            data = file.read_bytes()
            file.write_bytes(data[: len(data) // 2])
            assert outcome(file)[1].corrupt, (options, index_types)


def test_records_that_a_program_adds_for_itself_are_left_out(original, tmp_path):
    options = dict.fromkeys(SWITCHES, False)
    file = recorded(
        tmp_path / "private.mcap",
        original,
        index_types=IndexType.NONE,
        enable_crcs=False,
        **options,
    )
    data = file.read_bytes()
    behind = 8 + 9 + int.from_bytes(data[9:17], "little")
    private = b"\x8a" + (5).to_bytes(8, "little") + b"12345"
    file.write_bytes(data[:behind] + 2 * private + data[behind:])
    assert outcome(file) == (original, None)


def packed(data):
    return zstandard.ZstdCompressor().compress(data)


def test_messages_that_were_compressed_one_by_one_are_unpacked(original, tmp_path):
    assert read_all(recorded(tmp_path / "packed.mcap", original, packed)) == original
    streamed = zstandard.ZstdCompressor(write_content_size=False).compress
    assert read_all(recorded(tmp_path / "streamed.mcap", original, streamed)) == original


@pytest.mark.parametrize("damage", [lambda data: data[:-5], lambda data: data[:6]])
def test_compressed_message_that_cannot_be_unpacked_is_lost_alone(original, tmp_path, damage):
    lost = original[3].data

    def prepare(data):
        return damage(packed(data)) if data == lost else packed(data)

    found, error = outcome(recorded(tmp_path / "damaged.mcap", original, prepare))
    assert found == [entry for entry in original if entry.data != lost]
    assert error.corrupt
    assert "a compressed message " in str(error)
    assert f"declares {len(original)} messages, {len(original) - 1} can be read" in str(error)


def test_message_that_would_fill_the_memory_is_lost(original, tmp_path):
    bomb = zstandard.ZstdCompressor(write_content_size=False).compress(bytes(2**26 + 1))
    file = recorded(tmp_path / "bomb.mcap", original[:1], lambda data: bomb)
    found, error = outcome(file)
    assert found == []
    assert error.corrupt


def test_tool_uses_all_parts_and_ends_with_3_if_one_is_missing(tmp_path, capsys):
    source = resources.bag("one_radar")
    whole = BagReader(source)
    entries = [(entry.topic, entry.data, entry.log_time_ns) for entry in whole.messages()]
    topics = [whole.topic(name) for name in whole.types]
    split, rest = (
        write(tmp_path / name, part, topics)
        for name, part in (("split", entries[:40]), ("rest", entries[40:]))
    )
    shutil.move(rest / "rest_0.mcap", split / "split_1.mcap")
    metadata(split, ["split_0.mcap", "split_1.mcap"])
    shutil.copy(source / "parameters.yaml", split)
    plots = [tmp_path / f"{name}.ast" for name in ("whole", "split", "first")]
    for bag, out in zip((source, split), plots, strict=False):
        assert bridge.main([str(bag), "--plots", "--out", str(out)]) == 0
    (split / "split_1.mcap").unlink()
    assert bridge.main([str(split), "--plots", "--out", str(plots[2])]) == 3
    assert "missing: split_1.mcap" in capsys.readouterr().err
    assert plots[0].read_bytes() == plots[1].read_bytes()
    assert 0 < plots[2].stat().st_size < plots[1].stat().st_size
