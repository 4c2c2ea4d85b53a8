"""Tracks as sentences of NMEA 0183, as a ship's radar sends its tracked targets.

``TTM`` has them by distance and bearing from own ship, ``TLL`` by latitude and longitude, and
``OSD`` the heading of own ship, to which relative bearings refer. Distances are in nautical miles,
speeds in knots, and the talker is ``RA``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.conflicts.model import closest_approach
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.types import TENTATIVE, Estimates, Pose

from ..targets import geodetic, vertical
from ..targets.tracks import rows_by_track

MILE = 1852.0


class Target(NamedTuple):
    """A target with the number that a ship's radar would give it."""

    number: int  # From 1 to 99
    found: Estimates  # The present ones, or for a lost target the last ones that had it
    row: int  # Its row in them
    status: str  # ``T`` tracked, ``Q`` being acquired, ``L`` lost
    name: str  # Its code or address, or else its track number


class TargetNumbers:
    """The numbers from 1 to 99 of tracks; a number stays with its track as long as it is reported.

    If there are more tracks than numbers, the nearest new ones get those that are free; the number
    that has been free for longest is the next.
    """

    def __init__(self) -> None:
        self._free = list(range(1, 100))
        self._numbered: dict[int, Target] = {}
        self._targets: list[Target] = []
        self._latest: Estimates | None = None

    def of(
        self,
        found: Estimates,
        centre: Sequence[float],
        names: Mapping[int, str] = MappingProxyType({}),
    ) -> list[Target]:
        """Return the targets of a scan by number, with those that are lost since the scan before.

        `names` has those that an operator has given to tracks, and `centre` is the place to which
        targets are near, in the world frame, metres, (2,). Several outputs may ask for the targets
        of one scan.
        """
        if found is not self._latest:
            self._latest = found
            self._targets = self._renew(found, centre, names)
        return self._targets

    def _renew(
        self, found: Estimates, centre: Sequence[float], names: Mapping[int, str]
    ) -> list[Target]:
        distance = np.hypot(*(found.position - np.asarray(centre)).T)
        before, self._numbered = self._numbered, {}
        rows, identities = rows_by_track(found), vertical.identities(found)
        known = [entry for entry in rows if entry[0] in before]
        new = sorted((e for e in rows if e[0] not in before), key=lambda e: distance[e[1]])
        for track, row in [*known, *new[: len(self._free)]]:
            number = before[track].number if track in before else self._free.pop(0)
            status = "Q" if found.track_state[row] == TENTATIVE else "T"
            code, address = identities[row]
            name = _plain(names.get(track, "")) or code or address or str(track)
            self._numbered[track] = Target(number, found, row, status, name)
        lost = [each for track, each in before.items() if track not in self._numbered]
        self._free += sorted(each.number for each in lost)
        return sorted([*self._numbered.values(), *(each._replace(status="L") for each in lost)])


def _plain(name: str) -> str:
    """Return a name without the characters that a sentence reserves or cannot have."""
    return "".join(letter for letter in name if " " <= letter <= "~" and letter not in "$*,!\\^~")


def ttm(targets: Sequence[Target], own: Pose, plane: Plane | None, relative: bool) -> list[bytes]:
    """Encode targets relative to own ship: from true north, or from its bow if `relative`.

    `own` is its pose in the world frame: a velocity of NaN leaves out the distance and the time of
    the closest point of approach, which are also left out beyond a thousand minutes; the time is
    negative after it. Speeds and courses are those over ground. Without a plane the world's y axis
    is true north. A relative message begins with own ship's heading, and is empty if that is NaN.
    """
    knot = MILE / 3600.0
    x, y = own.position
    north = 0.0
    if plane is not None:
        north = float(plane.convergence(*plane.to_geodetic(x, y)))
    heading = 0.5 * math.pi - own.yaw + north
    if relative and math.isnan(heading):
        return []
    zero, mark = (heading, "R") if relative else (0.0, "T")
    sentences = []
    if relative:
        made_good = ",P,,P"
        if not any(map(math.isnan, own.velocity)):
            course = _degrees(math.atan2(*own.velocity) + north)
            made_good = f"{course},P,{math.hypot(*own.velocity) / knot:.1f},P"
        sentences.append(_sentence(f"RAOSD,{_degrees(heading)},A,{made_good},,,N"))
    for target in targets:
        place, velocity = (
            column[target.row] for column in (target.found.position, target.found.velocity)
        )
        line = place - own.position
        speed = float(np.hypot(*velocity))
        values = [
            f"{np.hypot(*line) / MILE:.3f}",
            f"{_degrees(math.atan2(*line) + north - zero)},{mark}",
            f"{speed / knot:.1f}",
            _degrees(math.atan2(*velocity) + north - zero) if speed > geodetic.LEAST_SPEED else "",
            f"{mark},{_approach(line, velocity - own.velocity)},N",
        ]
        text = f"RATTM,{target.number:02d},{','.join(values)}"
        end = f"{target.status},,{_time(target.found.stamp_ns)},A"
        sentences.append(_named_sentence(text, target.name, end))
    return sentences


def tll(targets: Sequence[Target], plane: Plane) -> list[bytes]:
    """Encode targets by latitude and longitude."""
    sentences = []
    for target in targets:
        latitude, longitude = map(float, plane.to_geodetic(*target.found.position[target.row]))
        place = f"{_minutes(latitude, 2, 'NS')},{_minutes(longitude, 3, 'EW')}"
        end = f"{_time(target.found.stamp_ns)},{target.status},"
        sentences.append(_named_sentence(f"RATLL,{target.number:02d},{place}", target.name, end))
    return sentences


def _approach(line: FloatArray, velocity: FloatArray) -> str:
    """Return distance, miles, and time, minutes, of the closest point of approach as two fields.

    `line` is the target's position and `velocity` its velocity relative to own ship.
    """
    found = closest_approach(line, velocity, np.zeros(2))
    if not abs(found.time_s) < 60e3:  # NaN too
        return ","
    return f"{found.distance / MILE:.3f},{found.time_s / 60.0:.1f}"


def _degrees(angle: float) -> str:
    """Return an angle, radians, as degrees from 0 to 359.9."""
    return f"{round(math.degrees(angle) % 360.0, 1) % 360.0:05.1f}"


def _minutes(angle: float, digits: int, signs: str) -> str:
    """Return an angle, degrees, as degrees and minutes with the letter of its sign."""
    whole, rest = divmod(round(abs(angle) * 6e5), 600_000)
    return f"{whole:0{digits}d}{rest // 10_000:02d}.{rest % 10_000:04d},{signs[angle < 0.0]}"


def _time(stamp_ns: int) -> str:
    """Return the time of day of a stamp, to a hundredth of a second."""
    minutes, rest = divmod(stamp_ns // 10_000_000 % 8_640_000, 6000)
    return f"{minutes // 60:02d}{minutes % 60:02d}{rest // 100:02d}.{rest % 100:02d}"


def _named_sentence(text: str, name: str, end: str) -> bytes:
    """Return a sentence with a name, which is left out where the sentence would be too long."""
    named = _sentence(f"{text},{name},{end}")
    # The standard's longest sentence, with its line end.
    return named if len(named) <= 82 else _sentence(f"{text},,{end}")


def _sentence(text: str) -> bytes:
    """Return a sentence with its start, checksum and line end."""
    checksum = 0
    for byte in text.encode("ascii"):
        checksum ^= byte
    return f"${text}*{checksum:02X}\r\n".encode("ascii")
