"""Values that are written as more than one plain number, text or list."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from .schema import Form

# The value of a radar's parameter `pose` for one that stands.
FIXED = "fixed"
# nav_msgs/Odometry and geometry_msgs/PoseStamped.
POSE_MESSAGES = ("odometry", "pose_stamped")
STABILISED = "stabilised"
# A target that cannot be missed would be lost for good with its first miss.
MOST_PROBABILITY = 0.999
MOST_LAG_SCANS, MOST_LAG_S = 100, 1e5
CLUTTER_LAWS = ("rayleigh", "log_normal", "learned")
_LAG = re.compile(r"\s*([0-9]+)\s*|\s*([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*s\s*")


def _number(value: Any) -> float | None:
    plain = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    # Bounds first: a whole number may be too large for a float.
    return float(value) if plain and -1e300 <= value <= 1e300 else None


def lag_of(text: str) -> tuple[int, float | None]:
    """Return a lag's scans, and its seconds if it is one in seconds."""
    found = _LAG.fullmatch(text)
    if found is None:
        raise ValueError(f"{text!r} is not a lag")
    return (int(found[1]), None) if found[1] else (0, float(found[2]))


def _lag(value: Any) -> str | None:
    number = _number(value)
    if number is not None:
        value = str(int(number)) if number.is_integer() else ""
    try:
        scans, seconds = lag_of(value) if isinstance(value, str) else (-1, None)
    except ValueError:
        return None
    if seconds is not None:
        return f"{seconds:.10g} s" if 0.0 < seconds <= MOST_LAG_S else None
    return str(scans) if 0 <= scans <= MOST_LAG_SCANS else None


LAG = Form(
    f"a whole number of scans from 0 to {MOST_LAG_SCANS}, or seconds above 0 as in '20 s'", _lag
)


def _probability(value: Any) -> float | list[float] | None:
    number = _number(value)
    if number is not None:
        return number if 0.0 <= number <= MOST_PROBABILITY else None
    if isinstance(value, (str, bytes)) or not hasattr(value, "__len__"):
        return None
    found = [_number(entry) for entry in value]
    numbers = [entry for entry in found if entry is not None]
    return numbers if numbers and len(numbers) == len(found) else None


PROBABILITY = Form(
    f"a number from 0 to {MOST_PROBABILITY}, or a list of ranges (m) and probabilities in turn",
    _probability,
)


def pose_of(text: str) -> tuple[str, str, bool]:
    """Return the topic of a platform's poses, their message, and whether they turn the radar."""
    topic, *words = text.split() or [""]
    message = next((word for word in words if word in POSE_MESSAGES), POSE_MESSAGES[0])
    return ("" if topic == FIXED else topic), message, STABILISED not in words


def _pose(value: Any) -> str | None:
    words = value.split()[1:] if isinstance(value, str) else [""]
    return value if set(words) <= {*POSE_MESSAGES, STABILISED} and len(words) <= 2 else None


POSE = Form(
    f"{FIXED}, or a topic's name, with {POSE_MESSAGES[1]} after it for geometry_msgs/PoseStamped "
    f"and {STABILISED} for azimuths that the platform does not turn",
    _pose,
)


def clutter_of(text: str) -> tuple[str, float]:
    """Return the law of clutter's amplitudes and its level, dB."""
    law, *level = text.split()
    return law, float(level[0]) if level else 0.0


def _clutter(value: Any) -> str | None:
    if not isinstance(value, str) or not value.split():
        return None
    law, *level = value.split()
    if law not in CLUTTER_LAWS or len(level) > (law != "learned"):
        return None
    try:
        return value if not level or -100.0 <= float(level[0]) <= 200.0 else None
    except ValueError:
        return None


CLUTTER = Form(
    "rayleigh, log_normal or learned; after the first two a level in dB from -100 to 200", _clutter
)


def _position(value: Any) -> list[float] | None:
    if isinstance(value, (str, bytes)) or not hasattr(value, "__len__"):
        return None
    found = [entry for entry in map(_number, value) if entry is not None]
    return found if len(found) == len(value) and len(found) in (2, 3) else None


POSITION = Form("a list of 2 or 3 finite numbers", _position)
