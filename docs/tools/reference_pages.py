"""Pages of parameters and metrics, and lists of outputs, written from the tables in the code."""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from msg_adapters.encoding import names
from msg_adapters.outgoing import diagnostics, outputs
from phd_jdtc_ros import report_bridge as reports
from phd_jdtc_ros.asterix_bridge import configuration as bridge
from phd_jdtc_ros.configuration.parameters import replaced
from phd_jdtc_ros.configuration.schema import Parameter, table
from phd_jdtc_ros.configuration.tables import GROUPS as PARTS
from phd_jdtc_ros.configuration.tables import TABLES, TOP, schema
from phd_jdtc_ros.evaluation.run_scores import CURVES, GROUPS, PUBLISHED, TERMS
from phd_jdtc_ros.handover import settings as hand_over
from phd_jdtc_ros.nodes.tracker import settings as tracker
from phd_jdtc_ros.parameter_files import node_tables, yaml_files
from phd_jdtc_ros.parameter_files.node_tables import Managed, Receiving
from phd_jdtc_ros.study.metrics import OF_STUDY

_PARAMETERS = """\
# Parameters

Written by `make parameters` from the declarations in the code, {count} in all. Parameters marked *
can change while the tracker runs, from the next scan on. A change is checked together with all
other values, and if it is refused, every reason is given. The tracker's other parameters change
only while it is not configured; those of the other nodes are fixed at the start, except `start_s`
of `sensor_replay`. Whole numbers are accepted for all numbers. All faults of a configuration are
listed at once, and the node then ends with status 2.
"""

# Parameters of the bridge that each radar may have too, and those that it alone has.
_OF_ALL = ", ".join(f"`{p.name}`" for p in bridge.RADAR if p in bridge.TABLE)
_OF_RADARS = tuple(p for p in bridge.RADAR if p not in bridge.TABLE)

# Parameters of sensors of positions that radars have too.
_OF_POSITIONS = ", ".join(f"`{p.name}`" for p in TABLES["position"] if p in TABLES["radar"])

# Parameters that several nodes have, and the others.
_MANAGED, _RECEIVING = table(Managed), table(Receiving)


def _own(declared: Iterable[Parameter]) -> tuple[Parameter, ...]:
    return tuple(p for p in declared if p not in (*_MANAGED, *_RECEIVING))


_SECTIONS: tuple[tuple[str, str, tuple[Parameter, ...]], ...] = (
    (
        "tracker",
        "The defaults are two radars and targets of two classes that can appear anywhere; "
        "`config/defaults.yaml` lists them all. "
        "QoS can be overridden: `qos_overrides.TOPIC.publisher.{reliability,history,depth}`, "
        "and `qos_overrides.TOPIC.subscription.{reliability,history,depth,deadline}` (ns).",
        TOP,
    ),
    (
        "tracker, for every radar in `sensors`",
        "`kind` is radar. Names are prefixed: `radar_1.position`.",
        TABLES["radar"],
    ),
    (
        "tracker, for every position in `sensors`",
        f"`kind` is position. Of a radar's parameters it has {_OF_POSITIONS} too.",
        tuple(p for p in TABLES["position"] if p not in TABLES["radar"]),
    ),
    (
        "tracker, for every receiver in `sensors`",
        "`kind` is reports. `kind`, `topic` and `frame` are as those of a radar, and the topic is "
        "/NAME/reports if it is empty. Reports are beside the tracks of other sensors, which they "
        "do not change.",
        tuple(p for p in TABLES["reports"] if p not in TABLES["radar"]),
    ),
    *((f"tracker, for every name in `{name}`", "", PARTS[name]) for name in list(PARTS)[1:]),
    ("tracker, as a node", "The offline executables do not have these.", _own(tracker.TABLE)),
    (
        "sensor_replay",
        "The flags `--rate`, `--start`, `--duration`, `--loop` and `--start-paused` and the "
        "positional argument set the corresponding parameters.",
        node_tables.REPLAY,
    ),
    ("evaluator", "", node_tables.EVALUATOR),
    (
        "asterix_bridge",
        "The offline tool has only the parameters of the conversion that it runs.",
        _own(bridge.TABLE),
    ),
    (
        "asterix_bridge, for every name in `radars`",
        f"{_OF_ALL} can be set for a radar too; without, those above count.",
        _OF_RADARS,
    ),
    ("report_bridge", "The offline tool has the first one.", _own(reports.TABLE)),
    (
        "asterix_bridge and report_bridge",
        "The offline tools have the first one.",
        _RECEIVING,
    ),
    ("tracker, asterix_bridge and report_bridge", "", _MANAGED),
    ("hand_over", "The offline tool has options for those that it needs.", hand_over.TABLE),
    ("hand_over, for every name in `trackers`", "", hand_over.TRACKER),
)


def parameters() -> str:
    """Return the page of the nodes' parameters as Markdown."""
    parts = [_PARAMETERS.format(count=declared())]
    for title, text, listed in _SECTIONS:
        rows = [
            (f"`{p.name}`{' *' * p.mutable}", f"`{_default_text(p)}`", p.allowed, p.description)
            for p in listed
        ]
        head = ("name", "default", "allowed", "meaning")
        parts.append(_section(title, text, head, rows))
    return "\n".join(parts)


def declared() -> int:
    """Return the number of declared parameters."""
    return sum(len(listed) for _, _, listed in _SECTIONS)


def _default_text(parameter: Parameter) -> str:
    default = parameter.default
    if parameter.keys:
        default = {key: getattr(default, key) for key in parameter.keys if getattr(default, key)}
    return str(default).replace("'", "") if default != "" else "(empty)"


_METRICS = """\
# Metrics

Written by `make parameters` from the table in the code. `metrics.json` has them by source
(`filtered`, `smoothed`), set (`all`, `class_0` ...) and key; the `summary.json` of a study by case,
variant, lag, set and key, as means over runs. Shares are shown in per cent; in both files they are
from 0 to 1. A figure that has no meaning, such as the RMS of no pairs, is null.

The evaluator publishes on `~/ospa`, for every scan and set: {}. On a topic each, for
[curves](visualisation.md#curves), it publishes {} too.

c, the cutoff, is the evaluator's parameter `cutoff`, and an option `--cutoff` of `track_bag`,
`report` and `monte_carlo`; p, the order, is 2. A target and an estimate are a pair where the
best assignment by position alone pairs them closer than c.
`confusion` of all targets counts, over the scans, targets by true class (rows) and by the class of
their paired estimate (columns). The last column counts missed targets, the last row false
estimates.

`consistency` has for each source, over all targets, the judged `pairs`, `nees` with `nees_band_95`,
and `outside_3_sigma`; and under `by_age` the same for tracks of an age. The age of a track is the
number of scans since its number was first reported by that source; an unlabelled estimate has none.
The band assumes that the pairs are independent. Those of one track are correlated from scan to
scan, so that the mean is outside the band in more than 5 % of runs; a study has the interval over
its runs instead.
"""

_WHOLE = "In `metrics.json` for all targets only."


def metrics() -> str:
    """Return the page of the metrics as Markdown."""
    listed = (", ".join(f"`{name}`" for name in names) for names in (PUBLISHED, CURVES))
    parts = [_METRICS.format(*listed)]
    sections = [
        (group.title[0].upper() + group.title[1:], "" if group.of_sets else _WHOLE, metrics)
        for group, metrics in GROUPS.items()
    ]
    of_study = tuple(metric for each in OF_STUDY for metric in each.metrics)
    for title, text, group in [*sections, ("In studies only", "", of_study)]:
        rows = [(m.heading, f"`{m.key}`", m.unit, m.definition) for m in group]
        parts.append(_section(title, text, ("metric", "key", "unit", "definition"), rows))
    parts.append(_section("Other terms", "", ("term", "definition"), TERMS))
    return "\n".join(parts)


def _section(title: str, text: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table under its heading and, if it is not empty, its text."""
    lines = [f"| {' | '.join(cells)} |" for cells in (head, *rows)]
    lines.insert(1, "|---" * len(head) + "|")
    return "\n".join([f"## {title}", "", *([text, ""] if text else []), *lines, ""])


_LISTED = re.compile(r"(?<=<!-- outputs: make parameters -->\n).*?(?=<!-- end -->)", re.DOTALL)
_RELIABLE, _LATCHED = "reliable, depth 10", "reliable, transient local, depth 1"


def topics(page: str) -> str:
    """Return the tracker's page with the rows of all its outputs."""
    rows: dict[tuple[str, ...], list[str]] = {}
    table = outputs.table(1)
    every = {row.topic for row in table}
    for row in table:
        how = "publishes" + ("" if row.usual else ", if enabled" if row.switch else ", if learned")
        kind, qos = row.type_name.replace("/msg/", "/"), _LATCHED if row.latched else _RELIABLE
        topic = row.topic.replace("s_0", "s_K")
        if row.topic.replace("/filtered/", "/smoothed/") in every - {row.topic}:
            topic = topic.replace("/filtered/", "/{filtered,smoothed}/")
        if row.topic.replace("/smoothed/", "/filtered/") not in every - {row.topic}:
            rows.setdefault((how, kind, qos, row.switch), []).append(f"`{topic}`")
    for engine, figures in diagnostics.FIGURES.items():
        listed = ", ".join(f"`{names.curve(name, '~')}`" for name in figures)
        key = "publishes", names.NUMBER.replace("/msg/", "/"), _RELIABLE, "curves"
        rows[key].append(f"with {engine} {listed}")
    lines = [
        f"| {how}{f' (`{switch}`)' if switch else ''} | {', '.join(listed)} | {kind} | {qos} |\n"
        for (how, kind, qos, switch), listed in rows.items()
    ]
    head = "\n| | name | type | QoS |\n|---|---|---|---|\n"
    return _LISTED.sub(head + "".join(lines) + "\n", page)


_TOPICS = re.compile(
    r"( +)<topics (?:publish|subscribe)=\"ALLOW\">\n(.*?)(?= +</topics>)", re.DOTALL
)
# The tracker's topics other than its outputs.
_OTHERS = ("/tracker/_instance", "/tracker/transition_event")


def policies(document: str) -> str:
    """Return the SROS2 policies with all outputs of a tracker wherever they list its markers."""
    known = {row.topic.replace("~", names.TRACKER) for row in outputs.table(2)}
    known |= {t for t in outputs.optional() if t.startswith(f"{names.TRACKER}/")}

    def listed(match: re.Match[str]) -> str:
        found = set(re.findall("<topic>(.*)</topic>", match[2]))
        if f"{names.TRACKER}/markers" not in found:
            return match[0]
        kept = {t for t in found if t in _OTHERS or not t.startswith(f"{names.TRACKER}/")}
        lines = [f"{match[1]}  <topic>{topic}</topic>\n" for topic in sorted(kept | known)]
        return match[0].removesuffix(match[2]) + "".join(lines)

    return _TOPICS.sub(listed, document)


_BEGIN, _END = "<!-- begin: make parameters -->", "<!-- end -->"
_REPLACED = (
    (
        "tracker",
        {
            **replaced.TRACKER,
        },
    ),
    ("tracker, of each sensor", replaced.RADAR),
    ("tracker, of each birth term", replaced.BIRTH),
    ("tracker, as a node", replaced.NODE),
    ("sensor_replay", replaced.REPLAY),
    ("evaluator", replaced.EVALUATOR),
    ("asterix_bridge", replaced.BRIDGE),
    ("asterix_bridge, of each radar", replaced.BRIDGE_RADAR),
    ("hand_over", replaced.HAND_OVER),
    ("hand_over, of each tracker", replaced.HAND_OVER_TRACKER),
)


def upgrade(page: str) -> str:
    """Return the upgrade page with its tables of renamed parameters rewritten."""
    head, _, rest = page.partition(_BEGIN)
    _, _, tail = rest.partition(_END)
    tables = [
        _section(title, "", ("before", "now"), [*_joined(names), *_rewritten(title)])
        for title, names in _REPLACED
    ]
    return "\n".join([f"{head}{_BEGIN}", *(f"#{table}" for table in tables), f"{_END}{tail}"])


# Replacements that differ in a value or a word only, and what they have in common.
_CONSTANT = re.compile(r"it is a constant now, (.*)")
_OUTPUT = re.compile(r"use outputs, a list with (\w+) in it")


def _joined(names: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return the rows of former names, one for all names with the same replacement."""
    rows: dict[str, list[str]] = {}
    for old, new in names.items():
        name, now = f"`{old}`", new
        if constant := _CONSTANT.fullmatch(new):
            name, now = f"{name} ({constant[1]})", "it is a constant now"
        elif output := _OUTPUT.fullmatch(new):
            name, now = f"{name} (`{output[1]}`)", "use outputs, a list of such words"
        rows.setdefault(now, []).append(name)
    return [(", ".join(old), now) for now, old in rows.items()]


def _rewritten(title: str) -> list[tuple[str, str]]:
    """Return a row for each value in a former notation of a part, and the lines that replace it."""
    return [
        (
            f"`{name}: {yaml_files.scalar(value)}`",
            ", ".join(f"`{line}`" for line in lines(name, value)),
        )
        for name, lines, values in replaced.NOTATIONS.get(title, ())
        for value in values
    ]


_DEFAULTS = """\
# All defaults: two radars, and targets of two classes that can appear anywhere. For your own radars
# start with a copy of surveillance.yaml, which has the most important ones, or of another profile
# beside it. Written by `make parameters`; each parameter is explained where it first occurs.
/**/tracker:
  ros__parameters:
"""


def defaults() -> str:
    """Return a parameter file of the tracker with all defaults and their descriptions."""
    lines, described, group = [_DEFAULTS.rstrip()], set(), ""
    for name, parameter in schema({}).items():
        prefix, _, last = name.rpartition(".")
        if prefix != group and prefix:
            lines += ["", f"    {prefix}:"]
        group, indent = prefix, "      " if prefix else "    "
        if parameter.description not in described:
            mark = f"{indent}# "
            lines += textwrap.wrap(
                parameter.description, 100, initial_indent=mark, subsequent_indent=mark
            )
        described.add(parameter.description)
        lines.append(f"{indent}{last}: {yaml_files.scalar(parameter.default)}")
    return "\n".join(lines) + "\n"


PAGES = {"parameters.md": parameters, "metrics.md": metrics}
# Files with lists that are rewritten, relative to the documentation.
LISTS = {
    "nodes/tracker.md": topics,
    "upgrade.md": upgrade,
    "../config/sros2/policies.xml": policies,
}


def main(argv: Sequence[str]) -> int:
    """Write the generated pages, and the defaults and policies into `config` beside them."""
    (directory,) = map(Path, argv)
    for name, page in PAGES.items():
        (directory / name).write_text(page(), encoding="utf-8")
    for name, written in LISTS.items():
        path = directory / name
        path.write_text(written(path.read_text(encoding="utf-8")), encoding="utf-8")
    (directory.parent / "config" / "defaults.yaml").write_text(defaults(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
