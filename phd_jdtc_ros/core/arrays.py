"""Array types, and operations on arrays that several packages of the core use."""

from __future__ import annotations

from dataclasses import field, fields
from functools import cache, cached_property
from typing import Annotated, Any, TypeVar, get_args, get_type_hints

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
# Arrays with this number of axes, as compiled functions declare them.
Float1 = Annotated[FloatArray, 1]
Float2 = Annotated[FloatArray, 2]
Float3 = Annotated[FloatArray, 3]
Float4 = Annotated[FloatArray, 4]
Int1 = Annotated[IntArray, 1]
Int2 = Annotated[IntArray, 2]
Bool1 = Annotated[BoolArray, 1]
# Marks an unknown code, address or type.
UNKNOWN = -1
# No type information comes with scipy.
SparseArray = Any
# Smallest positive normal number: a lower bound of divisors, and of arguments of logarithms.
TINY = float(np.finfo(np.float64).tiny)
# The golden ratio minus 1: the fractional parts of its first n multiples are evenly spread for
# every n.
GOLDEN_RATIO = 0.5 * (5.0**0.5 - 1.0)


def read_only(array: npt.ArrayLike, dtype: npt.DTypeLike = np.float64) -> Any:
    """Return `array` as a contiguous, read-only array of `dtype`.

    A contiguous array of this type is not copied: the result is a read-only view of it.
    """
    # Names of arguments would take a third of the time of these calls, and `flags` takes four times
    # as long as `setflags`.
    view: Any = np.ascontiguousarray(array, dtype).view()
    view.setflags(False)
    return view


ColumnsT = TypeVar("ColumnsT", bound=tuple[Any, ...])


def frozen(columns: ColumnsT) -> ColumnsT:
    """Return a named tuple with contiguous, read-only arrays, as compiled functions take them.

    Contiguous arrays are not copied, and become read-only themselves.
    """
    own: Any = columns
    for index, column in enumerate(columns):
        if isinstance(column, np.ndarray):
            contiguous: Any = np.ascontiguousarray(column)
            contiguous.setflags(False)  # See `read_only`.
            if contiguous is not column:
                own = own._make([*own[:index], contiguous, *own[index + 1 :]])
    same: ColumnsT = own
    return same


# The dtype of each array type; dtype objects, because NumPy looks up other types at each call.
_DTYPES = (
    (FloatArray, np.dtype(np.float64)),
    (IntArray, np.dtype(np.int64)),
    (BoolArray, np.dtype(np.bool_)),
)


@cache
def _layout(cls: Any) -> tuple[dict[str, np.dtype[Any]], tuple[str, ...]]:
    """Return the dtype of each array field of a dataclass, optional ones included, by name.

    The other result has the names of its cached properties.
    """
    hints = get_type_hints(cls)
    arrays = {
        each.name: dtype
        for each in fields(cls)
        for array, dtype in _DTYPES
        if array in (hints[each.name], *get_args(hints[each.name]))
    }
    members = ((name, value) for base in cls.__mro__ for name, value in vars(base).items())
    return arrays, tuple({name for name, value in members if isinstance(value, cached_property)})


ValueT = TypeVar("ValueT", bound="ReadOnly")


class ReadOnly:
    """Base of frozen dataclasses, whose arrays become read-only and get their declared type."""

    def __post_init__(self) -> None:
        cls: Any = type(self)
        values = self.__dict__
        for name, dtype in _layout(cls)[0].items():
            if values[name] is not None:
                values[name] = read_only(values[name], dtype)

    def changed(self: ValueT, **values: Any) -> ValueT:
        """Return this value with some fields changed; faster than `dataclasses.replace`.

        The new values must be valid: they are not checked, and the given arrays themselves become
        read-only.
        """
        cls: Any = type(self)
        arrays, computed = _layout(cls)
        other: ValueT = object.__new__(cls)
        own = other.__dict__
        own |= self.__dict__
        for name in computed:
            if name in own:
                del own[name]
        for name in values:
            if name in arrays and values[name] is not None:
                values[name].setflags(False)
        own |= values
        return other


def zeros_field(*shape: int, dtype: type = np.float64) -> Any:
    """Return the default of a dataclass's field: an array of zeros."""
    return field(default_factory=lambda: np.zeros(shape, dtype))


def wrap_angle(angle: FloatArray) -> FloatArray:
    """Return `angle` in radians wrapped to (-pi, pi], elementwise."""
    wrapped = np.pi - np.mod(np.pi - angle, 2.0 * np.pi)
    inside: FloatArray = np.where(wrapped > -np.pi, wrapped, np.pi)  # Rounding may reach -pi
    return inside


def median(value: FloatArray) -> float:
    """Return the median of at least one value; for few values ten times as fast as NumPy's."""
    ordered, half = value.copy(), value.size // 2
    ordered.sort()
    return float(ordered[half] if value.size % 2 else 0.5 * (ordered[half - 1] + ordered[half]))


def sum_by(index: IntArray, weight: FloatArray, size: int) -> FloatArray:
    """Return the sums of `weight` over equal `index`, shape (size,).

    Long runs of equal indices, such as the particles of one target, are summed run by run, which is
    ten times as fast.
    """
    # Number of values up to which the test for runs costs more than it saves.
    if len(index) > 64:
        first = run_starts(index)
        # Mean length of a run of equal values above which a sum by runs is faster.
        if len(first) < len(index) // 4:
            index, weight = index.take(first), np.add.reduceat(weight, first)
    total: FloatArray = np.bincount(index, weights=weight, minlength=size).astype(
        np.float64, copy=False
    )
    return total


def run_starts(value: IntArray) -> IntArray:
    """Return the index at which each run of equal values begins."""
    return np.flatnonzero(np.concatenate([[True], value[1:] != value[:-1]])[: len(value)])


def factorize(value: IntArray) -> tuple[IntArray, IntArray]:
    """Return the distinct values, ascending, and for each entry the index of its value in them.

    This equals `numpy.unique` with the inverse, but is fast for long runs of equal values and for
    ascending ones.
    """
    starts = np.ones(len(value), dtype=np.bool_)
    np.not_equal(value[1:], value[:-1], out=starts[1:])
    distinct, run = value[starts], starts.cumsum() - 1
    if (distinct[1:] > distinct[:-1]).all():
        return distinct, run
    distinct, index = np.unique(distinct, return_inverse=True)
    return distinct, index.ravel()[run]


def contains(ascending: IntArray, value: IntArray) -> BoolArray:
    """Return whether each value is one of the ascending ones, shape of `value`.

    For few values this takes a fifth of the time of `numpy.isin`.
    """
    if not ascending.size:
        return np.zeros(value.shape, dtype=np.bool_)
    index = np.minimum(ascending.searchsorted(value), ascending.size - 1)
    is_contained: BoolArray = ascending[index] == value
    return is_contained


def matches(ascending: IntArray, value: IntArray) -> tuple[IntArray, IntArray]:
    """Return the rows of values that are among the ascending ones, and their places there."""
    index = ascending.searchsorted(value)
    inside = (index < len(ascending)).nonzero()[0]
    row = inside[ascending[index[inside]] == value[inside]]
    return row, index[row]


def add_by_row(total: FloatArray | IntArray, row: IntArray, weight: FloatArray | None) -> None:
    """Add the sums of `weight` over ascending rows to `total`, in place; None counts rows."""
    if len(row):
        sums = np.bincount(row - row[0], weights=weight)
        total[row[0] : row[0] + len(sums)] += sums


def distinct_cells(cell: IntArray, cells: int) -> tuple[IntArray, IntArray]:
    """Return the distinct cells, ascending, and the index of each entry's cell among them.

    For many entries, a table of all cells replaces the sort of `numpy.unique`, which would take
    half of the time of an update with particles.
    """
    # Largest number of cells per entry at which a table of all cells is faster than a sort of
    # entries.
    if cells > 8 * len(cell):
        found, index = np.unique(cell, return_inverse=True)
        return found, index.ravel()
    table = np.zeros(cells, dtype=np.int64)
    table[cell] = 1
    distinct: IntArray = np.flatnonzero(table)
    table[distinct] = np.arange(len(distinct))
    return distinct, table.take(cell)
