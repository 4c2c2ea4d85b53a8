"""The parameters beside a bag."""

from pathlib import Path

import pytest

from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments, yaml_files

ROOT = Path(__file__).parents[3]
SHIPPED = sorted(path.parent.name for path in ROOT.glob("bags/*/metadata.yaml"))
# Bags of real data, with their profiles.
RECORDED = {"autoferry_2": "autoferry"}


def test_there_are_nineteen_shipped_bags():
    assert len(SHIPPED) == 19


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_bag_has_the_parameters_of_its_scenario_or_profile(name):
    if name in RECORDED:
        given = from_arguments.load(ROOT / "config" / f"{RECORDED[name]}.yaml")
    else:
        scenario = yaml_files.load(ROOT / "config" / "scenarios" / f"{name}.yaml")
        given = from_arguments.scenario_parameters(scenario)
    expected = from_arguments.config_of(given).values
    found = bag_parameters.read(ROOT / "bags" / name)
    assert from_arguments.config_of(found).values == expected
    assert bag_parameters.read(ROOT / "bags" / name / f"{name}_0.mcap") == found


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"sensors": ["y", "1e5", "012"], "ct.turn_noise_density": 1e-12},
        {"births": [], "detection_births.rates": [1e-5, 1.0]},
        {"world_frame": "on", "radar_1.topic": "/a: b", "radar_2.fields.amplitude": "#"},
    ],
    ids=["defaults", "names like numbers", "empty lists", "text like other things"],
)
def test_what_is_written_is_read_as_it_was(tmp_path, given):
    values = resolve(given).values
    bag_parameters.write(tmp_path / bag_parameters.NAME, values)
    assert resolve(bag_parameters.read(tmp_path)).values == values


def test_only_a_file_of_this_kind_is_replaced(tmp_path):
    path = tmp_path / bag_parameters.NAME
    for lag in (3, 4):
        bag_parameters.write(path, resolve({"lag": lag}).values)
        assert bag_parameters.read(tmp_path)["lag"] == lag
    path.write_text("/**/tracker: {ros__parameters: {lag: 5}}  # mine\n")
    with pytest.raises(BagError, match="only a recording's parameter file is replaced"):
        bag_parameters.write(path, resolve({}).values)
    assert path.read_text().endswith("# mine\n")


def test_a_node_takes_the_file_as_it_is(processes, peer, tmp_path):
    path = tmp_path / "own.yaml"
    bag_parameters.write(path, resolve({"classes": ["y", "1e5"]}).values, "/t2")
    words = ("--ros-args", "-r", "__node:=t2", "--params-file", path)
    tracker = processes.start("tracker", *words)
    assert peer.spin_until(lambda: "tracking " in tracker.log.read_text())
    assert "tracking 2 classes (y, 1e5) " in tracker.log.read_text()


def test_bags_without_parameters_have_none_and_unwritable_ones_one_fault(tmp_path):
    assert bag_parameters.read(tmp_path) is None
    assert bag_parameters.read(tmp_path / "none.mcap") is None
    with pytest.raises(BagError, match="cannot be written: No such file"):
        bag_parameters.write(tmp_path / "none" / "p.yaml", resolve({}).values)
