"""Owners: the marginal probabilities that sources own tracks, and numbers that go along with them.

A source owns at most one track, and a track has usually at most one source of each identity space:
an AIS and an ADS-B transmitter may share a target, and rarely two of one space do. The weights are
accumulated likelihood ratios, so that the marginals are those of the whole history and not of one
report after the other.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray, factorize, frozen, read_only
from ..association.marginals import MOST_WORK, edge_probabilities
from ..compilation import Float1, Int1, compiled
from .tables import Pairs, Sources, Tracks

# Largest log weight in the association: larger ones are as certain.
MOST_LOG_WEIGHT = 25.0
# Probability that a target has a second transmitter of one identity space: another set, or one that
# is registered twice. It counts where two sources are this likely owners, as log weights.
SECOND, LIKELY = 1e-3, 2.0
# Labels of sources that are tracks of their own begin here; those of the engine are below.
OWN_LABELS = 1 << 58
# A source that was heard for longer before its track was known has a number of its own, seconds.
PRECEDES_S = 60.0
# Number of reports with a certain owner after which a track's number goes along with the source.
NUMBERED = 2


@compiled
def _marginals(
    most_work: int, sources: int, source: Int1, track: Int1, odds: Float1, outside: Float1
) -> FloatArray:
    share, _, _ = edge_probabilities(most_work, sources, source, track, odds, outside)
    return share


def owner_probabilities(
    source: IntArray, label: IntArray, space: IntArray, log_weight: FloatArray
) -> FloatArray:
    """Return the probability of each pair that the source owns the track, (P,).

    `source` and `label` are those of each pair, and `space` is the identity space of its source.

    Notes
    -----
    A second transmitter is a second place at the same track, with the weight times `SECOND`.
    """
    if not len(source):
        return np.zeros(0)
    sources, row = factorize(source)
    # Sources of other spaces do not compete for a track.
    ranked = factorize(label)[1] * (1 + int(space.max())) + space
    tracks, column = factorize(ranked)
    odds, count = np.exp(np.minimum(log_weight, MOST_LOG_WEIGHT)), len(tracks)
    contested = np.bincount(column[log_weight > LIKELY], minlength=count) > 1
    (second,) = contested[column].nonzero()
    edges = (
        np.concatenate([row, row[second]]).astype(np.int64),
        np.concatenate([column, count + column[second]]).astype(np.int64),
        np.concatenate([odds, SECOND * odds[second]]),
        np.ones(2 * count),
    )
    share: FloatArray = read_only(_marginals(MOST_WORK, len(sources), *edges))
    found: FloatArray = share[: len(row)].copy()
    found[second] += share[len(row) :]
    return found.clip(0.0, 1.0)


def with_public(sources: Sources, tracks: Tracks, pairs: Pairs) -> tuple[Sources, Tracks]:
    """Return sources and tracks with the labels under whose numbers tracks are published.

    A certain owner brings its label along: where two tracks have swapped their targets, it goes
    over to the other one. No two tracks have the same.
    """
    sure = np.flatnonzero(pairs.certain >= NUMBERED).tolist()
    if not sure:
        return sources, tracks
    carried, public = sources.public.copy(), tracks.public.copy()
    for pair in sure:
        source = int(sources.number.searchsorted(pairs.source[pair]))
        track = int(tracks.label.searchsorted(pairs.label[pair]))
        if carried[source] < 0:
            before_ns = tracks.known_ns[track] - sources.first_ns[source]
            own = OWN_LABELS + sources.number[source]
            carried[source] = own if before_ns > PRECEDES_S * 1e9 else public[track]
        if carried[source] != public[track]:
            public[public == carried[source]] = public[track]
            public[track] = carried[source]
    return (
        frozen(sources._replace(public=carried)),
        frozen(tracks._replace(public=public)),
    )
