"""Proposals of `tune` beside what was simulated: the parameters beside a bag, and its truth."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from msg_adapters import interfaces, names, truth
from phd_jdtc_ros import resources
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.calibration.tuning import proposal
from phd_jdtc_ros.calibration.tuning.findings import Findings
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.exit_status import OK
from phd_jdtc_ros.parameter_files import bag_parameters, tracker_params

from . import recorded_plots, seen_targets

# Of the table, in characters: a line for each radar.
WIDTH = 116
COLUMNS = (
    "recording",
    "radar",
    "turn, s",
    "interval, s",
    "range, m",
    "azimuth, deg",
    "detected",
    "clutter",
)


def compare(bags: Sequence[str], seconds: float) -> int:
    """Print what is proposed for simulated bags beside what was simulated.

    Raises
    ------
    BagError
        If a bag has no truth, or no parameters beside it.
    """
    table = Table(*COLUMNS, caption="found / simulated; detected: share of the true targets' looks")
    for given in bags:
        for cells in _compared(given, seconds):
            table.add_row(*cells)
    console = Console()
    console.width = max(console.width, WIDTH)
    console.print(table)
    return OK


def _compared(given: str, seconds: float) -> list[tuple[str, ...]]:
    """Return the cells of a bag's radars."""
    source = resources.bag(given)
    bag = BagReader(source)
    recorded = bag_parameters.read(source)
    if recorded is None or names.TRUTH not in bag.types:
        lacking = names.TRUTH if recorded else bag_parameters.path_of(source).name
        raise BagError(f"{source}: has no {lacking}, which the truth is in")
    config = tracker_params.config(recorded)
    plots = recorded_plots.read(bag, config, seconds)
    found = recorded_plots.findings_of(source, plots)
    until_ns = bag.start_ns + round(seconds * 1e9)
    targets = [
        truth.from_msg(interfaces.decode(entry.data, names.CLOUD))
        for entry in bag.messages([names.TRUTH], until_ns)
    ]
    rows = []
    interval_s = proposal.interval_s(found)
    for radar in config.model.radars:
        own = plots.plots[radar.name]
        if own is None:
            continue
        share = seen_targets.share_detected(targets, own, radar)
        true_interval_s = config.model.modes.interval_s
        interval = f"{interval_s:g} / {true_interval_s:g}"
        rows.append((source.name, radar.name, *_cells(found[radar.name], radar, share, interval)))
    return rows


def _cells(found: Findings, radar: RadarModel, share: float, interval: str) -> tuple[str, ...]:
    """Return the cells of a radar: what was found, and what was simulated."""
    noise, turn_s = found.noise, found.timing.rotation_s
    return (
        f"{turn_s:.4g} / {radar.rotation_s:g}" if turn_s or radar.rotation_s else "none",
        interval,
        f"{noise.range_std:.3g} / {radar.range_std:g}",
        f"{math.degrees(noise.azimuth_std):.3g} / {math.degrees(radar.azimuth_std):g}",
        f"{found.detection.value:.3f} / {share:.3f}",
        f"{found.clutter.value:.3g} / {radar.clutter_rate:g}",
    )
