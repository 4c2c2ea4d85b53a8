"""An engine's state: saved by reference (`Stateful`), or as named arrays to be stored (`Snapshot`).

A value type declares the bounds of the array with each field, for example
``mean: Annotated[FloatArray, floats("TD", -1e9, 1e9)]``. `to_snapshot` and `from_snapshot` follow
these declarations, so that no module converts its fields by hand.

A snapshot may come from a forged file. Every value is checked against the values that the tracker
could have stored, so that none of them crashes the tracker or becomes an estimate.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, fields
from functools import cache
from typing import Any, ClassVar, Protocol, TypeAlias, TypeVar, cast, get_args, get_type_hints

import numpy as np
import numpy.typing as npt

AnyArray = npt.NDArray[Any]
T = TypeVar("T")
# The latest stamp that a ROS message can have.
MAX_STAMP_NS = (1 << 31) * 1_000_000_000 - 1
# Bound on labels and rows; sums of them cannot overflow.
MAX_INDEX = 1 << 60
# Largest component of a state: metres, metres per second, radians per second.
MAX_STATE = 1e9
# Largest mass of a target, filtered or smoothed, that is accepted in a snapshot. It can exceed 1,
# because random draws preserve the mass only on average.
MAX_MASS = 100.0
# Tolerance for rounding in the correlations of a covariance.
ROUNDING = 1e-6


@dataclass(frozen=True)
class Snapshot:
    """An engine's state, as data without code."""

    stamp_ns: int | None  # Stamp of the last scan; None before the first
    arrays: dict[str, AnyArray] = field(default_factory=dict)  # Arrays by dotted name
    # Values that are stored as JSON: the states of random generators.
    json_values: dict[str, Any] = field(default_factory=dict)

    def array(self, name: str) -> AnyArray:
        """Return a stored array; raise `ValueError` if there is none of this name."""
        if name not in self.arrays:
            raise ValueError(f"{name}: missing")
        return self.arrays[name]

    def names_below(self, name: str) -> set[str]:
        """Return the next component of every array name below this dotted name."""
        start = f"{name}."
        return {
            full.removeprefix(start).split(".")[0] for full in self.arrays if full.startswith(start)
        }


@dataclass(frozen=True)
class _Array:
    """An array of numbers; `shape` has a letter for each axis, and is empty for a single number."""

    kind: str
    shape: str
    low: float
    high: float
    below: str = ""
    ascending: bool = False
    covariances: bool = False
    key: str = ""  # Name in the snapshot, if it is not the field's

    def put(self, snapshot: Snapshot, name: str, value: Any) -> None:
        """Store a value under a name."""
        snapshot.arrays[name] = np.asarray(value, None if self.shape else f"{self.kind}8")

    def get(self, snapshot: Snapshot, name: str, sizes: dict[str, int]) -> Any:
        """Return the value of a name; raises ValueError if the tracker could not have stored it."""
        array = snapshot.array(name)
        if array.dtype.kind != self.kind:
            expected = "floats" if self.kind == "f" else "whole numbers"
            raise ValueError(f"{name}: {array.dtype} given, expected {expected}")
        _require_shape(name, array.shape, self.shape, sizes)
        high = sizes[self.below] - 1 if self.below else self.high
        # This comparison also rejects NaN.
        if not ((array >= self.low) & (array <= high)).all() or np.isinf(array).any():
            text = f"{array.item()} given" if array.ndim == 0 else "a number is not finite, or"
            raise ValueError(f"{name}: {text} outside [{self.low:g}, {high:g}]")
        if self.ascending and (array[1:] <= array[:-1]).any():
            raise ValueError(f"{name}: must increase")
        if self.covariances:
            _require_covariances(name, array)
        # Compiled functions take only elements of eight bytes, and files may have others.
        return np.asarray(array, f"{self.kind}8", "C") if self.shape else array.item()


@dataclass(frozen=True)
class _Nested:
    """A value with declared fields of its own."""

    cls: Any
    sizes: tuple[tuple[str, int], ...]
    key: str = ""

    def put(self, snapshot: Snapshot, name: str, value: Any) -> None:
        to_snapshot(value, snapshot, name)

    def get(self, snapshot: Snapshot, name: str, sizes: dict[str, int]) -> Any:
        return from_snapshot(self.cls, snapshot, name, dict(self.sizes))


_Stored: TypeAlias = "_Array | _Nested"


class Stateful(Protocol):
    """An object whose state is saved by reference, for reprocessing.

    `STATE` names the attributes that change from scan to scan. Their values are replaced and never
    modified, so that a shallow copy is enough to restore a state; an attribute that is `Stateful`
    or a random generator saves its own state.
    """

    STATE: ClassVar[tuple[str, ...]]


def shared_state(owner: Stateful) -> dict[str, Any]:
    """Return the state of an object, for `restore_shared`; its values are shared."""

    def save(value: Any) -> Any:
        if hasattr(value, "STATE"):
            return shared_state(value)
        return value.bit_generator.state if isinstance(value, np.random.Generator) else copy(value)

    return {name: save(getattr(owner, name)) for name in owner.STATE}


def restore_shared(owner: Stateful, state: Mapping[str, Any]) -> None:
    """Return an object to a saved state."""
    for name in owner.STATE:
        value: Any = getattr(owner, name)
        if hasattr(value, "STATE"):
            restore_shared(value, state[name])
        elif isinstance(value, np.random.Generator):
            value.bit_generator.state = state[name]
        else:
            setattr(owner, name, copy(state[name]))


def integers(
    shape: str,
    low: int,
    high: int = MAX_INDEX,
    *,
    below: str = "",
    ascending: bool = False,
    key: str = "",
) -> _Stored:
    """Declare an array of integers with inclusive bounds.

    The shape has a letter for each axis; axes of the same letter have the same size. If `below` is
    the letter of an axis, all numbers are below the size of that axis. `key` is the name of the
    array in snapshots, if it is not the field's.
    """
    return _Array("i", shape, low, high, below, ascending, key=key)


def floats(shape: str, low: float, high: float, *, key: str = "") -> _Stored:
    """Declare an array of finite floats; see `integers`."""
    return _Array("f", shape, low, high, key=key)


def covariances(shape: str, std: float) -> _Stored:
    """Declare covariances with standard deviations from 0 to `std`."""
    return _Array("f", shape, -(std**2), std**2, covariances=True)


def nested(cls: type[Any], **sizes: int) -> _Stored:
    """Declare a value with declared fields of its own, with sizes of its axes by letter."""
    return _Nested(cls, tuple(sizes.items()))


@cache
def _fields(cls: type[Any]) -> dict[str, tuple[_Stored, bool]]:
    """Return the declared fields of a value type, and whether each may be None."""
    declared = {}
    for name, hint in get_type_hints(cls, include_extras=True).items():
        for stored in getattr(hint, "__metadata__", ()):
            declared[name] = stored, type(None) in get_args(get_args(hint)[0])
    return declared


def restored(value: T, snapshot: Snapshot, name: str, sizes: Mapping[str, int]) -> T:
    """Return a value of a dataclass with its declared fields as stored, and its other fields."""
    declared, cls = _fields(cast(Any, type(value))), cast(Any, type(value))
    others = {part.name: getattr(value, part.name) for part in fields(cast(Any, value))}
    others = {part: given for part, given in others.items() if part not in declared}
    restored_value: T = from_snapshot(cls, snapshot, name, sizes, **others)
    return restored_value


def stored_fields(value: Any) -> dict[str, Any]:
    """Return the declared fields of a value, by name."""
    return {name: getattr(value, name) for name in _fields(cast(Any, type(value)))}


def to_snapshot(value: Any, snapshot: Snapshot, name: str) -> None:
    """Store the declared fields of a value under ``name.field``, except for those that are None."""
    for part, (stored, _) in _fields(cast(Any, type(value))).items():
        content = getattr(value, part)
        if content is not None:
            stored.put(snapshot, f"{name}.{stored.key or part}", content)


def from_snapshot(
    cls: type[T], snapshot: Snapshot, name: str, sizes: Mapping[str, int], **others: Any
) -> T:
    """Return a stored value of a dataclass or named tuple with declared fields.

    `sizes` has sizes of axes by letter; other letters may have any size that is the same in all
    fields. The fields that are not stored are given as further arguments. Raise `ValueError` if an
    array is missing, or the tracker could not have stored it.
    """
    known_sizes, values = dict(sizes), others
    for part, (stored, optional) in _fields(cast(Any, cls)).items():
        full = f"{name}.{stored.key or part}"
        absent = optional and full not in snapshot.arrays and not snapshot.names_below(full)
        values[part] = None if absent else stored.get(snapshot, full, known_sizes)
    return cls(**values)


def _require_shape(name: str, shape: tuple[int, ...], axes: str, sizes: dict[str, int]) -> None:
    """Raise ValueError unless axes have their sizes; record the sizes of new letters."""
    expected = ", ".join(str(sizes.get(axis, axis)) for axis in axes)
    if len(shape) != len(axes) or list(shape) != [
        sizes.setdefault(axis, size) for axis, size in zip(axes, shape, strict=True)
    ]:
        raise ValueError(f"{name}: shape {shape}, expected ({expected})")


def _require_covariances(name: str, array: AnyArray) -> None:
    """Raise ValueError unless all matrices, (..., D, D), are covariances.

    They must be finite; axes of zero variance are allowed.
    """
    axes = np.arange(array.shape[-1])
    variance = array[..., axes, axes]
    std = np.sqrt(np.maximum(variance, 0.0))
    scale = std[..., None] * std[..., None, :]
    used = scale > 0.0
    correlation = np.where(used, array / np.where(used, scale, 1.0), 0.0)
    transposed = correlation.swapaxes(-1, -2)
    if (
        (variance < 0.0).any()
        or array[~used].any()
        or (np.abs(correlation - transposed) > ROUNDING).any()
        or np.linalg.eigvalsh(correlation).min(initial=0.0) < -ROUNDING
    ):
        raise ValueError(f"{name}: not a covariance")
