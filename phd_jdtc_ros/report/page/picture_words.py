"""The elements around the page's picture: the controls and the list of tracks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

from phd_jdtc_ros.core.types import SOURCES

from ..record import Record
from ..units import Clock

CONTROLS = """<div class="controls">
<button id="back" aria-label="one scan back">&lsaquo;</button>
<button id="play">Play</button>
<button id="forth" aria-label="one scan on">&rsaquo;</button>
<input id="scan" type="range" min="0" value="0" aria-label="scan">
<output id="shown" for="scan"></output>
</div>"""
# Selectable lengths of trails and detections: value in seconds and label.
TRAILS = {"0": "none", "30": "30 s", "120": "2 min", "300": "5 min", "600": "10 min", "all": "all"}
DETECTIONS = {"none": "none", "0": "this scan", "10": "10 s", "30": "30 s", "120": "2 min"}
# Text symbols of the classes, as drawn in the picture.
SYMBOLS = ("\u25cf", "\u25b2", "\u25a0", "\u25c6")
KEYS = (
    "Drag to move, scroll or pinch to zoom, double-click to see all again; with the keyboard, "
    "arrows, +, - and 0 while the picture has the focus. Click a symbol or a row of the list to "
    "select a track; click it again or press Escape to deselect it."
)


def section(head: Mapping[str, Any]) -> str:
    """Return the page's section for a picture with this header."""
    level = ["level"] if head["levels"] or head["ground"] else []
    heads = "".join(
        f'<th scope="col"><button type="button">{name}</button></th>'
        for name in ("track", *level, "speed", "course")
    )
    return f"""<figure id="picture">
<figcaption><h2>Traffic</h2>
<p>{escape(_caption(head))}</p></figcaption>
{CONTROLS}
<div class="scope">
<div class="view">
<canvas id="map" tabindex="0" role="img" aria-label="picture of the traffic"
 aria-describedby="keys"></canvas>
<p id="pointer" class="pointer"></p>
</div>
<aside>
{_options(head)}
<p id="details" class="details" aria-live="polite"></p>
<p class="find"><input id="search" type="search" placeholder="find a track"
 aria-label="find a track by call sign, code, address or number"> <output id="count"></output></p>
<div class="list" tabindex="0" role="region" aria-label="tracks">
<table><thead><tr>{heads}</tr></thead><tbody id="tracks"></tbody></table>
</div>
</aside>
</div>
<p id="keys" class="pointer">{KEYS}</p>
</figure>"""


def lead(record: Record) -> str:
    """Return how many tracks there are, and when, in one sentence; empty without estimates."""
    found = max((record.of_source(source) for source in SOURCES), key=len)
    if not found:
        return ""
    clock, most = Clock.of(record), max(map(len, found))
    numbers = {label for each in found for label in each.track_id.tolist() if label}
    tracks = f"{len(numbers)} tracks" if numbers else "Targets"
    begin = f" from {clock.begin}" if clock.begin else ""
    return (
        f'<p class="lead">{tracks} in {clock.text(clock.span_s)}{begin}, at most {most} at a time.'
        "</p>"
    )


def _caption(head: Mapping[str, Any]) -> str:
    """Return one sentence that describes the picture."""
    parts = []
    if head["sources"]:
        parts.append(
            "open symbols are filtered estimates, filled symbols are smoothed estimates, and dots "
            "joined by a line are past positions"
        )
    if head["known"]["truth"]:
        parts.append("plus signs and thin lines are the truth")
    if head["known"]["plots"]:
        amplitudes = head["amplitudes"]
        scale = (
            ", with more contrast the higher their amplitude, of {:g} to {:g} noise standard "
            "deviations".format(*amplitudes)
            if amplitudes
            else ""
        )
        parts.append(f"small marks are detections{scale}")
    if head["known"]["alarms"]:
        parts.append(
            "red lines join what will probably come too near each other, with the probability, and "
            "thinner ones once that is acknowledged"
        )
    if "clutter" in head:
        parts.append("brown squares are the clutter map learned by the end of the run")
    if head["place_unknown"]:
        parts.append("the radar's position is unknown, and so are latitudes and longitudes")
    text = "; ".join(parts)
    return f"{text[:1].upper()}{text[1:]}."


def _options(head: Mapping[str, Any]) -> str:
    """Return the controls that select layers, levels and classes."""
    layers = {source: source for source in head["sources"]}
    if head["sources"]:
        layers |= {"labels": "labels", "ellipses": "95 % ellipses"}
    if head["known"]["truth"]:
        layers["truth"] = "truth"
    if head["ground"]:
        layers["ground"] = "ground traffic"
    layers["lines"] = "latitudes and ranges" if "earth" in head else "grid and ranges"
    if "clutter" in head:
        layers["clutter"] = "learned clutter"
    if head["known"]["alarms"]:
        layers["alarms"] = "zones and alarms"
    parts = [
        _select("trails", "Trails", TRAILS, "120") if head["sources"] else "",
        _select("detections", "Detections", DETECTIONS, "0") if head["known"]["plots"] else "",
        *(_check(name, escape(title)) for name, title in layers.items()),
        _levels(head["levels"]) if head["levels"] else "",
        _classes(head["classes"]) if len(head["classes"]) > 1 else "",
    ]
    return (
        f'<div id="options" class="options">\n{"".join(f"{part}" for part in parts if part)}</div>'
    )


def _select(name: str, title: str, values: Mapping[str, str], chosen: str) -> str:
    options = "".join(
        f'<option value="{value}"{" selected" if value == chosen else ""}>{text}</option>'
        for value, text in values.items()
    )
    return f'<label>{title} <select id="{name}">{options}</select></label>\n'


def _check(name: str, title: str) -> str:
    return f'<label><input type="checkbox" id="{name}" checked> {title}</label>\n'


def _levels(unit: str) -> str:
    name, step = ("Flight level", 10) if unit == "FL" else ("Height (m)", 1)
    ends = "".join(
        f'{word} <input type="number" id="{key}" step="{step}" aria-label="{name} {word}"> '
        for key, word in (("low", "from"), ("high", "to"))
    )
    return f"<span>{name} {ends}</span>\n"


def _classes(classes: Iterable[Mapping[str, str]]) -> str:
    return "".join(
        _check(
            f"class{k}",
            f'<span style="color: {kind["colour"]}">{SYMBOLS[k % len(SYMBOLS)]}</span> '
            f"{escape(kind['title'])}",
        )
        for k, kind in enumerate(classes)
    )
