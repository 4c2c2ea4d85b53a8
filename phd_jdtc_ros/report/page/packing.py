"""Whole numbers of a page as few bytes: columns of differences, compressed, as base64."""

from __future__ import annotations

import base64
import gzip

import numpy as np
import numpy.typing as npt


class Columns:
    """Columns of whole numbers of 32 bits; the page's script reads them back by name.

    Attributes
    ----------
    index : list of (name, number of entries)
        In the order of `text`.
    """

    def __init__(self) -> None:
        self.index: list[tuple[str, int]] = []
        self._parts: list[bytes] = []

    def add(self, name: str, values: npt.ArrayLike) -> None:
        """Add a column.

        What is stored of it are the differences from one entry to the next, from 0 on, with the
        sign as the lowest bit; first the lowest bytes of all, and last the highest, which are
        mostly 0.
        """
        numbers = np.asarray(values, dtype=np.int64)
        steps = np.diff(numbers, prepend=0)
        folded = np.where(steps < 0, -2 * steps - 1, 2 * steps).astype("<u4")
        self.index.append((name, len(numbers)))
        self._parts.append(folded.view(np.uint8).reshape(-1, 4).T.tobytes())

    def text(self) -> str:
        """Return all columns, compressed, as base64."""
        return packed(b"".join(self._parts))


def packed(data: bytes) -> str:
    """Return bytes, compressed by gzip, as base64; equal bytes give equal texts."""
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode("ascii")
