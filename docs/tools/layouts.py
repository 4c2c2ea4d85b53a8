"""Derives the layouts of Foxglove and Lichtblick in foxglove/ from layout.json among them.

That one is for the reference demo, and may be edited in a viewer and exported. The others are for
the other demos and for bags tracked offline. Plots are by the time of receipt: a replay publishes
stamps of its own time, years away from that of the recording, and viewers draw nothing outside a
recording's time.
"""

from __future__ import annotations

import copy
import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

from msg_adapters.encoding import names

FOLDER = Path(__file__).resolve().parents[2] / "foxglove"
MASTER = FOLDER / "layout.json"
# Markers are sized for maps of 30 km, and would cover one of some hundred metres.
SHORT = 10e3
MAP, EARTH = "3D!map", "map!earth"
# Scores, figures and markers are published by nodes, and are in no bag that is tracked offline.
LIVE_TOPICS = (names.detections_in_map(), f"{names.TRACKER}/markers")
LIVE_PANELS = ("Plot!ospa", "Plot!step", "DiagnosticSummary!all")


class View(NamedTuple):
    """What a layout shows."""

    extent: float  # Height of the 3D panel, metres
    cell: float  # Width of a cell of its grid, metres
    decay_s: float  # How long smoothed estimates stay, seconds
    live: bool = True  # True if it is for a recording of nodes
    earth: bool = False  # True if there is a map of the earth


VIEWS = {
    "earth": View(220e3, 20e3, 120.0, earth=True),
    "marine": View(24e3, 1e3, 120.0),
    "automotive": View(420.0, 20.0, 5.0),
    "offline": View(32e3, 1e3, 300.0, live=False),
    "offline_earth": View(220e3, 20e3, 120.0, live=False, earth=True),
}


def layout(master: dict[str, Any], view: View) -> dict[str, Any]:
    """Return a layout: maps to the left, curves and the diagnostics to the right."""
    found = copy.deepcopy(master)
    panels = found["configById"]
    scene, topics = panels[MAP], panels[MAP]["topics"]
    scene["cameraState"]["distance"] = view.extent
    # Beyond the camera's height and that of what flies.
    scene["cameraState"]["far"] = 2.0 * view.extent + 50e3
    scene["scene"]["transforms"]["axisScale"] = 0.04 * view.extent
    divisions = 2 * round(view.extent / view.cell)
    scene["layers"]["grid"].update(size=divisions * view.cell, divisions=divisions)
    topics[names.estimates("smoothed")]["decayTime"] = view.decay_s
    topics[f"{names.TRACKER}/markers"]["visible"] = view.extent > SHORT
    if not view.live:
        for part, left_out in ((topics, LIVE_TOPICS), (panels, LIVE_PANELS)):
            for name in left_out:
                del part[name]
        found["layout"]["second"] = "Plot!number"
    if view.earth:
        earth = {
            "foxglovePanelTitle": "Earth",
            "lichtblickPanelTitle": "Earth",
            "disabledTopics": [],
            "followTopic": "",
            "layer": "map",
            "customTileUrl": "",
            "topicColors": {},
            "zoomLevel": 7,
        }
        found["configById"] = {EARTH: earth, **panels}
        found["layout"]["first"] = {
            "direction": "column",
            "splitPercentage": 50,
            "first": EARTH,
            "second": MAP,
        }
    return found


def texts() -> dict[str, str]:
    """Return the text of each derived layout's file, by its name."""
    master = json.loads(MASTER.read_text(encoding="utf-8"))
    return {
        f"{name}.json": json.dumps(layout(master, view), indent=2) + "\n"
        for name, view in VIEWS.items()
    }


def main() -> int:
    """Write the derived layouts."""
    for name, text in texts().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
