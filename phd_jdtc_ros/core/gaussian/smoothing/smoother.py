"""The fixed-lag smoother: the smoothed mixtures of a window, or its targets at one stamp."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...tracks.common_stamp import between
from ...types import Estimates
from ..dynamics import Dynamics
from ..entries import Entry
from ..extraction import extract_targets
from ..mixture import Mixture
from .lineages import Around, Lineages


def backward_pass(entries: Sequence[Entry]) -> list[Mixture]:
    """Return the smoothed mixtures of a window, newest first: lag 0, lag 1 and so on.

    Parameters
    ----------
    entries : sequence of Entry
        Oldest first. A source outside these entries has left the window.
    """
    lineages = Lineages()
    lineages.extend(entries)
    lineages.smooth()
    return [lineages.smoothed(entry.stamp_ns) for entry in reversed(entries)]


def extract_at(
    lineages: Lineages,
    around: Around,
    dynamics: Dynamics,
    stamp_ns: int,
    lag: int,
    threshold: float,
) -> Estimates:
    """Return the smoothed targets at a stamp, between the updates `around` it."""
    before, after = around
    if (lineages.stamps(before) == stamp_ns).all():
        # Targets below the threshold are not needed to interpolate between updates. Those of one
        # stamp are sorted by label.
        targets = lineages.labels(before), *lineages.hypotheses(before)
        return extract_targets(*targets, dynamics, stamp_ns, lag, threshold)
    by_label = lineages.labels(before).argsort()
    before, after = before[by_label], after[by_label]
    has_later = after >= 0
    count, parts = int(np.count_nonzero(has_later)), (before[has_later], after[has_later])
    updates = np.concatenate([*parts, before[~has_later]])
    targets = lineages.labels(updates), *lineages.hypotheses(updates)
    estimates = extract_targets(*targets, dynamics, stamp_ns, lag, -1.0)
    rows = slice(count), slice(count, 2 * count), slice(2 * count, None)
    modes = dynamics.model.modes
    return between(estimates, lineages.stamps(updates), *rows, stamp_ns, threshold, modes)
