"""The layouts of Foxglove and Lichtblick; what they draw of recordings is in test_asterix_demo."""

from pathlib import Path

import layouts
import numpy as np
import pytest
from layout_panels import LAYOUTS, panels

from msg_adapters.encoding import interfaces, names
from msg_adapters.targets import truth
from phd_jdtc_ros import resources
from phd_jdtc_ros.bags.reader import BagReader

ROOT = Path(__file__).parents[2]
# The shipped bag of the demo that a layout is for.
BAGS = {
    "layout": "paper_scenario",
    "marine": "coastal",
    "automotive": "automotive",
    "earth": "two_approach_radars",
    "offline": "paper_scenario",
    "offline_earth": "two_approach_radars",
}


def test_layouts_are_those_of_the_tool_that_writes_them():
    written = {path.name: path.read_text() for path in (ROOT / "foxglove").glob("*.json")}
    assert written == {"layout.json": layouts.MASTER.read_text(), **layouts.texts()}
    assert LAYOUTS.keys() == BAGS.keys()


@pytest.mark.parametrize("name", BAGS)
def test_layout_places_every_panel_once_and_sees_all_targets(name):
    def leaves(node):
        return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])

    assert sorted(leaves(LAYOUTS[name]["layout"])) == sorted(LAYOUTS[name]["configById"])
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
