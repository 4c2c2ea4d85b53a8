"""Proposals of `tune` beside the simulated values: the parameters beside a bag, and its truth."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence

import numpy as np
from rich.table import Table

from msg_adapters.encoding import interfaces, names
from msg_adapters.targets import truth
from phd_jdtc_ros import resources
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.calibration.tuning import proposal
from phd_jdtc_ros.calibration.tuning.findings import Findings
from phd_jdtc_ros.calibration.tuning.plots import Plots
from phd_jdtc_ros.core.arrays import FloatArray, wrap_angle
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel, polar_radars
from phd_jdtc_ros.core.types import Truth
from phd_jdtc_ros.exit_status import ArgumentParser
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments
from phd_jdtc_ros.tools import command, recorded_plots

from ..runner import Figures, Study, table

COLUMNS = (
    *("recording", "radar", "revolution, s", "interval, s"),
    *("range, m", "azimuth, deg", "detected", "clutter"),
)
# Length of the part of a recording that is read by default, seconds.
SECONDS = 600.0
# Gate of the association of plots with targets, in standard deviations.
GATE = 4.0
# The beam passes a target once a revolution: no second plot within this share of a revolution
# counts.
AGAIN = 0.5
# Stamps of truth and clouds closer than this are the same, seconds.
SAME_STAMP_S = 1e-3


def _of_bag(given: str, seconds: float) -> list[list[str]]:
    """Return the table rows of a bag's radars, given its truth and the parameters beside it."""
    source = resources.bag(given)
    bag = BagReader(source)
    recorded = bag_parameters.read(source)
    if recorded is None or names.TRUTH not in bag.types:
        lacking = names.TRUTH if recorded else bag_parameters.path_of(source).name
        raise BagError(f"{source}: {lacking} is missing, a simulated bag is needed")
    config = from_arguments.config_of(recorded)
    plots = recorded_plots.read(bag, config, seconds)
    found = recorded_plots.findings_of(source, plots)
    until_ns = bag.start_ns + round(seconds * 1e9)
    targets = [
        truth.from_msg(interfaces.decode(entry.data, names.CLOUD))
        for entry in bag.messages([names.TRUTH], until_ns)
    ]
    rows = []
    interval_s = proposal.interval_s(found)
    for radar in polar_radars(config.model.radars):
        own = plots.plots[radar.name]
        if own is None:
            continue
        share = share_detected(targets, own, radar)
        true_interval_s = config.model.modes.interval_s
        interval = f"{interval_s:g} / {true_interval_s:g}"
        rows.append([source.name, radar.name, *_cells(found[radar.name], radar, share, interval)])
    return rows


def _cells(found: Findings, radar: RadarModel, share: float, interval: str) -> tuple[str, ...]:
    """Return the cells of a radar's row: estimated and simulated values."""
    noise, revolution_s = found.noise, found.timing.rotation_s
    return (
        f"{revolution_s:.4g} / {radar.rotation_s:g}"
        if revolution_s or radar.rotation_s
        else "none",
        interval,
        f"{noise.range_std:.3g} / {radar.range_std:g}",
        f"{math.degrees(noise.azimuth_std):.3g} / {math.degrees(radar.azimuth_std):g}",
        f"{found.detection.value:.3f} / {share:.3f}",
        f"{found.clutter.value:.3g} / {radar.clutter_rate:g}",
    )


def share_detected(truth: Sequence[Truth], plots: Plots, radar: RadarModel) -> float:
    """Return the share of looks in which targets in a stationary radar's field were detected.

    The truth is ordered by time; the radar has the simulated position and noise. NaN without
    targets.
    """
    hits, chances = 0, 0.0
    for number in np.unique(np.concatenate([targets.track_id for targets in truth])):
        found = [(each, np.flatnonzero(each.track_id == number)) for each in truth]
        there = [(each, rows[0]) for each, rows in found if len(rows)]
        if len(there) < 2:
            continue
        stamp_s = np.array([(each.stamp_ns - plots.zero_ns) * 1e-9 for each, _ in there])
        state = np.array([each.state[row] for each, row in there])
        inside = radar.visibility.probability_in_view(radar.measure(state)) > 0.0
        time_s = _detection_times(stamp_s, state, plots, radar)
        if radar.rotation_s:
            again = np.diff(time_s) < AGAIN * radar.rotation_s
            hits += len(time_s) - int(np.count_nonzero(again))
            revolutions = np.diff(stamp_s) * inside[1:] / radar.rotation_s
            chances += float(revolutions.sum())
        else:
            hits += len(np.unique(time_s))
            near = np.abs(plots.cloud_s[:, None] - stamp_s[inside]) < SAME_STAMP_S
            chances += np.count_nonzero(near.any(axis=1))
    return hits / chances if chances else float("nan")


def _detection_times(
    stamp_s: FloatArray, state: FloatArray, plots: Plots, radar: RadarModel
) -> FloatArray:
    """Return the times of the plots near a target, ascending, seconds.

    The target's states, (K, D), are of the times `stamp_s`.
    """
    during = (plots.time_s >= stamp_s[0]) & (plots.time_s <= stamp_s[-1])
    time_s = plots.time_s[during]
    then = np.stack([np.interp(time_s, stamp_s, column) for column in state.T], axis=1)
    expected = radar.measure(then)
    error = plots.measurement[during] - expected
    error[:, 1] = wrap_angle(error[:, 1])
    near = ((error / radar.noise_std) ** 2).sum(axis=1) < GATE**2
    near &= radar.visibility.probability_in_view(expected) > 0.0
    detected: FloatArray = time_s[near]
    return detected


def _add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("bag", nargs="+", help="simulated bags")
    seconds = command.at_least(1.0, "s")
    parser.add_argument("--seconds", type=seconds, default=SECONDS, help="%(default)s of each")


def _measure(arguments: argparse.Namespace, seed: int) -> Figures:
    return {"radars": [row for bag in arguments.bag for row in _of_bag(bag, arguments.seconds)]}


def _tables(found: Figures) -> list[Table | str]:
    return [
        table("found / simulated", COLUMNS, found["radars"]),
        "detected: share of the true targets' looks",
    ]


STUDY = Study(
    name="tuning_truth",
    purpose="What `tune` proposes for simulated bags, beside what was simulated.",
    measure=_measure,
    tables=_tables,
    runs=0,
    add_arguments=_add_arguments,
)
