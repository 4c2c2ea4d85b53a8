"""The items of ASTERIX categories, compiled from libasterix's specification for a fast walk.

libasterix parses a record into an object for every bit, which takes half a millisecond. Here each
item becomes a rule that finds its end, and each selection of items (FSPEC) becomes a plan that is
cached. Walking a record then takes a few microseconds, and only the needed items are decoded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, TypeAlias

from .item_rules import (
    Compound,
    Explicit,
    Extended,
    Fixed,
    MalformedError,
    RandomFieldSequence,
    Repetitive,
    RepetitiveFx,
    Rule,
    read_fspec,
)

# Upper bound of cached plans. A radar uses a few dozen; hostile data would fill the memory.
MAX_PLANS = 4096


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
        if len(self._plans) >= MAX_PLANS:
            self._plans.clear()
        self._plans[key] = segments
        return segments


def known_categories() -> list[int]:
    """Return the numbers of the categories that libasterix knows."""
    from asterix import generated

    return sorted(generated.manifest["CATS"])


@cache
def layouts(category: int) -> dict[str, Layout]:
    """Return the layouts of a category by the name of the record kind, ``""`` if there is one kind.

    The newest edition is used; later editions of a category only add items. Raise `KeyError` if
    libasterix does not know the category.
    """
    # This is imported here because the import takes 1.5 s and 70 MB.
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
