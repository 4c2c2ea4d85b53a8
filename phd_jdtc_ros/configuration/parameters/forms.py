"""Notations of values that are not plain numbers, words or lists, except places (`place_forms`)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from phd_jdtc_ros.core.clutter.rate import START_RATE
from phd_jdtc_ros.core.engine import Lag

from ..schema import Form, number, numbers

# A target with a detection probability of 1 would be deleted at its first missed detection.
MOST_PROBABILITY = 0.999
MOST_LAG_SCANS, MOST_LAG_S = 100, 1e5
MOST_CLUTTER = 1e6
# At a correlation of 1, a target that is missed once would never be detected again.
MOST_CORRELATION = 0.98
_LAG = re.compile(r"\s*([0-9]{1,9})\s*|\s*([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?\s*s\s*")


def _lag(given: Any) -> tuple[str, Lag] | None:
    plain = number(given)
    # The digits of a number are all kept, so that no other one is rounded to a whole number.
    found = _LAG.fullmatch(f"{plain:.17g}" if plain is not None else str(given))
    if found is None:
        return None
    if found[1]:
        lag = Lag(int(found[1]))
        return (str(lag.scans), lag) if lag.scans <= MOST_LAG_SCANS else None
    seconds = _rounded(found[2] + (found[3] or ""))
    return (f"{seconds:.10g} s", Lag(0, seconds)) if 0.0 < seconds <= MOST_LAG_S else None


def _rounded(word: str) -> float:
    """Return the number that a word has in canonical notations."""
    return float(f"{float(word):.10g}")


LAG = Form.parsed(
    f"a whole number of scans from 0 to {MOST_LAG_SCANS}, or seconds above 0 as in '20 s'", _lag
)


# The words for a value that is learned while the tracker runs, for a noise that is larger for some
# measurements, for false detections that are more frequent behind targets, and for the correlation
# of detections in consecutive looks.
AUTO, OUTLIERS, MULTIPATH, CORRELATED = "auto", "outliers", "multipath", "correlated"


class _Words(NamedTuple):
    """The parts of a notation such as ``auto 0.9 correlated 0.5``."""

    learned: bool  # True if it begins with auto
    numbers: list[float]
    flag: bool = False  # True if the notation's own word is given, here `correlated`
    after: Sequence[float] = ()


def _words_of(value: Any, flag: str, tables: bool) -> _Words | None:
    """Return the parts of a number, of a list if there may be `tables`, or of a text with words."""
    if not isinstance(value, str):
        listed = numbers(value) if tables and number(value) is None else numbers([value])
        return _Words(False, listed) if listed else None
    head, found, tail = value.partition(flag) if flag else (value, "", "")
    before = head.split()
    learned = before[:1] == [AUTO]
    try:
        parts = [[_rounded(word) for word in words] for words in (before[learned:], tail.split())]
    except ValueError:
        return None
    if not (learned or found) or None in map(numbers, parts):
        return None
    return _Words(learned, parts[0], bool(found), parts[1])


def _form(
    allowed: str,
    complete: Callable[[list[float], bool], list[float] | None],
    value_of: Callable[[_Words], Any],
    flag: str = "",
    most_after: float | None = None,
) -> Form:
    """Return the form of a value that may be learned, and that a word may follow.

    `complete`, called with the numbers and whether they are learned, returns them with the usual
    ones, or None if they are not allowed. `flag` is the word that may follow, and `most_after` the
    largest value of the number that may follow this word; None if none may.
    """
    tables = flag == CORRELATED

    def parse(value: Any) -> tuple[Any, Any] | None:
        words = _words_of(value, flag, tables)
        given = None if words is None else complete(words.numbers, words.learned)
        if words is None or given is None or len(words.after) > (most_after is not None):
            return None
        if any(number(each, 0.0, most_after or 0.0) is None for each in words.after):
            return None
        found = value_of(words._replace(numbers=given))
        if isinstance(value, str):
            text = [AUTO] * words.learned + _texts(given) + [flag] * words.flag
            return " ".join([*text, *_texts(words.after)]), found
        return given[0] if len(given) == 1 else given, found

    return Form.parsed(f"{allowed}; {flag} may follow" if flag and not tables else allowed, parse)


def _texts(given: Sequence[float]) -> list[str]:
    return [f"{each:.10g}" for each in given]


def learned_from(start: Sequence[float]) -> str:
    """Return the notation of a value that is learned from these numbers."""
    return " ".join([AUTO, *_texts(start)])


class Learnable(NamedTuple):
    """A value of a sensor."""

    start: float  # The value, or the one that learning starts from
    learned: bool  # True if it is learned while the tracker runs


class Noise(NamedTuple):
    """The standard deviation of a measurement's first component; see `Learnable`."""

    start: float
    learned: bool
    outliers: bool  # True if some detections have a larger noise in all components


class ClutterRate(NamedTuple):
    """The rate of a sensor's false detections; see `Learnable`."""

    start: float
    learned: bool
    multipath: bool  # True if false detections are more frequent behind targets


class Detectability(NamedTuple):
    """A sensor's detection probability, and its correlation from look to look."""

    # Ranges, metres, with probabilities; empty if these follow from the SNR bands.
    start: tuple[tuple[float, float], ...]
    learned: bool  # True if the probability is learned while the tracker runs
    correlation: Learnable | None  # None for independent looks


def std(start: float, low: float, high: float = math.inf, outliers: bool = False) -> Form:
    """Return the form of a standard deviation from `low` to `high` that can be learned.

    Learning begins at `start` without another value. The word outliers may follow if it is True.
    """

    def complete(given: list[float], learned: bool) -> list[float] | None:
        given = given or [start] * learned
        return given if len(given) == 1 and number(given[0], low, high) is not None else None

    def value_of(words: _Words) -> Learnable | Noise:
        own = words.numbers[0], words.learned
        return Noise(*own, words.flag) if outliers else Learnable(*own)

    most = f", at most {high:g}" if high < math.inf else ""
    allowed = f"a finite number, at least {low:g}{most} or {AUTO}, with or without a start value"
    return _form(allowed, complete, value_of, OUTLIERS if outliers else "")


def turn(longest_s: float) -> Form:
    """Return the form of an antenna's rotation period, whose value is 0 if it is to be learned."""

    def parse(given: Any) -> tuple[float | str, float] | None:
        if given == AUTO:
            return AUTO, 0.0
        found = number(given, 0.0, longest_s)
        return None if found is None else (found, found)

    return Form.parsed(f"a number of seconds from 0 to {longest_s:g}, or {AUTO}", parse)


def _complete_rate(given: list[float], learned: bool) -> list[float] | None:
    if learned:
        return None if given else []
    return given if len(given) == 1 and 0.0 <= given[0] <= MOST_CLUTTER else None


CLUTTER_RATE = _form(
    f"a finite number, at least 0, at most {MOST_CLUTTER:g} or {AUTO}",
    _complete_rate,
    lambda words: ClutterRate(
        words.numbers[0] if words.numbers else START_RATE, words.learned, words.flag
    ),
    MULTIPATH,
)


def _complete_table(given: list[float], _: bool) -> list[float] | None:
    """Return a probability or pairs of range and probability; None if they are not allowed."""
    if len(given) == 1:
        return given if 0.0 <= given[0] <= MOST_PROBABILITY else None
    rising = all(near < far for near, far in pairwise(given[::2]))
    sound = len(given) % 2 == 0 and all(0.0 < p <= MOST_PROBABILITY for p in given[1::2])
    return given if sound and rising else None


def _detectability(words: _Words) -> Detectability:
    of_looks = Learnable(words.after[0], False) if words.after else Learnable(0.0, True)
    given = words.numbers
    if len(given) == 1:
        given = [0.0, *given] if any(given) else []
    return Detectability(
        tuple(zip(given[::2], given[1::2], strict=True)),
        words.learned,
        of_looks if words.flag else None,
    )


PROBABILITY = _form(
    f"a number from 0 to {MOST_PROBABILITY}, or pairs of range (m, ascending) and probability "
    f"(above 0 and at most {MOST_PROBABILITY}) in one list, or {AUTO}, with or without such "
    f"numbers after it in one string; {CORRELATED} may follow in the string, with or without a "
    f"number from 0 to {MOST_CORRELATION}",
    _complete_table,
    _detectability,
    CORRELATED,
    MOST_CORRELATION,
)


def probability_numbers(given: float | list[float] | str) -> list[float]:
    """Return the numbers of a detection probability in a notation of `PROBABILITY`."""
    words = _words_of(given, CORRELATED, True)
    return [] if words is None else words.numbers


CLUTTER_LAWS = ("rayleigh", "log_normal", "learned")


def _clutter(given: Any) -> tuple[str, tuple[str, float]] | None:
    """Return a notation as it is, with the law of clutter amplitudes and its level, dB."""
    law, *level = given.split() if isinstance(given, str) and given.split() else [""]
    if law not in CLUTTER_LAWS or len(level) > (law != "learned"):
        return None
    try:
        level_db = float(*level)
    except ValueError:
        return None
    return (given, (law, level_db)) if -100.0 <= level_db <= 200.0 else None


CLUTTER = Form.parsed(
    "rayleigh, log_normal or learned; after the first two a level in dB from -100 to 200",
    _clutter,
)
