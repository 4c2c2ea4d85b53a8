"""Shipped files by their names."""

from pathlib import Path

import pytest

from phd_jdtc_ros import resources
from phd_jdtc_ros.bags.errors import BagError


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
        "four_classes: no such bag; those shipped are autoferry_2, automotive, clutter_50, "
        "coastal, coastal_ship, manoeuvring, one_radar, paper_scenario, terminal_radar, "
        "terminal_radar_by_sector, three_classes, two_approach_radars, two_terminal_radars"
    )


def test_profile_is_a_file_with_the_bag_that_shows_it():
    path, bag = resources.profile("air_traffic")
    assert path.name == "air_traffic.yaml"
    assert bag == "two_approach_radars"
    assert resources.profile("surveillance")[1] == resources.DEFAULT_BAG


@pytest.mark.parametrize("name", ["sea", "../config/surveillance"])
def test_profile_that_is_not_there_names_those_that_are(name):
    expected = r"no such profile; those shipped are air_traffic, autoferry, "
    with pytest.raises(BagError, match=expected):
        resources.profile(name)
