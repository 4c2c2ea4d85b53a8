"""The layouts of Foxglove and Lichtblick against the recordings that they are for."""

import json
from pathlib import Path

import layouts
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
# Topics that are shown where there are messages.
OPTIONAL = {names.clutter_map()}
# The shipped bag of the demo that a layout is for.
BAGS = {
    "layout": "paper_scenario",
    "marine": "coastal",
    "automotive": "automotive",
    "earth": "two_approach_radars",
    "offline": "paper_scenario",
    "offline_earth": "two_approach_radars",
}


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Return recordings on the earth: of nodes, and of `track_bag`."""
    directory = tmp_path_factory.mktemp("recordings")
    document = yaml_files.load(SCENARIO)
    document.update(scans=31, targets=document["targets"][:4])
    scenario, simulated = directory / "scenario.yaml", directory / "simulated"
    scenario.write_text(json.dumps(document))
    assert run("simulate", ["--scenario", str(scenario), "--out", str(simulated)]) == 0
    assert run("track_bag", [str(simulated), "--out", str(directory / "tracked")]) == 0
    # The demo plays what the radars would send.
    recording = ["--plots", "--out", str(simulated / "recording.ast")]
    assert run("asterix_bridge", [str(simulated), *recording]) == 0
    assert run("demo", ["--bag", str(simulated), "--out", str(directory / "demo")]) == 0
    return {True: directory / "demo" / "estimates", False: directory / "tracked"}


@pytest.fixture(params=["layout", "earth", "offline", "offline_earth"])
def shown(request, recordings):
    """Return the name of a layout, and a recording with all that it may show."""
    live = request.param not in layouts.VIEWS or layouts.VIEWS[request.param].live
    return request.param, BagReader(recordings[live])


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
    written = {path.name: path.read_text() for path in (ROOT / "foxglove").glob("*.json")}
    assert written == {"layout.json": layouts.MASTER.read_text(), **layouts.texts()}
    assert LAYOUTS.keys() == BAGS.keys()


@pytest.mark.parametrize("name", BAGS)
def test_layout_places_every_panel_once(name):
    def leaves(node):
        return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])

    assert sorted(leaves(LAYOUTS[name]["layout"])) == sorted(LAYOUTS[name]["configById"])


def test_layout_draws_every_plot_of_its_recording(shown):
    name, bag = shown
    plotted = [series for panel in panels(name, "Plot") for series in panel["paths"]]
    assert plotted
    for series in plotted:
        assert drawn(bag, series), series["value"]


def test_layout_shows_topics_that_its_recording_has(shown):
    name, bag = shown
    (scene,) = panels(name, "3D")
    for topic in scene["topics"].keys() - OPTIONAL:
        assert bag.types[topic] in {names.CLOUD, names.MARKERS}
        assert bag.counts[topic], topic
    for panel in panels(name, "DiagnosticSummary"):
        assert bag.counts[panel["topicToRender"]]
    for earth in panels(name, "map"):
        fixes = {topic for topic, kind in bag.types.items() if kind == names.FIX}
        places = [
            interfaces.decode(entry.data, names.FIX)
            for entry in bag.messages([*fixes - {*earth["disabledTopics"]}])
        ]
        assert places
        assert all(abs(fix.latitude - 50.0) < 2.0 for fix in places)
        # Viewers leave out what has no fix.
        assert all(fix.status.status >= 0 for fix in places)


@pytest.mark.parametrize("name", BAGS)
def test_layout_sees_all_targets_of_its_demo_and_not_much_more(name):
    bag = BagReader(resources.bag(BAGS[name]))
    farthest = max(
        float(np.abs(found.position).max(initial=0.0))
        for entry in bag.messages([names.TRUTH])
        for found in [truth.from_msg(interfaces.decode(entry.data, bag.types[entry.topic]))]
    )

    (scene,) = panels(name, "3D")
    half = 0.5 * scene["cameraState"]["distance"]
    assert 0.3 * half < farthest < 1.2 * half
    assert scene["layers"]["grid"]["size"] >= 2.0 * half
