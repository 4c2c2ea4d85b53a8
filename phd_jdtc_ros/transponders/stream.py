"""Converts the bytes of receivers of AIS and ADS-B to batches of reports of each network."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from phd_jdtc_ros.transport.network import Datagram, fits_stamp

from .aircraft import ModeSReader, read_sbs
from .ais import AisReader
from .batches import Batch, Batches
from .messages import Heard
from .transmitters import Transmitters
from .units import MODE_S, NMEA, Splitter, Unit

# The clock of receivers of Mode S, nanoseconds in twelve ticks, and its period in ticks.
NS_PER_12_TICKS, TICKS = 1000, 2**48
# Reasons for which a message is not used though nothing is wrong with it.
INTENDED = frozenset(
    ("other_message", "other_sentence", "other_type", "own_ship", "repeated", "coarse", "names")
)
# Reasons that are not for leaving a message out.
DATED = frozenset(
    ("no_time", "time_off", "time_stands", "tag_checksum", "tag_time_off", "names", "receipt_time")
)


@dataclass(frozen=True)
class StreamSettings:
    """How a stream of reports is read."""

    period_ns: int  # Period of clouds
    max_offset_ns: int  # Difference of a time from its receipt above which the receipt is used
    # Latitude and longitude of the receiver, degrees, for aircraft on the ground.
    position: tuple[float, float] | None = None
    start_ns: int = 0  # Time of the first message of a recording without times of receipt


class ReportStream:
    """Reads pieces of bytes; `counts` has what is left out by reason, `formats` what was read.

    Reasons beside those of its parts are ``time_unknown``, frames of a recording without times, and
    ``receipt_time``, pieces whose time of receipt fits no stamp and is ignored.

    `used` counts the reports by network.
    """

    def __init__(self, settings: StreamSettings) -> None:
        self.counts: Counter[str] = Counter()
        self.formats: Counter[str] = Counter()
        self.used: Counter[str] = Counter()
        self.transmitters = Transmitters(self.counts, settings.max_offset_ns, settings.start_ns)
        self.pieces = 0
        self._settings = settings
        self._splitter = Splitter(self.counts)
        self._ais = AisReader(self.counts, settings.max_offset_ns)
        self._mode_s = ModeSReader(self.counts, settings.position)
        self._batches: dict[str, Batches] = {}
        self._first_ticks: int | None = None
        self._received_ns: int | None = None

    @property
    def faulty(self) -> int:
        """Number of messages that should have been used and could not."""
        left_out = set(self.counts) - INTENDED - DATED
        return sum(self.counts[reason] for reason in left_out)

    def feed(self, piece: Datagram) -> Iterator[tuple[str, Batch] | None]:
        """Yield for each message of a piece the batch that it completes, with its network.

        It yields None if it completes none, so that the caller can do other work.
        """
        self.pieces += 1
        received_ns, source = piece.received_ns, piece.source or ""
        if received_ns is not None and not fits_stamp(received_ns):
            self.counts["receipt_time"] += 1
            received_ns = None
        self._received_ns = received_ns
        for unit in self._splitter.feed(piece.data, source):
            yield self._read(unit, received_ns, source)

    def due(self, now_ns: int) -> Iterator[tuple[str, Batch]]:
        """Yield the batches that have ended by a time of receipt."""
        for network, batches in self._batches.items():
            if (batch := batches.due(now_ns)) is not None:
                yield network, batch

    def finish(self) -> Iterator[tuple[str, Batch]]:
        """Yield what waits, at the end of a recording."""
        for unit in self._splitter.finish():
            if (found := self._read(unit, self._received_ns, "")) is not None:
                yield found
        for network, batches in self._batches.items():
            if (batch := batches.finish()) is not None:
                yield network, batch

    def _read(self, unit: Unit, received_ns: int | None, source: str) -> tuple[str, Batch] | None:
        self.formats[unit.kind] += 1
        heard: Heard | str | None
        if unit.kind == NMEA:
            found = self._ais.read(unit.data, received_ns, source)
            heard, received_ns = found or (None, received_ns)
        elif unit.kind == MODE_S:
            received_ns = self._clock_of(unit) if received_ns is None else received_ns
            if received_ns is None:
                heard = "time_unknown"
            else:
                heard = self._mode_s.read(unit.data, received_ns)
        else:
            heard = read_sbs(unit.data)
        if isinstance(heard, str):
            self.counts[heard] += 1
            return None
        return None if heard is None else self._take(heard, received_ns)

    def _take(self, heard: Heard, received_ns: int | None) -> tuple[str, Batch] | None:
        dated = self.transmitters.take(heard, received_ns)
        if dated is None:
            return None
        self.used[heard.network] += 1
        period_ns = self._settings.period_ns
        batches = self._batches.setdefault(heard.network, Batches(period_ns))
        batch = batches.add(dated, dated.time_ns if received_ns is None else received_ns)
        return None if batch is None else (heard.network, batch)

    def _clock_of(self, unit: Unit) -> int | None:
        """Return the time of a frame of a recording by the receiver's clock, None without one."""
        if unit.ticks is None:
            return None
        if self._first_ticks is None:
            self._first_ticks = unit.ticks
        passed = (unit.ticks - self._first_ticks) % TICKS
        return self._settings.start_ns + passed * NS_PER_12_TICKS // 12
