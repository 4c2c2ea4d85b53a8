"""What the turning radars of a scenario send: recordings of ASTERIX as real radars make them.

Plots leave a radar by sectors, some time after the antenna has passed their end, in data blocks of
a few. Each has the time of day of the radar's own clock; a capture has the times of receipt, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from phd_jdtc_ros.asterix.messages import DAY, NONE, Plot
from phd_jdtc_ros.asterix.transport import pcap_out
from phd_jdtc_ros.asterix.writing import plots as plots_out
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.radar_input import RadarInput
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.types import FULL_TURN, UNKNOWN, Detections
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.sending import Sending
from phd_jdtc_ros.simulation.turning_antenna import plot_times, plots_with_replies

# SAC of the radars; their SIC is their place, from 1.
SAC = 1
# Of a capture. Other files have the data blocks one after the other.
CAPTURE = ".pcap"
# A north mark or a sector crossing comes so long after the antenna, seconds.
SERVICE_DELAY_S = 0.02


def check(run: Scenario) -> None:
    """Refuse radars that do not turn: what they send is not simulated.

    Raises
    ------
    ConfigError
    """
    faults = [
        f"{radar.name}.rotation_s: 0 given, must be above 0 to send ASTERIX"
        for radar in run.radars
        if not radar.rotation_s
    ]
    if faults:
        raise ConfigError(faults)


def write(
    path: Path, run: Scenario, config: TrackerConfig, sending: Sequence[Sending], seed: int
) -> int:
    """Write what the radars of a seeded run send, in the order in which it is received.

    Parameters
    ----------
    path : Path
        A capture if it ends with `CAPTURE`.
    run : Scenario
        All its radars turn.
    config : TrackerConfig
        Its inputs say where the radars stand.
    sending : sequence of Sending
        One per radar.

    Returns
    -------
    int
        Number of data blocks.
    """
    sent = []
    for index, own in enumerate(sending):
        line = pcap_out.Line(sender=(10, 0, 0, index + 1))
        blocks = _blocks(run, index, config.inputs[index], own, seed)
        sent += [(time_ns, block, line) for time_ns, block in blocks]
    sent.sort(key=lambda entry: entry[0])
    with path.open("wb") as stream:
        if path.suffix == CAPTURE:
            stream.write(pcap_out.header())
            stream.writelines(pcap_out.packet(*entry) for entry in sent)
        else:
            stream.writelines(block for _, block, _ in sent)
    return len(sent)


def _blocks(
    run: Scenario, index: int, layout: RadarInput, sending: Sending, seed: int
) -> Iterator[tuple[int, bytes]]:
    """Yield time of receipt, nanoseconds since the epoch, and bytes of a radar's data blocks."""
    radar, antenna = run.radars[index], run.antennas[index]
    plots, answers = plots_with_replies(run, index, layout, seed)
    time_s = plot_times(run, index, plots)
    records = _plots(answers, layout, SAC << 8 | index + 1)
    own_ns = round(sending.clock_ahead_s * 1e9) + run.bias(index).offset_ns
    end = antenna.turns_at(np.array([run.duration_s]), radar.rotation_s)[0]
    crossed = np.arange(math.ceil(antenna.begin * sending.sectors), int(end * sending.sectors) + 1)
    times_s = antenna.times_at(crossed / sending.sectors, radar.rotation_s)
    edges = np.searchsorted(time_s, times_s)
    for number, passed_s, row, last in zip(
        crossed.tolist(), times_s.tolist(), [0, *edges.tolist()], edges.tolist(), strict=False
    ):
        passed_ns = run.ns_after(passed_s)
        if sending.services:
            azimuth = FULL_TURN * (number % sending.sectors) / sending.sectors
            service = plots_out.service_block(
                SAC << 8 | index + 1, passed_ns + own_ns, azimuth, radar.rotation_s
            )
            yield passed_ns + round(SERVICE_DELAY_S * 1e9), service
        for begin in range(row, last, sending.plots):
            some = range(begin, min(begin + sending.plots, last))
            timed = [(run.ns_after(float(time_s[k])) + own_ns, records[k]) for k in some]
            near = [entry for entry in timed if entry[1].distance <= plots_out.FARTHEST]
            for block in plots_out.plot_blocks(near):
                yield passed_ns + round(sending.delay_s * 1e9), block


def _plots(found: Detections, layout: RadarInput, number: int) -> list[Plot]:
    """Return plots as a radar measures and sends them."""
    above = np.full(len(found), np.nan) if found.height is None else found.height
    distance, azimuth = _measured(found, above, layout)
    codes, addresses = (
        [NONE if value == UNKNOWN else int(value) for value in _of(column, len(found))]
        for column in (found.code, found.address)
    )
    kinds = [max(int(value), 0) for value in _of(found.kind, len(found))]
    heights = (above + layout.datum).tolist()
    places = zip(distance.tolist(), azimuth.tolist(), heights, strict=True)
    identities = zip(codes, addresses, kinds, strict=True)
    return [
        Plot(number, NONE, DAY, *place, *identity, math.nan, math.nan)
        for place, identity in zip(places, identities, strict=True)
    ]


def _of(column: IntArray | None, count: int) -> IntArray:
    return np.full(count, UNKNOWN) if column is None else column


def _measured(
    found: Detections, above: FloatArray, layout: RadarInput
) -> tuple[FloatArray, FloatArray]:
    """Return slant ranges, metres, and azimuths clockwise from north, radians."""
    distance, azimuth = found.measurement.T
    if layout.site is not None:
        return distance, 0.5 * math.pi - azimuth - layout.site.turned
    return np.hypot(distance, np.nan_to_num(above - layout.height)), 0.5 * math.pi - azimuth
