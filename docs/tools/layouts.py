"""Writes the layouts of Foxglove and Lichtblick in foxglove/: one a demo, and one of offline bags.

Plots are by the time of receipt: a replay publishes stamps of its own time, years away from that of
the recording, and viewers draw nothing outside a recording's time.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

from msg_adapters import names
from msg_adapters.palette import COLOURS

FOLDER = Path(__file__).resolve().parents[2] / "foxglove"
INK, GREY = "#1c2126", "#858585"
SHORT = 10e3
SCORES, FIGURES = names.OSPA, names.cardinality()
STATUS = '.status[:]{{name=="{}"}}.values[:]{{key=="{}"}}.value'


class View(NamedTuple):
    """What a layout shows.

    Parameters
    ----------
    extent : float
        Of the 3D panel from top to bottom, metres.
    cell : float
        Of its grid, metres.
    decay_s : float
        How long smoothed estimates stay, seconds.
    live : bool
        Whether scores, figures and markers are published, as by nodes, and not only estimates.
    earth : bool
        Whether there is a map of the earth.
    """

    extent: float
    cell: float
    decay_s: float
    live: bool = True
    earth: bool = False


VIEWS = {
    "layout": View(32e3, 1e3, 300.0),
    "earth": View(220e3, 20e3, 120.0, earth=True),
    "marine": View(24e3, 1e3, 120.0),
    "automotive": View(420.0, 20.0, 5.0),
    "offline": View(32e3, 1e3, 300.0, live=False),
    "offline_earth": View(220e3, 20e3, 120.0, live=False, earth=True),
}


def scene(view: View) -> dict[str, Any]:
    """Return the 3D panel, seen from above."""
    colours = {"colorMode": "gradient", "minValue": 0, "maxValue": 1, "pointShape": "circle"}
    classes = {**colours, "visible": True, "colorField": "class_id", "gradient": [*COLOURS[:2]]}
    topics: dict[str, Any] = {
        names.TRUTH: {
            **classes,
            "gradient": [f"{colour}66" for colour in COLOURS[:2]],
            "pointSize": 12,
        },
        names.estimates("filtered"): {**classes, "pointSize": 6},
        names.estimates("smoothed"): {**classes, "pointSize": 4, "decayTime": view.decay_s},
        names.clutter_map(): {
            "visible": True,
            "colorMode": "custom",
            "minColor": "#b0762a00",
            "maxColor": "#b0762aff",
            "unknownColor": "#00000000",
            "invalidColor": "#00000000",
        },
    }
    if view.live:
        topics[names.detections_in_map()] = {
            **colours,
            "visible": True,
            "colorField": "amplitude",
            "gradient": ["#807dba", "#3f007d"],
            "minValue": 3,
            "maxValue": 30,
            "pointSize": 4,
        }
        # Markers are sized for maps of 30 km, and would cover one of some hundred metres.
        topics[f"{names.TRACKER}/markers"] = {"visible": view.extent > SHORT}
    divisions = 2 * round(view.extent / view.cell)
    return {
        **_title("Map"),
        "cameraState": {
            "perspective": False,
            "distance": view.extent,
            "phi": 0,
            "thetaOffset": 0,
            "target": [0, 0, 0],
            "targetOffset": [0, 0, 0],
            "targetOrientation": [0, 0, 0, 1],
            "fovy": 45,
            "near": 0.5,
            # Beyond the camera's height and that of what flies.
            "far": 2.0 * view.extent + 50e3,
        },
        "followMode": "follow-none",
        "followTf": "map",
        "scene": {
            "backgroundColor": "#f7f8fa",
            "transforms": {"showLabel": False, "axisScale": 0.04 * view.extent, "lineWidth": 0},
        },
        "transforms": {},
        "topics": topics,
        "layers": {
            "grid": {
                "visible": True,
                "frameLocked": True,
                "label": "Grid",
                "instanceId": "grid",
                "layerId": "foxglove.Grid",
                "frameId": "map",
                "size": divisions * view.cell,
                "divisions": divisions,
                "lineWidth": 1,
                "color": "#bec6ce66",
                "position": [0, 0, 0],
                "rotation": [0, 0, 0],
                "order": 1,
            }
        },
        "publish": {},
        "imageMode": {},
    }


def plot(title: str, unit: str, series: dict[str, tuple[str, str]]) -> dict[str, Any]:
    """Return a plot; `series` has path and colour by name, and the title says them."""
    legend = ", ".join(series) if len(series) > 1 else ""
    return {
        **_title(f"{title}: {legend}" if legend else title),
        "paths": [
            {
                "value": path,
                "enabled": True,
                "timestampMethod": "receiveTime",
                "label": name,
                "color": colour,
                "showLine": True,
                "lineSize": 1.5,
            }
            for name, (path, colour) in series.items()
        ],
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        # A legend takes half of a small plot.
        "showLegend": False,
        "legendDisplay": "none",
        "showPlotValuesInLegend": False,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "sidebarDimension": 240,
        "minYValue": 0,
        "yAxisLabel": unit,
    }


def _title(title: str) -> dict[str, str]:
    return {"foxglovePanelTitle": title, "lichtblickPanelTitle": title}


def _score(source: str, key: str) -> str:
    return SCORES + STATUS.format(source, key)


def plots(view: View) -> dict[str, Any]:
    """Return the plots of a layout."""
    number = {
        "truth (grey)": (f"{names.TRUTH}.width", GREY),
        "filtered (blue)": (f"{names.estimates('filtered')}.width", COLOURS[0]),
        "smoothed (black)": (f"{names.estimates('smoothed')}.width", INK),
    }
    found = {"Plot!number": plot("Targets", "targets", number)}
    if not view.live:
        return found
    return {
        "Plot!ospa": plot(
            "OSPA",
            "OSPA (m)",
            {
                "filtered (grey)": (_score("filtered/all", "ospa"), GREY),
                "smoothed (black)": (_score("smoothed/all", "ospa"), INK),
            },
        ),
        **found,
        "Plot!step": plot(
            "CPU time of a scan",
            "ms",
            {"step": (FIGURES + STATUS.format("tracker/cardinality", "step_ms"), INK)},
        ),
    }


def layout(view: View) -> dict[str, Any]:
    """Return a layout: maps to the left, plots and the diagnostics to the right."""
    right = plots(view)
    if view.live:
        right["DiagnosticSummary!all"] = {
            "minLevel": 0,
            "pinnedIds": [],
            "topicToRender": names.DIAGNOSTICS,
            "hardwareIdFilter": "",
            "sortByLevel": True,
            "secondsUntilStale": 5,
        }
    left: dict[str, Any] = {"3D!map": scene(view)}
    if view.earth:
        left = {
            "map!earth": {
                **_title("Earth"),
                "disabledTopics": [],
                "followTopic": "",
                "layer": "map",
                "customTileUrl": "",
                "topicColors": {},
                "zoomLevel": 7,
            },
            **left,
        }
    return {
        "configById": {**left, **right},
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "splitPercentage": 65,
            "first": _stacked([*left]),
            "second": _stacked([*right]),
        },
    }


def _stacked(panels: list[str]) -> Any:
    """Return panels of equal height, one above the other."""
    if len(panels) == 1:
        return panels[0]
    return {
        "direction": "column",
        "splitPercentage": round(100 / len(panels)),
        "first": panels[0],
        "second": _stacked(panels[1:]),
    }


def texts() -> dict[str, str]:
    """Return the text of each layout's file, by its name."""
    return {
        f"{name}.json": json.dumps(layout(view), indent=2) + "\n" for name, view in VIEWS.items()
    }


def main() -> int:
    """Write all layouts."""
    for name, text in texts().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
