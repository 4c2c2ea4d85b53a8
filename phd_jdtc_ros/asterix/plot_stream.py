"""Converts the datagrams of several radars to reports: sectors or time slices of each radar."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from phd_jdtc_ros.transport.network import fits_stamp

from . import records
from .assembly import LEARNED, Assembler
from .clocks import RadarClock, StreamClock
from .framing import BLOCK_HEADER, LARGEST_BLOCK
from .messages import NONE, CallSigns, Message, Plot
from .slices import NoRevolutionFinder, RevolutionFinder, SectorReport
from .specification import MalformedError

# Some recorders and networks append a trailer to every datagram. A rest of at most LONGEST_TRAILER
# bytes counts as a trailer once its length has occurred TRAILERS times.
LONGEST_TRAILER, TRAILERS = 16, 3
# Reasons for which a record is not to be used; any other is a fault of the record.
INTENDED = frozenset(("no_detection", "field_monitor", "test_target", ""))


class BlockReader:
    """Reads the datagrams of a stream; `categories` counts the records of all categories.

    `faulty` counts those of supported categories that should have been used and could not.

    `counts` gains the skipped data by reason: ``block_truncated`` or ``block_length`` if the rest
    of a datagram is not a data block; ``other_category`` for data blocks of unsupported categories;
    and the reasons of `MalformedError` and of `records`. `trailers` counts rests after the data
    blocks of datagrams, by length in bytes. Once a length has occurred `TRAILERS` times, such rests
    count as trailers and not as faults.
    """

    def __init__(self, counts: Counter[str]) -> None:
        self.counts = counts
        self.categories: Counter[int] = Counter()
        self.faulty: Counter[int] = Counter()
        self.trailers: Counter[int] = Counter()
        self._faults: dict[int, Counter[str]] = {}

    def known_trailers(self) -> dict[int, int]:
        """Return the numbers of trailers by length."""
        return {size: n for size, n in self.trailers.items() if n >= TRAILERS}

    def messages(self, data: bytes) -> Iterator[Message]:
        """Yield the messages of a datagram in order, each decoded on demand."""
        for category, begin, end in self._blocks(data):
            reads = records.reader(category)
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
                    self.faulty[category] += found not in INTENDED
                    if found:
                        self.counts[found] += 1
            except MalformedError as error:
                self.categories[category] += 1
                self.faulty[category] += 1
                self.counts[error.reason] += 1

    def _blocks(self, data: bytes) -> Iterator[tuple[int, int, int]]:
        """Yield category, begin and end of the records of each data block of a datagram."""
        at = 0
        while at < len(data):
            left = len(data) - at
            length = data[at + 1] << 8 | data[at + 2] if left >= BLOCK_HEADER else left + 1
            if not BLOCK_HEADER < length <= left:
                fault = "block_truncated" if length > left else "block_length"
                # The header of a cut block still gives its whole length.
                supported = records.reader(data[at]) is not None
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
                self.counts -= self._faults.pop(size)  # those rests were trailers


# Upper bound of a radar's messages that wait until its clock error is known.
MAX_WAITING = 1000
# Upper bound of radars accepted without configuration; forged radar numbers would fill the memory.
MAX_RADARS = 64
# A second source of a radar is accepted after the first has been silent for this time.
SOURCE_TIMEOUT_S = 10.0


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
    ``second_source``, messages from another address than the radar's; ``source_changed``; and
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
    undated: int = 0  # Number of plots without a time that fits a stamp
    services: int = 0  # Number of accepted service messages
    reports: int = 0  # Number of reports made from them
    # Sources of the radar's plots (`Plot`) and service messages (`ServiceMessage`), which may
    # differ; absent if unknown.
    sources: dict[type, str] = field(default_factory=dict)
    other_source: str | None = None  # The latest refused source
    time_ns: int = 0  # Time of the latest message
    statistics: PlotStatistics = field(default_factory=PlotStatistics)
    waiting: list[tuple[Message, int | None]] = field(default_factory=list)
    _received_ns: dict[type, int] = field(default_factory=dict)

    def accept_source(self, kind: type, source: str | None, now_ns: int) -> bool:
        """Return whether messages of this kind are accepted from this source, and count it.

        A second source of a radar is a redundant line or another radar with the same number. In
        neither case may messages of both sources be used.
        """
        if source is None:
            return True
        own = self.sources.get(kind, source)
        if source != own and abs(now_ns - self._received_ns[kind]) < SOURCE_TIMEOUT_S * 1e9:
            self.other_source = source
            self.counts["second_source"] += 1
            return False
        self.counts["source_changed"] += source != own
        self.sources[kind], self._received_ns[kind] = source, now_ns
        return True


class PlotStream:
    """Converts datagrams to the reports of radars, and collects the call signs of all plots.

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
    ) -> None:
        self.counts: Counter[str] = Counter()
        self.blocks = BlockReader(self.counts)
        self._finders = finders
        self.clock = clock or StreamClock()
        self.radars = {number: self._state(settings) for number, settings in radars.items()}
        self._others = others or RadarSettings("")
        self._configured_only = bool(radars)
        self.unknown: Counter[int] = Counter()
        self.datagrams = 0
        self.call_signs = CallSigns()

    def feed(
        self, data: bytes, received_ns: int | None = None, source: str | None = None
    ) -> list[tuple[RadarState, SectorReport]]:
        """Return the reports that a datagram completes, each with its radar, in order.

        The time of receipt since the epoch and the sender are None if unknown.
        """
        return [each for found in self.iter_reports(data, received_ns, source) for each in found]

    def iter_reports(
        self, data: bytes, received_ns: int | None = None, source: str | None = None
    ) -> Iterator[list[tuple[RadarState, SectorReport]]]:
        """Yield the reports that each message of a datagram completes; parameters as in `feed`.

        A datagram may hold thousands of messages. The caller can do other work between them.
        """
        self.datagrams += 1
        if received_ns is not None and not fits_stamp(received_ns):
            self.counts["receipt_time"] += 1
            received_ns = None
        for message in self.blocks.messages(data):
            state = self.radars.get(message.radar) or self._new(message.radar)
            if state is None:
                yield []
                continue
            now_ns = state.time_ns if received_ns is None else received_ns
            accepted = state.accept_source(type(message), source, now_ns)
            found = self._process(state, message, received_ns) if accepted else []
            yield [(state, report) for report in found]

    def finish(self) -> list[tuple[RadarState, SectorReport]]:
        """Return all pending reports at the end of a recording or when the radars are silent."""
        return [
            (state, report)
            for state in self.radars.values()
            for report in self._count(state, self._decide(state) + state.assembler.finish())
        ]

    def _process(
        self, state: RadarState, message: Message, received_ns: int | None
    ) -> list[SectorReport]:
        """Process a message, or keep it until its radar's clock error is known."""
        ready = state.clock.can_decide(message, received_ns)
        if not ready and len(state.waiting) < MAX_WAITING:
            state.waiting.append((message, received_ns))
            return []
        found = self._decide(state)
        return self._count(state, found + self._assemble(state, message, received_ns))

    def _decide(self, state: RadarState) -> list[SectorReport]:
        """Decide about the clock error, and process the messages that waited for it."""
        state.clock.decide()
        waiting, state.waiting = state.waiting, []
        return [report for entry in waiting for report in self._assemble(state, *entry)]

    @staticmethod
    def _count(state: RadarState, reports: list[SectorReport]) -> list[SectorReport]:
        state.reports += len(reports)
        return reports

    def _assemble(
        self, state: RadarState, message: Message, received_ns: int | None
    ) -> list[SectorReport]:
        is_plot = isinstance(message, Plot)
        time_ns = state.clock.time_ns(message, received_ns, not (is_plot and state.services))
        if time_ns is None:
            state.undated += is_plot
            return []
        state.time_ns = time_ns
        off_ns = 0 if received_ns is None else abs(received_ns - time_ns)
        plausible = off_ns <= self.clock.max_offset_s * 1e9
        state.counts["time_off"] += not plausible
        if isinstance(message, Plot):
            state.plots += 1
            state.statistics.add(message)
            self.call_signs.take(message.address, message.call_sign)
            if plausible:
                return state.assembler.add_plot(message, time_ns)
            state.assembler.keep_plot(message, time_ns)
            return []
        state.services += 1
        state.site = state.site or message.site
        return state.assembler.add_service(message, time_ns) if plausible else []

    def _new(self, number: int) -> RadarState | None:
        """Return the state of a new radar, None if the radar is not accepted."""
        if self._configured_only:
            self.counts["unknown_radar"] += 1
            self.unknown[number] += 1
            return None
        if len(self.radars) >= MAX_RADARS:
            self.counts["too_many_radars"] += 1
            return None
        name = f"radar_{number >> 8}_{number & 255}"
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
