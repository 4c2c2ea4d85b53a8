"""Silence of transmitters in continuous time, what it says of a target, and where it says it.

A transmitter reports every T. A report is lost with the probability q, and certainly while its
transmitter is hidden from the receiver, which begins and ends at constant rates. It is evaluated
only when somebody asks: at any two times the later result follows from the same formula, whatever
was asked in between. Where a receiver hears no transmitter, nothing is silent.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray
from .model import Receiver

# Probability that a target has a transmitter that it is not obliged to have.
VOLUNTARY = 0.05
# Rate at which transmitters are switched off after they were heard, per second.
SWITCHED_OFF = 1e-5
# Cells along an axis on each side of the origin.
SPAN = 1 << 20
# Largest number of cells with reports that are kept.
MOST_CELLS = 20_000


class Losses(NamedTuple):
    """How reports are lost."""

    lost: float  # Probability that a report is lost of a transmitter in sight
    hidden: float = 0.0  # Share of the time in which a transmitter is hidden
    hidden_s: float = 1.0  # Mean time for which it is, seconds

    def in_row(self, count: FloatArray, interval_s: FloatArray, hidden: float) -> FloatArray:
        """Return the probability that so many reports in a row are lost, (N,).

        `hidden` is the probability that the transmitter is hidden an interval before the first of
        them. From report to report, in sight or hidden is a Markov chain, so that the result is a
        sum of two powers: of the eigenvalues of "it goes over to a state, and is lost there".
        """
        share, high, low = self._powers(interval_s, hidden)
        found: FloatArray = share * high**count + (1.0 - share) * low**count
        return found.clip(0.0, 1.0)

    def unnoticed_s(self, time_s: FloatArray, interval_s: FloatArray) -> FloatArray:
        """Return how long a transmitter is expected to be silent in a time after a report, (N,).

        That is the integral of `since_report`: if it was switched off at a constant rate, it was so
        before it would have been heard again.
        """
        share, high, low = self._powers(interval_s, 0.0)
        count = np.floor(time_s / interval_s)
        whole = sum(
            weight * (1.0 - base**count) / np.maximum(1.0 - base, 1e-12)
            for weight, base in ((share, high), (1.0 - share, low))
        )
        part = time_s / interval_s - count
        found: FloatArray = interval_s * (whole + part * self.in_row(count, interval_s, 0.0))
        return found

    def hiding(self, count: FloatArray, interval_s: FloatArray) -> FloatArray:
        """Return the probability that the transmitter was hidden when so many were lost, (N,).

        They are all the reports between two that were received.
        """
        hides, _ = self._changes(interval_s)
        exactly = self.in_row(count, interval_s, 0.0) - self.in_row(count + 1.0, interval_s, 0.0)
        in_sight = ((1.0 - hides) * self.lost) ** count * (1.0 - hides) * (1.0 - self.lost)
        found: FloatArray = 1.0 - in_sight / np.maximum(exactly, 1e-300)
        return np.where(count > 0.0, found.clip(0.0, 1.0), 0.0)

    def _changes(self, interval_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the probabilities that it hides within an interval, and that it shows, (N,)."""
        goes = -np.expm1(-interval_s / (self.hidden_s * (1.0 - self.hidden)))
        return self.hidden * goes, (1.0 - self.hidden) * goes

    def _powers(
        self, interval_s: FloatArray, hidden: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the share of the first power in `in_row`, and the bases of both, (N,)."""
        hides, shows = self._changes(interval_s)
        trace = (1.0 - hides) * self.lost + 1.0 - shows
        determinant = self.lost * (1.0 - hides - shows)
        root = np.sqrt(np.maximum(0.25 * trace**2 - determinant, 1e-18))
        high, low = 0.5 * trace + root, 0.5 * trace - root
        is_hidden = hidden * (1.0 - shows) + (1.0 - hidden) * hides
        first = is_hidden + (1.0 - is_hidden) * self.lost
        return (first - low) / (high - low), high, low


def unheard(time_s: FloatArray, interval_s: FloatArray, losses: Losses) -> FloatArray:
    """Return the probability that a transmitter of unknown phase is silent for a time, (N,)."""
    whole = np.floor(time_s / interval_s)
    part = time_s / interval_s - whole
    less, more = (losses.in_row(whole + k, interval_s, losses.hidden) for k in (0, 1))
    return (1.0 - part) * less + part * more


def since_report(time_s: FloatArray, interval_s: FloatArray, losses: Losses) -> FloatArray:
    """Return the probability that a transmitter is silent for a time after a report, (N,)."""
    return losses.in_row(np.floor(time_s / interval_s), interval_s, 0.0)


def judge(
    obliged: FloatArray,
    off_prior: float,
    was_heard: BoolArray,
    quiet: FloatArray,
    unnoticed_s: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the probabilities that targets should transmit and do not, and that they do not, (N,).

    Parameters
    ----------
    obliged : array of shape (N,)
        Probability that the target is obliged to transmit.
    off_prior : float
        Probability that an obliged target never transmits.
    was_heard : bool array of shape (N,)
        Whether it has transmitted.
    quiet : array of shape (N,)
        Probability that a transmitter of its kind is silent as it was.
    unnoticed_s : array of shape (N,)
        How long it is expected to be silent since it was heard, if it transmits, seconds.
    """
    off = np.where(was_heard, np.minimum(unnoticed_s * SWITCHED_OFF, 0.5), off_prior)
    has = np.where(was_heard, 1.0 - off, VOLUNTARY)
    weights = np.stack(
        [
            obliged * off,
            obliged * (1.0 - off) * quiet,
            (1.0 - obliged) * (1.0 - has),
            (1.0 - obliged) * has * quiet,
        ]
    )
    share = weights / np.maximum(weights.sum(axis=0), 1e-300)
    return share[0], share[0] + share[2]


def cells_of(
    position: FloatArray, index: int, width: float, shift: tuple[int, int] = (0, 0)
) -> IntArray:
    """Return a number for the cell of each position, or the one beside it, of a receiver, (N,)."""
    cell = np.clip(np.floor(position / width), -SPAN + 2, SPAN - 2).astype(np.int64)
    x, y = (cell + shift + SPAN).T
    found: IntArray = (index * 2 * SPAN + x) * 2 * SPAN + y
    return found


def with_cells(known: IntArray, position: FloatArray, index: int, receiver: Receiver) -> IntArray:
    """Return the cells in which transmitters were heard, ascending, with those of positions."""
    if not len(position):
        return known
    return np.union1d(known, cells_of(position, index, receiver.habits.cell))[:MOST_CELLS]


def covered(position: FloatArray, index: int, receiver: Receiver, known: IntArray) -> BoolArray:
    """Return whether a receiver hears transmitters at positions, (N,).

    It does within the configured polygon, or without one beside cells from which it has heard one.
    """
    if len(receiver.coverage):
        return _inside(position, receiver.coverage)
    near = np.zeros(len(position), dtype=np.bool_)
    for x in (-1, 0, 1):
        for y in (-1, 0, 1):
            near |= np.isin(cells_of(position, index, receiver.habits.cell, (x, y)), known)
    return near


def _inside(position: FloatArray, corner: FloatArray) -> BoolArray:
    """Return whether positions are within a polygon, by the number of crossed edges."""
    inside = np.zeros(len(position), dtype=np.bool_)
    x, y = position.T
    for (x0, y0), (x1, y1) in zip(corner, np.roll(corner, -1, axis=0), strict=True):
        crosses = (y0 > y) != (y1 > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            inside ^= crosses & (x < (x1 - x0) * (y - y0) / (y1 - y0) + x0)
    return inside
