"""Bags to ASTERIX: estimates as CAT062 and CAT065, or detections as CAT048 and CAT034."""

from __future__ import annotations

import contextlib
import heapq
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from msg_adapters import interfaces, names
from msg_adapters.errors import RejectedMessageError
from msg_adapters.readers import reader_of
from phd_jdtc_ros.asterix.call_signs import CallSigns
from phd_jdtc_ros.asterix.messages import COMBINED, DAY, NONE, PRIMARY, Plot
from phd_jdtc_ros.asterix.writing import plots as plots_out
from phd_jdtc_ros.asterix_bridge import clouds, settings
from phd_jdtc_ros.asterix_bridge.settings import Bridge
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.intake.turns import Turns
from phd_jdtc_ros.core.sensors.slant_range import supposed_height
from phd_jdtc_ros.core.types import FULL_TURN, UNKNOWN, Coverage, Detections

# SAC of radars that have no name in the bridge's parameters; their SIC is their place, from 1.
OWN_SAC = 1


@dataclass
class Written:
    """What became of a bag.

    Parameters
    ----------
    what : str
        Of the records, in the plural.
    records, blocks, clouds : int
        Written, and the clouds that they are of.
    dropped : Counter
        Clouds that were left out, by reason, and ``range``: plots farther away than CAT048 can say.
    offered : int
        Clouds, those left out too.
    """

    what: str
    records: int = 0
    blocks: int = 0
    clouds: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    offered: int = 0

    @property
    def used(self) -> float:
        """Share of the bag's clouds that were used; 1 of none."""
        return self.clouds / self.offered if self.offered else 1.0


def bridge_parameters(config: TrackerConfig) -> dict[str, Any]:
    """Return the parameters with which a bridge makes the clouds that a tracker is configured for.

    The radars' numbers are those that `asterix_bridge BAG --plots` gives them. Tracks are sent with
    each cloud of estimates and of its time, so that they are the same however fast the demo is.
    """
    values: dict[str, Any] = {"radars": [radar.name for radar in config.inputs]}
    for number, radar in enumerate(config.inputs, start=1):
        values[f"{radar.name}.source"] = [OWN_SAC, number]
        if radar.sectors:
            values[f"{radar.name}.sectors"] = radar.sectors
        # `--plots` writes the plots of a sector before its crossing.
        values[f"{radar.name}.hold_sectors"] = 0
    values["output_period_s"] = 0.0
    if config.values["world_origin"]:
        values["world_origin"] = list(config.values["world_origin"])
    return values


def write_tracks(
    bag: BagReader, out: Path, bridge: Bridge, topic: str, radars: Sequence[str]
) -> Written:
    """Write the estimates of a bag as CAT062 and CAT065, each period those of its end.

    In a gap, which may be long, outputs go on until all tracks have ended.

    Parameters
    ----------
    topic : str
        Of the estimates.
    radars : sequence of str
        Topics of all radars; the clouds that are in the bag may have call signs.

    Raises
    ------
    BagError
        If the bag has no estimates on the topic.
    """
    bag.require({topic: names.CLOUD})
    call_signs = CallSigns()
    output = settings.output_of(bridge, len(radars) == 1, call_signs)
    heard = [radar for radar in radars if bag.types.get(radar) == names.CLOUD]
    period_ns = round(bridge.values["output_period_s"] * 1e9)
    last_ns = round(settings.MAX_PREDICTION_S * 1e9) + period_ns
    done = Written("tracks")
    due_ns: int | None = None
    with out.open("wb") as stream:

        def put(time_ns: int) -> None:
            found = output.datagrams(time_ns)
            done.blocks += len(found)
            stream.writelines(found)

        for entry in bag.messages([topic, *heard]):
            if entry.topic != topic:
                # One that cannot be read has none; that it is damaged is for its reader to say.
                with contextlib.suppress(RejectedMessageError):
                    clouds.learn_call_signs(interfaces.decode(entry.data, names.CLOUD), call_signs)
                continue
            if due_ns is not None and entry.stamp_ns < output.stamp_ns:  # of a new run
                put(due_ns)
                due_ns = None
            # The estimates before this one's time are those to predict.
            while due_ns is not None and due_ns < entry.stamp_ns:
                put(due_ns)
                due_ns += period_ns
                if due_ns - output.stamp_ns > last_ns:
                    due_ns = -(-entry.stamp_ns // period_ns) * period_ns
            done.offered += 1
            try:
                output.take(interfaces.decode(entry.data, names.CLOUD))
            except RejectedMessageError as error:
                done.dropped[error.reason] += 1
                continue
            done.clouds += 1
            if not period_ns:
                put(entry.stamp_ns)
            elif due_ns is None:
                due_ns = -(-entry.stamp_ns // period_ns) * period_ns
        if due_ns is not None:
            put(due_ns)
    done.records = output.tracks
    return done


def write_plots(bag: BagReader, out: Path, config: TrackerConfig, bridge: Bridge) -> Written:
    """Write the detections of a bag as CAT048, and how the antennas turn as CAT034.

    Raises
    ------
    BagError
        If the bag lacks a radar's topic.
    """
    bag.require({radar.topic: reader_of(radar).type_name for radar in config.inputs})
    done = Written("plots")
    numbers = {settings.name: number for number, settings in bridge.radars.items()}
    radars = [
        _Radar(
            config,
            index,
            numbers.get(radar.name, OWN_SAC << 8 | index + 1),
            bridge.amplitudes(radar.name if radar.name in numbers else "").noise_dbm,
        )
        for index, radar in enumerate(config.inputs)
    ]
    with out.open("wb") as stream:
        parts = [_ordered(radar.blocks(bag, done)) for radar in radars]
        for _, block in heapq.merge(*parts, key=lambda part: part[0]):
            stream.write(block)
            done.blocks += 1
    return done


def _ordered(parts: Iterable[tuple[int, bytes]]) -> Iterator[tuple[int, bytes]]:
    """Yield blocks with times that do not fall, so that they can be merged."""
    latest = 0
    for time_ns, block in parts:
        latest = max(latest, time_ns)
        yield latest, block


class _Radar:
    """The detections of a radar as data blocks."""

    def __init__(self, config: TrackerConfig, index: int, number: int, noise_dbm: float) -> None:
        self._input = config.inputs[index]
        self._site = self._input.site
        # On the earth, azimuths are from true north, and not from the map's.
        site = self._site
        self._yaw = config.model.radars[index].yaw if site is None else site.turned
        self._turns: Turns = config.turns()[index]
        self._number = number
        self._noise_dbm = noise_dbm

    def blocks(self, bag: BagReader, done: Written) -> Iterator[tuple[int, bytes]]:
        """Yield time and bytes of data blocks, in the order in which the radar would send them."""
        for entry in bag.messages([self._input.topic]):
            done.offered += 1
            try:
                report = reader_of(self._input).from_cdr(entry.data, self._input)
            except RejectedMessageError as error:
                done.dropped[error.reason] += 1
                continue
            pieces = self._turns.split(report.stamp_ns, report.detections, report.sector)
            if isinstance(pieces, Rejection):
                done.dropped[pieces.value] += 1
                continue
            done.clouds += 1
            for stamp_ns, piece in pieces:
                plots = self._plots(stamp_ns, piece)
                near = [entry for entry in plots if entry[1].distance <= plots_out.FARTHEST]
                done.dropped["range"] += len(plots) - len(near)
                done.records += len(near)
                yield from self._of_piece(stamp_ns, near, piece.coverage)

    def _of_piece(
        self, stamp_ns: int, plots: list[tuple[int, Plot]], coverage: Coverage | None
    ) -> Iterator[tuple[int, bytes]]:
        end_ns, azimuth = stamp_ns, 0.0
        if coverage is not None:
            # Clockwise, as radars turn, an antenna leaves a sector where it begins here.
            azimuth = 0.5 * math.pi - coverage.start - self._yaw
            part = 0.5 * coverage.width / FULL_TURN
            end_ns += round(part * self._input.rotation_s * 1e9)
        for block in plots_out.plot_blocks(plots):
            yield end_ns, block
        if coverage is None or coverage.turns:
            turn_s = self._input.rotation_s
            yield end_ns, plots_out.service_block(self._number, end_ns, azimuth, turn_s)

    def _plots(self, stamp_ns: int, found: Detections) -> list[tuple[int, Plot]]:
        count = len(found)

        def column(values: Any, unknown: float) -> list[Any]:
            return list(np.full(count, unknown) if values is None else values)

        height = np.array(column(found.height, math.nan)) + self._input.datum
        slant, azimuth = self._measured(found.measurement, height)
        plots = []
        for row, (time_s, level, code, address, kind) in enumerate(
            zip(
                column(found.time_s, 0.0),
                column(found.amplitude, math.nan),
                column(found.code, UNKNOWN),
                column(found.address, UNKNOWN),
                column(found.kind, UNKNOWN),
                strict=True,
            )
        ):
            answered = code != UNKNOWN or address != UNKNOWN
            supposed = COMBINED if answered else PRIMARY
            dbm = math.nan
            if level > 0.0:
                dbm = 20.0 * math.log10(level / math.sqrt(2.0)) + self._noise_dbm
            plot = Plot(
                self._number,
                NONE,
                DAY,
                float(slant[row]),
                0.5 * math.pi - float(azimuth[row]) - self._yaw,
                float(height[row]),
                NONE if code == UNKNOWN else int(code),
                NONE if address == UNKNOWN else int(address),
                supposed if kind == UNKNOWN else int(kind),
                dbm,
                math.nan,
            )
            plots.append((stamp_ns + round(time_s * 1e9), plot))
        return plots

    def _measured(
        self, measurement: FloatArray, height: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return slant ranges and azimuths of detections at heights, metres, NaN where unknown."""
        distance, azimuth = measurement.T
        if self._site is None:
            above = height - self._input.datum - self._input.height
            return np.hypot(distance, np.nan_to_num(above)), azimuth
        supposed = supposed_height(self._site, self._input.assumed_height, distance)
        return self._site.to_slant(distance, azimuth, np.where(np.isnan(height), supposed, height))
