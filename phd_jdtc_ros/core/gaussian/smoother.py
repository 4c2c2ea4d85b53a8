"""The fixed-lag smoother: the backward pass over the mixtures of a window.

A turning radar makes many small scans, each with the few targets that the antenna passed, so that
neighbouring targets were last updated in different scans. Every scan has a link to the hypotheses
that it continues, whichever scans these are of. One compiled call follows all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Any, overload

import numpy as np

from ..arrays import IntArray, contiguous
from ..window.entries import Entry, Source
from .hindsight import Gaussians, go_back
from .mixture import Mixture
from .prediction import Moves
from .reduction import Ancestry


@dataclass(frozen=True)
class Link:
    """The link from the hypotheses of a scan back to earlier hypotheses."""

    # From the earlier hypotheses, concatenated over all sources of the scan, to the predicted ones.
    moves: Moves
    ancestry: Ancestry  # From the predicted hypotheses to the kept ones

    @cached_property
    def columns(self) -> tuple[Any, ...]:
        """The columns from `child` to `place` as `hindsight.go_back` takes them."""
        one, moves = self.ancestry, self.moves
        return contiguous(
            *(one.child, one.parent, one.share, moves.change, moves.survival),
            *(moves.mean, moves.factor, moves.gain, moves.base, moves.place),
        )


def backward_pass(entries: Sequence[Entry[Mixture, Link]]) -> Sequence[Mixture]:
    """Return the smoothed mixtures of a window, newest first: lag 0, lag 1 and so on.

    Parameters
    ----------
    entries : sequence of Entry
        Oldest first. A source outside these entries has left the window.

    Notes
    -----
    A later mode j divides its smoothed weight among the pairs (i, j) of earlier modes i in
    proportion to w_i P_s pi_ij N(m_j; m_ij, P_ij), where m_j is the smoothed mean and m_ij, P_ij
    are the pair's predicted mean and covariance. The state of a pair follows by a backward step
    from the smoothed later state: the expectation correction. Without the normal density this is
    Kim's smoother, whose error grows with the lag; in a turn the growth cancels its gain. The
    weight of targets that die has the factor of a Bernoulli target's death,
    (1 - smoothed survivors) / (1 - filtered survivors).

    References
    ----------
    Barber, "Expectation correction for smoothed inference in switching linear dynamical systems",
    Journal of Machine Learning Research 7, 2006.
    Kim, "Dynamic linear models with Markov-switching", Journal of Econometrics 60, 1994.
    """
    if _is_chain(entries):
        return _smoothed_chain(entries)
    return _smoothed_whole(entries)


def _is_chain(entries: Sequence[Entry[Mixture, Link]]) -> bool:
    """Return whether every scan continues exactly the targets of the previous one."""
    return all(
        len(entry.sources) == 1
        and entry.sources[0].rows is None
        and entry.sources[0].stamp_ns == before.stamp_ns
        for before, entry in pairwise(entries)
    )


def _smoothed_chain(entries: Sequence[Entry[Mixture, Link]]) -> list[Mixture]:
    """Return the results of `backward_pass`, one scan after the other: no mixture is copied."""
    found = [entries[-1].stored]
    for before, entry in zip(entries[-2::-1], entries[:0:-1], strict=True):
        own = before.stored
        if entry.link is None:
            found.append(own)
            continue
        smoothed = Gaussians(*(np.empty_like(column) for column in own.gaussians))
        child, change = entry.link.ancestry.child, entry.link.moves.change
        sizes = np.array([0, len(child)]), np.array([0, len(change)])
        links = *entry.link.moves.pairs, *sizes, *entry.link.columns, np.arange(len(own))
        rows = (*links, own.target, *own.gaussians, *found[-1].gaussians)
        go_back(smoothed, *rows)
        found.append(own.with_gaussians(*smoothed))
    return found


@dataclass(frozen=True)
class _Parts(Sequence[Mixture]):
    """Mixtures whose rows are parts of the same arrays; each is made when it is asked for."""

    stored: Sequence[Mixture]
    rows: Sequence[slice]  # The rows of each mixture
    smoothed: Gaussians

    def __len__(self) -> int:
        return len(self.stored)

    @overload
    def __getitem__(self, index: int) -> Mixture: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Mixture]: ...
    def __getitem__(self, index: int | slice) -> Mixture | Sequence[Mixture]:
        if isinstance(index, slice):
            return _Parts(self.stored[index], self.rows[index], self.smoothed)
        own = self.rows[index]
        return self.stored[index].with_gaussians(*(column[own] for column in self.smoothed))


def _smoothed_whole(entries: Sequence[Entry[Mixture, Link]]) -> Sequence[Mixture]:
    """Return the results of `backward_pass`, with all rows of the window in the same arrays."""
    stored = [entry.stored for entry in entries]
    ends = list(accumulate([0, *map(len, stored)]))
    first = dict(zip((entry.stamp_ns for entry in entries), ends, strict=False))
    targets = accumulate([0, *(len(mixture.label) for mixture in stored)])
    links = [(entry.link, first[entry.stamp_ns]) for entry in reversed(entries) if entry.link]
    if not links:
        return stored[::-1]
    source = np.concatenate(
        [_rows(part, first) for entry in reversed(entries) if entry.link for part in entry.sources]
    )
    target = np.concatenate(
        [begin + mixture.target for begin, mixture in zip(targets, stored, strict=False)]
    )
    own = [np.concatenate(column) for column in zip(*(m.gaussians for m in stored), strict=True)]
    smoothed = Gaussians(*(column.copy() for column in own))
    rows = (*_joined(links), source, target, *own, *smoothed)
    go_back(smoothed, *rows)
    return _Parts(stored[::-1], list(map(slice, ends[-2::-1], ends[:0:-1])), smoothed)


def _rows(source: Source, first: Mapping[int, int]) -> IntArray:
    """Return the places of a source's rows in a window; -1 if they have left it."""
    if source.stamp_ns not in first:
        return np.full(source.size, -1)
    rows = np.arange(source.size) if source.rows is None else source.rows
    return first[source.stamp_ns] + rows


def _joined(links: Sequence[tuple[Link, int]]) -> tuple[Any, ...]:
    """Return the columns of links as `hindsight.go_back` takes them.

    Each comes with the place of its first later hypothesis.
    """
    edges, rows, pairs = (
        np.array([0, *accumulate(map(len, column))])
        for column in (
            [link.ancestry.child for link, _ in links],
            [link.moves.change for link, _ in links],
            [link.moves.mean for link, _ in links],
        )
    )
    every = zip(*(link.columns for link, _ in links), strict=True)
    child, *others, place = (np.concatenate(parts) for parts in every)
    child += np.repeat([begin for _, begin in links], np.diff(edges))
    place += np.where(place >= 0, np.repeat(pairs[:-1], np.diff(rows))[:, None], 0)
    return *links[0][0].moves.pairs, edges, rows, child, *others, place
