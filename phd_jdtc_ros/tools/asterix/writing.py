"""Bags and simulated runs to ASTERIX: tracks as CAT062 and 065, plots as CAT048 and CAT034."""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from msg_adapters.encoding import RejectedMessageError, interfaces, names
from msg_adapters.incoming.readers import learn_call_signs_from_cdr, reader_of
from phd_jdtc_ros import output_files
from phd_jdtc_ros.asterix import writing as plots_out
from phd_jdtc_ros.asterix.messages import COMBINED, DAY, NONE, PRIMARY, CallSigns, Plot
from phd_jdtc_ros.asterix_bridge.clouds import NOISE_DBM
from phd_jdtc_ros.asterix_bridge.configuration import Bridge
from phd_jdtc_ros.asterix_bridge.tracks import MAX_PREDICTION_S, TrackOutput, track_output
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.columns import ground_ranges
from phd_jdtc_ros.columns.sent_columns import fill
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.intake.revolutions import Revolutions
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.types import FULL_TURN, UNKNOWN, Coverage, Detections
from phd_jdtc_ros.simulation.antenna import Sending
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.turning_antenna import TurningRadar, plots_with_replies
from phd_jdtc_ros.transport import pcap

# SAC of radars without an identifier in the bridge's parameters; their SIC is their index from 1.
OWN_SAC = 1


@dataclass
class ConversionCounts:
    """The counts of a conversion to ASTERIX."""

    what: str  # Name of the records, in the plural
    records: int = 0
    blocks: int = 0  # Data blocks
    clouds: int = 0  # Number of clouds that were used
    dropped: Counter[str] = field(default_factory=Counter)  # Unused clouds by reason
    out_of_range: int = 0  # Plots beyond the largest range of CAT048, which are left out

    @property
    def used(self) -> float:
        """Share of the bag's clouds that were used; 1 if it has none."""
        offered = self.clouds + self.dropped.total()
        return self.clouds / offered if offered else 1.0


def bridge_parameters(config: TrackerConfig) -> dict[str, Any]:
    """Return parameters of a bridge whose clouds have the layout of a tracker's configuration.

    The radars have the identifiers that `asterix_bridge BAG --plots` gives them. Tracks are sent
    with each cloud of estimates, at its stamp, so that they do not depend on the demo's speed.
    """
    values: dict[str, Any] = {"radars": [radar.name for radar in config.radars]}
    for number, radar in enumerate(config.radars, start=1):
        values[f"{radar.name}.source"] = [OWN_SAC, number]
        if radar.sectors:
            values[f"{radar.name}.sectors"] = radar.sectors
        # `--plots` writes the plots of a sector before its crossing.
        values[f"{radar.name}.hold_sectors"] = 0
    values["output_period_s"] = 0.0
    if config.known_plane is not None:
        values["world_origin"] = list(config.values["world_origin"])
    return values


def write_tracks(
    bag: BagReader, out: Path, bridge: Bridge, topic: str, config: TrackerConfig
) -> ConversionCounts:
    """Write the estimates of a bag as CAT062 and CAT065, predicted to the end of each period.

    In a gap, which may be long, outputs continue until all tracks have ended. `topic` is that of
    the estimates. The clouds of all radars of the tracker's configuration may have call signs.
    """
    bag.require({topic: names.CLOUD})
    call_signs, radars = CallSigns(), [radar.topic for radar in config.inputs]
    output = track_output(bridge, len(radars) == 1, call_signs)
    output.modes = config.model.modes
    recorded = [radar for radar in radars if bag.types.get(radar) == names.CLOUD]
    period_ns = round(bridge.values["output_period_s"] * 1e9)
    done = ConversionCounts("tracks")
    with output_files.opened(out) as stream:
        periodic = _PeriodicOutput(output, stream, period_ns, done)
        for entry in bag.messages([topic, *recorded]):
            if entry.topic != topic:
                learn_call_signs_from_cdr(entry.data, call_signs)
                continue
            periodic.write_before(entry.stamp_ns)
            try:
                output.update(interfaces.decode(entry.data, names.CLOUD))
            except RejectedMessageError as error:
                done.dropped[error.reason] += 1
                continue
            done.clouds += 1
            periodic.schedule(entry.stamp_ns)
        periodic.finish()
    done.records = output.tracks
    return done


class _PeriodicOutput:
    """Writes tracks at multiples of a period, or with each cloud of estimates if it is zero."""

    def __init__(
        self, output: TrackOutput, stream: BinaryIO, period_ns: int, done: ConversionCounts
    ) -> None:
        self._output, self._stream, self._done = output, stream, done
        self._period_ns = period_ns
        self._max_gap_ns = round(MAX_PREDICTION_S * 1e9) + period_ns
        self._due_ns: int | None = None

    def write_before(self, stamp_ns: int) -> None:
        """Write what is due before a cloud, predicted from the estimates before it.

        A cloud that is older than these begins a new run.
        """
        if stamp_ns < self._output.stamp_ns:
            self.finish()
        while self._due_ns is not None and self._due_ns < stamp_ns:
            self._write(self._due_ns)
            self._due_ns += self._period_ns
            if self._due_ns - self._output.stamp_ns > self._max_gap_ns:
                self._due_ns = self._multiple_from(stamp_ns)

    def schedule(self, stamp_ns: int) -> None:
        """Write tracks with a cloud, or schedule the first output of a run."""
        if not self._period_ns:
            self._write(stamp_ns)
        elif self._due_ns is None:
            self._due_ns = self._multiple_from(stamp_ns)

    def finish(self) -> None:
        """Write the scheduled output, the last one of a run."""
        if self._due_ns is not None:
            self._write(self._due_ns)
            self._due_ns = None

    def _multiple_from(self, stamp_ns: int) -> int:
        """Return the first multiple of the period that is not before a stamp."""
        return -(-stamp_ns // self._period_ns) * self._period_ns

    def _write(self, stamp_ns: int) -> None:
        blocks = self._output.datagrams(stamp_ns)
        self._done.blocks += len(blocks)
        self._stream.writelines(blocks)


def write_plots(
    bag: BagReader, out: Path, config: TrackerConfig, bridge: Bridge
) -> ConversionCounts:
    """Write the detections of a bag as CAT048, and the antennas' rotation as CAT034."""
    bag.require({radar.topic: reader_of(radar).type_name for radar in config.radars})
    done = ConversionCounts("plots")
    numbers = {radar.name: number for number, radar in bridge.radars.items()}
    radars = [
        _Radar(
            config,
            index,
            numbers.get(radar.name, OWN_SAC << 8 | index + 1),
        )
        for index, radar in enumerate(config.radars)
    ]
    with output_files.opened(out) as stream:
        parts = [radar.blocks(bag, done) for radar in radars]
        for _, block in heapq.merge(*parts, key=lambda part: part[0]):
            stream.write(block)
            done.blocks += 1
    return done


class _Radar:
    """The detections of a radar as data blocks."""

    def __init__(self, config: TrackerConfig, index: int, number: int) -> None:
        self._input = config.radars[index]
        # On the earth, azimuths are from true north, and not from the map's.
        site = self._input.site
        self._yaw = config.model.radars[index].yaw if site is None else site.yaw_from_east
        self._revolutions: Revolutions = config.revolutions()[index]
        self._number = number

    def blocks(self, bag: BagReader, done: ConversionCounts) -> Iterator[tuple[int, bytes]]:
        """Yield ascending times, and bytes of data blocks as the radar would send them."""
        latest_ns = 0
        for entry in bag.messages([self._input.topic]):
            try:
                report = reader_of(self._input).from_cdr(entry.data, self._input)
            except RejectedMessageError as error:
                done.dropped[error.reason] += 1
                continue
            slices = self._revolutions.split(report.stamp_ns, report.detections, report.sector)
            if isinstance(slices, Rejection):
                done.dropped[slices.value] += 1
                continue
            done.clouds += 1
            for stamp_ns, cut in slices:
                plots = self._plots(stamp_ns, cut)
                near = [entry for entry in plots if entry[1].distance <= plots_out.FARTHEST]
                done.out_of_range += len(plots) - len(near)
                done.records += len(near)
                for time_ns, block in self._blocks_of_slice(stamp_ns, near, cut.coverage):
                    latest_ns = max(latest_ns, time_ns)
                    yield latest_ns, block

    def _blocks_of_slice(
        self, stamp_ns: int, plots: list[tuple[int, Plot]], coverage: Coverage | None
    ) -> Iterator[tuple[int, bytes]]:
        end_ns, azimuth = stamp_ns, 0.0
        if coverage is not None:
            # The antenna turns clockwise, so it leaves the sector at its counter-clockwise start.
            azimuth = 0.5 * math.pi - coverage.start - self._yaw
            part = 0.5 * coverage.width / FULL_TURN
            end_ns += round(part * self._input.rotation_s * 1e9)
        for block in plots_out.plot_blocks(plots):
            yield end_ns, block
        if coverage is None or coverage.part_of_revolution:
            revolution_s = self._input.rotation_s
            yield end_ns, plots_out.service_block(self._number, end_ns, azimuth, revolution_s)

    def _plots(self, stamp_ns: int, found: Detections) -> list[tuple[int, Plot]]:
        above = fill(found.height, len(found), math.nan)
        slant, azimuth = ground_ranges.measure(replace(found, height=above), self._input)
        azimuth, height = 0.5 * math.pi - azimuth - self._yaw, above + self._input.datum
        plots = plots_of(found, self._number, slant, azimuth, height, NOISE_DBM)
        own_s = fill(found.time_s, len(found), 0.0).tolist()
        return [
            (stamp_ns + round(time_s * 1e9), plot)
            for time_s, plot in zip(own_s, plots, strict=True)
        ]


def plots_of(
    found: Detections,
    number: int,
    slant: FloatArray,
    azimuth: FloatArray,
    height: FloatArray,
    noise_dbm: float = math.nan,
) -> list[Plot]:
    """Return the plots of detections of the radar with an identifier, 256 SAC + SIC.

    Slant ranges and heights (NaN: unknown) are in metres, and azimuths in radians clockwise from
    north. A noise level of NaN leaves amplitudes out.
    """
    code, address, detection_type = (
        fill(column, len(found), UNKNOWN).astype(int)
        for column in (found.code, found.address, found.detection_type)
    )
    replied = (code != UNKNOWN) | (address != UNKNOWN)
    detection_type = np.where(
        detection_type != UNKNOWN, detection_type, np.where(replied, COMBINED, PRIMARY)
    )
    level = fill(found.amplitude, len(found), math.nan)
    dbm = np.full(len(found), math.nan)
    seen = level > 0.0
    dbm[seen] = 20.0 * np.log10(level[seen] / math.sqrt(2.0)) + noise_dbm
    # Absent codes and addresses are -1 in detections and in plots.
    columns = (
        slant,
        azimuth,
        height,
        code,
        address,
        detection_type,
        dbm,
        np.full(len(found), math.nan),
    )
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [Plot(number, NONE, DAY, *row) for row in rows]


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
