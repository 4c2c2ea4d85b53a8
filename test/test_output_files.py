import os

import pytest
from full_disk import largest_file

from phd_jdtc_ros import output_files


def test_write_replaces_a_link_and_not_what_it_points_to(tmp_path):
    other, link = tmp_path / "other", tmp_path / "report.html"
    other.write_text("of somebody else")
    link.symlink_to(other)
    output_files.write(link, "page")
    assert (link.read_text(), link.is_symlink()) == ("page", False)
    assert other.read_text() == "of somebody else"


def test_write_leaves_nothing_where_there_is_no_room(tmp_path):
    path = tmp_path / "mine.yaml"
    with largest_file(1000), pytest.raises(OSError, match="too large") as caught:
        output_files.write(path, "x" * 2000)
    assert caught.value.filename == str(path)
    assert not os.listdir(tmp_path)


def test_file_written_in_parts_is_named_where_there_is_no_room(tmp_path):
    path = tmp_path / "tracks.ast"

    def write():
        with output_files.opened(path) as stream:
            stream.write(b"x" * 2000)

    with largest_file(1000), pytest.raises(OSError, match="too large") as caught:
        write()
    assert caught.value.filename == str(path)


def test_write_to_what_is_no_file_goes_through(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    output_files.write(pipe, "rows")
    assert os.read(reader, 100) == b"rows"
    os.close(reader)
