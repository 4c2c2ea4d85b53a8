"""Rules that find the end of an ASTERIX item, one class for each kind of item."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field


class MalformedError(ValueError):
    """A record that does not conform to its specification.

    The reason is ``truncated``, ``fspec``, ``undefined_item``, ``extension``,
    ``explicit_length`` or ``empty_record``.
    """

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class Rule(ABC):
    """Finds the end of an item."""

    size: int | None = None
    """Length in bytes if it is always the same."""

    @abstractmethod
    def end(self, data: bytes, at: int, limit: int) -> int:
        """Return the end of the item that begins at `at`; it may be beyond `limit`.

        Raise `MalformedError` if the bytes that give the length are beyond `limit` or violate the
        specification.
        """


@dataclass(frozen=True)
class Fixed(Rule):
    """An item of fixed length."""

    size: int

    def end(self, data: bytes, at: int, limit: int) -> int:
        """See `Rule.end`."""
        return at + self.size


@dataclass(frozen=True)
class Extended(Rule):
    """Parts, each with a bit (FX) that announces the next part."""

    parts: tuple[int, ...]  # Lengths in bytes
    last_extends: bool  # True if the last part has such a bit, which must then be zero

    def end(self, data: bytes, at: int, limit: int) -> int:
        """See `Rule.end`."""
        last = len(self.parts) - 1
        for index, size in enumerate(self.parts):
            at += size
            if at > limit:
                raise MalformedError("truncated")
            if index == last and not self.last_extends:
                return at
            if not data[at - 1] & 1:
                return at
        raise MalformedError("extension")


@dataclass(frozen=True)
class Repetitive(Rule):
    """A count, followed by that number of entries of one length."""

    count_size: int
    entry_size: int

    def end(self, data: bytes, at: int, limit: int) -> int:
        """See `Rule.end`."""
        begin = at + self.count_size
        if begin > limit:
            raise MalformedError("truncated")
        return begin + int.from_bytes(data[at:begin], "big") * self.entry_size


@dataclass(frozen=True)
class RepetitiveFx(Rule):
    """Entries of one length, each with a bit (FX) that announces the next entry."""

    entry_size: int

    def end(self, data: bytes, at: int, limit: int) -> int:
        """See `Rule.end`."""
        at += self.entry_size
        while at <= limit:
            if not data[at - 1] & 1:
                return at
            at += self.entry_size
        raise MalformedError("truncated")


@dataclass(frozen=True)
class Explicit(Rule):
    """Bytes preceded by their number, which counts itself."""

    def end(self, data: bytes, at: int, limit: int) -> int:
        """See `Rule.end`."""
        if at >= limit:
            raise MalformedError("truncated")
        if not data[at]:
            raise MalformedError("explicit_length")
        return at + data[at]


@dataclass(frozen=True)
class Compound(Rule):
    """A field specification (FSPEC), followed by the subitems that it selects."""

    # Rules of the subitems in the order of the FSPEC bits; None for a spare bit.
    rules: tuple[Rule | None, ...]
    # Cached length by the FSPEC's single byte, if all selected subitems have fixed lengths.
    _sizes: dict[int, int] = field(default_factory=dict, repr=False, compare=False)

    def end(self, data: bytes, at: int, limit: int) -> int:
        """See `Rule.end`."""
        first = data[at] if at < limit else 1
        if first in self._sizes:
            return at + self._sizes[first]
        chosen, end = read_fspec(data, at, limit, len(self.rules))
        fixed = not first & 1
        for index in chosen:
            rule = self.rules[index]
            if rule is None:
                raise MalformedError("undefined_item")
            end = rule.end(data, end, limit)
            if end > limit:
                raise MalformedError("truncated")
            fixed = fixed and rule.size is not None
        if fixed:
            self._sizes[first] = end - at
        return end


@dataclass(frozen=True)
class RandomFieldSequence(Rule):
    """A count, followed by that number of items in any order, each after its item number."""

    rules: Sequence[Rule | None] = field(repr=False)

    def end(self, data: bytes, at: int, limit: int) -> int:
        """See `Rule.end`."""
        if at >= limit:
            raise MalformedError("truncated")
        count, at = data[at], at + 1
        for _ in range(count):
            if at >= limit:
                raise MalformedError("truncated")
            number = data[at] - 1
            rule = self.rules[number] if 0 <= number < len(self.rules) else None
            if rule is None or isinstance(rule, RandomFieldSequence):
                raise MalformedError("undefined_item")
            at = rule.end(data, at + 1, limit)
        return at


def read_fspec(data: bytes, at: int, limit: int, most: int) -> tuple[list[int], int]:
    """Return the positions of the bits that a field specification (FSPEC) sets, and its end.

    There are `most` defined items. Raise `MalformedError` if it does not end, or selects others.
    """
    chosen, place = [], 0
    while True:
        if at >= limit:
            raise MalformedError("truncated")
        byte, at = data[at], at + 1
        for bit in range(7):
            if byte & (0x80 >> bit):
                chosen.append(place + bit)
        place += 7
        if not byte & 1:
            break
        if place >= most:
            raise MalformedError("fspec")
    if chosen and chosen[-1] >= most:
        raise MalformedError("undefined_item")
    return chosen, at
