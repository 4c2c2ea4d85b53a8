"""Simulates the ASTERIX output of the turning radars of a scenario.

A radar sends the plots of a sector some time after the antenna has passed its end, in data blocks
of a few plots. Plots have the time of day of the radar's clock; captures also times of receipt.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from phd_jdtc_ros import output_files
from phd_jdtc_ros.asterix import writing as plots_out
from phd_jdtc_ros.asterix.messages import Plot
from phd_jdtc_ros.columns.sent_columns import fill
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.types import FULL_TURN, Detections
from phd_jdtc_ros.simulation.antenna import Sending
from phd_jdtc_ros.simulation.looks import TurningRadar
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.turning_antenna import plots_with_replies
from phd_jdtc_ros.transport import pcap

from .writing import OWN_SAC, plots_of

# Suffix of a capture. Other files have the data blocks one after the other.
CAPTURE = ".pcap"


def check(run: Scenario) -> None:
    """Raise `ConfigError` if a radar does not turn: its ASTERIX output cannot be simulated."""
    faults = [
        f"{radar.name}.rotation_s: 0 given, must be above 0 to send ASTERIX"
        for radar in run.radars
        if not radar.rotation_s
    ]
    if faults:
        raise ConfigError(*faults)


def write(
    path: Path, run: Scenario, config: TrackerConfig, sending: Sequence[Sending], seed: int
) -> int:
    """Write the data blocks of a seeded run in order of receipt, and return their number.

    The file is a capture if its name ends with `CAPTURE`. All radars must turn.
    """
    sent = []
    for index, own in enumerate(sending):
        line = pcap.Line(sender=(10, 0, 0, index + 1))
        blocks = _blocks(run, index, config.radars[index], own, seed)
        sent += [(time_ns, block, line) for time_ns, block in blocks]
    sent.sort(key=lambda entry: entry[0])
    with output_files.opened(path) as stream:
        if path.suffix == CAPTURE:
            stream.write(pcap.header())
            stream.writelines(pcap.packet(*entry) for entry in sent)
        else:
            stream.writelines(block for _, block, _ in sent)
    return len(sent)


def _blocks(
    run: Scenario, index: int, layout: RadarParameters, sending: Sending, seed: int
) -> Iterator[tuple[int, bytes]]:
    """Yield time of receipt, nanoseconds since the epoch, and bytes of a radar's data blocks."""
    radar = TurningRadar(run, index, layout)
    plots, detections = plots_with_replies(radar, seed)
    time_s = radar.times_at(plots.revolutions)
    source = OWN_SAC << 8 | index + 1
    records = _plots(detections, layout, source)
    own_ns = round(sending.clock_ahead_s * 1e9) + run.bias(index).offset_ns
    sectors = sending.sectors
    crossed = np.arange(math.ceil(radar.antenna.begin * sectors), int(radar.end * sectors) + 1)
    times_s = radar.times_at(crossed / sectors)
    edges = np.searchsorted(time_s, times_s)
    for number, passed_s, row, last in zip(
        crossed.tolist(), times_s.tolist(), [0, *edges.tolist()], edges.tolist(), strict=False
    ):
        passed_ns = run.ns_after(passed_s)
        if sending.services:
            azimuth = FULL_TURN * (number % sectors) / sectors
            revolution_s = radar.model.rotation_s
            service = plots_out.service_block(source, passed_ns + own_ns, azimuth, revolution_s)
            # Delay of a north mark or a sector crossing after the antenna's passage, seconds.
            yield passed_ns + round(0.02 * 1e9), service
        for begin in range(row, last, sending.plots):
            some = range(begin, min(begin + sending.plots, last))
            timed = [(run.ns_after(float(time_s[k])) + own_ns, records[k]) for k in some]
            near = [entry for entry in timed if entry[1].distance <= plots_out.FARTHEST]
            for block in plots_out.plot_blocks(near):
                yield passed_ns + round(sending.delay_s * 1e9), block


def _plots(found: Detections, layout: RadarParameters, number: int) -> list[Plot]:
    """Return plots as a radar measures and sends them, without amplitudes."""
    above = fill(found.height, len(found), math.nan)
    distance, azimuth = found.measurement.T
    azimuth = 0.5 * math.pi - azimuth
    if layout.site is None:
        distance = np.hypot(distance, np.nan_to_num(above - layout.height))
    else:
        azimuth = azimuth - layout.site.yaw_from_east
    detection_type = np.maximum(fill(found.detection_type, len(found), 0), 0)
    sent = replace(found, amplitude=None, detection_type=detection_type)
    return plots_of(sent, number, distance, azimuth, above + layout.datum)
