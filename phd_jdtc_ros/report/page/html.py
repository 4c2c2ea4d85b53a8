# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""A run's report as one self-contained HTML page.

The charts, their library, the numbers and the style sheet are part of the page, so the file can be
mailed, stored with the data and opened from disk years later. It supports light and dark mode.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from plotly.offline import get_plotlyjs

from phd_jdtc_ros import output_files

from ..clock import Clock
from ..record import Record
from . import score_words
from .amplitude_scale import AMPLITUDE_SCALES
from .chart import Chart
from .scan_list import first_shown, scans_of
from .time_axes import times

CONTROLS = """<div class="controls">
<button id="back" aria-label="one scan back">&lsaquo;</button>
<button id="play">Play</button>
<button id="forth" aria-label="one scan on">&rsaquo;</button>
<input id="scan" type="range" min="0" value="0" aria-label="scan">
<output id="shown" for="scan"></output>
</div>
"""

# The page may not load anything, even if a library tries to.
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
)


def write_report(
    path: Path,
    title: str,
    summary: Mapping[str, Any],
    record: Record,
    charts: Sequence[Chart] = (),
    notes: Sequence[str] = (),
) -> Path:
    """Write the report of a run.

    Parameters
    ----------
    path : pathlib.Path
        Of the page; its directory is created if it does not exist.
    title : str
    summary : mapping
        As `Evaluation.summary` returns it, with an optional ``step_ms`` of ``median`` and
        ``p99``. A value that is missing or None is shown as a dash.
    record : Record
        Its stamps are the positions of the slider.
    charts : sequence of Chart
        In order.
    notes : sequence of str
        Sentences shown first.

    Returns
    -------
    pathlib.Path
        `path`.
    """
    page = Template(_part("page.html")).substitute(
        policy=POLICY,
        title=escape(title),
        style=_part("page.css"),
        lead=score_words.lead(summary),
        notes="\n".join(f'<p class="note">{escape(note)}</p>' for note in notes),
        tiles=score_words.tiles(summary),
        tables=score_words.tables(summary),
        charts="\n".join(_chart(chart) for chart in charts),
        terms=score_words.definitions(summary),
        run=_run_json(record, charts),
        plotly=get_plotlyjs(),
        script=_part("page.js"),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    output_files.write(path, page)
    return path


def _part(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def _run_json(record: Record, charts: Sequence[Chart]) -> str:
    """Return the script's data, without ``<``.

    A name with ``</script>`` would end the element, and one with ``<!--<script>`` would make it
    swallow the rest of the page.
    """
    clock = Clock.of(record)
    scans = scans_of(record)
    document = {
        "times": times(clock, [scan.stamp_ns for scan in scans]),
        "unit": clock.unit,
        "first": first_shown(scans),
        "amplitude_scales": AMPLITUDE_SCALES,
        "charts": [
            {"name": c.name, "figure": c.figure.to_plotly_json(), "moving": list(c.moving)}
            for c in charts
        ],
    }
    return json.dumps(document, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _chart(chart: Chart) -> str:
    controls = CONTROLS if chart.name == "map" else ""
    return (
        f"<figure>\n<figcaption><h2>{escape(chart.title)}</h2>\n<p>{escape(chart.caption)}</p>"
        f'</figcaption>\n{controls}<div id="{chart.name}"></div>\n</figure>'
    )
