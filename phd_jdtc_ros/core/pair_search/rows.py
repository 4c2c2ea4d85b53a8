"""Rows of two particle sets, as input of a compiled kernel."""

from __future__ import annotations

from typing import NamedTuple

from ..arrays import FloatArray, IntArray


class Queries(NamedTuple):
    """The later rows.

    Parameters
    ----------
    whitened : array of shape (Q, K)
    group, mode : int arrays of shape (Q,)
        Groups from 0.
    """

    whitened: FloatArray
    group: IntArray
    mode: IntArray


class Points(NamedTuple):
    """The earlier rows.

    Parameters
    ----------
    whitened : array of shape (motions, P, K)
        Whitened states predicted by each motion.
    group, mode : int arrays of shape (P,)
    weight : array of shape (P,)
    """

    whitened: FloatArray
    group: IntArray
    mode: IntArray
    weight: FloatArray
