"""Hostile ASTERIX: mutated datagrams and recordings are used or counted, and nothing else."""

from __future__ import annotations

import math
import random
import struct
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from phd_jdtc_ros.asterix import framing
from phd_jdtc_ros.asterix import writing as plots_out
from phd_jdtc_ros.asterix.messages import DAY, NONE, Plot
from phd_jdtc_ros.asterix.plot_stream import MAX_RADARS, PlotStream
from phd_jdtc_ros.asterix_bridge.clouds import columns
from phd_jdtc_ros.transponders import stream
from phd_jdtc_ros.transponders.stream import Batch
from phd_jdtc_ros.transport.network import RecordingError

from ..harness.figures import Found, measures

EXAMPLES = 10_000
# Longest processing time and largest size of a datagram.
MOST_S = 1.0
LARGEST = 65_507
NS = 10**9
ROTATION_S, SECTORS = 4.0, 32


@measures(
    "ASTERIX decoder on hostile input",
    "10,000 datagrams and recordings: 0 errors, 0 silent losses, 0 NaN, each below 1 s",
)
def measure(examples: int = EXAMPLES) -> Found:
    """Decode mutated datagrams and recordings."""
    rng = random.Random(4)
    outcomes: Counter[str] = Counter()
    worst_s = 0.0
    good = radar_datagrams(rng)
    stream = PlotStream({})
    for index in range(examples):
        data = KINDS[index % len(KINDS)](good, rng)[:LARGEST]
        begin = time.process_time()
        if index % 10:
            outcomes[_of_datagram(stream, data, index)] += 1
        else:
            outcomes[_of_recording(data)] += 1
        worst_s = max(worst_s, time.process_time() - begin)
    wrong = sum(n for what, n in outcomes.items() if what.startswith(("error", "NaN", "silent")))
    bounded = len(stream.radars) <= MAX_RADARS
    text = (
        f"{examples:,} examples: {wrong} errors, silent losses or NaN; "
        f"{outcomes['used']:,} used, {outcomes['counted']:,} counted; the longest {worst_s:.2f} s"
    )
    details = {
        **outcomes,
        "longest_s": worst_s,
        **{f"reason {k}": n for k, n in stream.counts.items()},
    }
    reached = not wrong and outcomes["used"] > 0 and bounded and worst_s < MOST_S
    return text, reached, details


def _of_datagram(stream: PlotStream, data: bytes, index: int) -> str:
    """Return the outcome of a datagram; each comes a tick later from one of three senders."""
    counted, taken = _fault_counts(stream), _used_count(stream)
    try:
        found = stream.feed(data, 10**18 + index * NS // 8, f"10.0.0.{index % 3} to group")
        faults = [_fault(state.settings.sectors, report) for state, report in found]
    except Exception as error:  # Any exception would end a node
        return f"error: {type(error).__name__}: {error}"[:120]
    if any(faults):
        return "NaN"
    if _used_count(stream) > taken:
        return "used"
    return "counted" if _fault_counts(stream) != counted or not data else "silent"


def _of_recording(data: bytes) -> str:
    """Return the outcome of a recording."""
    counts: Counter[str] = Counter()
    stream = PlotStream({})
    try:
        for received in framing.datagrams(data, None, counts):
            stream.feed(*received)
    except RecordingError:
        return "counted"
    except Exception as error:
        return f"error: {type(error).__name__}: {error}"[:120]
    if _used_count(stream):
        return "used"
    return "counted" if counts.total() + sum(_fault_counts(stream)) else "silent"


def _used_count(stream: PlotStream) -> int:
    """Return the number of messages that were used, or wait until their radar's clock is known."""
    return sum(s.plots + s.positions + s.services + len(s.waiting) for s in stream.radars.values())


def _fault_counts(stream: PlotStream) -> tuple[int, int]:
    """Return the numbers of counted faults and of known trailers."""
    of_radars = sum(state.counts.total() for state in stream.radars.values())
    return stream.counts.total() + of_radars, stream.blocks.trailers.total()


def _fault(sectors: int, report: Any) -> bool:
    """Return whether a mandatory number is not finite."""
    if isinstance(report, Batch):
        found, mandatory = stream.columns(report, True), ("latitude", "longitude", "time")
    else:
        found, mandatory = columns(report, sectors), ("range", "azimuth", "time")
    return not all(np.isfinite(found[name]).all() for name in mandatory)


def radar_datagrams(rng: random.Random) -> list[bytes]:
    """Return the datagrams of a revolution of three radars."""
    return [b"".join(blocks) for blocks in _by_sector(rng)]


def radar_blocks(rng: random.Random) -> list[bytes]:
    """Return the data blocks of a revolution of three radars."""
    return [block for blocks in _by_sector(rng) for block in blocks]


def _by_sector(rng: random.Random) -> Iterator[list[bytes]]:
    for sector in range(SECTORS):
        for radar in (0x0101, 0x0102, 0x1907):
            time_ns = round((sector + 1) / SECTORS * ROTATION_S * NS)
            azimuth = (sector + 1) / SECTORS * 2.0 * math.pi
            plots = [
                (time_ns, _plot(radar, azimuth - rng.uniform(0.0, 0.19), rng))
                for _ in range(rng.randrange(4))
            ]
            crossing = plots_out.service_block(radar, time_ns, azimuth, ROTATION_S)
            yield [*plots_out.plot_blocks(plots), crossing]


def _plot(radar: int, azimuth: float, rng: random.Random) -> Plot:
    code, address = rng.choice([NONE, 0, 0o7777]), rng.choice([NONE, 1, 2**24 - 1])
    distance, height = rng.uniform(0.0, 4e5), rng.choice([math.nan, -304.8, 12_000.0])
    identity = code, address, rng.randrange(1, 8)
    return Plot(radar, NONE, DAY, distance, azimuth, height, *identity, -60.0, -70.0)


def _positions(good: list[bytes], rng: random.Random) -> bytes:
    """Return a record of positions with usual items, and random bytes in them."""
    usual = {20: b"\xf5\x14", 21: b"\xdb\x19\x03", 10: b"\xb1\x04", 62: b"\x9d\x0d\x04"}
    category = rng.choice([*usual])
    body = usual[category] + rng.randbytes(rng.randrange(20, 80))
    return struct.pack(">BH", category, len(body) + 3) + body


def _mutate(good: list[bytes], rng: random.Random) -> bytes:
    data = bytearray(rng.choice(good))
    for _ in range(rng.randrange(1, 6)):
        data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data)


def _cut(good: list[bytes], rng: random.Random) -> bytes:
    data = rng.choice(good)
    at = rng.randrange(len(data))
    return data[:at] + rng.randbytes(rng.randrange(8)) + data[at + rng.randrange(8) :]


def _join(good: list[bytes], rng: random.Random) -> bytes:
    return b"".join(_mutate(good, rng) for _ in range(rng.randrange(1, 20)))


def _claim(good: list[bytes], rng: random.Random) -> bytes:
    """Return random bytes under the header of a category, with any length."""
    body = rng.randbytes(rng.randrange(300))
    length = rng.choice([len(body) + 3, rng.randrange(2**16), 0, 3, 2**16 - 1])
    return (
        struct.pack(">BH", rng.choice([1, 2, 10, 20, 21, 21, 34, 48, 48, 48, 62, 255]), length)
        + body
    )


def _chain(good: list[bytes], rng: random.Random) -> bytes:
    """Return a block with an endless field specification or item."""
    size = rng.choice([20, 2000, LARGEST])
    head = rng.choice([b"", b"\x20", b"\x80\x01\x02\x20", b"\x02\x02", b"\x02\xfe"])
    body = (head + b"\xff" * size)[: size - 3]
    return struct.pack(">BH", rng.choice([1, 20, 21, 34, 48, 62]), len(body) + 3) + body


def _endless(good: list[bytes], rng: random.Random) -> bytes:
    """Return a block of 64 kB of the smallest records there are, with plots or without."""
    record = rng.choice([b"\x00", b"\x80\x01\x02", b"\x90\x01\x02\x10\x00\x20\x00", b"\x01\x00"])
    body = record * ((LARGEST - 3) // len(record) // rng.choice([1, 50, 500]))
    return struct.pack(">BH", rng.choice([34, 48]), len(body) + 3) + body


def _many_radars(good: list[bytes], rng: random.Random) -> bytes:
    radar = rng.randrange(2**16)
    return plots_out.service_block(radar, rng.randrange(86_400) * NS, 0.0, 0.0)


def _noise(good: list[bytes], rng: random.Random) -> bytes:
    return rng.randbytes(rng.randrange(1, 400))


# Half of them resemble a radar's datagrams.
KINDS: tuple[Callable[[list[bytes], random.Random], bytes], ...] = (
    *(_mutate, _cut, _join, _mutate, _cut, _join, _mutate),
    *(_claim, _chain, _many_radars, _noise, _claim, _mutate, _positions, _positions),
    *(_endless,),
)
