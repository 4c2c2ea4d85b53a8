"""Filtered heights of the last scans, and what later ones make of them.

The filter of a height is linear and has two states, so that a Rauch-Tung-Striebel pass over a few
stored steps smooths it.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray
from ..snapshot import MOST_STAMP_NS, MOST_STATE, covariances, floats, integers
from .height import HeightModel, Heights


class History(NamedTuple):
    """Filtered heights, by ascending origin and then by ascending stamp.

    Parameters
    ----------
    origin, stamp_ns : int arrays of shape (R,)
    mean : array of shape (R, 2)
    covariance : array of shape (R, 2, 2)
    """

    origin: Annotated[IntArray, integers("R", 0)]
    stamp_ns: Annotated[IntArray, integers("R", 0, MOST_STAMP_NS)]
    mean: Annotated[FloatArray, floats("RA", -MOST_STATE, MOST_STATE)]
    covariance: Annotated[FloatArray, covariances("RAA", MOST_STATE)]

    @staticmethod
    def empty() -> History:
        """Return one without rows."""
        none = np.zeros(0, dtype=np.int64)
        return History(none, none, np.zeros((0, 2)), np.zeros((0, 2, 2)))

    def take(self, rows: IntArray) -> History:
        """Return these rows."""
        columns: list[Any] = [column[rows] for column in self]
        return History(*columns)

    def noted(self, origin: IntArray, stamp_ns: int, heights: Heights) -> History:
        """Return the history with those of a scan, in place of what it has of the same scan."""
        old = self.take(
            np.flatnonzero(~((self.stamp_ns == stamp_ns) & np.isin(self.origin, origin)))
        )
        new = origin, np.full(len(origin), stamp_ns), heights.mean, heights.covariance
        columns: list[Any] = [np.concatenate(pair) for pair in zip(old, new, strict=True)]
        return History(*columns).take(np.lexsort((columns[1], columns[0])))

    def without(self, origin: IntArray) -> History:
        """Return the history of other origins."""
        if not np.isin(self.origin, origin).any():
            return self
        return self.take(np.flatnonzero(~np.isin(self.origin, origin)))

    def since(self, stamp_ns: int, alive: IntArray) -> History:
        """Return what a smoothed height from a stamp on may need, of some origins."""
        following = np.append(self.stamp_ns[1:], np.iinfo(np.int64).max)
        last = np.append(self.origin[1:] != self.origin[:-1], True)[: len(self.origin)]
        needed = last | (following[: len(self.origin)] > stamp_ns)
        return self.take(np.flatnonzero(needed & np.isin(self.origin, alive)))

    def smoothed(self, origin: IntArray, stamp_ns: int, model: HeightModel) -> Heights:
        """Return the heights of origins at a stamp, given all that later scans have told.

        Parameters
        ----------
        origin : int array of shape (T,)
        stamp_ns : int
        model : HeightModel

        Returns
        -------
        Heights
            `known` is 1 where there is any row of the origin, and 0 elsewhere.
        """
        first = np.searchsorted(self.origin, origin)
        end = np.searchsorted(self.origin, origin, side="right")
        found = Heights.fresh(len(origin))
        found.known[end > first] = 1.0
        row = end - 1
        going = np.flatnonzero(end > first)
        later = Heights(found.known, *(np.zeros_like(part) for part in found[1:]))
        later.mean[going], later.covariance[going] = (
            self.mean[row[going]],
            self.covariance[row[going]],
        )
        while len(going):
            # Where the next row back is earlier than the stamp, the step ends at the stamp.
            at = self.stamp_ns[row[going]]
            back = np.maximum(row[going] - 1, 0)
            more = (row[going] > first[going]) & (at > stamp_ns)
            before_ns = np.where(more, self.stamp_ns[back], at)
            until = np.maximum(before_ns, stamp_ns)
            done = ~more
            rest = going[done]
            dt = _seconds(stamp_ns - at[done])
            last = Heights(later.known[rest], later.mean[rest], later.covariance[rest])
            moved = last.moved(dt, model)
            found.mean[rest], found.covariance[rest] = moved.mean, moved.covariance
            some = going[more]
            own = Heights(np.ones(len(some)), self.mean[back[more]], self.covariance[back[more]])
            ahead = _seconds((until - before_ns)[more])
            after = _seconds((at - until)[more])
            start = own.moved(ahead, model)
            told = _told(start, later.take(some), after, model)
            later.mean[some], later.covariance[some] = told.mean, told.covariance
            there = until[more] == stamp_ns
            ended = some[there]
            found.mean[ended], found.covariance[ended] = told.mean[there], told.covariance[there]
            row[some] -= 1
            going = some[~there]
        return found


def _told(before: Heights, later: Heights, dt: FloatArray, model: HeightModel) -> Heights:
    """Return filtered heights given smoothed ones `dt` seconds later: a step back."""
    move, _ = model.transition(dt)
    predicted = before.moved(dt, model)
    gain = before.covariance @ move.swapaxes(1, 2) @ np.linalg.inv(predicted.covariance)
    change = later.mean - predicted.mean
    mean = before.mean + (gain @ change[:, :, None])[:, :, 0]
    spread = gain @ (later.covariance - predicted.covariance) @ gain.swapaxes(1, 2)
    return Heights(before.known, mean, before.covariance + spread)


def _seconds(ns: IntArray) -> FloatArray:
    seconds: FloatArray = ns.astype(np.float64) * 1e-9
    return seconds
