"""Tables of the hypotheses and links of an entry, or of several small ones that follow each other.

A call of compiled code takes as long as the backward step of several targets. A radar that turns
makes many small scans, whose tables are therefore joined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ...arrays import IntArray
from .backward_step import Gaussians, Links
from .updates import EDGE, ROW

# Number of tables that are joined at a time, and the largest number of hypotheses of each.
JOINED, LARGEST = 8, 512


@dataclass
class Table:
    """Hypotheses, and the links to earlier ones; both are the arrays of a single entry themselves.

    No array is changed, except the smoothed ones when they have been copied.
    """

    end: int  # Number of the update after its last one
    filtered: Gaussians
    links: Links | None  # None without earlier hypotheses
    smoothed: Gaussians = field(init=False)
    is_joined: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        self.smoothed = self.filtered

    @property
    def changeable(self) -> Gaussians:
        """The smoothed hypotheses, in arrays of their own."""
        if self.smoothed is self.filtered:
            self.smoothed = Gaussians(*(column.copy() for column in self.filtered))
        return self.smoothed

    @property
    def is_small(self) -> bool:
        """Whether the table can be joined to others."""
        return not (self.is_joined or self.links is None) and len(self.filtered.weight) <= LARGEST


def _shift(links: Links, begins: IntArray) -> Links:
    """Return links that refer to rows of joined tables, in which their own have these `begins`."""
    rows, predicted, _, pairs, factors = begins
    return links._replace(
        child=links.child + rows,
        parent=np.where(links.parent < 0, -1, links.parent + predicted),
        place=np.where(links.place < 0, -1, links.place + pairs),
        factored=np.where(links.factored < 0, -1, links.factored + factors),
    )


def join(tables: Sequence[Table], updates: IntArray, first: int) -> Table:
    """Return a table of the rows of several that have links; their updates get the places there.

    Parameters
    ----------
    updates : int array of shape (U, COLUMNS)
        All updates of the tables, which are changed.
    first : int
        Number of the first of these updates.
    """
    links = [table.links for table in tables if table.links is not None]
    rows = [len(table.filtered.weight) for table in tables]
    sizes = np.array(
        [
            [count, len(own.change), len(own.child), len(own.mean), len(own.factor)]
            for count, own in zip(rows, links, strict=True)
        ]
    )
    begins = sizes.cumsum(axis=0) - sizes
    ends, numbers = [table.end for table in tables], first + np.arange(len(updates))
    of_table = np.searchsorted(ends, numbers, side="right")
    updates[:, ROW : EDGE + 2] += begins[of_table, :3].repeat(2, axis=1)
    shifted = map(_shift, links, begins)
    filtered, smoothed = (
        Gaussians(*map(np.concatenate, zip(*gaussians, strict=True)))
        for gaussians in zip(*((table.filtered, table.smoothed) for table in tables), strict=True)
    )
    joined = Table(
        tables[-1].end, filtered, Links(*map(np.concatenate, zip(*shifted, strict=True)))
    )
    joined.smoothed, joined.is_joined = smoothed, True
    return joined
