"""The layouts of Foxglove and Lichtblick against the recordings that they are for."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from message_paths import values

from msg_adapters import interfaces, names, stamps, truth
from phd_jdtc_ros import resources
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.parameter_files import yaml_files

ROOT = Path(__file__).parents[2]
LAYOUTS = {path.stem: json.loads(path.read_text()) for path in (ROOT / "foxglove").glob("*.json")}
SCENARIO = ROOT / "config" / "scenarios" / "two_approach_radars.yaml"
# What is shown where there is any of it.
OPTIONAL = {names.clutter_map()}
# The recordings, and the shipped bag of the demo, that a layout is for.
OF_DEMO = {
    "layout": ("demo", "paper_scenario"),
    "marine": ("demo", "coastal"),
    "automotive": ("demo", "automotive"),
    "earth": ("earth_demo", "two_approach_radars"),
    "offline": ("tracked", "paper_scenario"),
    "offline_earth": ("earth_tracked", "two_approach_radars"),
}


@pytest.fixture(scope="module")
def recordings(tmp_path_factory, short_bag, tracked):
    """Return recordings of nodes and of `track_bag`, in a plane and on the earth."""
    directory = tmp_path_factory.mktemp("recordings")
    document = yaml_files.load(SCENARIO)
    document.update(scans=31, targets=document["targets"][:4])
    scenario, simulated = directory / "scenario.yaml", directory / "simulated"
    scenario.write_text(json.dumps(document))
    assert run("simulate", ["--scenario", str(scenario), "--out", str(simulated)]) == 0
    assert run("track_bag", [str(simulated), "--out", str(directory / "earth_tracked")]) == 0
    # The demo plays what the radars would send.
    recording = ["--plots", "--out", str(simulated / "recording.ast")]
    assert run("asterix_bridge", [str(simulated), *recording]) == 0
    few = ["-p", "particles_per_target:=100", "-p", "particles_per_birth:=256"]
    for name, bag, more in (("demo", short_bag, few), ("earth_demo", simulated, [])):
        assert run("demo", ["--bag", str(bag), "--out", str(directory / name), *more]) == 0
    return {
        "demo": directory / "demo" / "estimates",
        "earth_demo": directory / "earth_demo" / "estimates",
        "tracked": tracked,
        "earth_tracked": directory / "earth_tracked",
    }


def panels(name, kind):
    """Return the panels of a kind of a layout."""
    configured = LAYOUTS[name]["configById"]
    return [panel for key, panel in configured.items() if key.startswith(f"{kind}!")]


def drawn(bag, series):
    """Return the points of a series that a viewer draws: those within the recording's time."""
    topic, _, path = series["value"].partition(".")
    entries = list(bag.messages([topic]))
    times = [entry.log_time_ns for entry in bag.messages([*bag.types])]
    points = []
    for entry in entries:
        message = interfaces.decode(entry.data, bag.types[topic])
        if series["timestampMethod"] == "headerStamp":
            time_ns = stamps.to_ns(message.header.stamp)
        else:
            time_ns = entry.log_time_ns
        if min(times) <= time_ns <= max(times):
            points += [float(value) for value in values(message, f".{path}")]
    return points


def test_layouts_are_those_of_the_tool_that_writes_them():
    specification = importlib.util.spec_from_file_location(
        "layouts", ROOT / "docs" / "tools" / "layouts.py"
    )
    layouts = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(layouts)

    written = {path.name: path.read_text() for path in (ROOT / "foxglove").glob("*.json")}
    assert written == layouts.texts()
    assert LAYOUTS.keys() == OF_DEMO.keys()


@pytest.mark.parametrize("name", OF_DEMO)
def test_layout_places_every_panel_once(name):
    def leaves(node):
        return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])

    assert sorted(leaves(LAYOUTS[name]["layout"])) == sorted(LAYOUTS[name]["configById"])


@pytest.mark.parametrize("name", OF_DEMO)
def test_layout_draws_every_plot_of_its_recording(recordings, name):
    bag = BagReader(recordings[OF_DEMO[name][0]])

    plotted = [series for panel in panels(name, "Plot") for series in panel["paths"]]
    assert plotted
    for series in plotted:
        assert drawn(bag, series), series["value"]


@pytest.mark.parametrize("name", OF_DEMO)
def test_layout_shows_topics_that_its_recording_has(recordings, name):
    bag = BagReader(recordings[OF_DEMO[name][0]])

    (scene,) = panels(name, "3D")
    kinds = {names.CLOUD, names.MARKERS}
    for topic in scene["topics"].keys() - OPTIONAL:
        assert bag.types[topic] in kinds
        assert bag.counts[topic], topic
    for panel in panels(name, "DiagnosticSummary"):
        assert bag.counts[panel["topicToRender"]]


@pytest.mark.parametrize("name", [name for name in OF_DEMO if panels(name, "map")])
def test_map_of_the_earth_has_places_in_its_recording(recordings, name):
    bag = BagReader(recordings[OF_DEMO[name][0]])

    (earth,) = panels(name, "map")
    fixes = {topic for topic, kind in bag.types.items() if kind == names.FIX}
    places = [
        interfaces.decode(entry.data, names.FIX)
        for entry in bag.messages([*fixes - {*earth["disabledTopics"]}])
    ]
    assert places
    assert all(abs(fix.latitude - 50.0) < 2.0 for fix in places)
    # Viewers leave out what has no fix.
    assert all(fix.status.status >= 0 for fix in places)


@pytest.mark.parametrize("name", OF_DEMO)
def test_layout_sees_all_targets_of_its_demo_and_not_much_more(name):
    bag = BagReader(resources.bag(OF_DEMO[name][1]))
    farthest = max(
        float(np.abs(found.position).max(initial=0.0))
        for entry in bag.messages([names.TRUTH])
        for found in [truth.from_msg(interfaces.decode(entry.data, bag.types[entry.topic]))]
    )

    (scene,) = panels(name, "3D")
    half = 0.5 * scene["cameraState"]["distance"]
    assert 0.3 * half < farthest < 1.2 * half
    assert scene["layers"]["grid"]["size"] >= 2.0 * half
