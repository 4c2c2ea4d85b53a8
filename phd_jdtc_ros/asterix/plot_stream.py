# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Datagrams of several radars to the sectors of each: the whole path in."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from . import blocks
from .assembly import Assembler, SectorReport
from .clocks import StreamClock
from .messages import DAY, Plot, ServiceMessage

# Radars that are taken without being named; forged ones would fill the memory.
MAX_RADARS = 64
# A second source of a radar is taken once the first has been silent for so long.
SOURCE_TIMEOUT_S = 10.0


@dataclass(frozen=True)
class RadarSettings:
    """What is known of a radar.

    Parameters
    ----------
    name : str
    sectors : int
        To a turn; a multiple of 4.
    rotation_s : float
        0 if it is not known.
    hold_sectors : int
        See `Assembler`.
    """

    name: str
    sectors: int = 32
    rotation_s: float = 0.0
    hold_sectors: int = 0


@dataclass
class RadarState:
    """What became of one radar's messages.

    Attributes
    ----------
    plots, services, reports : int
        Messages taken and sectors made.
    counts : Counter
        What was left out or bridged, by reason: those of `Assembler` and `StreamClock`, and
        ``second_source``, messages from another address than the radar's, and ``source_changed``.
    sources : dict of kind to str
        Where the radar's plots (`Plot`) and service messages (`ServiceMessage`) come from, which
        may differ, if it is known.
    other_source : str or None
        The last other one.
    time_ns : int
        Of the last message.
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
    """Takes datagrams, returns sectors.

    Parameters
    ----------
    radars : mapping of number to RadarSettings
        By SAC in the upper and SIC in the lower eight bits. If it is empty all radars are taken,
        under the name ``radar_SAC_SIC``.
    others : RadarSettings
        Of radars that are not named.
    clock : StreamClock or None

    Attributes
    ----------
    counts : Counter
        What was left out of all radars' messages, by reason; see `blocks.messages`, and
        ``unknown_radar`` and ``too_many_radars``.
    radars : dict of number to RadarState
    """

    def __init__(
        self,
        radars: Mapping[int, RadarSettings],
        others: RadarSettings | None = None,
        clock: StreamClock | None = None,
    ) -> None:
        self.counts: Counter[str] = Counter()
        self.radars = {number: _state(settings) for number, settings in radars.items()}
        self.clock = clock or StreamClock()
        self._others = others or RadarSettings("")
        self._named = bool(radars)
        self.datagrams = 0

    def feed(
        self, data: bytes, received_ns: int | None = None, source: str | None = None
    ) -> list[tuple[RadarState, SectorReport]]:
        """Return the sectors that are complete by a datagram, each with its radar, in order.

        Parameters
        ----------
        data : bytes
        received_ns : int or None
            When it came, since the epoch, if that is known.
        source : str or None
            Where it came from, if that is known.
        """
        self.datagrams += 1
        found: list[tuple[RadarState, SectorReport]] = []
        for message in blocks.messages(data, self.counts):
            state = self.radars.get(message.radar) or self._new(message.radar)
            if state is None:
                continue
            now_ns = state.time_ns if received_ns is None else received_ns
            if not state.belongs(type(message), source, now_ns):
                continue
            reports = self._taken(state, message, received_ns)
            state.reports += len(reports)
            found += [(state, report) for report in reports]
        return found

    def finish(self) -> list[tuple[RadarState, SectorReport]]:
        """Return what is left at the end of a recording."""
        found = []
        for state in self.radars.values():
            reports = state.assembler.finish()
            state.reports += len(reports)
            found += [(state, report) for report in reports]
        return found

    def _taken(
        self, state: RadarState, message: Plot | ServiceMessage, received_ns: int | None
    ) -> list[SectorReport]:
        if isinstance(message, Plot):
            period, judged = message.period, not state.services
        else:
            period, judged = DAY, True
        time_ns = self.clock.time_ns(
            message.radar, message.time_of_day, period, received_ns, judged, state.counts
        )
        state.time_ns = time_ns
        if isinstance(message, Plot):
            state.plots += 1
            return state.assembler.add_plot(message, time_ns)
        state.services += 1
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
        state = self.radars[number] = _state(replace(self._others, name=name))
        return state


def _state(settings: RadarSettings) -> RadarState:
    counts: Counter[str] = Counter()
    assembler = Assembler(
        settings.sectors, settings.rotation_s, settings.hold_sectors, counts=counts
    )
    return RadarState(settings, assembler, counts=counts)
