"""The measurements as tables, for the terminal and in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from rich.table import Table
from rich.text import Text

from phd_jdtc_ros.report.table import simple_table
from studies.runner import goals_table

from ..engine import late
from ..engine.recursion import FORMS, GAUSSIAN, PARTS
from ..engine.steps import PAPER
from ..transport.turning import ONE_CLOUD


def tables(summary: Mapping[str, Any]) -> Iterator[Table]:
    """Yield a table for every part that was measured, the goals last."""
    if "steps" in summary:
        yield from _steps(summary["steps"])
    if "step_growth" in summary:
        yield _step_growth(summary["step_growth"])
    if "peers" in summary:
        yield _peers(summary["peers"])
    if "parts" in summary.get("messages", {}):
        yield _messages(summary["messages"])
    if "estimate_ms" in summary.get("live", {}):
        yield _live(summary["live"])
    if "turning" in summary:
        yield from _turning(summary["turning"])
    if "late" in summary:
        yield _late(summary["late"])
    if "plots_per_s" in summary.get("asterix", {}):
        yield _asterix(summary["asterix"])
    yield goals_table(summary["figures"])


def markdown(given: Iterable[Table]) -> str:
    """Return tables in Markdown, without colours and styles."""
    lines: list[str] = []
    for table in given:
        columns = [
            [Text.from_markup(str(cell)).plain for cell in (column.header, *column.cells)]
            for column in table.columns
        ]
        header, *rows = zip(*columns, strict=True)
        rule = ["---", *["---:"] * (len(header) - 1)]
        caption = Text.from_markup(str(table.caption or "")).plain
        lines += [f"**{table.title}**", ""]
        lines += [f"| {' | '.join(row)} |" for row in (header, rule, *rows)]
        lines += ["", *([caption, ""] if caption else [])]
    return "\n".join(lines)


def _ms(value: float) -> str:
    return f"{_number(value)} ms"


def _number(value: float) -> str:
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def _steps(scenes: Mapping[str, Any]) -> Iterator[Table]:
    """Yield a table of the parts of a step for each form."""
    for form in FORMS:
        columns = {
            scene: (found["detections_a_radar"], found["forms"][form])
            for scene, found in scenes.items()
            if form in found["forms"]
        }
        title = f"the whole step, {form}, CPU medians in ms"
        caption = "4 targets: the reference scenario" if PAPER in columns else ""
        table = simple_table(title, ["part", *columns], caption=caption)
        for part in ("step", *PARTS):
            cells = [f"{of['times'][part]['median_ms']:.1f}" for _, of in columns.values()]
            table.add_row(part, *cells, end_section=part == "step")
        table.add_section()
        for count in ("hypotheses", "approximate clusters"):
            table.add_row(count, *(f"{of['counts'][count]:.0f}" for _, of in columns.values()))
        table.add_row("detections", *(f"{number:.0f}" for number, _ in columns.values()))
        yield table


def _step_growth(growth: Mapping[str, Any]) -> Table:
    """Return each form's step by number of targets, and the memory."""
    sizes = sorted({size for form in growth["forms"].values() for size in form["size"]})
    memory = ", ".join(f"{name} {_number(mb)} MB" for name, mb in growth["memory"]["MB"].items())

    def row(name: str, form: Mapping[str, Any]) -> list[str]:
        times = dict(zip(form["size"], form["times"], strict=True))
        cells = (_ms(times[size]["median_ms"]) if size in times else "-" for size in sizes)
        return [name, *cells, f"{form['exponent']:.2f}"]

    return simple_table(
        "the whole step against targets, CPU medians",
        ["form", *map(str, sizes), "exponent"],
        (row(name, form) for name, form in growth["forms"].items()),
        f"peak memory with {growth['memory']['targets']} targets and a lag of 5: {memory}",
    )


def _peers(peers: Mapping[str, Any]) -> Table:
    own = peers[GAUSSIAN]["median_ms"]

    def row(name: str, found: Mapping[str, Any]) -> list[str]:
        return [name, _ms(found["median_ms"]), _number(found["median_ms"] / own)]

    title = "a scan of the reference scenario, both radars"
    rows = (row(name, found) for name, found in peers.items())
    return simple_table(title, ("tracker", "CPU", "times gaussian"), rows)


def _messages(messages: Mapping[str, Any]) -> Table:
    rows = [(name, _ms(found["median_ms"])) for name, found in messages["parts"].items()]
    table = simple_table("a scan of 1000 detections and 200 estimates", ("message", "CPU"), rows)
    table.add_row("the node in total", _ms(messages["total_ms"]), style="bold")
    return table


PERCENTILES = ("p50", "p99", "most")


def _live(live: Mapping[str, Any]) -> Table:
    rate = live["highest_rate_hz"]
    caption = (
        f"highest rate without a gap: {rate['value']:.1f} Hz"
        if rate["value"]
        else f"highest rate: {rate['reason']}"
    )
    labels = {
        "estimate_ms": "to the estimate",
        "step_ms": "the step (CPU)",
        "beyond_step_ms": "to the last message, less the step",
    }
    return simple_table(
        f"the tracker over DDS, {live['scans']} scans, wall time",
        ("from last detection", *PERCENTILES),
        ([label, *(_ms(live[key][each]) for each in PERCENTILES)] for key, label in labels.items()),
        caption,
    )


def _turning(found: Mapping[str, Any]) -> Iterator[Table]:
    if "latency_s" in found["latency"]:
        yield _sector_latency(found["latency"])
    medians = {form: of_form["median_ms"] for form, of_form in found["cost"].items()}
    yield simple_table(
        "a revolution of 50 aircraft, CPU medians",
        ("reports", "CPU"),
        (
            (form, f"{_ms(median)} ({_number(median / medians[ONE_CLOUD])}x)")
            for form, median in medians.items()
        ),
        "estimates once a revolution, except in the row with estimates at each sector; "
        "in brackets, as a multiple of one cloud",
    )


def _late(found: Mapping[str, Any]) -> Table:
    dropped, reprocessed = (found["peak_MB"][name] for name in (late.NOT_READY, late.READY))
    return simple_table(
        "a scan of the reference scenario, CPU medians",
        ("late reports", "CPU"),
        (
            (name, f"{_ms(step['median_ms'])} ({_number(late.ratio(found, name))}x)")
            for name, step in found["steps"].items()
        ),
        "steps that reprocess a report, or all steps if none is late; in brackets, as a "
        f"multiple of where they are dropped. Most memory of these two: {_number(dropped)} and "
        f"{_number(reprocessed)} MB",
    )


def _sector_latency(found: Mapping[str, Any]) -> Table:
    latency, step = found["latency_s"], found["step_ms"]
    return simple_table(
        f"a turning radar over DDS, {found['sectors']} sectors in real time",
        ("of a detection", *PERCENTILES),
        (
            ["to the estimates of its sector", *(f"{latency[p]:.3f} s" for p in PERCENTILES)],
            ["the step (CPU)", *(_ms(step[p]) for p in PERCENTILES)],
        ),
        f"{found['detections']} detections, {found['targets']:.0f} aircraft tracked",
    )


def _asterix(found: Mapping[str, Any]) -> Table:
    live = found["live"]
    caption = live.get("reason")
    if "latency_s" in live:
        latency = live["latency_s"]
        caption = (
            f"{live['aircraft']} aircraft, {live['sectors']} sectors in real time: from antenna "
            f"to tracks p50 {latency['p50']:.3f} s, p99 {latency['p99']:.3f} s, most "
            f"{latency['most']:.3f} s"
        )
    rates = [(f"plots, {name}", f"{r:,.0f} per s") for name, r in found["plots_per_s"].items()]
    rows = [*rates, ("100 tracks to CAT062", _ms(found["tracks_ms"]))]
    return simple_table("ASTERIX on one core", ("what", "speed"), rows, caption)
