"""Conversion between PointCloud2 and columns, with checks of the message's layout."""

from __future__ import annotations

import math
import struct
from collections.abc import Collection, Mapping, Sequence
from functools import cache, lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from . import RejectedMessageError, cdr, quote, stamps

# Larger clouds are rejected before their data is read.
MAX_POINTS = 100_000
MAX_OFFSET = 2**16
LARGEST = float(np.finfo(np.float32).max)

_CODES = {
    PointField.INT8: "i1",
    PointField.UINT8: "u1",
    PointField.INT16: "i2",
    PointField.UINT16: "u2",
    PointField.INT32: "i4",
    PointField.UINT32: "u4",
    PointField.FLOAT32: "f4",
    PointField.FLOAT64: "f8",
}
_DATATYPES = {code: datatype for datatype, code in _CODES.items()}
# Bytes of a stamp, of a width, and of the members after the point step in a cloud without points.
_STAMP, _WIDTH, _AFTER_FIELDS = 8, 4, 9
FLOATS = ("f4", "f8")
UNSIGNED = ("u4",)


def encode(
    stamp_ns: int, frame: str, columns: Mapping[str, npt.NDArray[Any]], wide: Collection[str] = ()
) -> PointCloud2:
    """Return a dense little-endian cloud of height 1.

    `columns` are arrays of shape (M,) by field name, in order, or (M, N) for fields of N numbers:
    float arrays become FLOAT32, or FLOAT64 if they are named in `wide`, integer arrays UINT32, and
    byte arrays UINT8.
    """
    points = _points(columns, wide)
    cloud = _empty(points.dtype, frame)
    cloud.header.stamp = stamps.header(stamp_ns, frame).stamp
    cloud.width, cloud.row_step = len(points), points.nbytes
    # The data is bytes, because a list is copied element by element, which is 500 times slower.
    cloud.data = points.tobytes()
    return cloud


def to_cdr(
    stamp_ns: int, frame: str, columns: Mapping[str, npt.NDArray[Any]], wide: Collection[str] = ()
) -> bytes:
    """Return the cloud of `encode` in serialised form, which the middleware sends as it is."""
    points = _points(columns, wide)
    before, fields = _constant_bytes(points.dtype, frame)
    return b"".join(
        (
            cdr.ENCAPSULATION,
            struct.pack("<iI", *divmod(stamp_ns, stamps.NS_PER_S)),
            before,
            struct.pack("<I", len(points)),
            fields,
            struct.pack("<II", points.nbytes, points.nbytes),
            points.tobytes(),
            b"\x01",  # The flag is_dense.
        )
    )


def _points(columns: Mapping[str, npt.NDArray[Any]], wide: Collection[str]) -> npt.NDArray[np.void]:
    kinds = tuple([(name, array.dtype.char, array.shape[1:]) for name, array in columns.items()])
    points = np.empty(len(next(iter(columns.values()))), dtype=_layout(kinds, frozenset(wide)))
    for name, array in columns.items():
        points[name] = array
    return points


def _empty(layout: np.dtype[np.void], frame: str) -> PointCloud2:
    return PointCloud2(
        header=Header(frame_id=frame),
        height=1,
        fields=_fields(layout),
        is_bigendian=False,
        point_step=layout.itemsize,
        is_dense=True,
    )


@cache
def _constant_bytes(layout: np.dtype[np.void], frame: str) -> tuple[bytes, bytes]:
    """Return a serialised cloud's bytes between stamp and width, and from there to the row step."""
    header, whole = cdr.Writer(), cdr.Writer()
    cloud = _empty(layout, frame)
    cdr.put_message(header, cloud.header)
    header.put("I", cloud.height)
    cdr.put_message(whole, cloud)
    begin, data = header.size, whole.data
    return data[_STAMP:begin], data[begin + _WIDTH : -_AFTER_FIELDS]


@cache
def _layout(
    kinds: tuple[tuple[str, str, tuple[int, ...]], ...], wide: frozenset[str]
) -> np.dtype[np.void]:
    """Return the layout of a point, given name, type and inner shape of each column."""
    return np.dtype([(name, f"<{_code(kind, name in wide)}", inner) for name, kind, inner in kinds])


def _code(kind: str, wide: bool) -> str:
    """Return the type code of a column, given the character of its type."""
    if kind in np.typecodes["Float"]:
        return "f8" if wide else "f4"
    return "u1" if kind == "B" else "u4"


def _fields(layout: np.dtype[np.void]) -> list[PointField]:
    """Return the fields of a cloud, which belong to its message alone."""
    columns: Any = layout.fields
    return [
        PointField(
            name=name,
            offset=offset,
            datatype=_DATATYPES[dtype.base.str[1:]],
            count=math.prod(dtype.shape),
        )
        for name, (dtype, offset) in columns.items()
    ]


def finite(column: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Return which numbers are finite in single precision.

    Estimates are published in single precision, and sums and squares of such numbers are finite in
    double precision. Neither holds for a double such as 1e300.
    """
    mask: npt.NDArray[np.bool_] = np.abs(column) <= LARGEST  # False for NaN
    return mask


def require_finite(columns: Mapping[str, npt.NDArray[Any]]) -> None:
    """Raise `RejectedMessageError` if a column contains a number that is not `finite`."""
    for name, column in columns.items():
        if not finite(column).all():
            raise RejectedMessageError(
                "schema", f"field {name!r} has a value that is not finite in single precision"
            )


def field_names(cloud: PointCloud2) -> list[str]:
    """Return the names of a cloud's fields in order."""
    return [field.name for field in cloud.fields]


def decode(cloud: PointCloud2, wanted: Mapping[str, Sequence[str]]) -> dict[str, npt.NDArray[Any]]:
    """Return the wanted columns of a cloud of either byte order, copies in native byte order.

    Each wanted field has its allowed type codes, such as `FLOATS`, before which stands the number
    of its elements if that is not 1, as in ``20u1``; further fields are ignored.

    Raise `RejectedMessageError`: ``oversize`` above `MAX_POINTS`; ``schema`` if a field is missing
    or has another type or count, or if the steps do not match each other or the data.
    """
    count = cloud.width * cloud.height
    if count > MAX_POINTS:
        raise RejectedMessageError("oversize", f"{count} points, at most {MAX_POINTS} are allowed")
    by_name = {field.name: field for field in cloud.fields}
    for name in wanted:
        if name not in by_name:
            raise RejectedMessageError(
                "schema", f"field {name!r} is missing; the cloud has {quote(sorted(by_name))}"
            )
    found = [by_name[name] for name in wanted]
    places = tuple([(field.offset, field.datatype, field.count) for field in found])
    allowed = tuple([(name, tuple(types)) for name, types in wanted.items()])
    layout = _checked_layout(allowed, places, cloud.is_bigendian, cloud.point_step)
    if cloud.row_step < cloud.width * cloud.point_step or len(cloud.data) != (
        cloud.row_step * cloud.height
    ):
        raise RejectedMessageError(
            "schema",
            f"{len(cloud.data)} bytes of data, row_step {cloud.row_step} and point_step "
            f"{cloud.point_step} do not fit {cloud.height} x {cloud.width} points",
        )
    # The strides carry the step, because numpy limits items to less than 2 GiB.
    points = np.ndarray(
        shape=(cloud.height, cloud.width),
        dtype=layout,
        buffer=cloud.data if count else b"",
        strides=(cloud.row_step, cloud.point_step) if count else None,
    ).ravel()
    return {
        name: points[name].astype(points[name].dtype.newbyteorder("="), copy=True)
        for name in wanted
    }


# The clouds of a topic usually have the same layout.
@lru_cache(maxsize=64)
def _checked_layout(
    wanted: tuple[tuple[str, tuple[str, ...]], ...],
    places: tuple[tuple[int, int, int], ...],
    is_bigendian: bool,
    point_step: int,
) -> np.dtype[np.void]:
    """Return the layout of the wanted fields in a point, after checks of the types and places.

    Each place is a field's offset, datatype and count.
    """
    order = ">" if is_bigendian else "<"
    formats, offsets = [], []
    for (name, allowed), place in zip(wanted, places, strict=True):
        code = _checked_code(name, place, allowed, point_step)
        formats.append(f"{code[:-2]}{order}{code[-2:]}")
        offsets.append(place[0])
    return np.dtype({"names": [name for name, _ in wanted], "formats": formats, "offsets": offsets})


def _checked_code(
    name: str, place: tuple[int, int, int], allowed: Sequence[str], point_step: int
) -> str:
    """Return a field's type code, after checks of its type and its place in the point."""
    offset, datatype, count = place
    base = _CODES.get(datatype, "unknown")
    code = base if count == 1 else f"{count}{base}"
    if code not in allowed:
        single = "" if any(each[:-2] for each in allowed) else ", count 1"
        raise RejectedMessageError(
            "schema",
            f"field {name!r} has type {base}, count {count}; "
            f"must be one of {', '.join(allowed)}{single}",
        )
    if offset + np.dtype(code).itemsize > point_step:
        raise RejectedMessageError("schema", f"field {name!r} reaches beyond the point's step")
    if offset > MAX_OFFSET:
        raise RejectedMessageError(
            "schema", f"field {name!r} begins at byte {offset}, at most {MAX_OFFSET}"
        )
    return code
