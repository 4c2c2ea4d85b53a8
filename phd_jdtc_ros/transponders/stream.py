"""Converts the bytes of receivers of AIS and ADS-B to batches of reports of each network."""

from __future__ import annotations

import math
import re
from collections import Counter, OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.transport.network import Datagram, fits_stamp

from .aircraft import ModeSReader, read_sbs
from .ais import AisReader
from .messages import NAME_SIZE, NONE, Heard
from .transmitters import Dated, Transmitters

# Marks an unknown address or code in a cloud.
UNKNOWN = 2**32 - 1
# Columns of double precision.
WIDE = ("latitude", "longitude", "time")


class Batch(NamedTuple):
    """Reports that came within a period."""

    stamp_ns: int  # When the last of them came
    reports: list[Dated]


class Batches:
    """Collects reports; a batch ends a period after its first report."""

    # Upper bound of the reports of a batch.
    MOST = 10_000

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._pending: list[Dated] = []
        self._first_ns = self._last_ns = 0

    def add(self, report: Dated, came_ns: int) -> Batch | None:
        """Add a report, and return the batch that has ended before it."""
        full = len(self._pending) >= self.MOST
        ended = self.finish() if full or abs(came_ns - self._first_ns) >= self._period_ns else None
        if not self._pending:
            self._first_ns = came_ns
        self._pending.append(report)
        self._last_ns = came_ns
        return ended

    def due(self, now_ns: int) -> Batch | None:
        """Return the batch that has ended by a time, None if none has."""
        return self.finish() if abs(now_ns - self._first_ns) >= self._period_ns else None

    def finish(self) -> Batch | None:
        """Return the reports that wait, None without any."""
        if not self._pending:
            return None
        # Stamps rise with the reports, which have their own times.
        found, self._pending = self._pending, []
        return Batch(self._last_ns, found)


def columns(batch: Batch, ellipses: bool = False) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of a cloud in their order, arrays of shape (M,); unknown numbers are NaN.

    They are ``latitude longitude`` (degrees), ``time`` (s since the epoch), ``speed`` (m/s),
    ``course heading`` (degrees clockwise from true north), ``height`` (m), ``std`` of each axis, or
    with `ellipses` ``x_std y_std correlation`` (m, east and north); ``length beam`` of a ship, and
    the antenna's place ``ahead left`` of her middle (m); ``address`` (`UNKNOWN` without one),
    ``space``, ``interval`` (the shortest one of such a transmitter, s), ``type`` (0 if unknown),
    ``accurate`` (255 if unknown), and ``name``, shape (M, `NAME_SIZE`), ASCII padded with zeros.
    """
    found = [report.heard for report in batch.reports]
    by_name = dict(zip(Heard._fields, zip(*found, strict=True), strict=True))

    def column(name: str) -> npt.NDArray[np.float64]:
        return np.array(by_name[name], dtype=np.float64)

    def small(name: str) -> npt.NDArray[np.uint8]:
        return np.array(by_name[name]).clip(0, 255).astype(np.uint8)

    std = ("x_std", "y_std", "correlation") if ellipses else ("x_std",)
    hulls = np.array([_hull(each) for each in found])
    address = column("address")
    return {
        "latitude": column("latitude"),
        "longitude": column("longitude"),
        "time": np.array([report.time_ns for report in batch.reports]) * 1e-9,
        **{name: column(name) for name in ("speed", "course", "heading", "height")},
        **{name if ellipses else "std": column(name) for name in std},
        **{name: hulls[:, k] for k, name in enumerate(("length", "beam", "ahead", "left"))},
        "address": np.where(address == NONE, UNKNOWN, address).astype(np.uint32),
        "space": small("space"),
        "interval": column("interval_s"),
        "type": small("type"),
        "accurate": small("accurate"),
        "name": _names(by_name["name"]),
    }


def _hull(heard: Heard) -> tuple[float, float, float, float]:
    """Return length and beam of a ship, and how far ahead and left of her middle the antenna is."""
    if heard.hull is None:
        return (math.nan,) * 4
    bow, stern, port, starboard = heard.hull
    length, beam = float(bow + stern), float(port + starboard)
    if not (bow or port):  # The antenna's place is unknown
        return length, beam, math.nan, math.nan
    return length, beam, 0.5 * (stern - bow), 0.5 * (starboard - port)


def _names(names: tuple[str, ...]) -> npt.NDArray[np.uint8]:
    text = [name.encode("ascii", "replace")[:NAME_SIZE].ljust(NAME_SIZE, b"\0") for name in names]
    return np.frombuffer(b"".join(text), dtype=np.uint8).reshape(-1, NAME_SIZE)


NMEA, SBS, MODE_S = "nmea", "sbs", "mode_s"
# Upper bound of a line, bytes: a sentence has 82 of them, a tag block not many more.
LONGEST_LINE = 1024
# A frame of Beast: an escape, its kind, a clock of 48 bits, the level, and the message by its kind.
# The escape is doubled within it. Source: the description of Mode-S Beast by its author.
ESCAPE = 0x1A
_BEAST = {ord("1"): 2, ord("2"): 7, ord("3"): 14, ord("4"): 2}
_BEAST_HEAD = 7
_SENTENCE = re.compile(rb"[!$][^*]*\*[0-9A-Fa-f]{2}$")
# Hexadecimal frames as dump1090 writes them, with the clock or without.
_HEXADECIMAL = re.compile(rb"(?:\*|@([0-9A-Fa-f]{12}))((?:[0-9A-Fa-f]{2}){2,14});")


class Unit(NamedTuple):
    """A line or a frame."""

    kind: str  # `NMEA`, `SBS` or `MODE_S`
    data: bytes  # A line without its end; for Mode S the message
    ticks: int | None = None  # The receiver's clock of 12 MHz, None if unknown


class Splitter:
    """Splits the pieces of several sources; `counts` gains what is left out.

    These are ``line_too_long``, ``other_line`` for lines of no known format, ``frame_broken``, and
    ``line_cut`` for lines whose end never came.
    """

    # Upper bound of the sources whose last line waits for its end.
    MOST_SOURCES = 256

    def __init__(self, counts: Counter[str]) -> None:
        self.counts = counts
        self._rests: OrderedDict[str, bytes] = OrderedDict()
        # Sources in the middle of a line that is too long.
        self._skipping: set[str] = set()

    def feed(self, data: bytes, source: str) -> Iterator[Unit]:
        """Yield the units that a piece of a source completes."""
        data, at = self._rests.pop(source, b"") + data, 0
        if source in self._skipping:
            at = data.find(b"\n") + 1
            if not at:
                return
            self._skipping.discard(source)
        while at < len(data):
            end = self._frame_end(data, at) if data[at] == ESCAPE else _line_end(data, at)
            if end < 0:
                break
            unit = _frame(data, at, end) if data[at] == ESCAPE else self._line(data[at:end])
            if unit is not None:
                yield unit
            at = end
        self._keep(data[at:], source)

    def finish(self) -> Iterator[Unit]:
        """Yield the last lines of the sources, at the end of a recording."""
        for rest in self._rests.values():
            if rest[0] == ESCAPE:
                self.counts["frame_broken"] += 1
            elif (unit := self._line(rest)) is not None:
                yield unit
        self._rests.clear()

    def _keep(self, rest: bytes, source: str) -> None:
        if not rest:
            return
        if len(rest) > LONGEST_LINE:
            self.counts["line_too_long"] += 1
            self._skipping.add(source)
            return
        self._rests[source] = rest
        if len(self._rests) > self.MOST_SOURCES:
            self._rests.popitem(last=False)
            self.counts["line_cut"] += 1

    def _line(self, line: bytes) -> Unit | None:
        line = line.strip()
        if not line:
            return None
        if len(line) > LONGEST_LINE:
            self.counts["line_too_long"] += 1
            return None
        if b"!" in line or line[:1] in b"\\$":
            return Unit(NMEA, line)
        if line.startswith((b"MSG,", b"MLAT,", b"SEL,", b"ID,", b"AIR,", b"STA,", b"CLK,")):
            return Unit(SBS, line)
        found = _HEXADECIMAL.fullmatch(line)
        if found is None:
            self.counts["other_line"] += 1
            return None
        return Unit(
            MODE_S, bytes.fromhex(found[2].decode()), int(found[1], 16) if found[1] else None
        )

    def _frame_end(self, data: bytes, at: int) -> int:
        """Return the end of a frame of Beast, -1 if it is not there yet; pass a broken one."""
        if at + 1 >= len(data):
            return -1
        size = _BEAST.get(data[at + 1])
        end, left = at + 2, 0 if size is None else _BEAST_HEAD + size
        while left:
            if end >= len(data):
                return -1
            if data[end] == ESCAPE:
                if end + 1 >= len(data):
                    return -1
                if data[end + 1] != ESCAPE:  # The next frame begins
                    self.counts["frame_broken"] += 1
                    return end
                end += 1
            end, left = end + 1, left - 1
        if size is None:
            self.counts["frame_broken"] += 1
        return end


def _frame(data: bytes, at: int, end: int) -> Unit | None:
    """Return a frame of Beast with a message of Mode S, None for others and broken ones."""
    size = _BEAST.get(data[at + 1], 0)
    body = data[at + 2 : end].replace(b"\x1a\x1a", b"\x1a")
    if size < 7 or len(body) != _BEAST_HEAD + size:
        return None
    return Unit(MODE_S, body[_BEAST_HEAD:], int.from_bytes(body[:6], "big"))


def _line_end(data: bytes, at: int) -> int:
    """Return the end of a line, -1 if it is not there yet.

    A datagram may end without a line feed, after the checksum of its sentence.
    """
    found = data.find(b"\n", at)
    frame = data.find(ESCAPE, at)
    if frame >= 0 and (found < 0 or frame < found):
        return frame
    if found >= 0:
        return found + 1
    tail = data[at:].rstrip()
    if len(tail) <= LONGEST_LINE and (_SENTENCE.search(tail) or _HEXADECIMAL.fullmatch(tail)):
        return len(data)
    return -1


# The clock of receivers of Mode S, nanoseconds in twelve ticks, and its period in ticks.
NS_PER_12_TICKS, TICKS = 1000, 2**48
# Reasons for which a message is not used though nothing is wrong with it.
INTENDED = frozenset(
    ("other_message", "other_sentence", "other_type", "own_ship", "repeated", "coarse", "names")
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

    # Reasons that are not for leaving a message out.
    DATED = frozenset(
        (
            "no_time",
            "time_off",
            "time_stands",
            "tag_checksum",
            "tag_time_off",
            "names",
            "receipt_time",
        )
    )

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
        left_out = set(self.counts) - INTENDED - self.DATED
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
