"""What the tools share that make bags of clouds from recordings."""

from __future__ import annotations

import argparse
import csv
import io
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import interfaces, names
from phd_jdtc_ros import output_files
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.writer import BagWriter, Topic
from phd_jdtc_ros.exit_status import CORRUPT, OK, ArgumentParser
from phd_jdtc_ros.quoting import counted, short
from phd_jdtc_ros.transport import network, pcap
from phd_jdtc_ros.transport.network import Datagram, RecordingError


@dataclass
class CloudWriter:
    """Writes clouds into a bag, whose topics it adds when they are needed."""

    DEPTH = 50

    bag: BagWriter
    topics: set[str] = field(default_factory=set)
    newest_ns: int = 0  # Newest stamp
    disorder_ns: int = 0  # Largest time by which a cloud was behind the newest stamp before it

    def write(self, topic: str, cloud: PointCloud2, stamp_ns: int) -> None:
        """Write a cloud at its stamp."""
        if topic not in self.topics:
            self.bag.add_topic(Topic(topic, names.CLOUD, self.DEPTH))
            self.topics.add(topic)
        self.bag.write(topic, interfaces.encode(cloud), stamp_ns)
        self.disorder_ns = max(self.disorder_ns, self.newest_ns - stamp_ns)
        self.newest_ns = max(self.newest_ns, stamp_ns)


@dataclass
class Ports:
    """The UDP ports of a capture."""

    wanted: frozenset[int]  # Those that are read; empty for all
    seen: Counter[int] = field(default_factory=Counter)  # Captured datagrams by port

    def pass_on(self, received: Iterator[Datagram], counts: Counter[str]) -> Iterator[Datagram]:
        """Yield the datagrams to wanted ports; `counts` gains ``other_port``."""
        for each in received:
            port = network.port_of(each)
            if port is not None:
                self.seen[port] += 1
                if self.wanted and port not in self.wanted:
                    counts["other_port"] += 1
                    continue
            yield each

    @property
    def silent(self) -> list[int]:
        """The wanted ports without datagrams; recordings without ports are read as a whole."""
        return sorted(self.wanted - set(self.seen)) if self.seen else []

    @property
    def reads_nothing(self) -> bool:
        """Whether there are ports, and none of the wanted ones."""
        return len(self.silent) == len(self.wanted) > 0

    @property
    def silence(self) -> str:
        """The ports without datagrams, in words."""
        silent = " or ".join(map(str, self.silent))
        return f"no datagram is to port {silent}; ports with their datagrams: {most(self.seen)}"


@contextmanager
def opened(path: Path, counts: Counter[str]) -> Iterator[Any]:
    """Open a recording and yield its bytes; `counts` gains its skipped parts.

    Raise `BagError` if it is empty, or cannot be read.
    """
    try:
        with pcap.open_recording(path, counts) as data:
            if not len(data):
                why = "is empty, nothing was recorded"
                if counts["unpacking_ended"]:
                    why = "is damaged: nothing can be unpacked"
                raise BagError(f"{path}: {why}", corrupt=True)
            yield data
    except RecordingError as error:
        raise BagError(f"{path}: {error}") from error


@contextmanager
def table(
    out: Path, columns: Sequence[str]
) -> Iterator[Callable[[Iterable[Sequence[str]]], object]]:
    """Open a table of comma-separated values with a heading; the function writes rows into it."""
    with output_files.opened(out) as stream:
        lines = io.TextIOWrapper(stream, "utf-8", newline="", write_through=True)
        writer = csv.writer(lines, lineterminator="\n")
        writer.writerow(columns)
        yield writer.writerows
        lines.detach()


def ended(name: str, path: Path, lines: Iterable[str], faults: Sequence[str]) -> int:
    """Print what a tool has read of a recording, and its faults; return the exit status."""
    for line in lines:
        print(line)
    for fault in faults:
        print(f"{name}: {path}: {short(fault)}", file=sys.stderr)
    return CORRUPT if faults else OK


def most(counts: Counter[Any]) -> str:
    """Return the most frequent ports or radars with their counts, in words."""
    # Largest number of ports, or of unknown radars, in a message.
    return ", ".join(f"{name} ({count})" for name, count in counts.most_common(8))


def damage(counts: Counter[str]) -> Iterator[str]:
    """Yield a line for each way in which a recording is damaged; see `network.follow`."""
    damaged = counts["resynchronised"] + counts["recording_cut"]
    if damaged:
        places = counted(damaged, "place[s]")
        yield f"is damaged in {places}: {counts['bytes_skipped']} bytes are left out"
    if cut := counts["packet_cut"]:
        packets = counted(cut, "packet[s] that [was|were] not captured whole, and [is|are]")
        yield f"has {packets} left out: tcpdump -s 0"
    if counts["unpacking_ended"]:
        yield "cannot be unpacked to its end: what is behind the damage is missing"


def add_port_argument(parser: ArgumentParser) -> None:
    """Add the argument that selects ports of captures."""
    parser.add_argument(
        "--port",
        type=_port,
        action="append",
        default=[],
        help="for captures: read only datagrams to this UDP port; may be repeated",
    )


def _port(text: str) -> int:
    """Return a UDP port."""
    digits = text.isascii() and text.isdigit() and len(text) <= 5
    if not (digits and 0 < int(text) < 2**16):
        raise argparse.ArgumentTypeError(f"{text} given, must be a port from 1 to 65535")
    return int(text)


def day(text: str) -> int:
    """Return when a day begins, nanoseconds since the epoch."""
    return _time(text, "%Y-%m-%d", "a date such as 2026-11-22")


def moment(text: str) -> int:
    """Return a time of UTC, nanoseconds since the epoch; a date alone is its beginning."""
    form = "%Y-%m-%dT%H:%M:%S" if "T" in text else "%Y-%m-%d"
    return _time(text, form, "a time such as 2026-11-22T10:30:00")


def _time(text: str, form: str, wanted: str) -> int:
    try:
        found = datetime.strptime(text, form).replace(tzinfo=timezone.utc)
    except ValueError:
        found = None
    if found is None or found.year < 1970 or found.year > 2200:
        raise argparse.ArgumentTypeError(f"{text} given, must be {wanted}")
    return int(found.timestamp()) * 10**9
