"""The ASTERIX bridge: plots per second on one core, beside libasterix alone, and its latency."""

from __future__ import annotations

import math
import random
import time
from collections import Counter
from statistics import median
from typing import Any

import numpy as np

from phd_jdtc_ros.asterix import plot_stream
from phd_jdtc_ros.asterix import writing as plots_out
from phd_jdtc_ros.asterix import writing as tracks_out
from phd_jdtc_ros.asterix.messages import DAY, NONE, Plot
from phd_jdtc_ros.asterix.plot_stream import PlotStream
from phd_jdtc_ros.asterix.writing import Source, TrackReport

from . import asterix_latency

NS = 10**9
# Plots of a revolution, which is cut in sectors, and of a data block at most.
PLOTS, SECTORS, ROTATION_S = 2048, 32, 4.0
TRACKS = 100
LIBRARY, RECORDS, CLOUDS = "libasterix alone", "to plots", "to clouds"


def measure(quick: bool) -> dict[str, Any]:
    """Return plots per second by how far they are read, and the time and the way of tracks."""
    datagrams = revolution()
    rounds = 3 if quick else 9
    cases = {LIBRARY: _by_library, RECORDS: _to_plots, CLOUDS: _to_clouds}
    # The library is a hundred times slower, so that a part of the revolution suffices.
    share = {LIBRARY: datagrams[: len(datagrams) // 16]}
    spent: dict[str, list[float]] = {name: [] for name in cases}
    for name, read in cases.items():
        read(share.get(name, datagrams)[:2])
    for _ in range(rounds):
        for name, read in cases.items():
            given = share.get(name, datagrams)
            begin = time.process_time()
            count = read(given)
            spent[name].append(count / (time.process_time() - begin))
    return {
        "plots_per_s": {name: median(rates) for name, rates in spent.items()},
        "tracks_ms": median(_tracks_ms() for _ in range(10 * rounds)),
        "live": asterix_latency.measure(quick),
    }


def revolution() -> list[bytes]:
    """Return the datagrams of a revolution: each sector's plots, with all items, and crossing."""
    rng = random.Random(1)
    found = [plots_out.service_block(0x0102, 0, 0.0, ROTATION_S)]
    for sector in range(SECTORS):
        plots = []
        for _ in range(PLOTS // SECTORS):
            turned = (sector + rng.random()) / SECTORS
            place = rng.uniform(1e3, 4e5), 2.0 * math.pi * turned, 7.62 * rng.randrange(1600)
            identity = rng.randrange(2**12), rng.randrange(1, 2**24), 5
            plot = Plot(0x0102, NONE, DAY, *place, *identity, math.nan, -60.0)
            plots.append((round(turned * ROTATION_S * NS), plot))
        found += plots_out.plot_blocks(plots)
        end = (sector + 1) / SECTORS
        time_ns = round(end * ROTATION_S * NS)
        found.append(plots_out.service_block(0x0102, time_ns, 2.0 * math.pi * end, ROTATION_S))
    return found


def _by_library(datagrams: list[bytes]) -> int:
    """Parse plots with libasterix, read a value of each, and return their number."""
    from asterix import base, generated

    uaps = {number: generated.manifest["CATS"][number][-1].cv_uap for number in (34, 48)}
    count = 0
    for data in datagrams:
        rest = base.Bits.from_bytes(data)
        while len(rest):
            block, rest = base.RawDatablock.parse_single(rest)
            found = uaps[block.get_category()].parse(block.get_raw_records())
            for record in found if block.get_category() == 48 else ():
                record.get_item("040").variation.get_item("RHO").as_uint()
                count += 1
    return count


def _to_plots(datagrams: list[bytes]) -> int:
    counts: Counter[str] = Counter()
    found = sum(len(list(plot_stream.BlockReader(counts).messages(data))) for data in datagrams)
    # Each datagram without plots is a service message.
    return found - sum(data[0] == 34 for data in datagrams)


def _to_clouds(datagrams: list[bytes]) -> int:
    from phd_jdtc_ros.asterix_bridge.clouds import cloud_of

    stream, count = PlotStream({}), 0
    for data in datagrams:
        for state, report in stream.feed(data):
            cloud = cloud_of(report, state)
            count += cloud.width
    for state, report in stream.finish():
        cloud = cloud_of(report, state)
        count += cloud.width
    return count


def _tracks_ms() -> float:
    """Return the CPU milliseconds of writing all tracks once."""
    values = np.linspace(0.0, 1.0, TRACKS)
    tracks = [
        TrackReport(
            number,
            (1e5 * value, -1e5 * value),
            (200.0, -100.0),
            (52.0 + value, 4.0 - value),
            1e4 * value,
            5.0,
            number,
            number + 1,
            coasting=number % 5 == 0,
            height_std=10.0,
            climb_std=1.0,
        )
        for number, value in enumerate(map(float, values))
    ]
    source = Source(1, 2)
    begin = time.process_time()
    tracks_out.track_blocks(tracks, 0, source)
    return 1e3 * (time.process_time() - begin)
