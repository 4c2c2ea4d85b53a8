"""Converts recordings of AIS and ADS-B to bags or tables; without arguments it is the node."""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

from msg_adapters.encoding import names
from phd_jdtc_ros import output_files
from phd_jdtc_ros import report_bridge as settings
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.writer import BagWriter
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.exit_status import ArgumentParser
from phd_jdtc_ros.parameter_files import from_arguments
from phd_jdtc_ros.quoting import counted, counts_text
from phd_jdtc_ros.transponders.messages import ICAO, MMSI, NONE, NOT_SAID
from phd_jdtc_ros.transponders.stream import Batch, ReportStream
from phd_jdtc_ros.transponders.transmitters import Dated
from phd_jdtc_ros.transport import pcap
from phd_jdtc_ros.transport.network import Datagram

from . import command, recorded_clouds
from .recorded_clouds import CloudWriter, Ports

NAME = "report_bridge"
# Size of the pieces of a recording, bytes.
PIECE = 2**16
# The table of reports: seconds since 1970, the number of a ship in decimal and of an aircraft in
# hexadecimal digits, degrees, metres per second, metres. Unknown values are empty.
COLUMNS = (
    *("time", "network", "address", "latitude", "longitude", "speed", "course", "heading"),
    *("height", "std", "accurate", "type", "name"),
)


@dataclass
class Conversion:
    """The counts of a conversion."""

    stream: ReportStream
    ports: Ports
    recording: Counter[str] = field(default_factory=Counter)  # Skipped parts of the file, by reason
    clouds: int = 0

    @property
    def reports(self) -> int:
        """Number of reports."""
        return self.stream.used.total()

    def lines(self) -> Iterator[str]:
        """Yield what was read, and what was left out or dated otherwise, by reason."""
        for network, count in sorted(self.stream.used.items()):
            yield f"{network}: {counted(count, 'report[s]')} on {names.reports(network)}"
        known = self.stream.transmitters.known
        formats = counts_text(self.stream.formats) or "none"
        yield f"{counted(len(known), 'transmitter[s]')}; messages: {formats}"
        yield f"left out or noted: {counts_text(self.recording + self.stream.counts) or 'nothing'}"
        if self.ports.silent and not self.ports.reads_nothing:
            yield self.ports.silence

    def faults(self) -> Iterator[str]:
        """Yield a line for each reason why the recording was not used as it should be."""
        if self.ports.reads_nothing:
            yield self.ports.silence
            return
        yield from recorded_clouds.damage(self.recording)
        faulty, used = self.stream.faulty, self.reports
        # Smallest share of a recording's messages that must be used; otherwise the tool fails.
        if used and used + self.stream.counts["names"] >= 0.5 * (used + faulty):
            return
        reasons = counts_text(self.recording + self.stream.counts)
        held = f"of {self.stream.formats.total()} messages {used} could be used as reports"
        yield held + (f"; left out: {reasons}" if reasons else "")
        if self.stream.counts["time_unknown"]:
            yield "frames without times cannot be used: record Beast, @ frames, or a capture"


def main(argv: Sequence[str]) -> int:
    """Run the offline bridge."""
    return command.run(_parser(), argv, _work)


def _work(arguments: argparse.Namespace) -> int:
    path, out = Path(arguments.source), arguments.out or arguments.csv
    if arguments.out is None:
        output_files.require_new({"--csv": out})
    else:
        command.require_new("it", out)
    given = from_arguments.from_arguments(arguments.params_file, arguments.assignments, NAME)
    if not path.exists():
        raise BagError(f"{path}: no such recording")
    stream = settings.stream(settings.resolve(given), arguments.start)
    done = Conversion(stream, Ports(frozenset(arguments.port)))
    try:
        with recorded_clouds.opened(path, done.recording) as data:
            batches = _batches(data, done)
            # A recording without reports leaves nothing behind.
            if (first := next(batches, None)) is not None:
                sink = _table if arguments.out is None else _bag
                with sink(out) as write:
                    for network, batch in chain([first], batches):
                        done.clouds += 1
                        write(network, batch)
    except ModuleNotFoundError as error:
        raise ConfigError(f"{path}: {settings.missing(error)}") from error
    written = f"{counted(done.clouds, 'cloud[s]')}, {counted(done.reports, 'report[s]')}"
    print(f"{out}: {written}" if done.clouds else f"{out}: not written, no reports")
    return recorded_clouds.ended(NAME, path, done.lines(), list(done.faults()))


def _batches(data: Any, done: Conversion) -> Iterator[tuple[str, Batch]]:
    """Yield the batches of a recording, each with its network."""
    received: Iterator[Datagram] = (
        Datagram(data[at : at + PIECE]) for at in range(0, len(data), PIECE)
    )
    if pcap.is_capture(data[:4]):
        received = done.ports.pass_on(pcap.packets(data, done.recording), done.recording)
    for piece in received:
        yield from (found for found in done.stream.feed(piece) if found is not None)
    yield from done.stream.finish()


@contextmanager
def _bag(out: Path) -> Iterator[Callable[[str, Batch], object]]:
    """Open a new bag; the function writes a batch of a network into it."""
    with BagWriter(out) as bag:
        writer = CloudWriter(bag)

        def write(network: str, batch: Batch) -> None:
            cloud = settings.cloud(batch, network)
            writer.write(names.reports(network), cloud, batch.stamp_ns)

        yield write


@contextmanager
def _table(out: Path) -> Iterator[Callable[[str, Batch], object]]:
    """Open a table; the function writes a batch of a network into it; see `COLUMNS`."""
    with recorded_clouds.table(out, COLUMNS) as write:
        yield lambda network, batch: write(_cells(network, report) for report in batch.reports)


def _cells(network: str, report: Dated) -> list[str]:
    """Return a report as the cells of `COLUMNS`."""
    heard, time_ns = report.heard, report.time_ns
    forms = {MMSI: "09d", ICAO: "06X"}
    moving = (heard.speed, heard.course, heard.heading, heard.height, heard.x_std)
    return [
        f"{time_ns // 10**9}.{time_ns % 10**9 // 1000:06d}",
        network,
        "" if heard.address == NONE else f"{heard.address:{forms.get(heard.space, 'd')}}",
        f"{heard.latitude:.7f}",
        f"{heard.longitude:.7f}",
        *("" if math.isnan(value) else f"{value:.2f}" for value in moving),
        "" if heard.accurate == NOT_SAID else str(heard.accurate),
        str(heard.type) if heard.type else "",
        heard.name,
    ]


def _parser() -> ArgumentParser:
    parser = ArgumentParser(NAME, description=__doc__)
    parser.add_argument(
        "source",
        help="recording: sentences of AIS, SBS-1, Beast or hexadecimal frames of 1090 MHz, or a "
        "capture (pcap, pcapng) of them; gzip, bzip2, xz or zip may have packed it",
    )
    written = parser.add_mutually_exclusive_group(required=True)
    written.add_argument("--out", "--output", type=Path, help="directory of the new bag")
    written.add_argument(
        "--csv", type=Path, metavar="FILE", help="write the reports as a table, and no bag"
    )
    parser.add_argument(
        "--start",
        type=recorded_clouds.moment,
        default=0,
        metavar="YYYY-MM-DD[THH:MM:SS]",
        help="time (UTC) of the first message of a recording without times of its own; default: "
        "1970-01-01",
    )
    recorded_clouds.add_port_argument(parser)
    command.add_params_file_argument(parser)
    command.add_assignments_argument(parser)
    return parser
