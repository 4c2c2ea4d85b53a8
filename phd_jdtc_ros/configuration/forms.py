"""Notations of values that are not plain numbers, words or lists, except places (`place_forms`)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from phd_jdtc_ros.core.clutter.rate import START_RATE
from phd_jdtc_ros.core.engine import Lag

from .schema import Form, number, numbers

# A target with a detection probability of 1 would be deleted at its first missed detection.
MOST_PROBABILITY = 0.999
MOST_LAG_SCANS, MOST_LAG_S = 100, 1e5
_LAG = re.compile(r"\s*([0-9]+)\s*|\s*([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*s\s*")


def _lag(text: str) -> Lag:
    found = _LAG.fullmatch(text)
    if found is None:
        raise ValueError(f"{text!r} is not a lag")
    return Lag(int(found[1])) if found[1] else Lag(0, float(found[2]))


def _read_lag(value: Any) -> str | None:
    plain = number(value)
    if plain is not None:
        value = str(int(plain)) if plain.is_integer() else ""
    try:
        lag = _lag(value) if isinstance(value, str) else Lag(-1)
    except ValueError:
        return None
    if lag.seconds is not None:
        return f"{lag.seconds:.10g} s" if 0.0 < lag.seconds <= MOST_LAG_S else None
    return str(lag.scans) if 0 <= lag.scans <= MOST_LAG_SCANS else None


LAG = Form(
    f"a whole number of scans from 0 to {MOST_LAG_SCANS}, or seconds above 0 as in '20 s'",
    _read_lag,
    _lag,
)


# The word for a value that is learned while the tracker runs.
AUTO = "auto"


class Learnable(NamedTuple):
    """A value of a sensor."""

    start: Any  # The value, or the one that learning starts from
    learned: bool  # Whether it is learned while the tracker runs


def _after_auto(value: Any) -> list[float] | None:
    """Return the numbers after the word auto; None for another value."""
    words = value.split() if isinstance(value, str) else []
    if words[:1] != [AUTO]:
        return None
    try:
        return numbers([float(word) for word in words[1:]])
    except ValueError:
        return None


def learned_from(start: Sequence[float]) -> str:
    """Return the notation of a value that is learned from these numbers."""
    return " ".join([AUTO, *_words(start)])


def std(start: float, low: float, high: float = math.inf) -> Form:
    """Return the form of a standard deviation from `low` to `high` that can be learned.

    Learning begins at `start` without another value.
    """

    def read(value: Any) -> float | str | None:
        plain, after = number(value, low, high), _after_auto(value)
        if plain is not None or after is None:
            return plain
        given = number((after or [start])[0], low, high) if len(after) <= 1 else None
        return None if given is None else learned_from([given])

    def learnable(given: float | str) -> Learnable:
        if isinstance(given, str):
            return Learnable(float(given.split()[1]), True)
        return Learnable(given, False)

    most = f", at most {high:g}" if high < math.inf else ""
    return Form(
        f"a finite number, at least {low:g}{most} or {AUTO}, with or without a start value",
        read,
        learnable,
    )


# The word after a standard deviation if some measurements have a larger noise.
OUTLIERS = "outliers"


class Noise(NamedTuple):
    """The standard deviation of a measurement's first component."""

    # `start`, `learned`: see `Learnable`.
    start: float
    learned: bool
    outliers: bool  # Whether some detections have a larger noise in all components


def noise(usual: Form) -> Form:
    """Return the form of a standard deviation that the word outliers may follow."""
    return _followed(usual, OUTLIERS, lambda own, outliers: Noise(own.start, own.learned, outliers))


def _followed(usual: Form, word: str, value_of: Callable[[Any, bool], Any]) -> Form:
    """Return the form of a number or auto that a word may follow."""

    def read(value: Any) -> float | str | None:
        if not isinstance(value, str) or not value.endswith(f" {word}"):
            own: float | str | None = usual.read(value)
            return own
        try:
            found = usual.read(before(value))
        except ValueError:
            return None
        return None if found is None else f"{_text(found)} {word}"

    def before(given: str) -> float | str:
        head = given.removesuffix(word).strip()
        return head if head.startswith(AUTO) else float(head)

    def value(given: float | str) -> Any:
        if isinstance(given, str) and given.endswith(word):
            return value_of(usual.value(before(given)), True)
        return value_of(usual.value(given), False)

    return Form(f"{usual.allowed}; {word} may follow", read, value)


def _text(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.10g}"


# The word after a clutter rate if false detections are more frequent behind targets.
MULTIPATH = "multipath"
MOST_CLUTTER = 1e6


class ClutterRate(NamedTuple):
    """The rate of a sensor's false detections."""

    # `start`, `learned`: see `Learnable`.
    start: float
    learned: bool
    multipath: bool  # Whether false detections are more frequent behind targets


def _read_rate(value: Any) -> float | str | None:
    return AUTO if value == AUTO else number(value, 0.0, MOST_CLUTTER)


def _rate(given: float | str) -> Learnable:
    return Learnable(START_RATE, True) if isinstance(given, str) else Learnable(given, False)


CLUTTER_RATE = _followed(
    Form(f"a finite number, at least 0, at most {MOST_CLUTTER:g} or {AUTO}", _read_rate, _rate),
    MULTIPATH,
    lambda own, multipath: ClutterRate(own.start, own.learned, multipath),
)


def _read_table(given: list[float]) -> float | list[float] | None:
    """Return a probability, or pairs of range and probability; None if they are not allowed."""
    if len(given) == 1:
        return number(given[0], 0.0, MOST_PROBABILITY)
    ranges, probabilities = given[::2], given[1::2]
    rising = all(near < far for near, far in pairwise(ranges))
    sound = len(given) > 0 and len(given) % 2 == 0
    sound = sound and all(0.0 < p <= MOST_PROBABILITY for p in probabilities)
    return given if sound and rising else None


# The word between a probability and the correlation of detections in consecutive looks, and the
# largest one: at 1, a target that is missed once would never be detected again.
CORRELATED, MOST_CORRELATION = "correlated", 0.98


class Detectability(NamedTuple):
    """A sensor's detection probability, and its correlation from look to look."""

    # Range, m, and probability; empty if it follows from the SNR bands.
    start: tuple[tuple[float, float], ...]
    learned: bool  # Whether the probability is learned while the tracker runs
    correlation: Learnable | None  # None for independent looks


def _read_probability(value: Any) -> float | list[float] | str | None:
    head, found, tail = value.partition(CORRELATED) if isinstance(value, str) else (value, "", "")
    if found:
        return _read_correlated(head.split(), tail.split())
    after = _after_auto(value)
    if after is None:
        plain = number(value, 0.0, MOST_PROBABILITY)
        return _read_table(numbers(value) or []) if plain is None else plain
    if after and _read_table(after) is None:
        return None
    return learned_from(after)


def _read_correlated(head: list[str], tail: list[str]) -> str | None:
    """Return the notation of a probability and a correlation, given as words."""
    learned = [AUTO] if head[:1] == [AUTO] else []
    try:
        given, of_looks = ([float(word) for word in w] for w in (head[len(learned) :], tail))
    except ValueError:
        return None
    sound = all(number(each, 0.0, MOST_CORRELATION) is not None for each in of_looks)
    if not sound or len(of_looks) > 1 or (given and _read_table(given) is None):
        return None
    return " ".join([*learned, *_words(given), CORRELATED, *_words(of_looks)])


def _words(given: Sequence[float]) -> list[str]:
    return [f"{each:.10g}" for each in given]


def probability_numbers(given: float | list[float] | str) -> list[float]:
    """Return the numbers of a detection probability in a notation of `PROBABILITY`."""
    if isinstance(given, str):
        return [float(word) for word in given.partition(CORRELATED)[0].split() if word != AUTO]
    return given if isinstance(given, list) else [given]


def _detectability(given: float | list[float] | str) -> Detectability:
    """Return the value of a notation that `_read_probability` has returned."""
    text = given if isinstance(given, str) else ""
    _, found, tail = text.partition(CORRELATED)
    of_looks = Learnable(float(tail), False) if tail.split() else Learnable(0.0, True)
    return Detectability(
        _over_range(probability_numbers(given)), text.startswith(AUTO), of_looks if found else None
    )


def _over_range(values: list[float]) -> tuple[tuple[float, float], ...]:
    """Return pairs of range and probability; none if the probability is not given."""
    if len(values) > 1:
        return tuple(zip(values[::2], values[1::2], strict=True))
    return ((0.0, values[0]),) if any(values) else ()


PROBABILITY = Form(
    f"a number from 0 to {MOST_PROBABILITY}, or pairs of range (m, ascending) and probability "
    f"(above 0 and at most {MOST_PROBABILITY}) in one list, or {AUTO}, with or without such "
    f"numbers after it in one string; {CORRELATED} may follow in the string, with or without a "
    f"number from 0 to {MOST_CORRELATION}",
    _read_probability,
    _detectability,
)

CLUTTER_LAWS = ("rayleigh", "log_normal", "learned")


def _clutter(text: str) -> tuple[str, float]:
    """Return the law of clutter amplitudes and its level, dB."""
    law, *level = text.split()
    return law, float(level[0]) if level else 0.0


def _read_clutter(value: Any) -> str | None:
    law, *level = value.split() if isinstance(value, str) and value.split() else [""]
    if law not in CLUTTER_LAWS or len(level) > (law != "learned"):
        return None
    try:
        return value if not level or -100.0 <= float(level[0]) <= 200.0 else None
    except ValueError:
        return None


CLUTTER = Form(
    "rayleigh, log_normal or learned; after the first two a level in dB from -100 to 200",
    _read_clutter,
    _clutter,
)
