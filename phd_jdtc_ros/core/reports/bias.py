"""Constant errors of radars, as what owned tracks report of themselves shows them.

Both components of a radar's measurements may be wrong by constants, in units of its standard
deviations. Each look tells how far the plots of owned tracks are from the ghosts of their sources,
which are of reports alone. Before an error is certain none is assumed: it could be the mean of the
antennas' places. Radar tracks keep it; pairs are updated with corrected plots.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray, frozen, matches
from .filters import moved
from .tables import Biases, Look, Pairs, Sources

# Time for which looks count, seconds.
MEMORY_S = 300.0
# Probability that a plot is of a track, and of a track's owner, from which the plot counts.
LIKELY = 0.5
# Square distance from none at which an error is certain.
CERTAIN = 30.0


def learned(
    biases: Biases,
    look: Look,
    label: IntArray,
    sources: Sources,
    pairs: Pairs,
    density: float,
    antenna: FloatArray,
) -> Biases:
    """Return what is known of the biases after a look.

    `label` are those of the look's targets, `density` is that of the sources' acceleration, and
    `antenna`, (S,), the variance of each antenna's place, metres, over the looks that count: it is
    the same in all of them.
    """
    (own,) = (pairs.owned > LIKELY).nonzero()
    pair, target = matches(label, pairs.label[own])
    owner = np.full(len(label), -1)
    owner[target] = sources.number.searchsorted(pairs.source[own[pair]])
    (used,) = ((owner[look.target] >= 0) & (look.probability > LIKELY)).nonzero()
    plot, row = look.column[used], owner[look.target[used]]
    late_s = (look.stamp_ns - sources.last_ns[row]) * 1e-9 + look.time_s[plot]
    mean, spread = moved(sources.mean[row, :4], sources.covariance[row, :4, :4], late_s, density)
    noise = spread[:, :2, :2] + look.noise[plot] + antenna[row, None, None] * np.eye(2)
    error, root = (look.position[plot] - mean[:, :2])[:, :, None], look.root[plot]
    gain = np.linalg.solve(noise, root * look.probability[used, None, None]).swapaxes(1, 2)
    information, total, time_ns = (column.copy() for column in biases)
    fade = np.exp(-max(look.stamp_ns - int(time_ns[look.radar]), 0) * 1e-9 / MEMORY_S)
    information[look.radar] = fade * information[look.radar] + (gain @ root).sum(axis=0)
    total[look.radar] = fade * total[look.radar] + (gain @ error).sum(axis=0)[:, 0]
    time_ns[look.radar] = look.stamp_ns
    return frozen(Biases(information, total, time_ns))


def corrected(biases: Biases, look: Look) -> Look:
    """Return a look with its plots as they would be without the radar's certain bias."""
    covariance = np.linalg.inv(biases.information[look.radar] + 1e-9 * np.eye(2))
    bias = covariance @ biases.total[look.radar]
    if bias @ biases.total[look.radar] < CERTAIN:
        return look
    noise = look.noise + look.root @ covariance @ look.root.swapaxes(1, 2)
    return frozen(look._replace(position=look.position - look.root @ bias, noise=noise))
