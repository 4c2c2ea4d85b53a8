import os
from pathlib import Path

import pytest
from full_disk import largest_file

from phd_jdtc_ros import output_files, resources
from phd_jdtc_ros.bags import BagError


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


def test_write_does_not_wait_for_the_reader_of_a_pipe(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(OSError, match="no program reads this pipe") as caught:
        output_files.write(pipe, "rows")
    assert caught.value.filename == str(pipe)


@pytest.mark.parametrize(
    ("place", "said"),
    [("none/x", "{}/none is no directory"), ("file/x", "{}/file is a file, must be a directory")],
)
def test_a_directory_that_takes_no_file_is_named_before_the_work(tmp_path, place, said):
    (tmp_path / "file").touch()
    directory = (tmp_path / place).parent
    assert output_files.why_closed(directory) == said.format(tmp_path)
    assert output_files.why_closed(tmp_path / "none" / "new", parents=True) == ""
    assert output_files.why_closed(tmp_path / "file" / "new", parents=True)
    assert output_files.why_closed(Path("/proc")).startswith("/proc cannot be written to: ")
    assert os.listdir(tmp_path) == ["file"]


def test_bag_is_found_by_name_from_any_directory(tmp_path, monkeypatch):
    # The user has bags too.
    (tmp_path / "bags" / "mine").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    assert (resources.bag("three_classes") / "metadata.yaml").is_file()


def test_bag_of_the_users_comes_first(tmp_path, monkeypatch):
    (tmp_path / "three_classes").mkdir()
    monkeypatch.chdir(tmp_path)
    assert resources.bag("three_classes") == Path("three_classes")


def test_bag_by_path_is_left_as_it_is(tmp_path):
    assert resources.bag(tmp_path / "none") == tmp_path / "none"


def test_bag_that_is_not_there_names_those_that_are(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BagError) as caught:
        resources.bag("four_classes")
    assert str(caught.value) == (
        "four_classes: no such bag; those shipped are air_3d, approach_adsb, autoferry_2, "
        "automotive, cars_4d, clutter_50, coastal, coastal_ship, drones, harbour_ais, manoeuvring, "
        "one_radar, "
        "paper_scenario, terminal_radar, terminal_radar_by_sector, three_classes, "
        "two_approach_radars, two_slant, "
        "two_terminal_radars"
    )


def test_profile_is_a_file_with_the_bag_that_shows_it():
    path, bag = resources.profile("air_traffic")
    assert path.name == "air_traffic.yaml"
    assert bag == "two_approach_radars"
    assert resources.profile("surveillance")[1] == resources.DEFAULT_BAG


@pytest.mark.parametrize("name", ["sea", "../config/surveillance"])
def test_profile_that_is_not_there_names_those_that_are(name, tmp_path, monkeypatch):
    # The checkout is no longer the working directory.
    monkeypatch.chdir(tmp_path)
    expected = r"no such profile; those shipped are air_traffic, autoferry, "
    with pytest.raises(BagError, match=expected):
        resources.profile(name)


def test_scenario_is_a_file_or_a_shipped_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "one_radar").mkdir()
    assert resources.scenario("one_radar").name == "one_radar.yaml"
    for given in ("mine.yaml", "other", "config/one_radar", str(tmp_path / "one_radar")):
        assert resources.scenario(given) == Path(given)
