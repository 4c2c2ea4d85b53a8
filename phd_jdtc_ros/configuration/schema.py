"""Definition of a parameter: name, default, which fixes the type, and allowed values.

A parameter is declared once, as a field of a dataclass: `parameter` gives it a default, a
description and bounds. `table` returns the parameters of such a class, from which the checks, the
documentation and the descriptors of ROS follow, and `build` makes an instance of checked values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields, replace
from difflib import get_close_matches
from types import MappingProxyType
from typing import Any, TypeAlias, TypeVar

import numpy as np

from phd_jdtc_ros.quoting import short

Value: TypeAlias = "bool | int | float | str | list[float] | list[str]"
INFINITY = math.inf
# Lower bound of parameters that must be positive.
SMALL = 1e-9
# How much a misspelt name is like the one that is meant, and how many are looked for: more than
# these are another program's, and each takes time.
LIKENESS, MISSPELT = 0.8, 20


@dataclass(frozen=True)
class Form:
    """A way to write a value that is no plain number, text or list.

    Parameters
    ----------
    allowed : str
        The allowed values in words.
    read : callable
        Returns a given value as it is kept, or None if it is not allowed.
    """

    allowed: str
    read: Callable[[Any], Any]


@dataclass(frozen=True)
class Parameter:
    """One parameter: name, default, which fixes the type, and allowed values.

    Parameters
    ----------
    name : str
        Dotted; within a group, the part after the member's name.
    default : bool, int, float, str, list of float or list of str
    description : str
        With the unit.
    low, high : float
        Inclusive bounds of a number, or of every number of a list.
    choices : tuple of str
        Allowed strings; empty for any.
    length : int or None
        Required length of a list.
    element : type
        Of a list: float or str.
    most : int or None
        How many names a list may have; None for any number.
    words : tuple of str
        Words that are allowed in the place of a number.
    mutable : bool
        Whether it may change between two scans. The other parameters determine the structure of
        the tracker or of what it keeps from scan to scan.
    form : Form or None
        How a value is written that is no plain number, text or list.
    keys : tuple of str
        Those of a mapping: each has a parameter of its own, ``NAME.KEY``, where it is given.
    """

    name: str
    default: Value
    description: str
    low: float = -INFINITY
    high: float = INFINITY
    choices: tuple[str, ...] = ()
    length: int | None = None
    element: type = float
    most: int | None = None
    words: tuple[str, ...] = ()
    mutable: bool = False
    form: Form | None = None
    keys: tuple[str, ...] = ()

    @property
    def allowed(self) -> str:
        """The allowed values in words."""
        if self.form is not None:
            return self.form.allowed
        if self.choices and isinstance(self.default, list):
            return "a list of some of " + ", ".join(self.choices)
        if self.choices:
            return "one of " + ", ".join(self.choices)
        if isinstance(self.default, bool):
            return "true or false"
        if isinstance(self.default, str):
            return "a string"
        if isinstance(self.default, list) and self.element is str:
            return "a list of distinct names" + (f", at most {self.most}" if self.most else "")
        noun = "a whole number" if isinstance(self.default, int) else "a finite number"
        if isinstance(self.default, list):
            noun = (
                "finite numbers"
                if self.length is None
                else f"a list of {self.length} finite numbers"
            )
        bounds = [
            f"at least {self.low:g}" if self.low > -INFINITY else "",
            f"at most {self.high:g}" if self.high < INFINITY else "",
        ]
        allowed = ", ".join([noun, *(bound for bound in bounds if bound)])
        return " or ".join([allowed, *self.words])

    def coerce(self, value: Any) -> Value | None:
        """Return `value` as the parameter's type, or None if it is not allowed."""
        if self.form is not None:
            found: Value | None = self.form.read(value)
            return found
        if isinstance(self.default, bool):
            return value if isinstance(value, bool) else None
        if isinstance(self.default, str):
            valid = isinstance(value, str) and (not self.choices or value in self.choices)
            return value if valid else None
        if isinstance(self.default, list):
            return self._coerce_list(value)
        if self.words and isinstance(value, str):
            return value if value in self.words else None
        return self._coerce_number(value)

    def _coerce_number(self, value: Any) -> int | float | None:
        if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
            return None
        # Bounds first: a whole number may be too large for a float.
        if not max(self.low, -1e300) <= value <= min(self.high, 1e300):
            return None
        if isinstance(self.default, int):
            return int(value) if float(value).is_integer() else None
        return float(value)

    def _coerce_list(self, value: Any) -> Value | None:
        if isinstance(value, (str, bytes)) or not hasattr(value, "__len__"):
            return None
        if self.most is not None and len(value) > self.most:
            return None
        entries = list(value)
        if self.length is not None and len(entries) != self.length:
            return None
        if self.element is str:
            valid = all(isinstance(entry, str) and entry for entry in entries)
            valid = valid and len(set(entries)) == len(entries)
            return entries if valid and set(entries) <= set(self.choices or entries) else None
        number = Parameter("", 0.0, "", self.low, self.high)
        found = [number._coerce_number(entry) for entry in entries]
        valid_numbers = [float(value) for value in found if value is not None]
        return valid_numbers if len(valid_numbers) == len(entries) else None


# Where a field's metadata has its parameter.
_DECLARED = "parameter"
T = TypeVar("T")


def parameter(
    default: Any,
    description: str,
    low: float = -INFINITY,
    high: float = INFINITY,
    name: str = "",
    **more: Any,
) -> Any:
    """Return a field of a dataclass that is a parameter; see `Parameter`.

    The parameter has the name of the field, unless it is given: a dotted one.
    """
    declared = Parameter(name, default, description, low, high, **more)
    return field(default_factory=lambda: default, metadata={_DECLARED: declared})


def table(declared: type) -> tuple[Parameter, ...]:
    """Return the parameters that a dataclass declares, in their order."""
    return tuple(
        replace(entry.metadata[_DECLARED], name=entry.metadata[_DECLARED].name or entry.name)
        for entry in _entries(declared)
    )


def _entries(declared: type) -> tuple[Field[Any], ...]:
    return fields(declared)


def build(declared: type[T], values: Mapping[str, Any], prefix: str = "") -> T:
    """Return an instance of a dataclass that declares parameters; `prefix` ends with a dot."""
    given: dict[str, Any] = {}
    for entry in _entries(declared):
        own: Parameter = entry.metadata[_DECLARED]
        name = f"{prefix}{own.name or entry.name}"
        if own.keys:
            own_keys = {
                key: values[f"{name}.{key}"] for key in own.keys if f"{name}.{key}" in values
            }
            given[entry.name] = own_keys
        else:
            given[entry.name] = values[name]
    return declared(**given)


def flatten(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the leaves of nested mappings with dotted names."""
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from flatten(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def unknown(given: Iterable[str], known: Collection[str]) -> list[str]:
    """Return a fault for each parameter that there is not, with the one that was probably meant.

    Parameters
    ----------
    given : iterable of str
        Dotted names.
    known : collection of str
        Dotted names of all parameters.
    """
    names = [name for name in given if name not in known]
    if len(names) > MISSPELT:
        return [f"{name}: unknown parameter" for name in names]
    return [f"{name}: unknown parameter{_meant(name, known)}" for name in names]


def refused(
    given: Iterable[str],
    table: Collection[str],
    known: Collection[str],
    old: Mapping[str, str],
    old_members: Mapping[str, str],
) -> list[str]:
    """Return a fault for each parameter that is no longer there or never was.

    Parameters
    ----------
    given : iterable of str
        Dotted names.
    table : collection of str
        Names of all parameters; none of them is a fault.
    known : collection of str
        Those that may be meant.
    old, old_members : mapping of a name of before to what takes its place
        Of the whole, and of each name in a list.
    """
    others = [name for name in given if name not in table]
    instead = {name: old.get(name) or old_members.get(name.partition(".")[2]) for name in others}
    faults = [f"{name}: no longer a parameter, {text}" for name, text in instead.items() if text]
    return faults + unknown((name for name in others if not instead[name]), known)


def _meant(name: str, known: Iterable[str]) -> str:
    """Return a question for the most similar name of the same group, empty without one."""
    group = name.rpartition(".")[0]
    near = [each for each in known if each.rpartition(".")[0] == group]
    found = get_close_matches(name, near, 1, LIKENESS)
    return f", is {found[0]} meant?" if found else ""


class ConfigError(ValueError):
    """Every fault of a configuration at once.

    Attributes
    ----------
    faults : tuple of str
        One line each: dotted name, value, what is allowed; without the middle of what is too long.
    """

    def __init__(self, faults: Sequence[str]) -> None:
        self.faults = tuple(map(short, faults))
        super().__init__("\n".join(self.faults))


def check(
    table: Iterable[Parameter],
    found: Mapping[str, Any],
    old: Mapping[str, str] = MappingProxyType({}),
    old_members: Mapping[str, str] = MappingProxyType({}),
) -> tuple[dict[str, Any], list[str]]:
    """Return the values of a plain table's parameters, and every fault of the given ones.

    `old` and `old_members` are those of `replaced.faults`.
    """
    by_name = {parameter.name: parameter for parameter in table}
    faults = refused(found, by_name, by_name, old, old_members)
    values = {}
    for name, parameter in by_name.items():
        value = found.get(name, parameter.default)
        values[name] = parameter.coerce(value)
        if values[name] is None:
            faults.append(f"{name}: {value!r} given, must be {parameter.allowed}")
    return values, faults


def with_members(
    top: Iterable[Parameter],
    group: str,
    members: Iterable[Parameter],
    given: Mapping[str, Any],
) -> dict[str, Parameter]:
    """Return a table with what each name of a list has of its own.

    Parameters
    ----------
    top : iterable of Parameter
        Those of all, the list among them.
    group : str
        Which of them is the list of names.
    members : iterable of Parameter
        What each name has, as ``NAME.PARAMETER``. What is not given of one that is in `top` too is
        as for all.
    given : mapping of dotted name to value

    Raises
    ------
    ConfigError
        If the list cannot be one of names: nothing can be said of the rest then.
    """
    table = {parameter.name: parameter for parameter in top}
    listed = table[group]
    found = listed.coerce(given.get(group, listed.default))
    if not isinstance(found, list):
        raise ConfigError([f"{group}: {given[group]!r} given, must be {listed.allowed}"])
    own = {}
    for parameter in members:
        of_all = table.get(parameter.name, parameter)
        shared = of_all.coerce(given.get(parameter.name, of_all.default))
        default = of_all.default if shared is None else shared
        for name in found:
            full = f"{name}.{parameter.name}"
            own[full] = replace(parameter, name=full, default=default)
    return table | own
