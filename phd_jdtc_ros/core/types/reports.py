"""Self-reports: where transmitters say that they are, as AIS and ADS-B do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from ..arrays import UNKNOWN, BoolArray, FloatArray, IntArray, ReadOnly

# Identity spaces: an address is unique in its space only.
ICAO, MMSI, TRACK_NUMBER, OTHER = range(1, 5)
SPACES = ("", "icao", "mmsi", "number", "other")
# What an MMSI is of, if not of a craft, by ranges of numbers: MID, a country's, begins with 2 to 7
# (ITU-R M.585-9, annexes 1 and 2). Numbers of groups are of ships that have them wrongly set.
STATIONS = {
    "coast_station": ((2_000_000, 8_000_000),),  # 00 MID
    "aircraft": ((111_200_000, 111_800_000),),  # 111 MID
    "aid_to_navigation": ((992_000_000, 998_000_000),),  # 99 MID
    # Radios that people carry (8 MID), beacons of distress (970, 972, 974), and 979, of gear.
    "small_radio": ((820_000_000, 880_000_000), (970_000_000, 980_000_000)),
}
# Number of letters of a name or a call sign.
NAME_SIZE = 20
# Whether the source says that its position is accurate; `UNKNOWN` if it says nothing.
ACCURATE = 1


def is_of(station: str, address: FloatArray | IntArray, space: IntArray) -> BoolArray:
    """Return whether the addresses are MMSI of one of `STATIONS`, (N,)."""
    found = np.zeros(len(address), dtype=np.bool_)
    for first, end in STATIONS[station]:
        found |= (space == MMSI) & (address >= first) & (address < end)
    return found


@dataclass(frozen=True)
class SelfReports(ReadOnly):
    """Positions that M transmitters report of themselves, in any order."""

    time_ns: IntArray  # Time of the position, (M,)
    position: FloatArray  # Of the antenna in the world frame, metres, (M, 2)
    # Errors of the position, square metres, (M, 2, 2); NaN where unknown.
    covariance: FloatArray
    # Over ground in the world frame, metres per second, (M, 2); NaN where unknown.
    velocity: FloatArray
    # Direction of the bow in the world frame, radians counter-clockwise, (M,); NaN where unknown.
    heading: FloatArray
    height: FloatArray  # Above the world's zero, metres, (M,); NaN where unknown
    # Number of the transmitter in its space, 32 bits, (M,); `UNKNOWN` without one.
    address: IntArray
    space: IntArray  # Identity space, (M,)
    type: IntArray  # Type of ship or emitter as sent, (M,); `UNKNOWN` without one
    name: IntArray  # ASCII codes of the name, padded with zeros, (M, `NAME_SIZE`)
    accurate: IntArray  # `ACCURATE`, 0, or `UNKNOWN`, (M,)
    # Shortest interval at which such a transmitter reports, seconds, (M,); NaN where unknown.
    interval_s: FloatArray
    # Place of the antenna ahead and to the left of the middle of its ship, and the ship's length,
    # metres, (M, 3); NaN where unknown.
    hull: FloatArray
    # Index of the receiver among those that are configured, (M,).
    receiver: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __post_init__(self) -> None:
        size = len(self.time_ns)
        if not self.receiver.size:
            object.__setattr__(self, "receiver", np.zeros(size, dtype=np.int64))
        super().__post_init__()
        inner = {
            "position": (2,),
            "velocity": (2,),
            "covariance": (2, 2),
            "hull": (3,),
            "name": (NAME_SIZE,),
        }
        for each in fields(self):
            shape, expected = getattr(self, each.name).shape, (size, *inner.get(each.name, ()))
            if shape != expected:
                raise ValueError(f"{each.name}: expected shape {expected}, got {shape}")
        if not (np.isfinite(self.position).all() and (self.time_ns >= 0).all()):
            raise ValueError("position, time_ns: must be finite, and not negative")

    def __len__(self) -> int:
        return len(self.time_ns)

    @staticmethod
    def of(
        time_ns: IntArray, position: FloatArray, **columns: FloatArray | IntArray
    ) -> SelfReports:
        """Return reports with these columns; all others are unknown, and the space is `OTHER`."""
        count = len(time_ns)
        unknown: dict[str, FloatArray | IntArray] = {
            "covariance": np.full((count, 2, 2), np.nan),
            "velocity": np.full((count, 2), np.nan),
            "heading": np.full(count, np.nan),
            "height": np.full(count, np.nan),
            "address": np.full(count, UNKNOWN),
            "space": np.full(count, OTHER),
            "type": np.full(count, UNKNOWN),
            "name": np.zeros((count, NAME_SIZE), dtype=np.int64),
            "accurate": np.full(count, UNKNOWN),
            "interval_s": np.full(count, np.nan),
            "hull": np.full((count, 3), np.nan),
        }
        given: dict[str, Any] = {**unknown, **columns}
        return SelfReports(time_ns=time_ns, position=position, **given)

    def take(self, rows: IntArray) -> SelfReports:
        """Return the reports of these rows, in this order."""
        return self.changed(**{each.name: getattr(self, each.name)[rows] for each in fields(self)})

    @staticmethod
    def concatenate(parts: Sequence[SelfReports]) -> SelfReports:
        """Return the reports of all parts, at least one."""
        if len(parts) == 1:
            return parts[0]
        names = [each.name for each in fields(SelfReports)]
        return parts[0].changed(
            **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        )


def text_of(name: IntArray) -> str:
    """Return a name, whose letters are ASCII codes and 0 behind them, as text."""
    return bytes(name[name > 0].astype(np.uint8)).decode("ascii", "replace").strip()


# Why a source is doubtful, or what its owner was.
NO_REASON, UNCONFIRMED, LEFT, SHARED = range(4)
REASONS = ("", "unconfirmed", "left", "shared")
# Probability from which a finding is an alarm.
ALARM = 0.99


@dataclass(frozen=True)
class Reported(ReadOnly):
    """What self-reports say of T estimates."""

    # The most probable source, or for a track that its source has left, that one, (T,); `UNKNOWN`
    # without one.
    address: IntArray
    space: IntArray  # Its identity space; 0 without a source, (T,)
    name: IntArray  # Its name, (T, `NAME_SIZE`)
    type: IntArray  # Its type as sent, (T,); `UNKNOWN` without one
    # 1 for a track of reports alone, which no radar track owns, (T,).
    alone: IntArray
    owned: FloatArray  # Probability that the source reports this target, and rightly, (T,)
    dark: FloatArray  # Probability that it is obliged to transmit and does not, (T,)
    # Probability that it does not transmit, (T,); NaN outside the coverage of all receivers.
    silent: FloatArray
    # Probability that the source is not where it says, (T,); NaN where no radar looks.
    doubtful: FloatArray
    offset: FloatArray  # Of the antenna ahead and to the left, metres, (T, 2); NaN without one
    reason: IntArray  # Index in `REASONS`, (T,)
    since_ns: IntArray  # Time since which the reason holds, (T,); 0 without one
    # Time of the last report, (T,); 0 without one.
    heard_ns: IntArray

    @staticmethod
    def unknown(count: int) -> Reported:
        """Return what is said of `count` estimates without any report."""
        zeros, never = np.zeros(count), np.zeros(count, dtype=np.int64)
        nan, no_one = np.full(count, np.nan), np.full(count, UNKNOWN)
        return Reported(
            address=no_one,
            space=never,
            name=np.zeros((count, NAME_SIZE), dtype=np.int64),
            type=no_one,
            alone=never,
            owned=zeros,
            dark=zeros,
            silent=nan,
            doubtful=nan,
            offset=np.full((count, 2), np.nan),
            reason=never,
            since_ns=never,
            heard_ns=never,
        )

    def take(self, rows: IntArray | slice) -> Reported:
        """Return what is said of these estimates."""
        return Reported(**{each.name: getattr(self, each.name)[rows] for each in fields(self)})

    @staticmethod
    def concatenate(parts: Sequence[Reported]) -> Reported:
        """Return what is said of several sets of estimates."""
        names = [each.name for each in fields(Reported)]
        return Reported(
            **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        )

    def source_text(self, row: int) -> str:
        """Return the source of an estimate in words; empty without one."""
        if not self.space[row]:
            return ""
        name, address = text_of(self.name[row]), int(self.address[row])
        kind = SPACES[int(self.space[row])]
        number = f"{address:06X}" if kind == "icao" else str(address)
        identity = f"{kind.upper()} {number}" if address != UNKNOWN else "unnamed transmitter"
        return f"{name} ({identity})" if name else identity

    def reason_text(self, row: int, time_ns: int) -> str:
        """Return in words what an operator should know of an estimate; empty if nothing."""
        source, reason = self.source_text(row), int(self.reason[row])
        ago = f", for {max(time_ns - int(self.since_ns[row]), 0) * 1e-9:.0f} s"
        if reason == LEFT:
            said = f"{source} has left its radar track" if self.alone[row] else f"left by {source}"
            return said + ago
        if reason == SHARED:
            return f"two places report as {source}"
        if reason == UNCONFIRMED:
            return f"{source} is not where radars look for it{ago}"
        if self.dark[row] > 0.5:
            heard = int(self.heard_ns[row])
            since = f"since {(time_ns - heard) * 1e-9:.0f} s" if heard else "never heard"
            return f"does not transmit: {since}"
        return ""
