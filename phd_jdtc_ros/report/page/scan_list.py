# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The positions of the page's slider: the content of a record by stamp."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from phd_jdtc_ros.core.types import SOURCES, Estimates, Truth

from ..record import Plot, Record


class Scan(NamedTuple):
    """The content of a record at one stamp."""

    stamp_ns: int
    plots: dict[str, Plot]
    estimates: dict[str, Estimates]
    truth: Truth | None


def scans_of(record: Record) -> list[Scan]:
    """Return the content of all stamps in the record, in order."""
    truth = {entry.stamp_ns: entry for entry in record.truth}
    found = {s: {e.stamp_ns: e for e in record.of_source(s)} for s in SOURCES}
    plots: dict[int, dict[str, Plot]] = {}
    for plot in record.plots:
        plots.setdefault(plot.stamp_ns, {})[plot.radar] = plot
    stamps = truth.keys() | plots.keys() | set().union(*found.values())
    return [
        Scan(
            stamp,
            plots.get(stamp, {}),
            {source: run[stamp] for source, run in found.items() if stamp in run},
            truth.get(stamp),
        )
        for stamp in sorted(stamps)
    ]


def first_shown(scans: Sequence[Scan]) -> int:
    """Return the last of the scans with the most targets, counting true ones if known."""
    counts = [
        (
            0 if scan.truth is None else len(scan.truth.class_id),
            max((len(found) for found in scan.estimates.values()), default=0),
        )
        for scan in scans
    ]
    return max(range(len(scans)), key=lambda index: (counts[index], index), default=0)
