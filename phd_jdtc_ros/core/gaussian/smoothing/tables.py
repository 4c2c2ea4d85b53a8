"""Tables of the hypotheses and links of an entry, or of several small ones that follow each other.

A call of compiled code takes as long as the backward step of several targets. A radar that turns
makes many small scans, whose tables are therefore joined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ...arrays import IntArray, frozen, read_only
from ..mixture import Gaussians
from .backward_step import Links
from .updates import EDGE, ROW

# Number of tables that are joined at a time, and the largest number of hypotheses of each.
JOINED, LARGEST = 8, 512


@dataclass
class Table:
    """Hypotheses, and the links to earlier ones; both are the arrays of a single entry themselves.

    The smoothed hypotheses are the filtered ones until they are copied, to be changed.
    """

    end: int  # Number of the update after its last one
    filtered: Gaussians
    links: Links | None  # None without earlier hypotheses
    is_small: bool = False  # Whether the table can be joined to others
    smoothed: Gaussians = field(init=False)  # Its arrays are read-only views of `_own`
    _own: Gaussians | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.smoothed = self.filtered

    @property
    def changeable(self) -> Gaussians:
        """The smoothed hypotheses, in arrays of their own."""
        if self._own is None:
            return self.own(Gaussians(*(column.copy() for column in self.filtered)))
        return self._own

    def own(self, smoothed: Gaussians) -> Gaussians:
        """Take these arrays for the smoothed hypotheses, and return them."""
        self._own, self.smoothed = smoothed, Gaussians(*map(read_only, smoothed))
        return smoothed


def _shift(rows: IntArray, begin: IntArray) -> IntArray:
    """Return rows of joined tables, given the begin of each row's own table; -1 remains."""
    return np.where(rows < 0, -1, rows + begin)


def join(tables: Sequence[Table], updates: IntArray, first: int) -> Table:
    """Return a table of the rows of several that have links; their updates get the places there.

    Parameters
    ----------
    updates : int array of shape (U, COLUMNS)
        All updates of the tables, which are changed.
    first : int
        Number of the first of these updates.
    """
    parts = [table.links for table in tables if table.links is not None]
    sizes = np.array(
        [
            [len(table.filtered.weight), *map(len, (own.change, own.child, own.mean, own.factor))]
            for table, own in zip(tables, parts, strict=True)
        ]
    )
    begins = sizes.cumsum(axis=0) - sizes
    counts = np.diff([first, *[table.end for table in tables]])
    updates[:, ROW : EDGE + 2] += begins[:, :3].repeat(counts, axis=0).repeat(2, axis=1)
    _, predicted, edges, pairs, _ = sizes.T
    links = Links(*map(np.concatenate, zip(*parts, strict=True)))
    links = links._replace(
        child=links.child + begins[:, 0].repeat(edges),
        parent=_shift(links.parent, begins[:, 1].repeat(edges)),
        place=_shift(links.place, begins[:, 3].repeat(predicted)[:, None]),
        factored=_shift(links.factored, begins[:, 4].repeat(pairs)),
    )
    filtered, smoothed = (
        Gaussians(*map(np.concatenate, zip(*gaussians, strict=True)))
        for gaussians in zip(*((table.filtered, table.smoothed) for table in tables), strict=True)
    )
    joined = Table(tables[-1].end, frozen(filtered), frozen(links))
    joined.own(smoothed)
    return joined
