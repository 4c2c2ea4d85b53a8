"""Gating of targets whose gates differ in size: detections sorted by range in bands of azimuth."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray
from .intervals import expand

FULL_TURN = 2.0 * np.pi
MOST_BANDS = 512
# Distance between bands on the common axis, metres; it exceeds every range, so that the bands'
# intervals are disjoint.
BAND_OFFSET = 1e9


def in_boxes(
    ranges: FloatArray, azimuth: FloatArray, half_width: FloatArray, measured: FloatArray
) -> tuple[IntArray, IntArray]:
    """Return the pairs of a box in range and azimuth and a detection in it.

    Parameters
    ----------
    ranges : array of shape (N, 2)
        Smallest and largest range of each box, metres.
    azimuth, half_width : arrays of shape (N,)
        Centre and half width of each box in azimuth, radians.
    measured : array of shape (M, 2)
        (range, azimuth) of the detections; ranges are below `BAND_OFFSET`.

    Returns
    -------
    box, detection : int arrays of shape (P,)
        Boxes ascend.

    Notes
    -----
    Bands are about as wide as the median box, so that the cost grows with the number of pairs and
    not with N x M, if most boxes are of about one size.
    """
    if not len(azimuth) or not len(measured):
        none = np.zeros(0, dtype=np.int64)
        return none, none
    half_width = np.minimum(half_width, np.pi)
    typical = max(2.0 * float(np.median(half_width)), FULL_TURN / MOST_BANDS)
    bands = max(int(FULL_TURN / typical), 1)
    band = _band(measured[:, 1], bands) % bands
    key = band * BAND_OFFSET + measured[:, 0]
    order = np.argsort(key, kind="stable")
    key = key.take(order)
    first = _band(azimuth - half_width, bands)
    count = np.minimum(_band(azimuth + half_width, bands) - first + 1, bands)
    box, place = expand(np.arange(len(azimuth)), first, count)
    start = place % bands * BAND_OFFSET
    low = np.maximum(ranges[:, 0], 0.0).take(box)
    high = np.minimum(ranges[:, 1], 0.5 * BAND_OFFSET).take(box)
    begin = key.searchsorted(start + low, side="left")
    end = key.searchsorted(start + high, side="right")
    box, place = expand(box, begin, np.maximum(end - begin, 0))
    detection = order.take(place)
    apart = measured[:, 1].take(detection) - azimuth.take(box)
    apart -= FULL_TURN * np.round(apart / FULL_TURN)
    inside = np.flatnonzero(np.abs(apart) <= half_width.take(box))
    return box.take(inside), detection.take(inside)


def _band(azimuth: FloatArray, bands: int) -> IntArray:
    """Return the band of each azimuth; the count continues beyond a full turn."""
    band: IntArray = np.floor((azimuth + np.pi) * (bands / FULL_TURN)).astype(np.int64)
    return band
