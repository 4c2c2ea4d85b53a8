"""The measurements as tables, for the terminal and in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table
from rich.text import Text

from . import late
from .recursion import GAUSSIAN, PARTICLES, PARTS
from .turning import ONE_CLOUD

# Counts in the table of a step, by engine.
COUNTS = {
    PARTICLES: {"particles": "particles"},
    GAUSSIAN: {"rows": "hypotheses", "approximate clusters": "approximate clusters"},
}
STEPS_CAPTIONS = {
    PARTICLES: "4 targets: the reference scenario, 1500 particles per target; others: about 500",
    GAUSSIAN: "4 targets: the reference scenario",
}


def tables(summary: Mapping[str, Any]) -> Iterator[Table]:
    """Yield a table for every part that was measured, the goals last."""
    if "smoother" in summary:
        yield _smoother("the smoother per scan: one kernel and five lags", summary["smoother"])
    if "paper_smoother" in summary:
        yield _smoother("the same with the paper's kernel", summary["paper_smoother"])
    if "growth" in summary:
        yield _growth(summary["growth"])
    if "steps" in summary:
        yield from _steps(summary["steps"])
    if "step_growth" in summary:
        yield _step_growth(summary["step_growth"])
    if "searches" in summary:
        yield _searches(summary["searches"])
    if "peers" in summary:
        yield _peers(summary["peers"])
    if "parts" in summary.get("messages", {}):
        yield _messages(summary["messages"])
    for engine, found in summary.get("live", {}).items():
        if "estimate_ms" in found:
            yield _live(engine, found)
    if "turning" in summary:
        yield from _turning(summary["turning"])
    if "late" in summary:
        yield _late(summary["late"])
    if "plots_per_s" in summary.get("asterix", {}):
        yield _asterix(summary["asterix"])
    yield _goals(summary["figures"])


def markdown(given: Iterable[Table]) -> str:
    """Return the tables in Markdown."""
    lines: list[str] = []
    for table in given:
        columns = [
            [Text.from_markup(str(cell)).plain for cell in (column.header, *column.cells)]
            for column in table.columns
        ]
        header, *rows = zip(*columns, strict=True)
        rule = ["---", *["---:"] * (len(header) - 1)]
        lines += [f"**{table.title}**", ""]
        lines += [f"| {' | '.join(row)} |" for row in (header, rule, *rows)]
        lines += ["", *([f"{table.caption}", ""] if table.caption else [])]
    return "\n".join(lines)


def _table(title: str, *headings: str, caption: str | None = None) -> Table:
    table = Table(title=title, caption=caption)
    table.add_column(headings[0])
    for heading in headings[1:]:
        table.add_column(heading, justify="right")
    return table


def _ms(value: float) -> str:
    return f"{_number(value)} ms"


def _number(value: float) -> str:
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def _smoother(title: str, sizes: Mapping[str, Any]) -> Table:
    """Return each form's time, also as a multiple of the fastest."""
    table = _table(
        title,
        "form",
        *(f"N = {size}" for size in sizes),
        caption="CPU medians; in brackets, as a multiple of the fastest; peak memory of a kernel",
    )
    forms = list(dict.fromkeys(name for size in sizes.values() for name in size["times"]))
    whole = [name for name in forms if not name.startswith(("build", "backward"))]
    best = {
        size: min(found["times"][name]["median_ms"] for name in whole if name in found["times"])
        for size, found in sizes.items()
    }
    kinds = ["dense,", "dense ", "k-d tr", "smooth"]
    for name in sorted(whole, key=lambda name: kinds.index(name[:6])):
        cells = []
        for size, found in sizes.items():
            if name not in found["times"]:
                cells.append("-")
                continue
            median = found["times"][name]["median_ms"]
            memory = found["memory"].get(f"{name.replace('smoother', 'build')}, MB")
            extra = f", {memory:.0f} MB" if memory else ""
            cells.append(f"{_ms(median)} ({_number(median / best[size])}x{extra})")
        table.add_row(escape(name), *cells)
    return table


def _growth(growth: Mapping[str, Any]) -> Table:
    table = _table("growth: exponents", "form", "in particles per target", "in targets")
    ladders = [growth["particles_per_target"]["forms"], growth["targets"]["forms"]]
    for name in ladders[0]:
        slopes = [ladder.get(name, {}).get("exponent") for ladder in ladders]
        table.add_row(escape(name), *("-" if s is None else f"{s:.2f}" for s in slopes))
    return table


def _steps(scenes: Mapping[str, Any]) -> Iterator[Table]:
    """Yield a table of the parts of a step for each engine."""
    for engine, parts in PARTS.items():
        columns = {
            f"{scene}, {backend}": (found["detections_a_radar"], found["engines"][engine], times)
            for scene, found in scenes.items()
            if engine in found["engines"]
            for backend, times in found["engines"][engine]["backends"].items()
        }
        table = _table(
            f"the whole step, engine {engine}, CPU medians in ms",
            "part",
            *columns,
            caption=STEPS_CAPTIONS[engine],
        )
        for part in ("step", *parts):
            cells = [f"{times[part]['median_ms']:.1f}" for *_, times in columns.values()]
            table.add_row(part, *cells, end_section=part == "step")
        table.add_section()
        for count, label in COUNTS[engine].items():
            cells = [f"{found['counts'][count]:.0f}" for _, found, _ in columns.values()]
            table.add_row(label, *cells)
        table.add_row("detections", *(f"{number:.0f}" for number, *_ in columns.values()))
        yield table


def _step_growth(growth: Mapping[str, Any]) -> Table:
    """Return each engine's step by number of targets, and the memory."""
    sizes = sorted({size for form in growth["forms"].values() for size in form["size"]})
    held = ", ".join(f"{name} {_number(size)} MB" for name, size in growth["memory"]["MB"].items())
    table = _table(
        "the whole step against targets, CPU medians",
        "engine",
        *map(str, sizes),
        "exponent",
        caption=f"at most held with {growth['memory']['targets']} targets and a lag of 5: {held}",
    )
    for name, form in growth["forms"].items():
        times = dict(zip(form["size"], form["times"], strict=True))
        cells = [_ms(times[size]["median_ms"]) if size in times else "-" for size in sizes]
        table.add_row(escape(name), *cells, f"{form['exponent']:.2f}")
    return table


def _searches(found: Mapping[str, Any]) -> Table:
    table = _table(
        "a backward kernel by each search",
        "search",
        "pairs",
        "targets",
        "CPU",
        caption="within origins: the default corrector; anywhere: the PHD filter's, with spawning",
    )
    for place, sizes in found.items():
        for targets, ways in sizes.items():
            for name, times in ways.items():
                table.add_row(escape(name), place, targets, _ms(times["median_ms"]))
            table.add_section()
    return table


def _peers(peers: Mapping[str, Any]) -> Table:
    table = _table(
        "a scan of the reference scenario, both radars", "tracker", "CPU", "times particles"
    )
    own = next(found["median_ms"] for name, found in peers.items() if name.startswith("particles"))
    for name, found in peers.items():
        median = found.get("median_ms")
        cells = [found["reason"], "-"] if median is None else [_ms(median), _number(median / own)]
        table.add_row(escape(name), *cells)
    return table


def _messages(messages: Mapping[str, Any]) -> Table:
    table = _table("a scan of 1000 detections and 200 estimates", "message", "CPU")
    for name, found in messages["parts"].items():
        table.add_row(name, _ms(found["median_ms"]))
    table.add_row("the node in total", _ms(messages["total_ms"]), style="bold")
    return table


def _live(engine: str, live: Mapping[str, Any]) -> Table:
    rate = live["highest_rate_hz"]
    value = rate["value"]
    caption = (
        f"highest rate without a gap: {value:.1f} Hz"
        if value
        else f"highest rate: {rate['reason']}"
    )
    table = _table(
        f"engine {engine} over DDS, {live['scans']} scans, wall time",
        "from last detection",
        "p50",
        "p99",
        "most",
        caption=caption,
    )
    rows = {
        "estimate_ms": "to the estimate",
        "step_ms": "the step (CPU)",
        "beyond_step_ms": "to the last message, less the step",
    }
    for key, label in rows.items():
        table.add_row(label, *(_ms(live[key][column]) for column in ("p50", "p99", "most")))
    return table


def _turning(found: Mapping[str, Any]) -> Iterator[Table]:
    for engine, latency in found["latency"].items():
        if "latency_s" in latency:
            yield _sector_latency(engine, latency)
    cost = {
        f"{engine} [{backend}]": forms
        for engine, of_backends in found["cost"].items()
        for backend, forms in of_backends.items()
    }
    table = _table(
        "a turn of 50 aircraft, CPU medians",
        "reports",
        *map(escape, cost),
        caption="estimates once a turn, except where they are said to go out at each sector; "
        "in brackets, as a multiple of one cloud",
    )
    forms = next(iter(cost.values()))
    for form in forms:
        cells = []
        for of_forms in cost.values():
            median = of_forms[form]["median_ms"]
            cells.append(f"{_ms(median)} ({_number(median / of_forms[ONE_CLOUD]['median_ms'])}x)")
        table.add_row(form, *cells)
    yield table


def _late(found: Mapping[str, Any]) -> Table:
    memory = ", ".join(
        f"{engine} {_number(of_engine['peak_MB'][late.NOT_READY])} and "
        f"{_number(of_engine['peak_MB'][late.READY])} MB"
        for engine, of_engine in found.items()
    )
    table = _table(
        "a scan of the reference scenario, CPU medians",
        "late reports",
        *found,
        caption="steps that work a report in, or all where none is late; in brackets, as a "
        f"multiple of where they are dropped. Most memory of both: {memory}",
    )
    for name in next(iter(found.values()))["steps"]:
        cells = [
            f"{_ms(of_engine['steps'][name]['median_ms'])} "
            f"({_number(late.ratio(found, engine, name))}x)"
            for engine, of_engine in found.items()
        ]
        table.add_row(name, *cells)
    return table


def _sector_latency(engine: str, found: Mapping[str, Any]) -> Table:
    table = _table(
        f"a turning radar over DDS, engine {engine}, {found['sectors']} sectors in real time",
        "of a detection",
        "p50",
        "p99",
        "most",
        caption=f"{found['detections']} detections, {found['targets']:.0f} aircraft tracked",
    )
    columns = ("p50", "p99", "most")
    late = found["latency_s"]
    table.add_row("to the estimates of its sector", *(f"{late[c]:.3f} s" for c in columns))
    table.add_row("the step (CPU)", *(_ms(found["step_ms"][c]) for c in columns))
    return table


def _asterix(found: Mapping[str, Any]) -> Table:
    live = found["live"]
    caption = live.get("reason")
    if "latency_s" in live:
        late = live["latency_s"]
        caption = (
            f"{live['aircraft']} aircraft, {live['sectors']} sectors in real time: from antenna "
            f"to tracks p50 {late['p50']:.3f} s, p99 {late['p99']:.3f} s, most {late['most']:.3f} s"
        )
    table = _table("ASTERIX on one core", "what", "speed", caption=caption)
    for name, rate in found["plots_per_s"].items():
        table.add_row(f"plots, {name}", f"{rate:,.0f} per s")
    table.add_row("100 tracks to CAT062", _ms(found["tracks_ms"]))
    return table


def _goals(figures: Sequence[Mapping[str, Any]]) -> Table:
    table = _table("goals", "figure", "value", "goal", "reached")
    for figure in figures:
        sign = "at most" if figure["at_most"] else "at least"
        value = figure.get("reason") or _number(figure["value"])
        reached = {True: "yes", False: "no", None: "-"}[figure["reached"]]
        style = "red" if figure["reached"] is False else None
        table.add_row(
            escape(figure["name"]),
            escape(value),
            f"{sign} {figure['goal']:.4g}",
            reached,
            style=style,
        )
    return table
