"""Damaged recordings of ASTERIX: foreign blocks, wrong bytes and lengths, joined captures."""

from __future__ import annotations

import bisect
import itertools
import random
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from phd_jdtc_ros.asterix import framing
from phd_jdtc_ros.asterix.plot_stream import PlotStream
from phd_jdtc_ros.transport import pcap
from phd_jdtc_ros.transport.pcap import Line

from ..harness.figures import Found, measures
from .asterix_bytes import NS, ROTATION_S, SECTORS, radar_blocks

PLACES = 1000
# 2026-11-22, the day of the captures.
MIDNIGHT_NS = 20_779 * 86_400 * NS
FILE_HEADER = 24


class Damaged(NamedTuple):
    """A recording with a fault, and the data blocks that must be read of it."""

    what: str
    data: bytes
    intact: list[bytes]


@dataclass
class Tally:
    """The outcomes of damaged recordings."""

    recordings: int = 0
    intact: int = 0
    lost: int = 0
    miscounted: int = 0  # Recordings of which other bytes were left out than counted
    invented: int = 0  # Radars with several messages that are not in the recording
    worst: str = ""
    radars: set[int] = field(default_factory=set)

    def add(self, damaged: Damaged, raw: bool) -> None:
        """Read a recording and compare what was read."""
        counts: Counter[str] = Counter()
        found, stream = [], PlotStream({})
        for each in framing.datagrams(damaged.data, None, counts):
            found.append(each.data)
            stream.feed(*each)
        stream.finish()
        lost = (Counter(damaged.intact) - Counter(found)).total()
        skipped = counts["bytes_skipped"] + counts["padding_bytes"]
        exact = not raw or sum(map(len, found)) + skipped == len(damaged.data)
        invented = sum(
            state.plots + state.services > 1
            for number, state in stream.radars.items()
            if number not in self.radars
        )
        self.recordings += 1
        self.intact += len(damaged.intact)
        self.lost += lost
        self.miscounted += not exact
        self.invented += invented
        if (lost or invented or not exact) and not self.worst:
            self.worst = f"{damaged.what}: {lost} lost, {invented} invented, {dict(+counts)}"

    @property
    def found(self) -> Found:
        """The result as a measurement."""
        text = (
            f"{self.lost} of {self.intact:,} intact blocks lost in {self.recordings:,} recordings, "
            f"{self.invented} radars invented, {self.miscounted} miscounted"
        )
        reached = not (self.lost or self.invented or self.miscounted)
        return text, reached, {"worst": self.worst}


def _tally(damaged: Iterator[Damaged], raw: bool) -> Found:
    tally = Tally(radars={0x0101, 0x0102, 0x1907})
    for each in damaged:
        tally.add(each, raw)
    return tally.found


@measures(
    "foreign and damaged blocks in raw ASTERIX",
    "every intact block, 0 invented radars, the bytes left out counted exactly",
)
def measure_blocks(places: int = PLACES) -> Found:
    """Put every category between a radar's blocks, pad them, and damage a byte at many places."""
    return _tally(itertools.chain(_foreign(), _padded(), _wrong_bytes(places)), raw=True)


@measures("damaged captures", "resumed at the next packet: one lost at most, and counted")
def measure_captures() -> Found:
    """Change each bit in each length of a capture's packets, and join captures."""
    return _tally(itertools.chain(_wrong_lengths(), _joined()), raw=False)


def _foreign() -> Iterator[Damaged]:
    rng = random.Random(1)
    blocks = radar_blocks(rng)
    for category in range(1, 256):
        size = rng.choice([1, 6, 60, 600, 6000])
        header = struct.pack(">BH", category, size + 3)
        parts = [part for own in blocks for part in (own, header + rng.randbytes(size))]
        yield Damaged(f"category {category}", b"".join(parts), blocks)


def _padded() -> Iterator[Damaged]:
    blocks = radar_blocks(random.Random(2))
    for size in (2, 4, 8, 64):
        parts = [own + bytes(-len(own) % size) for own in blocks]
        yield Damaged(f"padded to {size}", b"".join(parts), blocks)


def _wrong_bytes(places: int) -> Iterator[Damaged]:
    rng = random.Random(3)
    blocks = radar_blocks(rng)
    whole = b"".join(blocks)
    ends = [*itertools.accumulate(map(len, blocks))]
    for index in range(places):
        at = rng.randrange(len(whole))
        what, part = (
            ("lost", b""),
            ("changed", bytes([whole[at] ^ rng.randrange(1, 256)])),
            ("inserted", bytes([rng.randrange(256), whole[at]])),
        )[index % 3]
        own = bisect.bisect_right(ends, at)
        intact = [*blocks[:own], *blocks[own + 1 :]]
        yield Damaged(f"byte {at} {what}", whole[:at] + part + whole[at + 1 :], intact)


def _packets(start_s: float) -> tuple[list[bytes], list[bytes]]:
    """Return the data blocks of a revolution, and the packets that carry them."""
    blocks = radar_blocks(random.Random(4))
    step_ns = round(ROTATION_S * NS / (3 * SECTORS))
    start_ns = MIDNIGHT_NS + round(start_s * NS)
    packets = [pcap.packet(start_ns + k * step_ns, own, Line()) for k, own in enumerate(blocks)]
    return blocks, packets


def _wrong_lengths() -> Iterator[Damaged]:
    blocks, packets = _packets(0.0)
    whole, at = pcap.header() + b"".join(packets), FILE_HEADER
    for index, packet in enumerate(packets[:8]):
        for bit in range(64):  # The captured and the original length
            data = bytearray(whole)
            data[at + 8 + bit // 8] ^= 1 << bit % 8
            intact = [*blocks[:index], *blocks[index + 1 :]]
            yield Damaged(f"packet {index} bit {bit}", bytes(data), intact)
        at += len(packet)


def _joined() -> Iterator[Damaged]:
    blocks, packets = _packets(0.0)
    _, later = _packets(3600.0)
    capture, second = (pcap.header() + b"".join(each) for each in (packets, later))
    yield Damaged("joined", capture + second, blocks * 2)
    for cut in range(1, len(packets[-1])):
        yield Damaged(f"joined, {cut} cut", capture[:-cut] + second, blocks[:-1] + blocks)
