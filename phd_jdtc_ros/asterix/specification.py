"""The items of ASTERIX categories, compiled from libasterix's specification for a fast walk.

libasterix parses a record into an object for every bit, which takes half a millisecond. Here each
item becomes a rule that finds its end, of one class for each kind of item, and each selection of
items (FSPEC) becomes a plan that is cached. Walking a record then takes a few microseconds, and
only the needed items are decoded.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, TypeAlias

# A run of fixed-length items (pairs of an item's index and its offset in the run), the length of
# the run, and the index and rule of the variable-length item that follows, or None.
Segment: TypeAlias = "tuple[tuple[tuple[int, int], ...], int, Rule | None, int]"


@dataclass
class Layout:
    """The items of one kind of record: its user application profile (UAP)."""

    names: tuple[str | None, ...]  # Item names in the order of the FSPEC bits; None for a spare bit
    rules: tuple[Rule | None, ...]  # The rule of each item; None for a spare bit
    # The segments of a record, by the selection of its items.
    _plans: dict[bytes, list[Segment]] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        self.place = {name: index for index, name in enumerate(self.names) if name is not None}
        self._none = [-1] * len(self.rules)

    def walk(self, data: bytes, at: int, limit: int) -> tuple[list[int], int]:
        """Return each item's beginning in the record at `at`, -1 if absent, and the record's end.

        Raise `MalformedError` if the record does not conform to the specification.
        """
        end, last = at, min(limit, at + len(self.rules))
        while end < last and data[end] & 1:
            end += 1
        key = data[at : end + 1]
        plan = self._plans.get(key)
        if plan is None:
            plan = self._plan(key)
        at = end + 1
        begins = self._none.copy()
        for offsets, size, rule, place in plan:
            for index, offset in offsets:
                begins[index] = at + offset
            at += size
            if rule is not None:
                begins[place] = at
                at = rule.end(data, at, limit)
        if at > limit:
            raise MalformedError("truncated")
        return begins, at

    def first(self, data: bytes, at: int, limit: int, name: str) -> int:
        """Return the beginning of an item, -1 if absent; only fixed-length items may precede it.

        Raise `MalformedError` if the selection of items is wrong.
        """
        chosen, at = read_fspec(data, at, limit, len(self.rules))
        for index in chosen:
            if index == self.place[name]:
                return at if at < limit else -1
            at += getattr(self.rules[index], "size", None) or 0
        return -1

    def _plan(self, key: bytes) -> list[Segment]:
        """Return the cached plan of a selection of items."""
        chosen, _ = read_fspec(key, 0, len(key), len(self.rules))
        if not chosen:
            raise MalformedError("empty_record")
        segments: list[Segment] = []
        run: list[tuple[int, int]] = []
        size = 0
        for index in chosen:
            rule = self.rules[index]
            if rule is None:
                raise MalformedError("undefined_item")
            if rule.size is not None:
                run.append((index, size))
                size += rule.size
            else:
                segments.append((tuple(run), size, rule, index))
                run, size = [], 0
        if run:
            segments.append((tuple(run), size, None, -1))
        # Upper bound of cached plans. A radar uses a few dozen; hostile data would fill the memory.
        if len(self._plans) >= 4096:
            self._plans.clear()
        self._plans[key] = segments
        return segments


def known_categories() -> list[int]:
    """Return the numbers of the categories that libasterix knows."""
    from asterix import generated

    return sorted(generated.manifest["CATS"])


@cache
def layouts(category: int, edition: tuple[int, int] | None = None) -> dict[str, Layout]:
    """Return the layouts of a category by the name of the record kind, ``""`` if there is one kind.

    The newest edition is used if none is given; later editions of a category only add items, except
    for CAT021. Raise `KeyError` if libasterix does not know the category.
    """
    # This is imported here because the import takes 1.5 s and 70 MB.
    from asterix import generated

    known = generated.manifest["CATS"][category]
    chosen: Any = next((each for each in known if each.cv_edition == edition), known[-1])
    uap = chosen.cv_uap
    kinds = getattr(uap, "cv_uaps", None) or {"": uap.cv_record}
    return {name: _layout(record) for name, record in kinds.items()}


def _layout(record: Any) -> Layout:
    from asterix import base

    names: list[str | None] = []
    rules: list[Rule | None] = []
    for item in record.cv_items_list:
        if issubclass(item, base.UapItem):
            names.append(item.cv_non_spare.cv_name)
            rules.append(_rule(item.cv_non_spare.cv_rule))
        else:
            names.append(None)
            # The rules of a random sequence include those of the items after it, so the list is
            # shared.
            rules.append(RandomFieldSequence(rules) if issubclass(item, base.UapItemRFS) else None)
    return Layout(tuple(names), tuple(rules))


def _rule(rule: Any) -> Rule:
    """Return the rule of an item; alternatives that depend on another item have equal lengths."""
    return _rule_of_variation(getattr(rule, "cv_variation", None) or rule.cv_default_variation)


def _rule_of_variation(kind: Any) -> Rule:
    from asterix import base

    if issubclass(kind, base.Element | base.Group):
        return Fixed(kind.cv_bit_size // 8)
    if issubclass(kind, base.Extended):
        parts = [_bits(part) // 8 for part in kind.cv_items_list]
        return Extended(tuple(parts), kind.cv_items_list[-1][-1] is None)
    if issubclass(kind, base.Repetitive):
        if kind.cv_rep_bytes is None:
            return RepetitiveFx((kind.cv_variation.cv_bit_size + 1) // 8)
        return Repetitive(kind.cv_rep_bytes, kind.cv_variation.cv_bit_size // 8)
    if issubclass(kind, base.Explicit):
        return Explicit()
    if issubclass(kind, base.Compound):
        items = kind.cv_items_list
        return Compound(tuple(None if item is None else _rule(item.cv_rule) for item in items))
    raise TypeError(f"{kind}: no rule for such an item")


def _bits(part: Sequence[tuple[Any, int] | None]) -> int:
    """Return the length of a part of an extended item, bits; None stands for the FX bit."""
    return sum(1 if entry is None else entry[1] for entry in part)


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
