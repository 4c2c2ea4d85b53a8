"""Datagrams of several radars to the sectors, or slices of time, of each: the whole path in."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from .assembly import LEARNED, Assembler
from .blocks import BlockReader
from .call_signs import CallSigns
from .clocks import StreamClock, possible
from .messages import DAY, NONE, Message, Plot
from .slices import SectorReport, TurnFinder, Unknown

# Messages of a radar that wait until its clock is known.
MAX_WAITING = 1000
# Radars that are taken without being named; forged ones would fill the memory.
MAX_RADARS = 64
# A second source of a radar is taken once the first has been silent for so long.
SOURCE_TIMEOUT_S = 10.0


@dataclass(frozen=True)
class RadarSettings:
    """What is known of a radar.

    Parameters
    ----------
    sectors : int
        To a turn; a multiple of 4.
    rotation_s : float
        0 if it is not known.
    hold_sectors : int
        See `Assembler`.
    site : tuple of three floats or None
        Latitude and longitude, degrees, and height of the antenna, metres; None if they are not
        known.
    """

    name: str
    sectors: int = 32
    rotation_s: float = 0.0
    hold_sectors: int = LEARNED
    site: tuple[float, float, float] | None = None


@dataclass(slots=True)
class Seen:
    """What the plots of a radar say of it.

    Attributes
    ----------
    nearest, farthest : float
        Slant ranges, metres.
    heights, codes, addresses, kinds, identified : int
        Numbers of plots that have a height, a code, an address, a kind, or a code or an address.
    """

    nearest: float = math.inf
    farthest: float = 0.0
    heights: int = 0
    codes: int = 0
    addresses: int = 0
    kinds: int = 0
    identified: int = 0

    def add(self, plot: Plot) -> None:
        """Take a plot."""
        code, address = plot.code != NONE, plot.address != NONE
        self.nearest = min(self.nearest, plot.distance)
        self.farthest = max(self.farthest, plot.distance)
        self.heights += not math.isnan(plot.height)
        self.codes += code
        self.addresses += address
        self.kinds += plot.kind > 0
        self.identified += code or address


@dataclass
class RadarState:
    """What became of one radar's messages.

    Attributes
    ----------
    plots, services, reports : int
        Messages taken and sectors or slices made.
    counts : Counter
        What was left out or bridged, by reason: those of `Assembler` and `StreamClock`, and
        ``second_source``, messages from another address than the radar's, and ``source_changed``,
        and ``time_off``, messages whose times are not near to when they were received. Plots of
        such times are kept as they are, and no message of such a time says how the antenna turns
        or that time has passed.
    sources : dict of kind to str
        Where the radar's plots (`Plot`) and service messages (`ServiceMessage`) come from, which
        may differ, if it is known.
    other_source : str or None
        The last other one.
    time_ns : int
        Of the last message.
    seen : Seen
        What its plots say.
    site : tuple of three floats or None
        Where it stands, by its settings or else by itself (I034/120).
    """

    settings: RadarSettings
    assembler: Assembler
    plots: int = 0
    services: int = 0
    reports: int = 0
    counts: Counter[str] = field(default_factory=Counter)
    sources: dict[type, str] = field(default_factory=dict)
    other_source: str | None = None
    time_ns: int = 0
    seen: Seen = field(default_factory=Seen)
    site: tuple[float, float, float] | None = None
    waiting: list[tuple[Message, int | None]] = field(default_factory=list)
    _heard_ns: dict[type, int] = field(default_factory=dict)

    def belongs(self, kind: type, source: str | None, now_ns: int) -> bool:
        """Return whether to take a message of a kind from this source.

        Two sources of one radar are a second line for safety, or a second radar with the same
        number. Of neither may both be taken.
        """
        if source is None:
            return True
        own = self.sources.get(kind, source)
        if source != own and abs(now_ns - self._heard_ns[kind]) < SOURCE_TIMEOUT_S * 1e9:
            self.other_source = source
            self.counts["second_source"] += 1
            return False
        self.counts["source_changed"] += source != own
        self.sources[kind], self._heard_ns[kind] = source, now_ns
        return True


class PlotStream:
    """Takes datagrams, returns the radars' reports: sectors, or slices of time.

    Parameters
    ----------
    radars : mapping of number to RadarSettings
        By SAC in the upper and SIC in the lower eight bits. If it is empty all radars are taken,
        under the name ``radar_SAC_SIC``.
    others : RadarSettings
        Of radars that are not named.
    finders : callable
        Returns what finds the turn of a radar without sector crossings.

    Attributes
    ----------
    counts : Counter
        What was left out of all radars' messages, by reason; that of `blocks`, and
        ``unknown_radar`` and ``too_many_radars``, and ``receipt_time`` for datagrams with a time of
        receipt that no stamp can say, which is then unknown.
    call_signs : CallSigns
        Of all plots.
    """

    def __init__(
        self,
        radars: Mapping[int, RadarSettings],
        others: RadarSettings | None = None,
        clock: StreamClock | None = None,
        finders: Callable[[], TurnFinder] = Unknown,
    ) -> None:
        self.counts: Counter[str] = Counter()
        self.blocks = BlockReader(self.counts)
        self._finders = finders
        self.radars = {number: self._state(settings) for number, settings in radars.items()}
        self.clock = clock or StreamClock()
        self._others = others or RadarSettings("")
        self._named = bool(radars)
        self.datagrams = 0
        self.call_signs = CallSigns()

    def feed(
        self, data: bytes, received_ns: int | None = None, source: str | None = None
    ) -> list[tuple[RadarState, SectorReport]]:
        """Return what is complete by a datagram, each with its radar, in order.

        Parameters
        ----------
        received_ns : int or None
            When it came, since the epoch, if that is known.
        source : str or None
            Where it came from, if that is known.
        """
        return [each for found in self.work(data, received_ns, source) for each in found]

    def work(
        self, data: bytes, received_ns: int | None = None, source: str | None = None
    ) -> Iterator[list[tuple[RadarState, SectorReport]]]:
        """Yield what is complete by each message of a datagram; parameters are those of `feed`.

        A datagram may have thousands of messages, and what asks for them one by one can do
        something else in between.
        """
        self.datagrams += 1
        if received_ns is not None and not possible(received_ns):
            self.counts["receipt_time"] += 1
            received_ns = None
        for message in self.blocks.read(data):
            state = self.radars.get(message.radar) or self._new(message.radar)
            if state is None:
                yield []
                continue
            now_ns = state.time_ns if received_ns is None else received_ns
            own = state.belongs(type(message), source, now_ns)
            yield self._dated(state, message, received_ns) if own else []

    def finish(self) -> list[tuple[RadarState, SectorReport]]:
        """Return what waits: a recording has ended, or nothing comes any more."""
        found: list[tuple[RadarState, SectorReport]] = []
        for number, state in self.radars.items():
            found += self._settled(number, state)
            found += self._made(state, state.assembler.finish())
        return found

    def _dated(
        self, state: RadarState, message: Message, received_ns: int | None
    ) -> list[tuple[RadarState, SectorReport]]:
        """Take a message once it is known how far its radar's clock is off."""
        period = message.period if isinstance(message, Plot) else DAY
        settles = self.clock.settles(message.radar, message.time_of_day, period, received_ns)
        settles |= len(state.waiting) >= MAX_WAITING
        if not settles:
            state.waiting.append((message, received_ns))
            return []
        found = self._settled(message.radar, state)
        return found + self._made(state, self._taken(state, message, received_ns))

    def _settled(self, number: int, state: RadarState) -> list[tuple[RadarState, SectorReport]]:
        """Take the messages that have waited."""
        self.clock.settle(number, state.counts)
        waiting, state.waiting = state.waiting, []
        reports = [report for entry in waiting for report in self._taken(state, *entry)]
        return self._made(state, reports)

    @staticmethod
    def _made(
        state: RadarState, reports: list[SectorReport]
    ) -> list[tuple[RadarState, SectorReport]]:
        state.reports += len(reports)
        return [(state, report) for report in reports]

    def _taken(
        self, state: RadarState, message: Message, received_ns: int | None
    ) -> list[SectorReport]:
        if isinstance(message, Plot):
            period, judged = message.period, not state.services
        else:
            period, judged = DAY, True
        time_ns = self.clock.time_ns(
            message.radar, message.time_of_day, period, received_ns, judged, state.counts
        )
        if time_ns is None:
            return []
        state.time_ns = time_ns
        believed = self.clock.believes(time_ns, received_ns)
        state.counts["time_off"] += not believed
        if isinstance(message, Plot):
            state.plots += 1
            state.seen.add(message)
            self.call_signs.take(message.address, message.call_sign)
            if believed:
                return state.assembler.add_plot(message, time_ns)
            state.assembler.keep_plot(message, time_ns)
            return []
        state.services += 1
        state.site = state.site or message.site
        if not believed:
            return []
        return state.assembler.add_service(message, time_ns)

    def _new(self, number: int) -> RadarState | None:
        """Return the state of a radar that was not heard before, None if it is not taken."""
        if self._named:
            self.counts["unknown_radar"] += 1
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
            settings.rotation_s,
            settings.hold_sectors,
            counts,
            self._finders(),
        )
        return RadarState(settings, assembler, counts=counts, site=settings.site)
