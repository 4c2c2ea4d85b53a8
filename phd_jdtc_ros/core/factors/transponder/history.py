"""Filtered heights of the last scans, and their smoothing.

The height filter is linear with two states; a Rauch-Tung-Striebel pass over the stored steps
smooths it.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray
from ...snapshot import MAX_STAMP_NS, MAX_STATE, covariances, floats, integers
from .height import HeightModel, Heights


class History(NamedTuple):
    """Filtered heights, sorted by label and then by stamp."""

    label: Annotated[IntArray, integers("R", 0, key="origin")]  # (R,)
    stamp_ns: Annotated[IntArray, integers("R", 0, MAX_STAMP_NS)]  # (R,)
    # Height and climb rate, metres and metres per second, (R, 2).
    mean: Annotated[FloatArray, floats("RA", -MAX_STATE, MAX_STATE)]
    covariance: Annotated[FloatArray, covariances("RAA", MAX_STATE)]  # (R, 2, 2)

    @staticmethod
    def empty() -> History:
        """Return a history without rows."""
        none = np.zeros(0, dtype=np.int64)
        return History(none, none, np.zeros((0, 2)), np.zeros((0, 2, 2)))

    def take(self, rows: IntArray) -> History:
        """Return these rows."""
        return History._make(column[rows] for column in self)

    def record(self, label: IntArray, stamp_ns: int, heights: Heights) -> History:
        """Return the history with a scan's heights, which replace earlier ones of that scan."""
        others = self.take(
            np.flatnonzero(~((self.stamp_ns == stamp_ns) & np.isin(self.label, label)))
        )
        added = label, np.full(len(label), stamp_ns), heights.mean, heights.covariance
        joined = History._make(map(np.concatenate, zip(others, added, strict=True)))
        return joined.take(np.lexsort((joined.stamp_ns, joined.label)))

    def without(self, label: IntArray) -> History:
        """Return the history without these labels."""
        if not np.isin(self.label, label).any():
            return self
        return self.take(np.flatnonzero(~np.isin(self.label, label)))

    def since(self, stamp_ns: int, alive: IntArray) -> History:
        """Return the rows of live labels that smoothing from a stamp on may need."""
        following = np.append(self.stamp_ns[1:], np.iinfo(np.int64).max)
        last = np.append(self.label[1:] != self.label[:-1], True)[: len(self.label)]
        needed = last | (following[: len(self.label)] > stamp_ns)
        return self.take(np.flatnonzero(needed & np.isin(self.label, alive)))

    def smooth(self, label: IntArray, stamp_ns: int, model: HeightModel) -> Heights:
        """Return the heights of labels at a stamp, given the detections of all later scans.

        `known` is 1 for labels with any row, and 0 for others.
        """
        first = np.searchsorted(self.label, label)
        end = np.searchsorted(self.label, label, side="right")
        result = Heights.fresh(len(label))
        result.known[end > first] = 1.0
        row = end - 1
        active = np.flatnonzero(end > first)
        later = Heights(result.known, *(np.zeros_like(part) for part in result[1:]))
        later.mean[active] = self.mean[row[active]]
        later.covariance[active] = self.covariance[row[active]]
        # Each step goes back from the stamp of a row to that of the row before it, or only to the
        # wanted stamp if this is between the two.
        while len(active):
            row_ns = self.stamp_ns[row[active]]
            previous = np.maximum(row[active] - 1, 0)
            goes_back = (row[active] > first[active]) & (row_ns > stamp_ns)
            before_ns = np.where(goes_back, self.stamp_ns[previous], row_ns)
            reached_ns = np.maximum(before_ns, stamp_ns)

            last = active[~goes_back]
            smoothed = later.take(last)
            predicted = smoothed.predict(_seconds(stamp_ns - row_ns[~goes_back]), model)
            result.mean[last], result.covariance[last] = predicted.mean, predicted.covariance

            stepped = active[goes_back]
            filtered = Heights(
                np.ones(len(stepped)),
                self.mean[previous[goes_back]],
                self.covariance[previous[goes_back]],
            ).predict(_seconds((reached_ns - before_ns)[goes_back]), model)
            dt = _seconds((row_ns - reached_ns)[goes_back])
            earlier = _smooth_step(filtered, later.take(stepped), dt, model)
            later.mean[stepped], later.covariance[stepped] = earlier.mean, earlier.covariance

            is_reached = reached_ns[goes_back] == stamp_ns
            ended = stepped[is_reached]
            result.mean[ended] = earlier.mean[is_reached]
            result.covariance[ended] = earlier.covariance[is_reached]
            row[stepped] -= 1
            active = stepped[~is_reached]
        return result


def _smooth_step(
    filtered: Heights, smoothed: Heights, dt: FloatArray, model: HeightModel
) -> Heights:
    """Return heights smoothed by one backward step from smoothed ones `dt` seconds later."""
    move, _ = model.transition(dt)
    predicted = filtered.predict(dt, model)
    gain = filtered.covariance @ move.swapaxes(1, 2) @ np.linalg.inv(predicted.covariance)
    change = smoothed.mean - predicted.mean
    mean = filtered.mean + (gain @ change[:, :, None])[:, :, 0]
    covariance_change = gain @ (smoothed.covariance - predicted.covariance) @ gain.swapaxes(1, 2)
    return Heights(filtered.known, mean, filtered.covariance + covariance_change)


def _seconds(ns: IntArray) -> FloatArray:
    return ns.astype(np.float64) * 1e-9
