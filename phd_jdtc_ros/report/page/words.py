"""The text of the page: controls and list of tracks around the picture, and the scores."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from phd_jdtc_ros.core.types import SMOOTHED, SOURCES
from phd_jdtc_ros.evaluation.accumulator import CLASSES, GOSPA, NEES, OSPA, OUTSIDE, Metric
from phd_jdtc_ros.evaluation.run_scores import BY_KEY, GLOBAL_METRICS, GROUPS, SET_METRICS, TERMS
from phd_jdtc_ros.report.style import Clock, metres_text

from ..record import LearnedValue, Record, Sets
from ..table import confusion_rows, engine_rows, nees_bands, unscored_note

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


def picture_lead(record: Record) -> str:
    """Return how many tracks there are, and when, in one sentence; empty without estimates."""
    found = max((record.of_source(source) for source in SOURCES), key=len)
    if not found:
        return ""
    clock, most = Clock.of(record), max(map(len, found))
    numbers = {label for each in found for label in each.track_id.tolist() if label}
    tracks = f"{len(numbers)} track{'s' * (len(numbers) > 1)}" if numbers else "Targets"
    begin = f" from {clock.begin}" if clock.begin else ""
    when = f"in {clock.text(clock.span_s)}{begin}"
    text = f"{tracks} {when}, at most {most} at a time" if most else f"No targets {when}"
    return f'<p class="lead">{text}.</p>'


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
    if any(head["told"]):
        parts.append(
            "rings tell what receivers hear: a thin green one is about a target that reports, a "
            "thick one about a dark target, a broken thick one about a doubtful source, and a "
            "broken thin one about a track that its source has left"
        )
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


NO_VALUE = "\N{EN DASH}"  # Cell of a missing value

# The table shows the localisation part of OSPA only, not of GOSPA.
DISTANCES = (*GROUPS[OSPA], *(m for m in GROUPS[GOSPA] if m.key != "gospa_localization"))
CONSISTENCY = (*GROUPS[NEES], *GROUPS[OUTSIDE])
_ELSEWHERE = (*DISTANCES, *GROUPS[GOSPA], *CONSISTENCY, *GROUPS[CLASSES])
OTHERS = tuple(metric for metric in (*SET_METRICS, *GLOBAL_METRICS) if metric not in _ELSEWHERE)


def tables(summary: Mapping[str, Any]) -> str:
    """Return the tables of all sets' figures; empty if there are none."""
    if not _sources(summary):
        return ""
    gap = summary.get("long_gap_s")
    over = "" if gap is None else f"Gaps of more than {gap:g} s are long."
    sets, matrix = Sets.of_summary(summary), _score(summary, SMOOTHED, "all", "confusion")
    confusion = "" if sets.one_class else " and confusion of classes"
    return "\n".join(
        (
            "<h2>Scores</h2>",
            _table(summary, DISTANCES, f"Means over all scans. {unscored_note(summary)}".rstrip()),
            f"<details>\n<summary>Surveillance figures{confusion}</summary>",
            _table(summary, OTHERS, over),
            _consistency(summary),
            "" if sets.one_class else _confusion(matrix, sets),
            "</details>",
            _engines(summary),
        )
    )


def _engines(summary: Mapping[str, Any]) -> str:
    """Return the table of the paper's filter and this tracker; empty if only one was run."""
    compared = summary.get("compared")
    if not compared:
        return ""
    headings = ("engine", "filtered OSPA", "smoothed OSPA", "reduction", "class accuracy", "CPU")
    rows = [
        [name, *(cell.replace("%", " %") for cell in cells)]
        for name, *cells in engine_rows(dict(summary), compared)
    ]
    return (
        f"<h2>The paper's filter</h2>\n{narrow(headings, rows)}<p>All targets; CPU time per scan, "
        f"the median. The rest of this page is of the engine {escape(summary['engine'])}, which "
        "ran live. The paper's filter, as printed and corrected, has tracked the same detections "
        "offline.</p>"
    )


def narrow(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table that is no wider than its texts, with a title in each row."""
    lines = (
        f'<tr><th scope="row">{escape(title)}</th>'
        + "".join(f"<td>{escape(cell)}</td>" for cell in cells)
        + "</tr>"
        for title, *cells in rows
    )
    return _wide(headings, _body(lines), ' class="narrow"')


def _body(lines: Iterable[str]) -> str:
    return "<tbody>\n" + "\n".join(lines) + "\n</tbody>"


def _wide(headings: Sequence[str], bodies: str, style: str = "") -> str:
    """Return a table that scrolls if the page is too narrow."""
    heads = "".join(f'<th scope="col">{escape(heading)}</th>' for heading in headings)
    return (
        f'<div class="wide">\n<table{style}>\n<thead><tr>{heads}</tr></thead>\n{bodies}\n'
        "</table>\n</div>\n"
    )


def _table(summary: Mapping[str, Any], columns: Sequence[Metric], note: str) -> str:
    """Return one table, without the columns in which no set has a value."""
    sets = Sets.of_summary(summary)
    keys = sets.keys
    known = [
        metric
        for metric in columns
        if any(_score(summary, s, key, metric.key) is not None for s in SOURCES for key in keys)
    ]
    rows = "\n".join(_rows(summary, known, key, sets.title(key)) for key in keys)
    headings = ["set", "source", *(metric.heading for metric in known)]
    return f"{_wide(headings, rows)}<p>{escape(note)}</p>"


def _consistency(summary: Mapping[str, Any]) -> str:
    """Return the table of the covariances' consistency; empty if there are no covariances."""
    bands = [f"{source}, {pairs} pairs: {band}" for source, pairs, band in nees_bands(summary)]
    if not bands:
        return ""
    note = (
        "Consistency of the covariances of positions, over all pairs and by age of the track in "
        "scans. If the covariances are correct, the mean NEES lies with 95 % probability within: "
        f"{'; '.join(bands)}."
    )
    return _table(summary, CONSISTENCY, note)


def _confusion(matrix: Sequence[Sequence[int]] | None, sets: Sets) -> str:
    """Return the table of the confusion matrix; empty without one."""
    if matrix is None:
        return ""
    table = narrow(*confusion_rows(matrix, sets, "false"))
    return f"{table}<p>Targets of all scans by true class (rows) and smoothed class.</p>"


def number(value: float | None, decimals: int = 0, unit: str = "") -> str:
    """Return `value` as text, a dash if it is None."""
    return NO_VALUE if value is None else f"{value:.{decimals}f}{unit}"


def percent(fraction: float | None, decimals: int = 0) -> str:
    """Return `fraction` as text in per cent, a dash if it is None."""
    return number(None if fraction is None else 100.0 * fraction, decimals, " %")


def _score(summary: Mapping[str, Any], source: str, key: str, part: str) -> Any:
    """Return one entry of the summary; None if any of its keys is missing."""
    return ((summary.get(source) or {}).get(key) or {}).get(part)


def _sources(summary: Mapping[str, Any]) -> list[str]:
    return [source for source in SOURCES if _score(summary, source, "all", "ospa") is not None]


def score_lead(summary: Mapping[str, Any]) -> str:
    """Return the result in one sentence; empty if there is none."""
    means = [f"{metres_text(_score(summary, s, 'all', 'ospa'))} {s}" for s in _sources(summary)]
    if not means:
        return ""
    reduction = summary.get("reduction")
    change = "" if reduction is None else f", {_change(reduction)}"
    return (
        f'<p class="lead">Mean OSPA distance of all targets: {", ".join(means)}{change}. '
        f"{unscored_note(summary)}".rstrip()
        + "</p>"
    )


def _change(reduction: float) -> str:
    word = "less" if reduction >= 0.0 else "more"
    return f"{percent(abs(reduction))} {word}"


def tiles(summary: Mapping[str, Any]) -> str:
    """Return the headline numbers that have a value, each with its name."""
    step_ms = summary.get("step_ms") or {}
    one_class = Sets.of_summary(summary).one_class
    numbers = [
        ("engine", escape(summary.get("engine") or "")),
        ("OSPA reduction", percent(summary.get("reduction"))),
        ("smoothed OSPA", _text(BY_KEY["ospa"], _score(summary, SMOOTHED, "all", "ospa"))),
        ("class accuracy", "" if one_class else percent(summary.get("class_accuracy"), 1)),
        _switches(summary),
        ("step, median", number(step_ms.get("median"), 1, " ms")),
        ("step, 99 %", number(step_ms.get("p99"), 1, " ms")),
        ("scans scored", number(summary.get("scans") or None)),
    ]
    return "\n".join(
        f"<div><dt>{name}</dt><dd>{value}</dd></div>"
        for name, value in numbers
        if value not in ("", NO_VALUE)
    )


def _switches(summary: Mapping[str, Any]) -> tuple[str, str]:
    """Return the label and the numbers of identity switches, one per scored source."""
    metric, sources = BY_KEY["identity_switches"], _sources(summary)
    counts = [_text(metric, _score(summary, source, "all", metric.key)) for source in sources]
    known = any(count != NO_VALUE for count in counts)
    return (
        f"{metric.heading}, {' / '.join(sources)}",
        " / ".join(counts) if known else "",
    )


def _text(metric: Metric, value: float | None) -> str:
    return NO_VALUE if value is None else metric.text(value)


def _rows(summary: Mapping[str, Any], columns: Sequence[Metric], key: str, name: str) -> str:
    """Return one set's rows, the filter's above the smoother's."""
    rows = []
    for source in _sources(summary):
        values = [(_score(summary, source, key, metric.key), metric) for metric in columns]
        cells = "".join(f"<td>{_text(m, v)}</td>" for v, m in values)
        rows.append(
            f'<tr class="{source}"><th scope="row">{escape(name)}</th><th>{source}</th>{cells}</tr>'
        )
        name = ""
    return _body(rows)


def definitions(summary: Mapping[str, Any]) -> str:
    """Return the definitions of the shown metrics and terms; empty if there are no scores."""
    if not _sources(summary):
        return ""
    metrics = (*DISTANCES, *OTHERS, GROUPS[NEES][0], GROUPS[OUTSIDE][0], *GROUPS[CLASSES])
    words = [*((m.heading[0].upper() + m.heading[1:], m.definition) for m in metrics), *TERMS]
    terms = "\n".join(f"<dt>{escape(word)}</dt>\n<dd>{escape(text)}</dd>" for word, text in words)
    return f'<h2>Definitions</h2>\n{_parameters(summary)}<dl class="terms">\n{terms}\n</dl>'


def _parameters(summary: Mapping[str, Any]) -> str:
    """Return the order p and the cutoff c of the definitions; empty if unknown."""
    order, cutoff = summary.get("p"), summary.get("c")
    if order is None or cutoff is None:
        return ""
    return f"<p>Here p = {order:g}, c = {cutoff:g} m.</p>\n"


def sensors(learned: Sequence[LearnedValue], changes: Mapping[str, str]) -> str:
    """Return the table of configured and learned values; empty if nothing is learned.

    `changes` says how each sensor has changed, by name.
    """
    if not learned:
        return ""
    rows = [
        [
            f"{value.sensor}: {value.quantity}",
            *(
                f"{each:.3g} {value.unit}".rstrip()
                for each in (value.given, value.found, value.std)
            ),
        ]
        for value in learned
    ]
    headings = ("sensor and parameter", "set", "found", "deviation")
    changed = "".join(
        f"<p><strong>{escape(name)}</strong>: {escape(text)}.</p>" for name, text in changes.items()
    )
    return (
        f"<h2>Sensors</h2>\n{narrow(headings, rows)}<p>These values were learned by the end of the "
        "run, with their standard deviations. The detection probabilities are means over the "
        f"targets.</p>{changed}"
    )
