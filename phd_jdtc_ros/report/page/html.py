"""A run's report as one self-contained HTML page.

The charts, their library, the numbers and the style sheet are part of the page, so that the file
can be mailed, archived and opened from disk. It supports light and dark mode.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from plotly.offline import get_plotlyjs

from phd_jdtc_ros import output_files
from phd_jdtc_ros.core.types import SOURCES
from phd_jdtc_ros.evaluation.run_scores import Evaluation
from phd_jdtc_ros.report.style import Clock

from ..record import Record
from . import charts, words
from .charts import Chart, class_probabilities, numbers, ospa, times
from .layers import AMPLITUDE_SCALES, pack
from .picture import Picture, picture_of

# Scripts of the page in the order of their dependencies; the first line makes all strict.
SCRIPTS = ("drawing.js", "picture.js", "page.js")
NO_TRUTH = "<h2>Scores</h2>\n<p>There is no truth in this bag, so nothing can be scored.</p>"
# Content security policy: the page loads nothing, even if a library tries to.
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
)


def charts_of(record: Record, evaluation: Evaluation) -> list[Chart]:
    """Return every chart over time that the run has data for."""
    found = []
    estimated = any(len(run) for source in SOURCES for run in record.of_source(source))
    if any(evaluation.scores[source] for source in SOURCES):
        found.append(ospa(record, evaluation))
    if record.filtered or record.smoothed or record.truth:
        found.append(numbers(record))
    # A single class has probability 1 throughout.
    if estimated and not record.sets.one_class:
        found.append(class_probabilities(record, evaluation))
    if tracks := charts.height_lines(record):
        found.append(charts.heights_over_time(record, tracks))
        if any(math.isfinite(site.height) and site.elevations for site in record.radars):
            found.append(charts.heights_from_the_side(record, tracks))
    return found


def notes_of(record: Record, evaluation: Evaluation) -> list[str]:
    """Return a sentence for each kind of data missing from the bag, with the consequence."""
    absent = [source for source in SOURCES if not record.of_source(source)]
    notes = [] if record.damage is None else [f"Only the intact part is shown. {record.damage}."]
    if len(absent) == len(SOURCES):
        notes.append(
            "There are no estimates in this bag, so only detections are shown. Run track_bag on "
            "it, or record the tracker's topics."
        )
    elif absent:
        notes.append(f"There are no {absent[0]} estimates in this bag.")
    scored = any(evaluation.scores[source] for source in SOURCES)
    if record.truth and len(absent) < len(SOURCES) and not scored:
        notes.append("No estimate has the stamp of a true state, so nothing can be scored.")
    if not record.plots:
        notes.append("There are no detections of the configured radars in this bag.")
    return notes


def write_report(
    path: Path,
    title: str,
    summary: Mapping[str, Any],
    record: Record,
    charts: Sequence[Chart] = (),
    notes: Sequence[str] = (),
) -> Path:
    """Write the report of a run, and return the path of the page.

    `summary` is an `Evaluation.summary`, with an optional ``step_ms`` of ``median`` and ``p99``; a
    value that is missing or None is shown as a dash. `charts` are in the order of the page, and
    `notes` are sentences at its top.
    """
    picture = picture_of(record)
    page = Template(_part("page.html")).substitute(
        policy=POLICY,
        title=escape(title),
        style=_part("page.css"),
        lead=words.score_lead(summary) or words.picture_lead(record),
        notes="\n".join(f'<p class="note">{escape(note)}</p>' for note in notes),
        tiles=words.tiles(summary),
        tables=words.tables(summary) if record.truth else NO_TRUTH,
        sensors=words.sensors(record.learned, record.changes),
        picture="" if picture is None else words.section(picture.header),
        charts="\n".join(_chart(chart) for chart in charts),
        terms=words.definitions(summary),
        run=_run_json(record, charts, picture),
        packed=_compressed_parts(charts, picture),
        script="".join(map(_part, SCRIPTS)),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    output_files.write(path, page)
    return path


def _part(name: str) -> str:
    return (files(__package__) / "assets" / name).read_text(encoding="utf-8")


def _run_json(record: Record, charts: Sequence[Chart], picture: Picture | None) -> str:
    """Return the script's data, without ``<``, which in a name could end or extend its element."""
    clock = Clock.of(record)
    document = {
        "times": [] if picture is None else times(clock, picture.frames.stamp_ns.tolist()),
        "unit": clock.unit,
        "utc_s": clock.origin_ns * 1e-9 if clock.begin else None,
        "amplitude_scales": AMPLITUDE_SCALES,
        "picture": None if picture is None else picture.header,
        "charts": [{"name": c.name, "figure": c.figure.to_plotly_json()} for c in charts],
    }
    return json.dumps(document, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _compressed_parts(charts: Sequence[Chart], picture: Picture | None) -> str:
    """Return the compressed parts of the page as elements: columns and the charts' library."""
    parts = {} if picture is None else {"columns": picture.columns.text()}
    if charts:
        parts["plotly"] = _library()
    return "\n".join(
        f'<script type="application/octet-stream" id="{name}">{text}</script>'
        for name, text in parts.items()
    )


@cache
def _library() -> str:
    """Return the charts' library, compressed, which takes most of the time of a page."""
    return pack(get_plotlyjs().encode("utf-8"))


def _chart(chart: Chart) -> str:
    return (
        f"<figure>\n<figcaption><h2>{escape(chart.title)}</h2>\n<p>{escape(chart.caption)}</p>"
        f'</figcaption>\n<div id="{chart.name}"></div>\n</figure>'
    )
