import os
import resource
import signal

import pytest

from phd_jdtc_ros import output_files


def test_write_replaces_a_link_and_not_what_it_points_to(tmp_path):
    other, link = tmp_path / "other", tmp_path / "report.html"
    other.write_text("of somebody else")
    link.symlink_to(other)
    output_files.write(link, "page")
    assert (link.read_text(), link.is_symlink()) == ("page", False)
    assert other.read_text() == "of somebody else"


def test_write_leaves_nothing_where_there_is_no_room(tmp_path):
    """A limit of the size of files fails as a full disk does, in a write."""
    path = tmp_path / "mine.yaml"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(OSError, match="too large") as caught:
            output_files.write(path, "x" * 2000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, ignored)
    assert caught.value.filename == str(path)
    assert not os.listdir(tmp_path)


def test_write_to_what_is_no_file_goes_through(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    output_files.write(pipe, "rows")
    assert os.read(reader, 100) == b"rows"
    os.close(reader)
