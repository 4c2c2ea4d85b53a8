# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the values of scans add up to over a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Totals:
    """What the values of scans add up to, of several runs or sets at once.

    Parameters
    ----------
    names : tuple of str
        Of the V values.
    scans : int
        Of each run.
    known : int array of shape (..., V)
        In how many scans there is such a value.
    sums, maxima : arrays of shape (..., V)
        Over those scans.
    """

    names: tuple[str, ...]
    scans: int
    known: IntArray
    sums: FloatArray
    maxima: FloatArray

    @staticmethod
    def of(names: tuple[str, ...], values: FloatArray) -> Totals:
        """Add up values of shape (..., scans, V), NaN where there is no such value."""
        known = np.isfinite(values)
        return Totals(
            names,
            values.shape[-2],
            known.sum(axis=-2),
            np.where(known, values, 0.0).sum(axis=-2),
            np.where(known, values, -np.inf).max(axis=-2, initial=-np.inf),
        )

    def plus(self, more: Totals) -> Totals:
        """Return the totals of the scans of both."""
        return Totals(
            self.names,
            self.scans + more.scans,
            self.known + more.known,
            self.sums + more.sums,
            np.maximum(self.maxima, more.maxima),
        )

    def mean(self, name: str) -> FloatArray:
        """Return the mean over the scans that have the value, shape (...); NaN if none of them."""
        column = self.names.index(name)
        return ratio(self.sums[..., column], self.known[..., column])

    def sum(self, name: str) -> FloatArray:
        """Return the sum over the scans, shape (...); NaN unless each of them has the value."""
        column = self.names.index(name)
        return np.where(self.known[..., column] == self.scans, self.sums[..., column], np.nan)

    def maximum(self, name: str) -> FloatArray:
        """Return the largest of the scans, shape (...); NaN unless each of them has the value."""
        column = self.names.index(name)
        known = (self.known[..., column] == self.scans) & (self.scans > 0)
        return np.where(known, self.maxima[..., column], np.nan)


def ratio(over: FloatArray, under: FloatArray | IntArray | int) -> FloatArray:
    """Return the ratios, NaN where there is none."""
    nothing = np.full(np.shape(over), np.nan)
    result: FloatArray = np.divide(over, under, out=nothing, where=np.asarray(under) > 0)
    return result
