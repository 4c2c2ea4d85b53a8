import pytest

from phd_jdtc_ros.report.sets import Sets


def test_sets_are_all_and_each_of_several_classes():
    sets = Sets.of(2, ("car", "van_2"))

    assert sets.keys == ["all", "class_0", "class_1"]
    assert [sets.title(key) for key in sets.keys] == ["all classes", "car", "van_2"]
    sets = Sets.of(1, ("car",))

    assert sets.one_class
    assert (sets.keys, sets.title("all")) == (["all"], "car")
    assert Sets.of(2, ("car", "van")).class_title(7) == "class 7"


@pytest.mark.parametrize("names", [(), ("car",), ("class_0", "class_1")])
def test_sets_without_fitting_names_are_numbered(names):
    assert [Sets.of(2, names).class_title(k) for k in range(2)] == ["class 0", "class 1"]


def test_sets_of_a_summary_are_those_of_its_figures():
    figures = {"all": {}, "class_0": {}, "class_1": {}}
    summary = {"filtered": figures, "smoothed": figures}

    assert Sets.of_summary(summary) == Sets.of(2)
    assert Sets.of_summary({**summary, "class_names": ["car", "van"]}) == Sets(("car", "van"))
