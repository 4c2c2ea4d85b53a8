"""Converts recordings of ASTERIX to bags and back; without arguments it is the node, with UDP."""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, TypeAlias

from msg_adapters.encoding import names
from phd_jdtc_ros import output_files, resources
from phd_jdtc_ros.asterix import framing, messages, records
from phd_jdtc_ros.asterix.clocks import StreamClock
from phd_jdtc_ros.asterix.messages import NONE, TRACKS, Plot
from phd_jdtc_ros.asterix.plot_stream import Cloud, PlotStream, RadarState
from phd_jdtc_ros.asterix_bridge import configuration
from phd_jdtc_ros.asterix_bridge.clouds import cloud_of, topic_of
from phd_jdtc_ros.asterix_bridge.configuration import Bridge
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader, is_mcap
from phd_jdtc_ros.bags.writer import BagWriter
from phd_jdtc_ros.calibration.tuning.plots import PlotRevolutions
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.types import FILTERED, SOURCES
from phd_jdtc_ros.exit_status import CORRUPT, OK, ArgumentParser
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments
from phd_jdtc_ros.quoting import counted, counts_text
from phd_jdtc_ros.transponders.stream import Batch

from .. import command, recorded_clouds
from ..recorded_clouds import CloudWriter, Ports, damage, most
from . import parameters, writing

# Smallest share of a recording's plots that must be used; otherwise the tool fails.
LEAST_USED = 0.5
# Descriptions of other categories, for the message that they are not used.
FOREIGN_TRACKS = "tracks of another tracker, not plots"
OTHERS = {11: FOREIGN_TRACKS, 30: FOREIGN_TRACKS}
STATUS = "no target reports"
# The table of decoded plots: seconds since 1970, slant ranges in metres, azimuths in degrees
# clockwise from north, heights in metres, amplitudes in dBm, the TYP of I048/020, the Mode 3/A code
# in octal digits and the Mode S address in hexadecimal ones.
COLUMNS = (
    *("time", "radar", "range", "azimuth", "height", "amplitude_dbm", "detection_type"),
    *("mode_3a", "mode_s", "call_sign"),
)


@dataclass
class Conversion:
    """The counts of a conversion to a bag."""

    stream: PlotStream
    ports: Ports
    recording: Counter[str] = field(default_factory=Counter)  # Skipped parts of the file, by reason
    clouds: int = 0
    plots: int = 0
    positions: int = 0
    hints: list[str] = field(default_factory=list)  # Remarks on the proposed parameters

    def count(self, report: Cloud) -> None:
        """Count the plots or the positions of a cloud."""
        if isinstance(report, Batch):
            self.positions += len(report.reports)
        else:
            self.plots += len(report.plots)

    def lines(self) -> Iterator[str]:
        """Yield the counts of each radar, and the reasons for messages that are not used."""
        for state in self.radars():
            name, revolution_s = state.settings.name, state.assembler.revolution_s
            revolution = f", a revolution of {revolution_s:.4f} s" if revolution_s else ""
            listed = counts_text(state.counts)
            held = counted(state.plots, "plot[s]")
            held += f", {counted(state.services, 'service message[s]')}"
            if state.positions:
                whose = {TRACKS: ", tracks of another centre,"}.get(state.source, "")
                held = f"{counted(state.positions, 'position[s]')}{whose} on {names.reports(name)}"
                held += f", {counted(state.plots, 'plot[s]')}" if state.plots else ""
            yield (
                f"{name}: {held}, "
                f"{counted(state.reports, 'cloud[s]')}{revolution}{f'; {listed}' if listed else ''}"
            )
            if state.counts["second_source"]:
                own = " and ".join(dict.fromkeys(state.sources.values()))
                yield (
                    f"{name}: messages of two sources, {own} and {state.other_source}: messages of "
                    "the second are left out"
                )
            if len(parts := state.assembler.parts) > 1:
                listed = ", ".join(
                    f"{period_s:.4f} s until {datetime.fromtimestamp(ns // 10**9, timezone.utc):%T}"
                    for ns, period_s in parts
                )
                yield (
                    f"{name}: its revolution has changed: {listed}; the parameters have the "
                    "longest; track the parts one by one for the best tracks"
                )
            shift_s = state.clock.shift_ns * 1e-9
            if shift_s:
                yield f"{name}: its clock is {-shift_s:+.1f} s off, and was shifted"
        for size, count in self.stream.blocks.known_trailers().items():
            trailed = counted(count, "datagram[ has|s have]")
            yield f"{trailed} a trailer of {size} bytes, which is skipped"
        if self.ports.silent and not self.ports.reads_nothing:
            yield self.ports.silence
        others = {n: count for n, count in self._held() if not records.readers(n)}
        if others:
            yield f"records of other categories, which are skipped: {_categories(others)}"
        yield f"left out: {counts_text(self._left_out()) or 'none'}"
        for state in self._lone():
            yield (
                f"{state.settings.name}: a single message, which is left out because a damaged "
                "byte may have made it"
            )
        yield from self.hints

    def radars(self) -> list[RadarState]:
        """Return the radars of the recording without those of a single message beside others."""
        lone = self._lone()
        return [state for state in self.stream.radars.values() if state not in lone]

    def _lone(self) -> list[RadarState]:
        states = [*self.stream.radars.values()]
        lone = [s for s in states if s.plots + s.positions + s.services + len(s.waiting) == 1]
        return lone if len(lone) < len(states) else []

    def _held(self) -> list[tuple[int, int]]:
        """Return all categories with the numbers of their records, the most frequent first."""
        return self.stream.blocks.categories.most_common()

    def faults(self) -> Iterator[str]:
        """Yield a line for each reason why the recording was not used as it should be."""
        if self.ports.reads_nothing:
            yield self.ports.silence
            return
        yield from damage(self.recording)
        yield from self._places()
        what, used, lost = self._share()
        if used and used >= LEAST_USED * (used + lost):
            return
        held, reasons = self._held(), self._reasons()
        if not held:
            yield "has no data blocks of ASTERIX" + (f"; left out: {reasons}" if reasons else "")
            return
        others = "".join(
            f"; CAT{number:03} is {OTHERS.get(number, STATUS)}"
            for number, _ in sorted(held)
            if not records.readers(number)
        )
        yield (
            f"{self._used(what, used, lost)}; all records: {_categories(dict(held))}{others}"
            + (f"; left out: {reasons}" if reasons else "")
            + (f"; SAC/SIC of unknown radars: {self._unknown()}" if self.stream.unknown else "")
        )

    def _places(self) -> Iterator[str]:
        """Yield a line for each radar that messages put at several places."""
        for state in self.radars():
            count = state.counts["second_place"]
            # A damaged byte may put one message elsewhere.
            if state.site and state.other_site and count > 1:
                own, other = (f"{at[0]:.4f}, {at[1]:.4f}" for at in (state.site, state.other_site))
                yield (
                    f"{state.settings.name} is at {own} first and in {count} messages elsewhere, "
                    f"such as {other}: two radars have its SAC/SIC, or it was moved; all its plots "
                    "are taken as seen from the first place"
                )

    def _share(self) -> tuple[str, int, int]:
        """Return what the recording is of, how much was used, and how much could not be.

        It is of plots if there is any, and of positions otherwise.
        """
        states, faulty = self.stream.radars.values(), self.stream.blocks.faulty
        dropped = sum(state.undated + state.counts["overflow"] for state in states)
        lost = dropped + sum(faulty[number] for number in records.PLOTS)
        if self.plots or not (self.positions or any(faulty[n] for n in records.POSITIONS)):
            return "plots", self.plots, lost
        lost += sum(faulty[number] for number in records.POSITIONS)
        return "positions", self.positions, lost + sum(s.counts["place_unknown"] for s in states)

    def _used(self, what: str, used: int, lost: int) -> str:
        """Return in words how many plots are used, and why none is, if that is known."""
        if not lost and not used:
            services = sum(state.services for state in self.radars())
            every = self.stream.blocks.categories.total()
            return f"has no plots; {services} of {every} records could be used"
        share = f"{used} of {used + lost} {what} could be used"
        timeless = sum(state.counts["time_unknown"] for state in self.stream.radars.values())
        if timeless and not used:
            share += ": no message has a time, its own or that of its receipt"
        return share

    def _reasons(self) -> str:
        states = self.stream.radars.values()
        return counts_text(sum((state.counts for state in states), self._left_out()))

    def _left_out(self) -> Counter[str]:
        return +(self.recording + self.stream.counts)

    def _unknown(self) -> str:
        radars = self.stream.unknown.items()
        return most(Counter({f"{radar >> 8}/{radar & 255}": count for radar, count in radars}))


def _categories(held: Mapping[int, int]) -> str:
    """Return categories with the numbers of their records, in words."""
    return ", ".join(f"CAT{number:03} {count}" for number, count in held.items())


# What is in a recording: its counts, and the reports of its radars in order.
_Recorded: TypeAlias = "tuple[Conversion, Iterator[tuple[RadarState, Cloud]]]"


@contextmanager
def _recorded(
    path: Path, bridge: Bridge, midnight_ns: int | None, ports: Iterable[int]
) -> Iterator[_Recorded]:
    """Open a recording; see `convert`."""
    clock = StreamClock(midnight_ns or 0, bridge.values["max_clock_offset_s"])
    done = Conversion(bridge.stream(clock), Ports(frozenset(ports)))
    with recorded_clouds.opened(path, done.recording) as data:
        framing.kind_of(data)
        yield done, _reports(data, done, midnight_ns)


def convert(
    path: Path, out: Path, bridge: Bridge, midnight_ns: int | None, ports: Iterable[int]
) -> Conversion:
    """Write the clouds of a recording into a new bag, with parameters for a tracker beside it.

    `midnight_ns` is the beginning of the recording's day; see `framing.datagrams`. If ports are
    given, captured datagrams to other ports are left out. Raise `BagError` if the file is empty or
    no recording of ASTERIX, or the bag cannot be written.
    """
    with _recorded(path, bridge, midnight_ns, ports) as (done, reports), BagWriter(out) as bag:
        writer = CloudWriter(bag)
        for state, report in reports:
            topic = topic_of(report, state)
            writer.write(topic, cloud_of(report, state), report.stamp_ns)
            done.clouds += 1
            done.count(report)
    states = done.radars()
    found = parameters.propose(states, writer.disorder_ns * 1e-9)
    if found is not None:
        parameters.measure(found, states, out)
        parameters.add_receivers(found, states)
        head = (
            f"For a tracker of {path.name}, by asterix_bridge: the profile "
            f"{parameters.PROFILE}, adapted to the recording.\n"
            "A comment gives the source of each changed value."
        )
        parameters.write(out / bag_parameters.NAME, head, found)
        done.hints += found.hints
    return done


def tabulate(
    path: Path, out: Path, bridge: Bridge, midnight_ns: int | None, ports: Iterable[int]
) -> Conversion:
    """Write the plots of a recording as comma-separated values; see `convert` and `COLUMNS`.

    They are in the order of the clouds that `convert` would write. Unknown values are empty.
    """
    with (
        _recorded(path, bridge, midnight_ns, ports) as (done, reports),
        recorded_clouds.table(out, COLUMNS) as write,
    ):
        for state, report in reports:
            done.clouds += 1
            done.count(report)
            if not isinstance(report, Batch):
                dated, name = zip(report.times_ns, report.plots, strict=True), state.settings.name
                write(_cells(name, time_ns, plot) for time_ns, plot in dated)
    if done.positions:
        done.hints.append("positions are no plots, and are not in the table: a bag has them")
    return done


def _cells(radar: str, time_ns: int, plot: Plot) -> list[str]:
    """Return a plot as the cells of `COLUMNS`."""
    echo = plot.secondary_dbm if math.isnan(plot.primary_dbm) else plot.primary_dbm
    return [
        f"{time_ns // 10**9}.{time_ns % 10**9 // 1000:06d}",
        radar,
        f"{plot.distance:.2f}",
        f"{math.degrees(plot.azimuth):.4f}",
        "" if math.isnan(plot.height) else f"{plot.height:.2f}",
        "" if math.isnan(echo) else f"{echo:.0f}",
        str(plot.detection_type) if plot.detection_type else "",
        "" if plot.code == NONE else f"{plot.code:04o}",
        "" if plot.address == NONE else f"{plot.address:06X}",
        messages.call_sign_text(plot.call_sign),
    ]


def _reports(
    data: Any, done: Conversion, midnight_ns: int | None
) -> Iterator[tuple[RadarState, Cloud]]:
    """Yield the reports of a recording in the order in which they are complete."""
    recorded = framing.datagrams(data, midnight_ns, done.recording)
    for received in done.ports.pass_on(recorded, done.recording):
        yield from done.stream.feed(*received)
    kept = done.radars()
    yield from (found for found in done.stream.finish() if found[0] in kept)
    for state in done.stream.radars.values():
        if isinstance(state.assembler.finder, PlotRevolutions):
            state.assembler.finder.find()


NAME = "asterix_bridge"


def main(argv: Sequence[str]) -> int:
    """Run the offline bridge."""
    return command.run(_parser(), argv, _work)


def _work(arguments: argparse.Namespace) -> int:
    if arguments.csv is None:
        command.require_new("it", arguments.out)
    else:
        output_files.require_new({"--csv": arguments.csv})
    given = from_arguments.from_arguments(arguments.params_file, arguments.assignments, NAME)
    path = Path(arguments.source)
    if path.suffix not in ("", ".mcap") and not path.exists():
        raise BagError(f"{path}: no such recording or bag")
    if path.is_file() and not is_mcap(path):
        return _from_recording(path, arguments, configuration.resolve(given))
    if arguments.csv is not None:
        raise ConfigError(
            f"--csv: given with {path}, which must be a recording of ASTERIX; the tracks of a bag "
            "are written by track_bag --csv"
        )
    return _to_asterix(resources.bag(arguments.source), arguments, given)


def _from_recording(path: Path, arguments: argparse.Namespace, bridge: Bridge) -> int:
    read, out = convert, arguments.out
    if arguments.csv is not None:
        read, out = tabulate, arguments.csv
    done = read(path, out, bridge, arguments.date, arguments.port)
    print(f"{out}: {counted(done.clouds, 'cloud[s]')}, {counted(done.plots, 'plot[s]')}")
    return recorded_clouds.ended(NAME, path, done.lines(), list(done.faults()))


def _to_asterix(path: Path, arguments: argparse.Namespace, given: dict[str, object]) -> int:
    bag = BagReader(path)
    recorded = bag_parameters.read(path) or {}
    config = from_arguments.config_of(recorded)
    if arguments.plots:
        bridge = configuration.resolve(given)
        done = writing.write_plots(bag, arguments.out, config, bridge)
    else:
        # The map's place on the earth is taken from the tracker's parameters.
        known = config.known_plane is not None and "world_origin" in recorded
        origin = {"world_origin": recorded["world_origin"]} if known else {}
        if config.plane is not None and not known:
            print("the position of the radar is unknown: tracks have no latitudes and longitudes")
        bridge = configuration.resolve({**origin, **given})
        topic = names.estimates(arguments.estimates)
        done = writing.write_tracks(bag, arguments.out, bridge, topic, config)
    dropped = counts_text(done.dropped)
    nothing = not done.clouds and not dropped
    print(
        f"{arguments.out}: {counted(done.records, f'{done.what[:-1]}[s]')} in "
        f"{counted(done.blocks, 'data block[s]')}, of {counted(done.clouds, 'cloud[s]')}; dropped: "
        f"{dropped or 'none'}"
    )
    if done.out_of_range:
        print(f"plots beyond the largest range of CAT048: {done.out_of_range}")
    if done.used >= LEAST_USED and not nothing:
        return OK
    used = f"{done.used:.0%} of its clouds could be used; dropped: {dropped}"
    fault = f"has no clouds, so there are no {done.what}" if nothing else used
    print(f"{NAME}: {path}: {fault}", file=sys.stderr)
    return CORRUPT


def _parser() -> ArgumentParser:
    parser = ArgumentParser(NAME, description=__doc__)
    parser.add_argument(
        "source", help=f"recording: ASTERIX, final, pcap or pcapng; or a {command.BAG}"
    )
    written = parser.add_mutually_exclusive_group(required=True)
    written.add_argument(
        "--out", type=Path, help="directory of the new bag, or file of the new data blocks"
    )
    written.add_argument(
        "--csv",
        type=Path,
        metavar="FILE",
        help="for a recording: write its decoded plots as a table, and no bag",
    )
    parser.add_argument(
        "--plots",
        action="store_true",
        help="for a bag: write its detections as CAT048 and CAT034, not its estimates as CAT062",
    )
    parser.add_argument(
        "--estimates",
        choices=SOURCES,
        default=FILTERED,
        help="for a bag: the estimates to write as CAT062 (%(default)s)",
    )
    parser.add_argument(
        "--date",
        type=recorded_clouds.day,
        metavar="YYYY-MM-DD",
        help="day of the recording, which ASTERIX does not contain; default: the capture's day, or "
        "1970-01-01",
    )
    recorded_clouds.add_port_argument(parser)
    command.add_params_file_argument(parser)
    command.add_assignments_argument(parser)
    return parser
