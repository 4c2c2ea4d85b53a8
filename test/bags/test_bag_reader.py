import random

import pytest
from mcap.writer import CompressionType
from samples import STAMP_NS, truth
from small_bags import MARKERS, POSES, RADAR, SECOND, TOPICS, chunked, made, read_all, types, write

from msg_adapters.encoding import interfaces, names
from msg_adapters.targets import truth as truth_adapter
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagMessage, BagReader


def failure(path):
    """Return the error that opening a bag or reading all of it ends with."""
    with pytest.raises(BagError) as caught:
        list(BagReader(path).messages())
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    return caught.value


@pytest.mark.parametrize("part", ["directory", "file"])
def test_reader_takes_a_directory_or_its_file(bag, original, part):
    path = bag if part == "directory" else bag / "recording_0.mcap"
    reader = BagReader(path)
    assert list(reader.messages()) == original
    assert reader.types == dict(types())
    assert reader.counts == {RADAR: 6, names.TRUTH: 6, POSES: 1, MARKERS: 1}
    assert reader.start_ns == STAMP_NS
    assert reader.end_ns == STAMP_NS + 20 * SECOND + 1


def test_reader_yields_what_was_written_of_the_topics_asked_for(bag, original):
    assert read_all(bag) == [
        BagMessage(topic, log_time, interfaces.encode(message))
        for topic, message, log_time in made()
    ]
    found = list(BagReader(bag).messages([POSES, RADAR]))
    assert found == [entry for entry in original if entry.topic in (POSES, RADAR)]
    assert len(found) == 7


def test_reader_yields_in_order_of_log_time_then_of_writing(tmp_path, original):
    shuffled = made()
    random.Random(3).shuffle(shuffled)
    path = write(tmp_path / "recording", shuffled)
    assert read_all(path) == original
    assert read_all(chunked(tmp_path / "small", path)) == original
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


def test_require_names_every_topic_that_is_missing_or_of_another_type(bag):
    BagReader(bag).require({RADAR: names.CLOUD, POSES: names.POSES})
    with pytest.raises(BagError) as caught:
        BagReader(bag).require({"/no": names.CLOUD, POSES: names.CLOUD, RADAR: names.CLOUD})
    assert not caught.value.corrupt
    assert str(caught.value) == (
        f"{bag}: /no is missing, must be {names.CLOUD}; "
        f"{POSES} is {names.POSES}, must be {names.CLOUD}"
    )


def test_reader_rejects_missing_paths_and_other_files(tmp_path, bag):
    error = failure(tmp_path / "none")
    assert "no such bag" in str(error)
    assert not error.corrupt
    error = failure(bag / "metadata.yaml")
    assert "is not an MCAP file; asterix_bridge converts" in str(error)
    assert not error.corrupt


def test_reader_of_a_directory_without_a_file_says_so(tmp_path):
    error = failure(tmp_path)
    assert str(error) == f"{tmp_path}: contains no MCAP file"
    assert not error.corrupt


@pytest.mark.parametrize("content", [b"", b"text", b"\x00" * 1000, b"\x89MCAP0\r\n"])
def test_reader_rejects_a_file_that_only_has_the_name_as_damaged(tmp_path, content):
    (tmp_path / "foreign.mcap").write_bytes(content)
    assert failure(tmp_path / "foreign.mcap").corrupt
