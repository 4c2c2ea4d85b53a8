"""What is said of tracks and sources: owners, dark and silent targets, doubtful sources."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray, matches
from ..types import COASTING, CONFIRMED, TENTATIVE, UNKNOWN, Estimates
from ..types.reports import LEFT, NO_REASON, SHARED, UNCONFIRMED, Reported
from . import silence
from .batches import keys_of
from .filters import moved
from .model import RELIABILITY
from .owners import OWN_LABELS
from .tables import LayerState, Sources

# Looks of a radar from which an unseen source is doubtful.
LOOKS = 3
# A source that is heard no more is a track of its own for this time, seconds, or three intervals.
SHOWN_S = 30.0
# Two sources of one address within this time are said to share it, seconds.
SHARED_S = 60.0
# Owner probability below which a source is a track of its own.
OWNED = 0.5
# Reports after which a source outside the coverage of radars is a confirmed track.
CONFIRMING = 2


class Judged(NamedTuple):
    """What is said of T tracks, as far as one receiver tells."""

    covered: BoolArray  # Whether the receiver would hear them
    obliged: FloatArray  # Probability that they are obliged to transmit
    dark: FloatArray  # That they are and do not
    silent: FloatArray  # That they do not transmit


def of_receiver(layer: LayerState, index: int, stamp_ns: int) -> Judged:
    """Return what the silence of tracks to one receiver says.

    It is the mixture over the sources that may be a track's own, or none since it was born. A
    receiver that hears no one is itself silent: nothing is said of the time since its last report.
    """
    tracks, sources, pairs = layer.tracks, layer.sources, layer.pairs
    receiver, size = layer.receivers[index], len(tracks.label)
    habits, source = receiver.habits, sources.number.searchsorted(pairs.source)
    of_space = sources.space[source] == receiver.space
    at, source = tracks.label.searchsorted(pairs.label[of_space]), source[of_space]
    # Two transmitters may be on one target.
    owned = np.bincount(at, pairs.owned[of_space], size)
    of, share = np.append(np.arange(size), at), np.append(1.0 - owned, pairs.owned[of_space])
    share = share.clip(0.0) / np.maximum(owned, 1.0)[of]
    heard = np.arange(len(of)) >= size
    gap_s = np.append(np.zeros(size), sources.gap_s[source])
    last_ns = np.maximum(sources.last_ns, sources.on_ns)[source]
    now_ns = min(int(layer.learned.alive_ns[index]), stamp_ns)
    silent_s = (now_ns - np.append(tracks.born_ns, last_ns)) * 1e-9
    quiet_s = np.maximum(silent_s - heard * habits.time_step_s, 0.0)
    interval_s = layer.intervals_of(
        np.full(len(of), index), tracks.mean[of, 2:], tracks.covariance[of, 2:, 2:], gap_s
    )
    losses = layer.losses[index]
    # Before its second report nobody knows how often a transmitter reports, unless it says so.
    rare = np.where(gap_s > 0.0, 0.0, habits.rare)
    quiet, unnoticed_s = np.zeros(len(of)), np.zeros(len(of))
    for part, each_s in (
        (1.0 - rare, interval_s),
        (rare, np.maximum(interval_s, habits.rare_s)),
    ):
        quiet += part * np.where(
            heard,
            silence.since_report(quiet_s, each_s, losses),
            silence.unheard(quiet_s, each_s, losses),
        )
        unnoticed_s += part * losses.unnoticed_s(quiet_s, each_s)
    obliged = np.zeros(size)
    if len(receiver.obliged):
        obliged = tracks.class_probability @ receiver.obliged
    off = float(layer.learned.off[index])
    said = silence.judge(obliged[of], off, heard, quiet, unnoticed_s)
    dark, silent = (np.bincount(of, share * each, size) for each in said)
    inside = silence.covered(tracks.mean[:, :2], index, receiver, layer.learned.cells)
    # A transmitter that has left its target is on, and says that it is elsewhere.
    elsewhere = np.isin(tracks.label, sources.owner[_leaving(sources, stamp_ns)])
    row, source = matches(sources.number, tracks.heard)
    is_own = ~np.isin(sources.owner[source], tracks.label)
    is_own |= sources.owner[source] == tracks.label[row]
    is_own &= sources.space[source] == receiver.space
    later = sources.last_ns[newest_of_address(sources)] > sources.last_ns
    elsewhere[row] |= is_own & later[source]
    free = (inside & ~elsewhere).astype(np.float64)
    return Judged(inside, obliged, free * dark, np.where(inside, free * silent, np.nan))


def _leaving(sources: Sources, stamp_ns: int) -> BoolArray:
    """Return whether each source has left the track that it owned, and is still heard."""
    active = (stamp_ns - sources.last_ns) * 1e-9 < SHARED_S
    return (sources.left_ns > 0) & active


def newest_of_address(sources: Sources) -> IntArray:
    """Return the row of the source of the same address that was heard last, (S,)."""
    key = keys_of(sources.address, sources.space)
    key = np.where(sources.address == UNKNOWN, -1 - np.arange(len(key)), key)
    order = np.lexsort((sources.last_ns, key))
    newest: IntArray = order[key[order].searchsorted(key, side="right") - 1]
    return newest


def goes_on_elsewhere(sources: Sources) -> BoolArray:
    """Return whether the path of each source ended before another one of its address began."""
    newest = newest_of_address(sources)
    is_elsewhere: BoolArray = sources.first_ns[newest] > sources.last_ns
    return is_elsewhere


def of_estimates(layer: LayerState, label: IntArray, stamp_ns: int) -> Reported:
    """Return what is said of the estimates with these labels."""
    sources, pairs, tracks = layer.sources, layer.pairs, layer.tracks
    said = Reported.unknown(len(label))
    columns = {name: value.copy() for name, value in vars(said).items()}
    row, track = matches(tracks.label, label)
    for index in range(len(layer.receivers)):
        judged = of_receiver(layer, index, stamp_ns)
        columns["dark"][row] = np.maximum(columns["dark"][row], judged.dark[track])
        columns["silent"][row] = np.fmax(columns["silent"][row], judged.silent[track])
    columns["heard_ns"][row] = tracks.heard_ns[track]
    # The most probable source of each, and one that has left it.
    order = np.argsort(pairs.owned, kind="stable")
    order = order[pairs.owned[order] > 0.0]
    ascending = np.argsort(label, kind="stable")
    pair, place = matches(label[ascending], pairs.label[order])
    best = np.full(len(label), -1)
    best[ascending[place]] = order[pair]
    (owning,) = (best >= 0).nonzero()
    chosen = best[owning]
    columns["owned"][owning] = pairs.owned[chosen]
    shown = pairs.owned[chosen] >= OWNED
    columns["offset"][owning[shown]] = pairs.mean[chosen[shown], 4:6]
    source = sources.number.searchsorted(pairs.source[chosen[shown]])
    _write_source(columns, owning[shown], sources, source)
    # Of clones each may own a track.
    columns["reason"][owning[shown]] = SHARED * _shared(sources, stamp_ns)[source]
    (leaving,) = _leaving(sources, stamp_ns).nonzero()
    left, place = matches(label[ascending], sources.owner[leaving])
    at, source = ascending[place], leaving[left]
    free = columns["owned"][at] < OWNED
    at, source = at[free], source[free]
    _write_source(columns, at, sources, source)
    columns["reason"][at], columns["since_ns"][at] = LEFT, sources.left_ns[source]
    return Reported(**columns)


def _write_source(
    columns: dict[str, FloatArray | IntArray], row: IntArray, sources: Sources, source: IntArray
) -> None:
    for name in ("address", "space", "name", "type"):
        columns[name][row] = getattr(sources, name)[source]


def doubtful(layer: LayerState, stamp_ns: int) -> FloatArray:
    """Return the probability of each source that it is not where it says, (S,).

    It is unknown, NaN, where no radar looks.
    """
    owned, sources = layer.owned, layer.sources
    is_seen = (sources.looks >= LOOKS) & ((stamp_ns - sources.looked_ns) * 1e-9 < SHOWN_S)
    return np.where(is_seen, 1.0 - owned, np.nan)


def joined(layer: LayerState, estimates: Estimates, said: Reported) -> Estimates:
    """Return estimates with what is said of them, and with the sources that own no track."""
    tracks = layer.tracks
    row, track = matches(tracks.label, estimates.track_id - 1)
    track_id = estimates.track_id.copy()
    track_id[row] = tracks.public[track] + 1
    # A source that is a track of its own may have the number that it has carried along.
    estimates = estimates.changed(track_id=track_id, reports=said)
    alone = _alone(layer, estimates)
    return estimates if alone is None else estimates.with_rows(alone)


def _alone(layer: LayerState, estimates: Estimates) -> Estimates | None:
    """Return the sources without a track as estimates; None without any."""
    sources, stamp_ns = layer.sources, estimates.stamp_ns
    interval_s = layer.intervals(sources)
    age_s = (stamp_ns - sources.last_ns) * 1e-9
    owned = layer.owned
    shown = (age_s < np.maximum(SHOWN_S, 3.0 * interval_s)) & (owned < OWNED)
    # A first report is not yet a path, and may be of a track that needs another look.
    shown &= (sources.reports >= CONFIRMING) & (sources.first_ns <= stamp_ns)
    shown &= ~(goes_on_elsewhere(sources) & shown[newest_of_address(sources)])
    (row,) = shown.nonzero()
    if not len(row):
        return None
    doubt = doubtful(layer, stamp_ns)[row]
    taken = set(estimates.track_id.tolist())
    own = OWN_LABELS + sources.number[row]
    label = np.where(sources.public[row] >= 0, sources.public[row], own)
    label = np.where([each + 1 in taken for each in label.tolist()], own, label)
    state, covariance = _ghosts(layer, row, estimates)
    said = Reported.unknown(len(row))
    columns = {name: value.copy() for name, value in vars(said).items()}
    _write_source(columns, np.arange(len(row)), sources, row)
    columns["alone"][:] = 1
    columns["owned"] = owned[row]
    columns["silent"][:] = 0.0
    columns["doubtful"] = doubt
    columns["heard_ns"] = sources.last_ns[row]
    is_doubtful = np.nan_to_num(doubt) > OWNED
    # Its earlier paths count too, until they are given up.
    left_ns = np.zeros(len(sources.number), dtype=np.int64)
    np.maximum.at(left_ns, newest_of_address(sources), sources.left_ns)
    left_ns = np.maximum(left_ns, sources.left_ns)[row]
    has_left = (left_ns > 0) & is_doubtful
    shared = _shared(sources, stamp_ns)[row]
    columns["reason"] = np.select(
        [shared, has_left, is_doubtful], [SHARED, LEFT, UNCONFIRMED], NO_REASON
    )
    first_ns = np.where(is_doubtful, sources.first_ns[row], 0)
    columns["since_ns"] = np.where(has_left, left_ns, first_ns)
    classes = layer.classes
    # Where a radar looks, or will within two turns, it will confirm the source or not.
    unseen = (stamp_ns - sources.looked_ns[row]) * 1e-9 > SHOWN_S
    unseen &= (stamp_ns - sources.first_ns[row]) * 1e-9 > 2.0 * layer.look_s
    state_of = np.select(
        [~unseen, age_s[row] > 2.0 * interval_s[row]], [TENTATIVE, COASTING], CONFIRMED
    )
    attributes = None
    if estimates.attributes is not None:
        attributes = type(estimates.attributes).unknown(len(row))
    return estimates.changed(
        state=state,
        covariance=covariance,
        weight=np.where(np.isnan(doubt), 1.0, 1.0 - doubt),
        class_probability=np.full((len(row), classes), 1.0 / classes),
        class_id=np.zeros(len(row), dtype=np.int64),
        track_id=label + 1,
        track_state=state_of.astype(np.int64),
        attributes=attributes,
        reports=Reported(**columns),
    )


def _shared(sources: Sources, stamp_ns: int) -> BoolArray:
    """Return whether another recent source has the address of each source, (S,)."""
    recent = ((stamp_ns - sources.last_ns) * 1e-9 < SHARED_S) & (sources.address != UNKNOWN)
    recent &= ~goes_on_elsewhere(sources)
    key = keys_of(sources.address, sources.space)
    distinct, count = np.unique(key[recent], return_counts=True)
    is_shared: BoolArray = recent & np.isin(key, distinct[count > 1])
    return is_shared


def _ghosts(
    layer: LayerState, row: IntArray, estimates: Estimates
) -> tuple[FloatArray, FloatArray]:
    """Return the states of sources at the estimates' stamp, with covariances."""
    sources, space = layer.sources, estimates.space
    dt = (estimates.stamp_ns - sources.last_ns[row]).astype(np.float64) * 1e-9
    density = RELIABILITY.unsteady * layer.noise_density
    mean, spread = moved(sources.mean[row, :4], sources.covariance[row, :4, :4], dt, density)
    axes = space.planar_axes
    state = np.zeros((len(row), len(space)))
    state[:, axes] = mean
    covariance = np.tile(1e-6 * np.eye(len(space)), (len(row), 1, 1))
    covariance[:, axes[:, None], axes] = 0.5 * (spread + spread.swapaxes(1, 2))
    return state, covariance
