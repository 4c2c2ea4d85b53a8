"""Notations of lists of numbers: places, poses, regions, biases, and lists that may be shorter."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from phd_jdtc_ros.core.sensors.bias import SensorBias
from phd_jdtc_ros.core.sensors.gaussians import STANDARD_AIR, Air, HeightPrior
from phd_jdtc_ros.core.sensors.position import Area
from phd_jdtc_ros.core.tracks.region import Region

from ..schema import Form, numbers

# The value of a radar's parameter `pose` if the radar does not move.
FIXED = "fixed"
# The messages nav_msgs/Odometry and geometry_msgs/PoseStamped.
POSE_MESSAGES = ("odometry", "pose_stamped")
# The value of `pose`, and `PoseSource.message`, of a radar whose frame the transforms place; and
# the topics of the transforms.
TF = "tf"
TRANSFORMS, STATIC_TRANSFORMS = TRANSFORM_TOPICS = ("/tf", "/tf_static")


class PoseSource(NamedTuple):
    """The topic of the poses of a radar's platform, and their use."""

    topic: str  # Empty for a radar that does not move
    message: str  # One of `POSE_MESSAGES`, or `TF`
    yaw: bool  # True if the platform's orientation turns the radar

    @property
    def topics(self) -> tuple[str, ...]:
        """All topics from which the poses follow."""
        return TRANSFORM_TOPICS if self.message == TF else (self.topic,) if self.topic else ()


NO_POSE = PoseSource("", POSE_MESSAGES[0], True)


def pose_source(topic: str, message: str, yaw: bool = True) -> PoseSource:
    """Return the source of the poses that the parameters `pose` and `pose_message` name."""
    if topic == FIXED:
        return NO_POSE
    return PoseSource(TRANSFORMS, TF, yaw) if topic == TF else PoseSource(topic, message, yaw)


def _pose(given: Any) -> str | None:
    words = given.split() if isinstance(given, str) else []
    # A word in other letters is most likely a mistake; the topics of transforms are read with tf.
    mistaken = len(words) == 1 and given not in (TF, FIXED) and given.lower() in (TF, FIXED)
    return None if len(words) != 1 or mistaken or given in TRANSFORM_TOPICS else str(given)


POSE = Form(f"{FIXED}, {TF}, or the topic of the platform's poses in the world frame", _pose)


def _list_form(
    allowed: str,
    sound: Callable[[list[float]], bool],
    value: Callable[[list[float]], Any] = lambda given: given,
) -> Form:
    """Return the form of a list of numbers that are `sound` together."""

    def read(given: Any) -> list[float] | None:
        found = numbers(given)
        return found if found is not None and sound(found) else None

    return Form(allowed, read, value)


def beginning_of(usual: Sequence[float], low: float, high: float, whole: bool = False) -> Form:
    """Return the form of the first numbers of a list, of which those left out are the usual ones.

    All are from `low` to `high`, and whole numbers if this is so.
    """
    noun = "whole numbers" if whole else "numbers"
    rest = ", ".join(f"{number:g}" for number in usual[1:])
    ends = "second is" if len(usual) == 2 else "others are"

    def read(given: Any) -> list[float] | None:
        found = numbers(given, low, high)
        if found is None or not 1 <= len(found) <= len(usual):
            return None
        found += usual[len(found) :]
        if not whole:
            return found
        return [int(each) for each in found] if all(each == int(each) for each in found) else None

    allowed = f"1 to {len(usual)} {noun} from {low:g} to {high:g}; if left out, the {ends} {rest}"
    return Form(allowed, read, tuple)


def is_region(region: Sequence[float]) -> bool:
    """Return whether these are two corners of a rectangle, with or without a margin."""
    return (
        len(region) in (4, 5)
        and region[0] < region[2]
        and region[1] < region[3]
        and all(margin >= 0.0 for margin in region[4:])
    )


# Largest biases: range, m; range gain, m per m; azimuth, degrees; time, s.
MOST_BIAS = (1e5, 0.5, 180.0, 60.0)
POSITION = _list_form(
    "a list of 2 or 3 finite numbers",
    lambda given: len(given) in (2, 3),
    lambda given: (*given, 0.0)[:3],
)
PLACE = _list_form(
    "empty or a latitude from -90 to 90 degrees, a longitude from -360 to 360 degrees and a height "
    "in metres",
    lambda given: not given or (len(given) == 3 and abs(given[0]) <= 90 and abs(given[1]) <= 360),
)
# A place whose latitude and longitude may be unknown: any will do for the curvature of the earth.
PLACE_OR_HEIGHT = _list_form(
    f"{PLACE.allowed}, or the height alone if the place is unknown",
    lambda given: (len(given) == 1) or PLACE.read([*given]) is not None,
    lambda given: [0.0, 0.0, *given] if len(given) == 1 else given,
)
HEIGHT = _list_form(
    "empty or one height from -10000 to 100000",
    lambda given: not given or (len(given) == 1 and -1e4 <= given[0] <= 1e5),
    lambda given: given[0] if given else None,
)
QNH = _list_form(
    "empty or two numbers: a pressure from 850 to 1100 and a deviation from 0 to 100, hPa",
    lambda given: (
        not given or (len(given) == 2 and 850 <= given[0] <= 1100 and 0 <= given[1] <= 100)
    ),
    lambda given: Air.of(*given) if given else STANDARD_AIR,
)
HEIGHTS = _list_form(
    "2 or 3 numbers: a mean, a standard deviation above 0, and a floor (0) below the mean plus "
    "twice the deviation, m",
    lambda given: (
        len(given) in (2, 3)
        and max(map(abs, given)) <= 1e6
        and given[1] > 0.0
        and (*given, 0.0)[2] < given[0] + 2.0 * given[1]
    ),
    lambda given: HeightPrior(*(*given, 0.0)[:3]),
)
REGION = _list_form(
    "empty or [x_min, y_min, x_max, y_max], and a margin of at least 0, with the third above the "
    "first and the fourth above the second, all from -1e6 to 1e6",
    lambda given: not given or (is_region(given) and max(map(abs, given)) <= 1e6),
    lambda given: Region(*given) if given else None,
)
APART = _list_form(
    "empty, or a distance and maybe a difference of heights, above 0 and at most 1e6",
    lambda given: len(given) <= 2 and all(0.0 < value <= 1e6 for value in given),
    lambda given: (*given, 0.0, 0.0)[:2],
)
AREA = _list_form(
    "[x_min, y_min, x_max, y_max], or x and y of at least 3 corners of a polygon, within 1e7 m and "
    "with a size above 0",
    lambda given: (
        len(given) >= 4
        and len(given) % 2 == 0
        and max(map(abs, given)) <= 1e7
        and (is_region(given) if len(given) == 4 else Area.of(given).size > 0.0)
    ),
    Area.of,
)
BIASES = _list_form(
    "4 numbers: range within 100000 m, gain within 0.5, azimuth within 180 degrees, time within "
    "60 s",
    lambda given: (
        len(given) == len(MOST_BIAS)
        and all(abs(bias) <= most for bias, most in zip(given, MOST_BIAS, strict=True))
    ),
    lambda given: SensorBias(given[0], given[1], math.radians(given[2]), given[3]),
)
