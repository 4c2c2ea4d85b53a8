"""Definition of a parameter: name, default, which fixes the type, and allowed values.

A parameter is declared once, as a field of a dataclass: `parameter` gives it a default, a help text
and bounds. `table` returns the parameters of such a class, from which the checks, the documentation
and the descriptors of ROS follow; `build` makes an instance of the class from checked values.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from types import MappingProxyType
from typing import Any, TypeAlias, TypeVar

import numpy as np

from phd_jdtc_ros.quoting import short

Value: TypeAlias = "bool | int | float | str | list[float] | list[str]"
INFINITY = math.inf
# Lower bound of parameters that must be positive.
SMALL = 1e-9
POSITIVE, NOT_NEGATIVE, UNBOUNDED = (SMALL, INFINITY), (0.0, INFINITY), (-INFINITY, INFINITY)
# Smallest similarity of a suggested name.
MIN_SIMILARITY = 0.75
_DIGITS = re.compile(r"\d+")
_NO_NAMES: Mapping[str, str] = MappingProxyType({})
# Key of a parameter in the metadata of its field.
_DECLARED = "parameter"
S = TypeVar("S")
T = TypeVar("T")


def number(value: Any, low: float = -INFINITY, high: float = INFINITY) -> float | None:
    """Return a finite number from `low` to `high` as a float; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
        return None
    # The bounds are checked first, because a whole number may be too large for a float.
    return float(value) if max(low, -1e300) <= value <= min(high, 1e300) else None


def numbers(value: Any, low: float = -INFINITY, high: float = INFINITY) -> list[float] | None:
    """Return a list of finite numbers from `low` to `high`; None for anything else."""
    if isinstance(value, (str, bytes)) or not hasattr(value, "__len__"):
        return None
    found = [each for each in (number(entry, low, high) for entry in value) if each is not None]
    return found if len(found) == len(value) else None


@dataclass(frozen=True)
class Form:
    """A notation for values that are not plain numbers, words or lists."""

    allowed: str  # The allowed values in words
    # Returns the canonical notation of a given value, or None if it is not allowed.
    read: Callable[[Any], Any]
    # Returns the value of the dataclass's field that the canonical notation stands for.
    value: Callable[[Any], Any] = lambda notation: notation


@dataclass(frozen=True)
class Parameter:
    """One parameter: name, default, which fixes the type, and allowed values."""

    name: str  # Dotted; within a group, the part after the member's name
    default: Any
    description: str  # With the unit
    # Inclusive bounds of a number, or of every number of a list.
    low: float = -INFINITY
    high: float = INFINITY
    # Allowed strings, with or without what each stands for; empty for any.
    choices: tuple[str, ...] | Mapping[str, Any] = ()
    length: int | None = None  # Required length of a list
    element: type = float  # Type of a list's entries, float or str
    most: int | None = None  # Largest number of names in a list; None for any number
    # True if it may change between two scans. The other parameters determine the structure of the
    # tracker or of its state.
    mutable: bool = False
    form: Form | None = None  # Notation of a value that is not a plain number, word or list
    # Keys of a mapping of strings, each with the allowed strings, none for any; each key that is
    # given is a parameter ``NAME.KEY``.
    keys: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    # True if a value must be given; the default then only fixes the type.
    required: bool = False
    # True if a list of words may have a word twice.
    repeats: bool = False
    # Returns the lines of a parameter file that replace a value in a former notation, given the
    # name without a prefix and the value; none for any other value.
    former: Callable[[str, Any], Sequence[str]] = lambda name, value: ()

    @property
    def allowed(self) -> str:
        """The allowed values in words."""
        if self.form is not None:
            return self.form.allowed
        if any(self.keys.values()):
            return "; ".join(f"{key}: one of {', '.join(of)}" for key, of in self.keys.items())
        if self.keys:
            return "names by " + ", ".join(self.keys)
        of_list = isinstance(self.default, list)
        if self.choices:
            return ("a list of any of " if of_list else "one of ") + ", ".join(self.choices)
        if isinstance(self.default, bool):
            return "true or false"
        if isinstance(self.default, str):
            return "a string"
        if of_list and self.element is str:
            return "a list of distinct names" + (f", at most {self.most}" if self.most else "")
        noun = "a whole number" if isinstance(self.default, int) else "a finite number"
        if of_list:
            noun = f"a list of {self.length} finite numbers" if self.length else "finite numbers"
        low = f", at least {self.low:g}" if self.low > -INFINITY else ""
        high = f", at most {self.high:g}" if self.high < INFINITY else ""
        return noun + low + high

    def coerce(self, value: Any) -> Any:
        """Return `value` as the parameter's type, or None if it is not allowed."""
        if self.form is not None:
            return self.form.read(value)
        if isinstance(self.default, bool):
            return value if isinstance(value, bool) else None
        if isinstance(self.default, str):
            valid = isinstance(value, str) and (not self.choices or value in self.choices)
            return value if valid else None
        if isinstance(self.default, list):
            if self.element is str:
                return self._names(value)
            listed = numbers(value, self.low, self.high)
            return listed if self.length in (None, len(listed or ())) else None
        found = number(value, self.low, self.high)
        if found is None or not isinstance(self.default, int):
            return found
        return int(value) if found.is_integer() else None

    def meaning(self, notation: Any) -> Any:
        """Return the value of the dataclass's field that a coerced value stands for."""
        if self.form is not None:
            return self.form.value(notation)
        return self.choices[notation] if isinstance(self.choices, Mapping) else notation

    def fault(self, value: Any) -> str:
        """Return the fault of a value that is not allowed."""
        lines = self.former(self.name.rpartition(".")[2], value)
        instead = f"write {' and '.join(lines)}" if lines else f"must be {self.allowed}"
        return f"{self.name}: {value!r} given, {instead}"

    def _names(self, value: Any) -> list[str] | None:
        if isinstance(value, (str, bytes)) or not hasattr(value, "__len__"):
            return None
        if len(value) > (self.most or INFINITY):
            return None
        names = list(value)
        if not all(isinstance(name, str) and name for name in names):
            return None
        distinct = self.repeats or len(set(names)) == len(names)
        return names if distinct and set(names) <= set(self.choices or names) else None


def parameter(
    default: Any,
    description: str,
    bounds: tuple[float, float] = UNBOUNDED,
    name: str = "",
    **more: Any,
) -> Any:
    """Return a field of a dataclass that is a parameter; see `Parameter`.

    `name` is the parameter's dotted name if it differs from the field's. The field of a required
    parameter has no default.
    """
    declared = Parameter(name, default, description, *bounds, **more)
    if declared.required:
        return field(metadata={_DECLARED: declared})
    usual = declared.meaning(default)
    return field(default_factory=lambda: usual, metadata={_DECLARED: declared})


def shared(declared: Any, name: str) -> Any:
    """Return a field of a dataclass that is the same parameter as a field of another one."""
    (entry,) = (each for each in fields(declared) if each.name == name)
    return field(default_factory=entry.default_factory, metadata=entry.metadata)


def _parameters_of(declared: Any) -> Iterator[tuple[str, Parameter]]:
    """Yield each field of a dataclass that is a parameter, with the parameter."""
    for entry in fields(declared):
        own = entry.metadata.get(_DECLARED)
        if own is not None:
            yield entry.name, replace(own, name=own.name or entry.name)


def table(declared: type) -> tuple[Parameter, ...]:
    """Return the parameters that a dataclass declares, in their order."""
    return tuple(own for _, own in _parameters_of(declared))


def build(declared: type[T], values: Mapping[str, Any], prefix: str = "", /, **others: Any) -> T:
    """Return an instance of a dataclass that declares parameters, from checked values.

    `prefix` is that of the parameters' names, with its dot; `others` are fields that are not
    parameters, or whose value is not the parameter's.
    """
    given: dict[str, Any] = {}
    for attribute, own in _parameters_of(declared):
        name = f"{prefix}{own.name}"
        if own.keys:
            named = {key: values[f"{name}.{key}"] for key in own.keys if f"{name}.{key}" in values}
            given[attribute] = replace(own.default, **named)
        else:
            given[attribute] = own.meaning(values[name])
    return declared(**{**given, **others})


def expand(
    top: Iterable[Parameter],
    groups: Iterable[str],
    members: Callable[[str, str], Iterable[Parameter]],
    given: Mapping[str, Any],
    usual: Callable[[str, Parameter], Any],
) -> dict[str, Parameter]:
    """Return a table with the parameters of every name in its lists.

    The parameters of `top` have no prefix and include the lists in `groups`. `members` returns the
    parameters ``NAME.PARAMETER`` of a name, given the list and the name; a faulty list is replaced
    by its default. `usual` returns the default of a member's parameter, given its full name.
    """
    found = {parameter.name: parameter for parameter in top}
    for group in groups:
        listed = found[group]
        names = listed.coerce(given.get(group, listed.default))
        for name in listed.default if names is None else names:
            for member in members(group, name):
                full = f"{name}.{member.name}"
                if not member.keys:
                    found[full] = replace(member, name=full, default=usual(full, member))
                for key in (key for key in member.keys if f"{full}.{key}" in given):
                    entry, default = f"{full}.{key}", getattr(member.default, key)
                    choices = member.keys[key]
                    found[entry] = Parameter(entry, default, member.description, choices=choices)
    return found


def with_members(
    top: Iterable[Parameter], group: str, members: Iterable[Parameter], given: Mapping[str, Any]
) -> dict[str, Parameter]:
    """Return a table with the parameters of each name of one list; see `expand`.

    A member's parameter that is in `top` too has the value given there as its default.

    Raise `ConfigError` if the list is faulty: the other parameters cannot be checked then.
    """
    by_name = {parameter.name: parameter for parameter in top}
    if group in given and by_name[group].coerce(given[group]) is None:
        raise ConfigError(by_name[group].fault(given[group]))

    def usual(_: str, member: Parameter) -> Any:
        of_all = by_name.get(member.name, member)
        found = of_all.coerce(given.get(member.name, of_all.default))
        return of_all.default if found is None else found

    return expand(by_name.values(), [group], lambda *_: members, given, usual)


def flatten(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the leaves of nested mappings with dotted names."""
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from flatten(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


class ConfigError(ValueError):
    """Every fault of a configuration at once: a line each with name, value and allowed values."""

    def __init__(self, *faults: str) -> None:
        self.faults = tuple(map(short, faults))
        super().__init__("\n".join(self.faults))


def read_each(read: Callable[[S], T], items: Iterable[S]) -> list[T]:
    """Return the value read from every item; raise `ConfigError` with the faults of all items."""
    found, faults = list[T](), list[str]()
    for item in items:
        try:
            found.append(read(item))
        except ConfigError as error:
            faults += error.faults
    if faults:
        raise ConfigError(*faults)
    return found


def name_faults(
    given: Iterable[str],
    known: Collection[str],
    old: Mapping[str, str] = _NO_NAMES,
    old_members: Mapping[str, str] = _NO_NAMES,
    similar: Iterable[str] = (),
    explain: Callable[[str], str] = lambda name: "",
) -> list[str]:
    """Return a fault for each former or unknown parameter.

    `old` and `old_members` have the replacements of former names in words, without a prefix and
    after the name of a list's member; `similar` names may be meant besides the known ones.
    `explain` returns why a name like no other is unknown, or an empty text.
    """
    others = [name for name in given if name not in known]
    instead = {name: old.get(name) or old_members.get(name.partition(".")[2]) for name in others}
    faults = [f"{name}: no longer a parameter, {text}" for name, text in instead.items() if text]
    unknown = [name for name in others if not instead[name]]
    # Largest number of unknown names for which suggestions are searched: more mean that the file is
    # for another program, and each search takes time.
    max_suggestions = 20
    candidates = {*known, *similar} if len(unknown) <= max_suggestions else ()
    hints = (_question(name, candidates) or explain(name) for name in unknown)
    return faults + [
        f"{name}: unknown parameter{hint and ', '}{hint}"
        for name, hint in zip(unknown, hints, strict=True)
    ]


def _question(name: str, known: Iterable[str]) -> str:
    """Return a question for the most similar name of the same group or a similar one, if any."""
    # The group itself would make all its members similar.
    group, _, member = name.rpartition(".")
    names = {
        each.rpartition(".")[2]: each for each in sorted(known) if each.rpartition(".")[0] == group
    }
    near = get_close_matches(member, names, 1, MIN_SIMILARITY)
    # A beginning, and swapped letters in a short name, are less similar than that.
    near = near or [
        each for each in names if each.startswith(member) or sorted(each) == sorted(member)
    ]
    found = [names[each] for each in near]
    found = found or [each for each in sorted(known) if _is_mistyped_group(name, each)]
    return f"did you mean {found[0]}?" if found else ""


def _is_mistyped_group(name: str, meant: str) -> bool:
    """Return whether two names differ only in the letters of similar groups, and not in numbers."""
    group, _, member = name.rpartition(".")
    other, _, other_member = meant.rpartition(".")
    if not group or member != other_member or _DIGITS.findall(group) != _DIGITS.findall(other):
        return False
    return bool(get_close_matches(group, [other], 1, MIN_SIMILARITY))


def check(
    table: Iterable[Parameter],
    given: Mapping[str, Any],
    old: Mapping[str, str] = _NO_NAMES,
    old_members: Mapping[str, str] = _NO_NAMES,
    similar: Iterable[str] = (),
    explain: Callable[[str], str] = lambda name: "",
) -> tuple[dict[str, Any], list[str]]:
    """Return the values of all parameters, and every fault of the given ones; see `name_faults`."""
    by_name = {parameter.name: parameter for parameter in table}
    found = {name: given.get(name, own.default) for name, own in by_name.items()}
    values = {name: own.coerce(found[name]) for name, own in by_name.items()}
    faults = [by_name[name].fault(found[name]) for name in by_name if values[name] is None]
    return values, faults + name_faults(given, by_name, old, old_members, similar, explain)
