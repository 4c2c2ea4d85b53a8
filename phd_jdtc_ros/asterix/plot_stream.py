"""Converts the datagrams of several radars to reports: sectors or time slices of each radar."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TypeAlias

from phd_jdtc_ros.transponders.stream import Batch, Batches
from phd_jdtc_ros.transponders.transmitters import Transmitters
from phd_jdtc_ros.transport.network import fits_stamp

from . import records
from .assembly import LEARNED, Assembler, NoRevolutionFinder, RevolutionFinder, SectorReport
from .clocks import RadarClock, StreamClock
from .framing import BLOCK_HEADER, LARGEST_BLOCK
from .messages import NONE, CallSigns, Message, Plot, PositionMessage, ServiceMessage
from .specification import MalformedError

# Some recorders and networks append a trailer to every datagram. A rest of at most LONGEST_TRAILER
# bytes counts as a trailer once its length has occurred TRAILERS times.
LONGEST_TRAILER, TRAILERS = 16, 3
# Upper bound of radars accepted without configuration; forged radar numbers would fill the memory.
MAX_RADARS = 64


class BlockReader:
    """Reads the datagrams of a stream; `categories` counts the records of all categories.

    `faulty` counts those of supported categories that should have been used and could not.

    `counts` gains the skipped data by reason: ``block_truncated`` or ``block_length`` if the rest
    of a datagram is not a data block; ``other_category`` for data blocks of unsupported categories;
    and the reasons of `MalformedError` and of `records`. `trailers` counts rests after the data
    blocks of datagrams, by length in bytes. Once a length has occurred `TRAILERS` times, such rests
    count as trailers and not as faults.
    """

    # Reasons for which a record is not to be used; any other is a fault of the record.
    INTENDED = frozenset(("no_detection", "field_monitor", "test_target", "position_check", ""))

    def __init__(self, counts: Counter[str]) -> None:
        self.counts = counts
        self.categories: Counter[int] = Counter()
        self.faulty: Counter[int] = Counter()
        self.trailers: Counter[int] = Counter()
        self._faults: dict[int, Counter[str]] = {}
        # Blocks that had the form of one edition only, by source.
        self._editions: dict[int, Counter[records.RecordReader]] = {}

    def known_trailers(self) -> dict[int, int]:
        """Return the numbers of trailers by length."""
        return {size: n for size, n in self.trailers.items() if n >= TRAILERS}

    def messages(self, data: bytes) -> Iterator[Message]:
        """Yield the messages of a datagram in order, each decoded on demand."""
        for category, begin, end in self._blocks(data):
            reads = self._reader(category, data, begin, end)
            if reads is None:
                self.counts["other_category"] += 1
                self.categories[category] += max(records.count(category, data, begin, end), 1)
                continue
            at = begin
            try:
                while at < end:
                    found, at = reads.read(data, at, end)
                    self.categories[category] += 1
                    if not isinstance(found, str):
                        yield found
                        continue
                    self.faulty[category] += found not in self.INTENDED
                    if found:
                        self.counts[found] += 1
            except MalformedError as error:
                self.categories[category] += 1
                self.faulty[category] += 1
                self.counts[error.reason] += 1

    def _reader(
        self, category: int, data: bytes, begin: int, end: int
    ) -> records.RecordReader | None:
        """Return the decoder of a block: of several editions that which its source uses.

        A block may by chance have the form of another edition too: then the edition counts that
        more blocks of the source had alone.
        """
        known = records.readers(category)
        if len(known) < 2 or begin == end:
            return known[0] if known else None
        fitting = [each for each in known if each.fits(data, begin, end)]
        if not fitting:
            return known[0]
        alone = self._editions.setdefault(known[0].source(data, begin, end), Counter())
        if len(fitting) == 1:
            alone[fitting[0]] += 1
        if len(self._editions) > MAX_RADARS:
            self._editions.clear()
        return max(fitting, key=lambda each: alone[each])

    def _blocks(self, data: bytes) -> Iterator[tuple[int, int, int]]:
        """Yield category, begin and end of the records of each data block of a datagram."""
        at = 0
        while at < len(data):
            left = len(data) - at
            length = data[at + 1] << 8 | data[at + 2] if left >= BLOCK_HEADER else left + 1
            if not BLOCK_HEADER <= length <= left:
                fault = "block_truncated" if length > left else "block_length"
                # The header of a cut block still gives its whole length.
                supported = bool(records.readers(data[at]))
                cut = supported and left < length <= LARGEST_BLOCK
                self._rest(fault, left, at > 0 and not cut)
                return
            yield data[at], at + BLOCK_HEADER, at + length
            at += length

    def _rest(self, fault: str, size: int, no_block: bool) -> None:
        """Count a rest of a datagram; `no_block` if it is not the beginning of a data block."""
        known = self.trailers[size] >= TRAILERS
        if size > LONGEST_TRAILER or not (known or no_block):
            self.counts[fault] += 1
            return
        self.trailers[size] += 1
        if not known:
            self.counts[fault] += 1
            self._faults.setdefault(size, Counter())[fault] += 1
            if self.trailers[size] >= TRAILERS:
                self.counts -= self._faults.pop(size)  # Those rests were trailers


# Time for which positions are collected to a cloud.
PERIOD_NS = 500_000_000


@dataclass(frozen=True)
class RadarSettings:
    """Configuration of a radar."""

    name: str
    sectors: int = 32  # Number of sectors per revolution; a multiple of 4
    hold_sectors: int = LEARNED  # See `Assembler`
    # Latitude and longitude, degrees, and height of the antenna, metres; None if unknown.
    site: tuple[float, float, float] | None = None


@dataclass(slots=True)
class PlotStatistics:
    """Statistics of a radar's plots."""

    nearest: float = math.inf  # Smallest slant range, metres
    farthest: float = 0.0  # Largest slant range, metres
    # Numbers of plots with a height, a code, an address, a detection type, and a code or an
    # address.
    heights: int = 0
    codes: int = 0
    addresses: int = 0
    detection_types: int = 0
    identified: int = 0

    def add(self, plot: Plot) -> None:
        """Add a plot to the statistics."""
        code, address = plot.code != NONE, plot.address != NONE
        self.nearest = min(self.nearest, plot.distance)
        self.farthest = max(self.farthest, plot.distance)
        self.heights += not math.isnan(plot.height)
        self.codes += code
        self.addresses += address
        self.detection_types += plot.detection_type > 0
        self.identified += code or address


@dataclass
class RadarState:
    """Progress and message counts of one radar.

    `counts` has skipped or bridged messages by reason: the reasons of `Assembler` and `RadarClock`;
    ``second_source``, messages from another address than the radar's; ``source_changed``;
    ``second_place``, messages that put the radar elsewhere than the first of them; and
    ``time_off``, messages whose time is far from their receipt. Plots with such a time are kept
    unchanged, but a message with such a time moves neither the antenna nor the clock.
    """

    settings: RadarSettings
    counts: Counter[str]
    assembler: Assembler
    clock: RadarClock
    # Position of the radar, from its configuration or else from I034/120; None if unknown.
    site: tuple[float, float, float] | None
    plots: int = 0  # Number of accepted plots
    undated: int = 0  # Number of plots and positions without a time that fits a stamp
    positions: int = 0  # Number of accepted positions
    # Source of the positions, such as `messages.TRACKS`; empty without any.
    source: str = ""
    services: int = 0  # Number of accepted service messages
    reports: int = 0  # Number of reports made from them
    # Sources of the radar's plots (`Plot`) and service messages (`ServiceMessage`), which may
    # differ; absent if unknown.
    sources: dict[type, str] = field(default_factory=dict)
    other_source: str | None = None  # The latest refused source
    other_site: tuple[float, float, float] | None = None  # The latest place of ``second_place``
    time_ns: int = 0  # Time of the latest message
    statistics: PlotStatistics = field(default_factory=PlotStatistics)
    waiting: list[tuple[Message, int | None]] = field(default_factory=list)
    batches: Batches = field(default_factory=lambda: Batches(PERIOD_NS))
    _received_ns: dict[type, int] = field(default_factory=dict)

    def take_site(self, site: tuple[float, float, float] | None) -> None:
        """Take the place that a message gives, if none is known, and count another one.

        Two radars have one number then, two numbers have been exchanged, or the radar has moved. A
        configured place stands against all messages.
        """
        # Satellite navigation is off by less, degrees: 500 m.
        apart = 0.005
        if site is None or self.settings.site is not None:
            return
        self.site = self.site or site
        if (
            max(abs(own - other) for own, other in zip(self.site[:2], site[:2], strict=True))
            > apart
        ):
            self.other_site = site
            self.counts["second_place"] += 1

    def accept_source(self, kind: type, source: str | None, now_ns: int) -> bool:
        """Return whether messages of this kind are accepted from this source, and count it.

        A second source of a radar is a redundant line or another radar with the same number. In
        neither case may messages of both sources be used.
        """
        if source is None:
            return True
        own = self.sources.get(kind, source)
        # A second source of a radar is accepted after the first has been silent for this time.
        if source != own and abs(now_ns - self._received_ns[kind]) < 10e9:
            self.other_source = source
            self.counts["second_source"] += 1
            return False
        self.counts["source_changed"] += source != own
        self.sources[kind], self._received_ns[kind] = source, now_ns
        return True


# What a cloud is made of: a sector or a slice of plots, or positions.
Cloud: TypeAlias = "SectorReport | Batch"
# Converts metres east and north of a place to latitude and longitude, degrees.
Locate: TypeAlias = "Callable[[tuple[float, float, float], float, float], tuple[float, float]]"


class PlotStream:
    """Converts datagrams to the reports of radars, and collects the call signs of all plots.

    Positions are those of `transponders`, by the same rules (`transmitters`). Positions in a plane
    need the place of their source, and `locate`; without they are counted as ``place_unknown``.

    `radars` has the configured radars, by SAC in the upper and SIC in the lower eight bits. If it
    is empty, every radar is accepted, with the settings `others` and the name ``radar_SAC_SIC``.
    `finders` creates an estimator of the rotation period of a radar without sector crossings.

    `counts` has the skipped messages of all radars by reason: the reasons of `BlockReader`;
    ``unknown_radar``; ``too_many_radars``; and ``receipt_time``, datagrams whose time of receipt
    does not fit a stamp and is ignored. `unknown` has those of unknown radars by SAC and SIC.
    """

    def __init__(
        self,
        radars: Mapping[int, RadarSettings],
        others: RadarSettings | None = None,
        clock: StreamClock | None = None,
        finders: Callable[[], RevolutionFinder] = NoRevolutionFinder,
        locate: Locate | None = None,
    ) -> None:
        self.counts: Counter[str] = Counter()
        self._locate = locate
        self.blocks = BlockReader(self.counts)
        self._finders = finders
        self.clock = clock or StreamClock()
        self.transmitters = Transmitters(self.counts, round(self.clock.max_offset_s * 1e9))
        self.radars = {number: self._state(settings) for number, settings in radars.items()}
        self._others = others or RadarSettings("")
        self._configured_only = bool(radars)
        self.unknown: Counter[int] = Counter()
        self.datagrams = 0
        self.call_signs = CallSigns()

    def feed(
        self, data: bytes, received_ns: int | None = None, source: str | None = None
    ) -> list[tuple[RadarState, Cloud]]:
        """Return the reports that a datagram completes, each with its radar, in order.

        The time of receipt since the epoch and the sender are None if unknown.
        """
        return [each for found in self.iter_reports(data, received_ns, source) for each in found]

    def iter_reports(
        self, data: bytes, received_ns: int | None = None, source: str | None = None
    ) -> Iterator[list[tuple[RadarState, Cloud]]]:
        """Yield the reports that each message of a datagram completes; parameters as in `feed`.

        A datagram may hold thousands of messages. The caller can do other work between them.
        """
        self.datagrams += 1
        if received_ns is not None and not fits_stamp(received_ns):
            self.counts["receipt_time"] += 1
            received_ns = None
        for message in self.blocks.messages(data):
            state = self.radars.get(message.radar) or self._new(message)
            if state is None:
                yield []
                continue
            now_ns = state.time_ns if received_ns is None else received_ns
            accepted = state.accept_source(type(message), source, now_ns)
            found = self._process(state, message, received_ns) if accepted else []
            yield [(state, report) for report in found]

    def due(self, now_ns: int) -> list[tuple[RadarState, Cloud]]:
        """Return the positions whose time to be sent has come."""
        found = [(state, state.batches.due(now_ns)) for state in self.radars.values()]
        return [(state, batch) for state, batch in found if batch is not None]

    def finish(self) -> list[tuple[RadarState, Cloud]]:
        """Return all pending reports at the end of a recording or when the radars are silent."""
        found: list[tuple[RadarState, Cloud]] = []
        for state in self.radars.values():
            pending = [*self._decide(state), *state.assembler.finish()]
            if (batch := state.batches.finish()) is not None:
                pending.append(batch)
            found += [(state, report) for report in self._count(state, pending)]
        return found

    def _process(self, state: RadarState, message: Message, received_ns: int | None) -> list[Cloud]:
        """Process a message, or keep it until its radar's clock error is known."""
        ready = state.clock.can_decide(message, received_ns)
        # Upper bound of a radar's messages that wait until its clock error is known.
        if not ready and len(state.waiting) < 1000:
            state.waiting.append((message, received_ns))
            return []
        found = self._decide(state)
        return self._count(state, found + self._assemble(state, message, received_ns))

    def _decide(self, state: RadarState) -> list[Cloud]:
        """Decide about the clock error, and process the messages that waited for it."""
        state.clock.decide()
        waiting, state.waiting = state.waiting, []
        return [report for entry in waiting for report in self._assemble(state, *entry)]

    @staticmethod
    def _count(state: RadarState, reports: list[Cloud]) -> list[Cloud]:
        state.reports += len(reports)
        return reports

    def _assemble(
        self, state: RadarState, message: Message, received_ns: int | None
    ) -> list[Cloud]:
        is_plot = not isinstance(message, ServiceMessage)
        time_ns = state.clock.time_ns(message, received_ns, not (is_plot and state.services))
        if time_ns is None:
            state.undated += is_plot
            return []
        state.time_ns = time_ns
        off_ns = 0 if received_ns is None else abs(received_ns - time_ns)
        plausible = off_ns <= self.clock.max_offset_s * 1e9
        state.counts["time_off"] += not plausible
        if isinstance(message, PositionMessage):
            return self._locate_and_take(state, message, time_ns, received_ns) if plausible else []
        if isinstance(message, Plot):
            state.plots += 1
            state.statistics.add(message)
            self.call_signs.take(message.address, message.call_sign)
            if plausible:
                return [*state.assembler.add_plot(message, time_ns)]
            state.assembler.keep_plot(message, time_ns)
            return []
        state.services += 1
        state.take_site(message.site)
        return [*state.assembler.add_service(message, time_ns)] if plausible else []

    def _locate_and_take(
        self, state: RadarState, message: PositionMessage, time_ns: int, received_ns: int | None
    ) -> list[Cloud]:
        """Apply the rules for transmitters to a position, and return the batch before it."""
        heard = message.heard
        if not heard.has_position:
            if state.site is None or self._locate is None:
                state.counts["place_unknown"] += 1
                return []
            latitude, longitude = self._locate(state.site, message.x, message.y)
            heard = heard._replace(latitude=latitude, longitude=longitude)
        state.source = message.source
        dated = self.transmitters.take(heard._replace(own_ns=time_ns), received_ns)
        if dated is None:
            return []
        state.positions += 1
        batch = state.batches.add(dated, time_ns if received_ns is None else received_ns)
        return [] if batch is None else [batch]

    def _new(self, message: Message) -> RadarState | None:
        """Return the state of a new radar, None if the radar is not accepted."""
        number = message.radar
        if self._configured_only:
            self.counts["unknown_radar"] += 1
            self.unknown[number] += 1
            return None
        if len(self.radars) >= MAX_RADARS:
            self.counts["too_many_radars"] += 1
            return None
        kind = message.source if isinstance(message, PositionMessage) else "radar"
        name = f"{kind}_{number >> 8}_{number & 255}"
        state = self.radars[number] = self._state(replace(self._others, name=name))
        return state

    def _state(self, settings: RadarSettings) -> RadarState:
        counts: Counter[str] = Counter()
        assembler = Assembler(
            settings.sectors,
            hold=settings.hold_sectors,
            counts=counts,
            finder=self._finders(),
        )
        clock = RadarClock(self.clock, counts)
        return RadarState(settings, counts, assembler, clock, settings.site)
