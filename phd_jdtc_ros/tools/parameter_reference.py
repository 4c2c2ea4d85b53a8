# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Makes the parameter reference page from the tables that the nodes declare."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from phd_jdtc_ros.core.configuration.parameters import BIRTH, CLASS, MOTION, RADAR, TOP
from phd_jdtc_ros.core.configuration.schema import Parameter
from phd_jdtc_ros.nodes.evaluator import node
from phd_jdtc_ros.nodes.replay import replay_parameters
from phd_jdtc_ros.nodes.tracker import settings

_INTRODUCTION = """\
# Parameters

Written by `make parameters` from the tables in the code. Parameters marked * can change while the
tracker runs, from the next scan on. A change is checked together with all other values, and if it
is refused, every reason is given. All other parameters are fixed at the start, except `seek_s` of
`sensor_replay`. Whole numbers are accepted for all numbers. All faults of a configuration are
listed at once, and the node then ends with status 2.
"""

_SECTIONS: tuple[tuple[str, str, tuple[Parameter, ...]], ...] = (
    (
        "tracker",
        "The defaults are the reference scenario; `config/paper_scenario.yaml` lists them all. "
        "QoS can be overridden: `qos_overrides.TOPIC.publisher.{reliability,history,depth}`, "
        "and `qos_overrides.TOPIC.subscription.{reliability,history,depth,deadline}` (ns).",
        TOP,
    ),
    ("tracker, for every name in `radars`", "Names are prefixed: `radar_1.position`.", RADAR),
    ("tracker, for every name in `classes`", "", CLASS),
    ("tracker, for every name in `motions`", "", MOTION),
    ("tracker, for every name in `births`", "", BIRTH),
    ("tracker, as a node", "The offline executables do not have these.", settings.TABLE),
    (
        "sensor_replay",
        "The flags `--rate`, `--start`, `--duration`, `--loop` and `--start-paused` and the "
        "positional argument set the corresponding parameters.",
        replay_parameters.TABLE,
    ),
    ("evaluator", "", node.TABLE),
)


def page() -> str:
    """Return the page as Markdown."""
    parts = [_INTRODUCTION]
    for title, text, table in _SECTIONS:
        rows = [
            f"| `{p.name}`{_mark(p)} | `{_shown(p.default)}` | {p.allowed} | {p.description} |"
            for p in table
        ]
        head = ["| name | default | allowed | meaning |", "|---|---|---|---|"]
        parts.append(
            "\n".join([f"## {title}", "", *([text, ""] if text else []), *head, *rows, ""])
        )
    return "\n".join(parts)


def _mark(parameter: Parameter) -> str:
    return " *" if parameter.mutable else ""


def _shown(default: object) -> str:
    return str(default).replace("'", "") if default != "" else "(empty)"


def main(argv: Sequence[str]) -> int:
    """Print the page."""
    sys.stdout.write(page())
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
