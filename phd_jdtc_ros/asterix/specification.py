"""The items of ASTERIX categories, compiled from libasterix's specification for a fast walk.

libasterix parses a record into an object for every bit, which takes half a millisecond. Here each
item becomes a rule that finds its end, and each selection of items (FSPEC) becomes a plan that is
cached. Walking a record then takes a few microseconds, and only the needed items are decoded.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, TypeAlias

# Upper bound of cached plans. A radar uses a few dozen; hostile data would fill the memory.
MAX_PLANS = 4096


class MalformedError(ValueError):
    """A record that does not conform to its specification.

    Parameters
    ----------
    reason : str
        ``truncated``, ``fspec``, ``undefined_item``, ``extension``, ``explicit_length`` or
        ``empty_record``.
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

        Raises
        ------
        MalformedError
            If the bytes that give the length are beyond `limit` or violate the specification.
        """


@dataclass(frozen=True)
class Fixed(Rule):
    """An item of fixed length."""

    size: int

    def end(self, data: bytes, at: int, limit: int) -> int:
        """Return the item's end."""
        return at + self.size


@dataclass(frozen=True)
class Extended(Rule):
    """Parts, each with a bit (FX) that announces the next part.

    Parameters
    ----------
    parts : tuple of int
        Lengths in bytes.
    last_extends : bool
        Whether the last part has such a bit, which must then be zero.
    """

    parts: tuple[int, ...]
    last_extends: bool

    def end(self, data: bytes, at: int, limit: int) -> int:
        """Return the item's end."""
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
class Counted(Rule):
    """A count, followed by that number of entries of one length."""

    count_size: int
    entry_size: int

    def end(self, data: bytes, at: int, limit: int) -> int:
        """Return the item's end."""
        begin = at + self.count_size
        if begin > limit:
            raise MalformedError("truncated")
        return begin + int.from_bytes(data[at:begin], "big") * self.entry_size


@dataclass(frozen=True)
class Chained(Rule):
    """Entries of one length, each with a bit (FX) that announces the next entry."""

    entry_size: int

    def end(self, data: bytes, at: int, limit: int) -> int:
        """Return the item's end."""
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
        """Return the item's end."""
        if at >= limit:
            raise MalformedError("truncated")
        if not data[at]:
            raise MalformedError("explicit_length")
        return at + data[at]


@dataclass(frozen=True)
class Compound(Rule):
    """A selection of subitems, followed by the selected subitems.

    Parameters
    ----------
    rules : tuple of (Rule or None)
        Rules of the subitems in the order of the selection's bits; None for a spare bit.
    """

    rules: tuple[Rule | None, ...]
    # Cached length by the selection's single byte, if all selected subitems have fixed lengths.
    _sizes: dict[int, int] = field(default_factory=dict, repr=False, compare=False)

    def end(self, data: bytes, at: int, limit: int) -> int:
        """Return the item's end."""
        first = data[at] if at < limit else 1
        if first in self._sizes:
            return at + self._sizes[first]
        chosen, end = selection(data, at, limit, len(self.rules))
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
class RandomSequence(Rule):
    """A count, followed by that number of items in any order, each after its item number."""

    rules: Sequence[Rule | None] = field(repr=False)

    def end(self, data: bytes, at: int, limit: int) -> int:
        """Return the item's end."""
        if at >= limit:
            raise MalformedError("truncated")
        count, at = data[at], at + 1
        for _ in range(count):
            if at >= limit:
                raise MalformedError("truncated")
            number = data[at] - 1
            rule = self.rules[number] if 0 <= number < len(self.rules) else None
            if rule is None or isinstance(rule, RandomSequence):
                raise MalformedError("undefined_item")
            at = rule.end(data, at + 1, limit)
        return at


def selection(data: bytes, at: int, limit: int, most: int) -> tuple[list[int], int]:
    """Return the positions of the bits that a field specification (FSPEC) sets, and its end.

    Parameters
    ----------
    most : int
        Number of defined items.

    Raises
    ------
    MalformedError
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


Segment: TypeAlias = "tuple[tuple[tuple[int, int], ...], int, Rule | None, int]"


@dataclass(frozen=True)
class Plan:
    """Steps for walking a record with one selection of items.

    Parameters
    ----------
    segments : tuple of Segment
        Each segment is a run of fixed-length items (pairs of an item's index and its offset in the
        run), the length of the run, and the index and rule of the variable-length item that
        follows, or None.
    """

    segments: tuple[Segment, ...]


@dataclass
class Layout:
    """The items of one kind of record.

    Parameters
    ----------
    Names in the order of the bits of a record's field specification; None for spare bits.
        bits.
    """

    names: tuple[str | None, ...]
    rules: tuple[Rule | None, ...]
    _plans: dict[bytes, Plan] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        self.place = {name: index for index, name in enumerate(self.names) if name is not None}
        self._none = [-1] * len(self.rules)

    def walk(self, data: bytes, at: int, limit: int) -> tuple[list[int], int]:
        """Return each item's beginning in the record at `at`, -1 if absent, and the record's end.

        Raises
        ------
        MalformedError
        """
        end = at
        while end < limit and data[end] & 1:
            end += 1
        key = data[at : end + 1]
        plan = self._plans.get(key)
        if plan is None:
            plan = self._plan(key)
        at = end + 1
        begins = self._none.copy()
        for offsets, size, rule, place in plan.segments:
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

        Raises
        ------
        MalformedError
        """
        chosen, at = selection(data, at, limit, len(self.rules))
        for index in chosen:
            if index == self.place[name]:
                return at if at < limit else -1
            at += getattr(self.rules[index], "size", None) or 0
        return -1

    def _plan(self, key: bytes) -> Plan:
        """Return the cached plan of a selection of items."""
        chosen, _ = selection(key, 0, len(key), len(self.rules))
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
        if len(self._plans) >= MAX_PLANS:
            self._plans.clear()
        plan = self._plans[key] = Plan(tuple(segments))
        return plan


@cache
def layouts(category: int) -> dict[str, Layout]:
    """Return the layouts of a category by the name of the record kind, ``""`` if there is one kind.

    The newest edition is used; later editions of a category only add items.

    Raises
    ------
    KeyError
        If libasterix does not know the category.
    """
    # Imported here because the import takes 1.5 s and 70 MB.
    from asterix import generated

    uap: Any = generated.manifest["CATS"][category][-1].cv_uap
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
            rules.append(RandomSequence(rules) if issubclass(item, base.UapItemRFS) else None)
    return Layout(tuple(names), tuple(rules))


def _rule(rule: Any) -> Rule:
    """Return the rule of an item; alternatives that depend on another item have equal lengths."""
    return _of_variation(getattr(rule, "cv_variation", None) or rule.cv_default_variation)


def _of_variation(kind: Any) -> Rule:
    from asterix import base

    if issubclass(kind, base.Element | base.Group):
        return Fixed(kind.cv_bit_size // 8)
    if issubclass(kind, base.Extended):
        parts = [_bits(part) // 8 for part in kind.cv_items_list]
        return Extended(tuple(parts), kind.cv_items_list[-1][-1] is None)
    if issubclass(kind, base.Repetitive):
        if kind.cv_rep_bytes is None:
            return Chained((kind.cv_variation.cv_bit_size + 1) // 8)
        return Counted(kind.cv_rep_bytes, kind.cv_variation.cv_bit_size // 8)
    if issubclass(kind, base.Explicit):
        return Explicit()
    if issubclass(kind, base.Compound):
        items = kind.cv_items_list
        return Compound(tuple(None if item is None else _rule(item.cv_rule) for item in items))
    raise TypeError(f"{kind}: no rule for such an item")


def _bits(part: Sequence[tuple[Any, int] | None]) -> int:
    """Return the length of a part of an extended item, bits; None stands for the FX bit."""
    return sum(1 if entry is None else entry[1] for entry in part)
