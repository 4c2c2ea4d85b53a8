"""Transponders that reply with code, address and height; the block ``transponders`` of a scenario.

Replies have their own random generators, so that the plots of a seed are the same without
transponders. Ground ranges do not depend on the heights.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from phd_jdtc_ros.configuration.schema import parameter
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.types import UNKNOWN, Detections

from .checked import mapping, read
from .targets import Flight

# Heights in metres: resolution of Mode C (100 ft), range of the levels, range of garbled heights.
MODE_C, LEVELS, GARBLED = 30.48, (1500.0, 11e3), (0.0, 14e3)
# Ranges of the climb rate, m/s, and of the duration of a climb, s. An aircraft that begins slower
# than GROUND_SPEED, m/s, stays on the ground; one that begins or ends slower than RUNWAY_SPEED,
# m/s, takes off or lands.
CLIMB, CLIMB_S, GROUND_SPEED, RUNWAY_SPEED = (3.0, 12.0), (60.0, 300.0), 20.0, 85.0
# Third word of the seeds of the replies' generators.
STREAM = 3


class ReplyContent(NamedTuple):
    """The content of a target's replies."""

    code: int  # `UNKNOWN` without a transponder, as the address
    address: int
    level: float  # Initial height, metres
    climb: float  # Climb rate, metres per second
    climb_start_s: float  # Start of the climb, seconds after scan 0
    climb_duration_s: float  # Duration of the climb, seconds

    def height(self, time_s: FloatArray) -> FloatArray:
        """Return the heights and climb rates at times after scan 0, shape (N, 2)."""
        flown = time_s - self.climb_start_s
        climbed = self.climb * np.clip(flown, 0.0, self.climb_duration_s)
        rate = np.where((flown >= 0.0) & (flown < self.climb_duration_s), self.climb, 0.0)
        landed = self.level + climbed < 0.0
        both = np.stack([self.level + climbed, rate], axis=1)
        return np.where(landed[:, None], 0.0, both)


@dataclass(frozen=True)
class Transponders:
    """The transponders of a scenario's targets, and the quality of their replies."""

    share: float = parameter(1.0, "Share of the targets with a transponder.", (0.0, 1.0))
    reply_probability: float = parameter(
        0.95, "Probability that an equipped target's plot has a reply.", (0.0, 1.0)
    )
    mode_s_share: float = parameter(
        1.0, "Share of the equipped targets with an address.", (0.0, 1.0)
    )
    # A garbled value is replaced by a random one.
    code_garbled: float = parameter(0.0, "Probability that a reply's code is garbled.", (0.0, 1.0))
    height_garbled: float = parameter(
        0.0, "Probability that a reply's height is garbled.", (0.0, 1.0)
    )
    address_garbled: float = parameter(
        0.0, "Probability that a reply's address is garbled.", (0.0, 1.0)
    )
    shared_code_share: float = parameter(0.1, "Share of targets with the code 7000.", (0.0, 1.0))
    seed: int = parameter(0, "Seed of the targets' codes and heights.", (0, 2**31 - 1))

    def reply_content(self, number: int, flight: Flight, duration_s: float) -> ReplyContent:
        """Return the content of a target's replies, by number from 1; it is deterministic.

        The run lasts `duration_s` seconds.
        """
        rng = np.random.default_rng([self.seed, number, STREAM])
        equipped, shared = rng.random() < self.share, rng.random() < self.shared_code_share
        own, address = int(rng.integers(1, 0o7000)), int(rng.integers(1, 1 << 24))
        # The code that some targets share.
        code = 0o7000 if shared else own
        level, climb = rng.uniform(*LEVELS), rng.uniform(*CLIMB)
        # One third of the targets keep their level, one third climb and one third descend.
        sense = int(rng.integers(-1, 2))
        climb_start_s, climb_duration_s = rng.uniform(0.0, duration_s), rng.uniform(*CLIMB_S)
        begins, ends = (np.hypot(*velocity) for velocity in (flight.velocity, flight.end_velocity))
        if flight.height or begins < GROUND_SPEED:
            level, sense = flight.height, 0
        elif begins < RUNWAY_SPEED:
            climb_start_s, climb_duration_s, sense, level = flight.start_s, level / climb, 1, 0.0
        elif ends < RUNWAY_SPEED:
            climb_duration_s, sense = level / climb, -1
            climb_start_s = flight.end_s - climb_duration_s
        if rng.random() >= self.mode_s_share:
            address = UNKNOWN
        if not equipped:
            code = address = UNKNOWN
        climb *= sense
        return ReplyContent(
            code, address, float(level), float(climb), float(climb_start_s), float(climb_duration_s)
        )

    def with_replies(
        self,
        found: Detections,
        source: IntArray,
        time_s: FloatArray,
        contents: Mapping[int, ReplyContent],
        rng: np.random.Generator,
    ) -> Detections:
        """Return M detections with replies.

        `source`, shape (M,), has the number of each detection's target, 0 for clutter,
        which does not reply; `time_s`, shape (M,), seconds after scan 0.
        """
        count = len(found)
        code, address = np.full(count, UNKNOWN), np.full(count, UNKNOWN)
        height = np.full(count, np.nan)
        replied = rng.random(count) < self.reply_probability
        garbled = rng.random((2, count)) < [[self.code_garbled], [self.height_garbled]]
        wrong, wrong_height = rng.integers(0, 1 << 12, count), rng.uniform(*GARBLED, count)
        for number in np.unique(source[source > 0]).tolist():
            content = contents[number]
            own = np.flatnonzero((source == number) & replied)
            if content.code == UNKNOWN:
                continue
            code[own], address[own] = content.code, content.address
            height[own] = content.height(time_s[own])[:, 0]
        replies = code != UNKNOWN
        code = np.where(garbled[0] & replies, wrong, code)
        # These are drawn last, so that the other draws do not depend on them.
        other = rng.random(count) < self.address_garbled
        address = np.where(other & (address != UNKNOWN), rng.integers(1, 1 << 24, count), address)
        height = np.where(garbled[1], wrong_height, height)
        height = np.where(replies, MODE_C * np.round(height / MODE_C), np.nan)
        return replace(found, code=code, address=address, height=height)


def transponders(document: Mapping[str, Any], faults: list[str]) -> Transponders | None:
    """Return the document's ``transponders``, None without; add its faults to `faults`."""
    if "transponders" not in document:
        return None
    given = mapping(document, "transponders", faults)
    return read(Transponders, given, "transponders.", faults)
