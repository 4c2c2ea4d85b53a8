"""Hostile input of receivers of AIS and ADS-B, beside a ship that reports as it should."""

from __future__ import annotations

import math
import random
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.transponders.stream import ReportStream, StreamSettings, columns
from phd_jdtc_ros.transponders.transmitters import MOST
from phd_jdtc_ros.transport.network import Datagram

from ..harness.figures import Found, measures, such_as

EXAMPLES = 10_000
# Longest processing time of a piece, seconds.
MOST_S = 1.0
NS = 10**9
# 2026-11-22, 10:30:00.
BEGIN_NS = (20_779 * 86_400 + 37_800) * NS
GOOD, OTHER = 211_000_001, 211_000_002
# Published examples of each format: a class A report, a name in two sentences, an aircraft.
PUBLISHED = (
    b"!AIVDM,1,1,,B,177KQJ5000G?tO`K>RA1wUbN0TKH,0*5C\r\n",
    b"!AIVDM,2,1,1,A,55?MbV02;H;s<HtKR20EHE:0@T4@Dn2222222216L961O5Gf0NSQEp6ClRp8,0*1C\r\n",
    b"!AIVDM,2,2,1,A,88888888880,2*25\r\n",
    b"\\s:2573535,c:1671533231*08\\!AIVDM,1,1,,B,15M67FC000G?ufbE`FepT@3n00Sa,0*5C\r\n",
    b"MSG,3,1,1,4CA2D6,1,2026/11/22,10:30:00.100,,,,35000,,,51.1,-0.5,,,,,,0\r\n",
    b"*8D40621D58C382D690C8AC2863A7;\r\n@00000000000A8D40621D58C386435CC412692AD6;\r\n",
    b"\x1a3\0\0\0\0\0\x01\x40\x8d\x40\x62\x1d\x58\xc3\x86\x43\x5c\xc4\x12\x69\x2a\xd6",
)


def report(mmsi: int, second: int, latitude: float = 54.5, longitude: float = 10.25) -> bytes:
    """Return the sentence of a position of class A."""
    bits = f"{1:06b}{0:02b}{mmsi:030b}{0:04b}{0:08b}{123:010b}1"
    bits += f"{round(longitude * 6e5) & 2**28 - 1:028b}{round(latitude * 6e5) & 2**27 - 1:027b}"
    bits += f"{451:012b}{47:09b}{second:06b}{0:025b}"
    values = (int(bits[k : k + 6], 2) for k in range(0, 168, 6))
    payload = "".join(chr(value + 48 + 8 * (value >= 40)) for value in values)
    body = f"AIVDM,1,1,,A,{payload},0"
    checksum = 0
    for byte in body.encode():
        checksum ^= byte
    return f"!{body}*{checksum:02X}\r\n".encode()


def new_stream() -> ReportStream:
    """Return a stream of reports as the bridge has it."""
    return ReportStream(StreamSettings(NS // 2, 10 * NS, (52.0, 4.5)))


def feed(stream: ReportStream, data: bytes, time_ns: int, source: str) -> list[str]:
    """Feed a piece, and return the faults of its clouds' columns."""
    found = [each for each in stream.feed(Datagram(data, time_ns, source)) if each is not None]
    wrong = []
    for _, batch in found:
        cloud = columns(batch)
        known = all(np.isfinite(cloud[name]).all() for name in ("latitude", "longitude", "time"))
        inside = (np.abs(cloud["latitude"]) <= 90.0).all()
        near = np.abs(cloud["time"] - time_ns * 1e-9).max() <= 60.0
        if not (known and inside and near):
            wrong.append("a place or a time that cannot be")
    return wrong


@measures(
    "AIS and ADS-B decoders on hostile input",
    "10,000 pieces: 0 errors, every report of a good ship beside them used, each below 1 s",
)
def measure(examples: int = EXAMPLES) -> Found:
    """Decode mutated pieces of all formats, and in between the reports of a ship."""
    rng, stream, outcomes = random.Random(6), new_stream(), Counter[str]()
    longest_s, good, used = 0.0, 0, 0
    for index in range(examples):
        time_ns = BEGIN_NS + index * NS // 4
        data = KINDS[index % len(KINDS)](rng)
        begin_s = time.process_time()
        outcomes.update(_tried(stream, data, time_ns, f"source {index % 5}"))
        longest_s = max(longest_s, time.process_time() - begin_s)
        if index % 8 == 0:
            good += 1
            before = _known(stream)
            sentence = report(GOOD, time_ns // NS % 60, 54.0 + index * 1e-6)
            outcomes.update(_tried(stream, sentence, time_ns, "good"))
            used += _known(stream) - before
    wrong = sum(outcomes.values())
    bounded = len(stream.transmitters.known) <= MOST
    text = (
        f"{examples:,} pieces: {wrong} errors{such_as(outcomes)}; {used:,} of {good:,} good "
        f"reports used; the longest {longest_s:.2f} s"
    )
    reached = not wrong and used == good and longest_s < MOST_S and bounded
    return text, reached, {"longest_s": longest_s, **stream.counts, **stream.formats}


def _known(stream: ReportStream) -> int:
    """Return how many reports of the good ship have been used."""
    ship = stream.transmitters.known.get((2, GOOD))
    return 0 if ship is None or ship.last is None else ship.heard


def _tried(stream: ReportStream, data: bytes, time_ns: int, source: str) -> list[str]:
    try:
        return feed(stream, data, time_ns, source)
    except Exception as error:  # Any would end a node
        return [f"{type(error).__name__}: {error}"[:120]]


def _mutated(rng: random.Random) -> bytes:
    data = bytearray(rng.choice(PUBLISHED))
    for _ in range(rng.randrange(1, 6)):
        data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data)


def _right_checksum(rng: random.Random) -> bytes:
    """Return a sentence with a random payload and a right checksum."""
    letters = bytes([*range(48, 88), *range(96, 120)]).decode()
    payload = "".join(rng.choice(letters) for _ in range(rng.choice([1, 10, 28, 28, 71, 300])))
    count = rng.choice([1, 1, 1, 2, 9])
    kind = rng.choice(["AIVDM", "AIVDM", "BSVDM", "ABVDM"])
    body = f"{kind},{count},{rng.randrange(1, count + 1)},{rng.choice(['', '3'])},A,{payload}"
    body += f",{rng.randrange(6)}"
    checksum = 0
    for byte in body.encode():
        checksum ^= byte
    return f"!{body}*{checksum:02X}\r\n".encode()


def _cut(rng: random.Random) -> bytes:
    data = b"".join(rng.choices(PUBLISHED, k=3))
    at = rng.randrange(len(data))
    return data[at : at + rng.randrange(200)]


def _noise(rng: random.Random) -> bytes:
    return rng.randbytes(rng.choice([1, 50, 3000]))


def _escapes(rng: random.Random) -> bytes:
    return bytes(rng.choices([0x1A, 0x31, 0x33, 0x0A, 0x8D], k=rng.choice([5, 500, 60_000])))


def _long(rng: random.Random) -> bytes:
    return rng.choice([b"MSG,3,", b"!AIVDM,", b"\\", b"*8D", b"1,1,"]) + b"9" * 2**16


def _numbers(rng: random.Random) -> bytes:
    """Return an SBS line with absurd numbers."""
    cells = PUBLISHED[4].decode().split(",")
    for place in (4, 6, 7, 11, 12, 13, 14, 15):
        if rng.random() < 0.4:
            cells[place] = rng.choice(["nan", "inf", "-1e308", "1e999", "", "x" * 50, "-0", "0x1"])
    return ",".join(cells).encode()


def _frame(rng: random.Random) -> bytes:
    size = rng.choice([7, 14])
    return b"*" + rng.randbytes(size).hex().encode() + b";\n"


KINDS: tuple[Callable[[random.Random], bytes], ...] = (
    *(_mutated, _right_checksum, _cut, _mutated, _right_checksum, _numbers),
    *(_noise, _escapes, _frame, _mutated, _right_checksum, _long),
)


class Case(NamedTuple):
    """Pieces of a bad receiver with their times, and the counts that they must make."""

    pieces: list[tuple[bytes, int]]
    wanted: Mapping[str, int]
    reports: int  # Reports that must be used of them


def cases() -> dict[str, Case]:
    """Return faults of receivers by name."""
    second = BEGIN_NS // NS % 60
    line = report(OTHER, second)
    ten = [
        (report(OTHER, second, 50.0 + k / 1000), BEGIN_NS + k * NS // 10_000) for k in range(10_000)
    ]
    standing = [(report(OTHER, second, 50.0 + k / 10), BEGIN_NS + k * 7 * NS) for k in range(8)]
    stale = [
        (report(OTHER, (second + 30) % 60, 50.0 + k / 10), BEGIN_NS + k * NS) for k in range(5)
    ]
    sbs, name = PUBLISHED[4], PUBLISHED[1:3]
    return {
        "split at every byte": Case([(line[k : k + 1], BEGIN_NS) for k in range(len(line))], {}, 1),
        "parts in the wrong order": Case(
            [(part, BEGIN_NS) for part in name[::-1] * 2], {"names": 2}, 0
        ),
        "a part missing": Case([(name[0], BEGIN_NS)] * 2, {"part_missing": 1}, 0),
        "wrong checksums": Case([(line[:-4] + b"00\r\n", BEGIN_NS)] * 9, {"checksum": 9}, 0),
        "MMSI 0": Case([(report(0, second), BEGIN_NS)] * 3, {"no_address": 3}, 0),
        "position 91, 181": Case(
            [(report(OTHER, second, 91.0, 181.0), BEGIN_NS)], {"no_position": 1}, 0
        ),
        "no second": Case([(report(OTHER, 60), BEGIN_NS)], {"no_time": 1}, 1),
        "a clock that stands": Case(standing, {"time_stands": 7}, 8),
        "half a minute off": Case(stale, {"time_off": 5}, 5),
        "10,000 reports in a second": Case(ten, {"too_many": 9990}, 10),
        "a line of 1 MB": Case(
            [(b"MSG,3," + b"9" * 2**20, BEGIN_NS), (b"\n" + sbs, BEGIN_NS)], {"line_too_long": 1}, 1
        ),
        "another continent": Case([(report(OTHER, second, -33.9, 151.2), BEGIN_NS)], {}, 1),
        "SBS of another zone": Case([(sbs.replace(b"10:30:00", b"21:15:00"), BEGIN_NS)], {}, 1),
        "the same from two receivers": Case(
            [(line, BEGIN_NS), (line, BEGIN_NS + NS)], {"repeated": 1}, 1
        ),
        "a stream that ends": Case([(line[:20], BEGIN_NS)], {}, 0),
        "a coast of forged ships": Case(list(_forged()), {}, 2 * MOST),
    }


def _forged() -> Iterator[tuple[bytes, int]]:
    for k in range(2 * MOST):
        time_ns = BEGIN_NS + k * NS // 1000
        yield report(300_000_000 + k, time_ns // NS % 60), time_ns


@measures(
    "bad receivers of AIS and ADS-B",
    "every fault counted by its name, the rest used, and a good ship beside them never lost",
)
def measure_receivers() -> Found:
    """Feed each fault beside a good ship, which reports before, between and behind."""
    wrong: dict[str, str] = {}
    found = cases()
    for name, case in found.items():
        stream, own = new_stream(), 0
        count = len(case.pieces)
        for index, (data, time_ns) in enumerate(case.pieces):
            if index % max(count // 5, 1) == 0:
                own += 1
                feed(stream, report(GOOD, time_ns // NS % 60, 54.0 + index * 1e-5), time_ns, "good")
            feed(stream, data, time_ns, "bad")
        used = stream.used.total() - own
        counted = {reason: stream.counts[reason] for reason in case.wanted}
        if counted != case.wanted or used != case.reports or len(stream.transmitters.known) > MOST:
            wrong[name] = f"{used} of {case.reports} used, {dict(+stream.counts)}"
    return f"{len(found)} faults: {len(wrong)} wrong{such_as(wrong)}", not wrong, {"wrong": wrong}


@measures("rate of reports", "2,000 a second on one core, through decoder, rules and clouds")
def measure_rate(seconds: float = 2.0) -> Found:
    """Feed reports of 500 ships, and count those that a second of processor time takes."""
    lines = [report(211_000_000 + k % 500, k // 50 % 60, 54.0 + k * 1e-6) for k in range(20_000)]
    stream, begin_s, fed = new_stream(), time.process_time(), 0
    while time.process_time() - begin_s < seconds:
        k = fed % len(lines)
        time_ns = BEGIN_NS + fed * NS // 50
        feed(stream, lines[k], time_ns, "x")
        fed += 1
    rate = fed / (time.process_time() - begin_s)
    return f"{rate:,.0f} a second of CPU", rate >= 2000.0 and math.isfinite(rate), {"rate": rate}
