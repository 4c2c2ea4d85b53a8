"""A compact code of a page's integers: compressed columns of differences, as base64."""

from __future__ import annotations

import base64
import gzip

import numpy as np
import numpy.typing as npt


class Columns:
    """Columns of 32-bit integers; the page's script reads them by name.

    `index` has names and numbers of entries, in the order of `text`.
    """

    def __init__(self) -> None:
        self.index: list[tuple[str, int]] = []
        self._parts: list[bytes] = []

    def add(self, name: str, values: npt.ArrayLike) -> None:
        """Add a column.

        It stores the differences of successive entries, from 0 on, with the sign as the lowest bit:
        first the lowest bytes of all entries, and last the highest, which are mostly 0.
        """
        numbers = np.asarray(values, dtype=np.int64)
        steps = np.diff(numbers, prepend=0)
        folded = np.where(steps < 0, -2 * steps - 1, 2 * steps).astype("<u4")
        self.index.append((name, len(numbers)))
        self._parts.append(folded.view(np.uint8).reshape(-1, 4).T.tobytes())

    def text(self) -> str:
        """Return all columns, compressed, as base64."""
        return pack(b"".join(self._parts))


def pack(data: bytes) -> str:
    """Return bytes, compressed by gzip, as base64; the text is reproducible."""
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode("ascii")
