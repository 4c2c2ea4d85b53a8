"""Totals of scan values over a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Totals:
    """Totals of scan values, for several runs or sets at once."""

    names: tuple[str, ...]  # Names of the V values
    scans: int  # Number of scans per run
    known: IntArray  # Number of scans that have the value, (..., V)
    sums: FloatArray  # Sum over those scans, (..., V)
    maxima: FloatArray  # Maximum over those scans, (..., V)

    @staticmethod
    def of(names: tuple[str, ...], values: FloatArray) -> Totals:
        """Return the totals of values of shape (..., scans, V), NaN for missing values."""
        known = np.isfinite(values)
        return Totals(
            names,
            values.shape[-2],
            known.sum(axis=-2),
            np.where(known, values, 0.0).sum(axis=-2),
            np.where(known, values, -np.inf).max(axis=-2, initial=-np.inf),
        )

    def plus(self, more: Totals) -> Totals:
        """Return the totals over the scans of both."""
        return Totals(
            self.names,
            self.scans + more.scans,
            self.known + more.known,
            self.sums + more.sums,
            np.maximum(self.maxima, more.maxima),
        )

    def mean(self, name: str) -> FloatArray:
        """Return the mean over the scans that have the value, shape (...); NaN without any."""
        column = self.names.index(name)
        return ratio(self.sums[..., column], self.known[..., column])

    def sum(self, name: str) -> FloatArray:
        """Return the sum over the scans, shape (...); NaN unless all scans have the value."""
        column = self.names.index(name)
        return np.where(self.known[..., column] == self.scans, self.sums[..., column], np.nan)

    def maximum(self, name: str) -> FloatArray:
        """Return the maximum over the scans, shape (...); NaN unless all scans have the value."""
        column = self.names.index(name)
        known = (self.known[..., column] == self.scans) & (self.scans > 0)
        return np.where(known, self.maxima[..., column], np.nan)


def ratio(over: FloatArray, under: FloatArray | IntArray | int) -> FloatArray:
    """Return the ratios, NaN where the denominator is not positive."""
    undefined = np.full(np.shape(over), np.nan)
    result: FloatArray = np.divide(over, under, out=undefined, where=np.asarray(under) > 0)
    return result
