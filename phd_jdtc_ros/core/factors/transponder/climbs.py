"""Range rates of targets whose climb rates are known.

A range rate has a part of the climb rate, the sine of the elevation. Where the climb rate is
unknown, this part is noise; that of a target with a known height is subtracted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import IntArray
from ...association.evidence import Paired
from ...sensors.polar_geometry import MIN_RANGE
from ...sensors.range_rate import RangeRateModel
from ...sensors.site import HeightProjection
from .height import Heights

# Smallest probability of a height whose climb rate is used.
MIN_KNOWN = 0.5


def without_climbs(
    pairs: Paired,
    target: IntArray,
    heights: Heights,
    projection: HeightProjection,
    model: RangeRateModel,
) -> Paired:
    """Return the pairs with a detection each, whose range rate has no part of a known climb rate.

    `target` has the target of each pair, (P,), and `heights` those of all targets at the scan's
    stamp. The elevation of a detection without a height is that of the target's height.
    """
    found, known = pairs.projected.take(pairs.projected_index), heights.known[target] > MIN_KNOWN
    rate, rise, level = found.range_rate, found.rise, found.level
    if rate is None or rise is None or level is None or not known.any():
        return pairs
    height, climb = heights.mean[target].T
    above, distance = height - projection.antenna, np.maximum(found.measurement[:, 0], MIN_RANGE)
    slant = np.hypot(distance, above)
    unknown = known & np.isnan(rise)
    rise, level = np.where(unknown, above / slant, rise), np.where(unknown, distance / slant, level)
    rise, own_std = np.nan_to_num(rise), found.range_rate_std
    std = np.full(len(rate), model.std) if own_std is None else own_std
    std = np.where(np.isfinite(std), std, model.std)
    climb_std = np.sqrt(np.maximum(heights.covariance[target, 1, 1], 0.0))
    resolved = replace(
        found,
        range_rate=np.where(known, rate - rise * climb, rate),
        range_rate_std=np.where(known, np.hypot(std, rise * climb_std), std),
        rise=np.where(known, 0.0, rise),
        level=level,
    )
    return pairs._replace(projected=resolved, projected_index=np.arange(len(pairs.row)))
