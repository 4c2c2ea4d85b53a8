"""Estimates of tracks with sources: mixtures of the radar's own and of the pairs, also smoothed."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray, frozen, matches
from ..types import Estimates
from .filters import moved
from .tables import LayerState, Links, Pairs, take

# Owner probability below which a pair changes no estimate.
LEAST_OWNED = 1e-4
# Largest number of scans with links, beyond any lag.
MAX_LINKS = 1000


def links_of(pairs: Pairs) -> tuple[Pairs, Links]:
    """Return the links of pairs that have moved on, and the pairs with new ones from there."""
    (row,) = (pairs.since_ns < pairs.time_ns).nonzero()
    own = take(pairs, row)
    links = frozen(Links(own.number, own.since_ns, own.shift, own.gain, own.rest))
    if not len(row):
        return pairs, links
    since_ns, shift, gain, rest = (
        column.copy() for column in (pairs.since_ns, pairs.shift, pairs.gain, pairs.rest)
    )
    since_ns[row], shift[row], rest[row] = pairs.time_ns[row], 0.0, 0.0
    gain[row] = np.eye(shift.shape[1])
    return frozen(pairs._replace(since_ns=since_ns, shift=shift, gain=gain, rest=rest)), links


def states_at(
    layer: LayerState, pairs: Pairs, stamp_ns: int, smoothed: bool
) -> tuple[FloatArray, FloatArray]:
    """Return the states of pairs at a stamp, (P, 6) and (P, 6, 6).

    Smoothed ones follow their links back (Rauch-Tung-Striebel), the others are predicted.
    """
    mean, covariance, time_ns = pairs.mean.copy(), pairs.covariance.copy(), pairs.time_ns.copy()
    order = np.argsort(pairs.number)
    ascending = pairs.number[order]
    for links in reversed(layer.links if smoothed else ()):
        link, place = matches(ascending, links.number)
        row = order[place]
        back = (time_ns[row] > stamp_ns) & (links.time_ns[link] < time_ns[row])
        row, link = row[back], link[back]
        gain = links.gain[link]
        mean[row] = links.shift[link] + (gain @ mean[row][:, :, None])[:, :, 0]
        covariance[row] = links.rest[link] + gain @ covariance[row] @ gain.swapaxes(1, 2)
        time_ns[row] = links.time_ns[link]
    return moved(mean, covariance, (stamp_ns - time_ns) * 1e-9, layer.noise_density)


def mixture(layer: LayerState, estimates: Estimates, smoothed: bool) -> Estimates:
    """Return estimates, whose `track_id` is still label + 1, as mixtures with those of pairs."""
    pairs = layer.pairs
    # A pair says nothing of a time before it began.
    began_ns = np.minimum(pairs.since_ns, _first_links(layer))
    (used,) = ((pairs.owned > LEAST_OWNED) & (began_ns <= estimates.stamp_ns)).nonzero()
    order = np.argsort(estimates.track_id, kind="stable")
    place, row = matches(estimates.track_id[order] - 1, pairs.label[used])
    used, row = used[place], order[row]
    if not len(used):
        return estimates
    axes = estimates.space.planar_axes
    chosen = take(pairs, used)
    mean, covariance = states_at(layer, chosen, estimates.stamp_ns, smoothed)
    owned = np.zeros(len(estimates))
    np.add.at(owned, row, chosen.owned)
    # Sources of two identity spaces may own one track.
    weight = chosen.owned / np.maximum(owned[row], 1.0)
    alone = np.maximum(1.0 - owned, 0.0)
    state, spread = estimates.state.copy(), estimates.covariance.copy()
    touched = np.unique(row)
    total = alone[:, None] * estimates.state[:, axes]
    np.add.at(total, row, weight[:, None] * mean[:, :4])
    own = estimates.state[:, axes] - total
    block = estimates.covariance[:, axes[:, None], axes]
    block = alone[:, None, None] * (block + own[:, :, None] * own[:, None])
    off = mean[:, :4] - total[row]
    parts = covariance[:, :4, :4] + off[:, :, None] * off[:, None]
    np.add.at(block, row, weight[:, None, None] * parts)
    others = np.setdiff1d(np.arange(state.shape[1]), axes)
    spread[touched[:, None, None], axes[:, None], axes] = 0.5 * (
        block[touched] + block[touched].swapaxes(1, 2)
    )
    cross = (
        alone[touched][:, None, None]
        * estimates.covariance[touched[:, None, None], axes[:, None], others]
    )
    spread[touched[:, None, None], axes[:, None], others] = cross
    spread[touched[:, None, None], others[:, None], axes] = cross.swapaxes(1, 2)
    state[np.ix_(touched, axes)] = total[touched]
    return estimates.changed(state=state, covariance=spread)


def _first_links(layer: LayerState) -> IntArray:
    """Return the time of the first state that each pair is linked to, (P,)."""
    pairs = layer.pairs
    first: IntArray = pairs.since_ns.copy()
    order = np.argsort(pairs.number)
    for links in layer.links:
        link, place = matches(pairs.number[order], links.number)
        row = order[place]
        first[row] = np.minimum(first[row], links.time_ns[link])
    return first
