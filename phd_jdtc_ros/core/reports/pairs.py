"""Which pairs begin and end: sources are found or made by reports, and paired with tracks near."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..arrays import IntArray, frozen
from ..compilation import Float1, Writeable, compiled, inner
from .batches import Batch, Tables
from .filters import State, moved, observe, predict
from .model import MOST_PAIRS, Reliability
from .pair_filter import update_pairs, write_matrix, write_noise, write_pair
from .tables import Pairs, Sources, Tracks, extended

# Existence probability from which a track can be a source's own.
LEAST_EXISTENCE = 0.2
# Two reports of one time and one address at this distance are one, metres.
SAME_PLACE = 1.0
# Distance within which sources of one address are always compared, metres.
FAR = 1e4
# A source that was heard this long ago may have been the track, seconds.
RECENT_S = 30.0
# Log weight from which the source's last report is that of the track.
LIKELY = 3.0
# The velocities that a new source says are as if they had been right this long ago, seconds.
UNTRUE_S = 4.0


class Found(NamedTuple):
    """The source of a report."""

    row: int  # Of the source whose ghost expects it; -1 for none, -2 if it repeats a report
    log_likelihood: float
    of_address: int  # Number of sources of the address
    oldest: int  # Row of the one that is silent for longest


class Assumed(NamedTuple):
    """What is assumed of the transmitters of each receiver, (K,)."""

    offset_std: Float1
    log_area: Float1  # Log of the area of unknown sources
    log_speeds: Float1  # Log of the area of their velocities


class Used(NamedTuple):
    """Numbers of rows in use, and the next number of a source and of a pair."""

    sources: int
    pairs: int
    source_number: int
    pair_number: int


@inner
def _copy(state: State, to: State) -> None:
    for i in range(len(state.mean)):
        to.mean[i] = state.mean[i]
        for k in range(len(state.mean)):
            to.covariance[i, k] = state.covariance[i, k]


@inner
def _new_state(size: int) -> State:
    return State(np.empty(size), np.empty((size, size)))


@compiled
def _find(
    batch: Batch,
    report: int,
    assumed: Assumed,
    rules: Reliability,
    tables: Writeable[Tables],
    best: Writeable[State],
) -> Found:
    """Return the source of a report, and write its ghost after the report."""
    sources, _, chains = tables
    time_ns, z, receiver = batch.time_ns[report], batch.measured[report], batch.receiver[report]
    density, size = rules.unsteady * rules.noise_density, batch.components[report]
    found, best_log, count, oldest = -1, -np.inf, 0, -1
    matrix, noise, straight = np.zeros((4, 6)), np.empty((4, 4)), np.zeros(2)
    state, speeds = _new_state(6), math.exp(0.5 * assumed.log_speeds[receiver])
    row = chains.first[batch.chain[report]]
    while row >= 0:
        count += 1
        if oldest < 0 or sources.last_ns[row] < sources.last_ns[oldest]:
            oldest = row
        away = math.hypot(z[0] - sources.mean[row, 0], z[1] - sources.mean[row, 1])
        dt = (time_ns - sources.last_ns[row]) * 1e-9
        if dt == 0.0 and away < SAME_PLACE:
            return Found(-2, 0.0, count, oldest)
        # Without addresses thousands of sources may be far away.
        if away < FAR + 4.0 * speeds * abs(dt):
            _copy(State(sources.mean[row], sources.covariance[row]), state)
            late_s = max(-dt, 0.0)
            if dt > 0.0:
                predict(state, dt, density)
                # A source that begins to lie need not say so by its velocities.
                for i in range(4, 6):
                    state.covariance[i, i] += density * dt
            write_matrix(matrix, straight, late_s)
            matrix[2, 4] = matrix[3, 5] = 1.0  # The error of the velocity
            write_noise(noise, batch.noise[report], late_s, density)
            log_likelihood, square = observe(state, z, matrix, noise, size)
            if square < rules.own_gate and log_likelihood > best_log:
                found, best_log = row, log_likelihood
                _copy(state, best)
        row = chains.following[row]
    return Found(found, best_log, count, oldest)


@inner
def _write_source(
    batch: Batch,
    report: int,
    row: int,
    number: int,
    variances: tuple[float, float],
    sources: Sources,
) -> None:
    """Write a new source into a row.

    `variances` are those of its velocity if it says none, and of how untrue it is if it does.
    """
    unknown, untrue = variances
    sources.number[row] = number
    sources.first_ns[row] = sources.last_ns[row] = batch.time_ns[report]
    sources.gap_s[row] = batch.gap_s[report]
    sources.reports[row] = sources.looks[row] = 0
    sources.left_ns[row] = sources.looked_ns[row] = sources.on_ns[row] = 0
    sources.owner[row] = sources.public[row] = -1
    sources.ahead[row, 0] = sources.ahead[row, 1] = 0.0
    mean, covariance, size = sources.mean[row], sources.covariance[row], batch.components[report]
    for i in range(6):
        mean[i] = batch.measured[report, i] if i < size else 0.0
        for k in range(6):
            known = i < size and k < size
            covariance[i, k] = batch.noise[report, i, k] if known else 0.0
    for i in range(2):
        covariance[i + 4, i + 4] = untrue
        if size == 4:
            covariance[i + 2, i + 2] += untrue
            covariance[i + 2, i + 4] = covariance[i + 4, i + 2] = -untrue
        else:
            covariance[i + 2, i + 2] = unknown


@compiled
def _begin_pairs(
    batch: Batch,
    report: int,
    source: int,
    assumed: Assumed,
    rules: Reliability,
    tracks: Tracks,
    tables: Writeable[Tables],
    used: int,
) -> int:
    """Begin a pair with each track near a report that has none; return the number of pairs."""
    sources, pairs, chains = tables
    time_ns, z, size = batch.time_ns[report], batch.measured[report], batch.components[report]
    offset_std = assumed.offset_std[batch.receiver[report]]
    matrix, noise, straight = np.zeros((4, 4)), np.empty((4, 4)), np.zeros(2)
    state, expected = _new_state(4), _new_state(4)
    write_matrix(matrix, straight, 0.0)
    for track in range(len(tracks.label)):
        if tracks.existence[track] < LEAST_EXISTENCE:
            continue
        dt = (time_ns - tracks.time_ns[track]) * 1e-9
        spread = math.sqrt(
            tracks.covariance[track, 0, 0]
            + tracks.covariance[track, 1, 1]
            + dt**2 * (tracks.covariance[track, 2, 2] + tracks.covariance[track, 3, 3])
            + batch.noise[report, 0, 0]
            + batch.noise[report, 1, 1]
            + offset_std**2
            + rules.noise_density * abs(dt) ** 3
        )
        away = math.hypot(
            z[0] - tracks.mean[track, 0] - dt * tracks.mean[track, 2],
            z[1] - tracks.mean[track, 1] - dt * tracks.mean[track, 3],
        )
        if away > 2.0 * math.sqrt(rules.gate) * spread:
            continue
        free, worst = -1, -1
        is_paired = False
        for slot in range(chains.pairs.shape[1]):
            row = chains.pairs[source, slot]
            if row < 0:
                free = slot
            elif pairs.label[row] == tracks.label[track]:
                is_paired = True
            elif worst < 0 or pairs.log_weight[row] < pairs.log_weight[chains.pairs[source, worst]]:
                worst = slot
        if is_paired:
            continue
        state_of_track = State(tracks.mean[track].copy(), tracks.covariance[track].copy())
        _copy(state_of_track, state)
        late_s = max(-dt, 0.0)
        begin_ns = max(time_ns, tracks.time_ns[track])
        if dt > 0.0:
            predict(state, dt, rules.noise_density)
        _copy(state, expected)
        write_matrix(matrix, straight, late_s)
        write_noise(noise, batch.noise[report], late_s, rules.noise_density)
        noise[0, 0] += offset_std**2
        noise[1, 1] += offset_std**2
        _, square = observe(state, z, matrix, noise, size)
        if square > rules.gate:
            continue
        since_s = (time_ns - sources.first_ns[source]) * 1e-9
        log_weight = 0.0 if since_s <= rules.early_s else rules.later
        if free < 0:
            # Only a less probable pair gives way.
            if pairs.log_weight[chains.pairs[source, worst]] >= log_weight:
                continue
            pairs.log_weight[chains.pairs[source, worst]] = -np.inf
            free = worst
        if used == len(pairs.label):
            continue
        write_pair(pairs, used, sources.number[source], tracks.label[track], begin_ns, offset_std)
        _copy(expected, State(pairs.mean[used], pairs.covariance[used]))
        pairs.log_weight[used] = log_weight
        chains.pairs[source, free] = used
        used += 1
    return used


@compiled
def take_reports(
    batch: Batch,
    assumed: Assumed,
    rules: Reliability,
    tracks: Tracks,
    used: Used,
    tables: Writeable[Tables],
) -> tuple[Used, IntArray]:
    """Update sources and pairs with reports; the tables have free rows at their ends.

    Also return the source of each report, as a row, (M,); -1 for a report that is not used.
    """
    sources, pairs, chains = tables
    count, pair_count, next_source = used.sources, used.pairs, used.source_number
    source_of, ghost = np.full(len(batch.time_ns), -1), _new_state(6)
    for report in range(len(batch.time_ns)):
        time_ns, receiver = batch.time_ns[report], batch.receiver[report]
        chain, log_speeds = batch.chain[report], assumed.log_speeds[receiver]
        row, log_ghost, of_address, oldest = _find(batch, report, assumed, rules, tables, ghost)
        if row == -2:
            continue
        uniform = -assumed.log_area[receiver]
        if batch.components[report] == 4:
            uniform -= log_speeds
        if row >= 0:
            _copy(ghost, State(sources.mean[row], sources.covariance[row]))
            dt = (time_ns - sources.last_ns[row]) * 1e-9
            if dt > 0.0:
                gap = sources.gap_s[row]
                sources.gap_s[row] = dt if gap == 0.0 else min(gap, dt)
                sources.last_ns[row] = time_ns
        else:
            log_ghost = uniform
            if of_address >= chains.most[chain]:
                # Its oldest path is given up.
                row = oldest
                for slot in range(chains.pairs.shape[1]):
                    if chains.pairs[row, slot] >= 0:
                        pairs.log_weight[chains.pairs[row, slot]] = -np.inf
                        chains.pairs[row, slot] = -1
            elif count < len(sources.number):
                row = count
                count += 1
                chains.following[row] = chains.first[chain]
                chains.first[chain] = row
            else:
                continue
            untrue = UNTRUE_S * rules.unsteady * rules.noise_density
            variances = math.exp(log_speeds) / 4.0, untrue
            _write_source(batch, report, row, next_source, variances, sources)
            next_source += 1
        source_of[report] = row
        sources.receiver[row] = receiver
        sources.reports[row] += 1
        if batch.ahead[report, 0] != 0.0 or batch.ahead[report, 1] != 0.0:
            sources.ahead[row, 0] = batch.ahead[report, 0]
            sources.ahead[row, 1] = batch.ahead[report, 1]
        log_ghost = np.logaddexp(
            math.log(1.0 - rules.jumps) + log_ghost, math.log(rules.jumps) + uniform
        )
        pair_count = _begin_pairs(batch, report, row, assumed, rules, tracks, tables, pair_count)
        update_pairs(batch, report, row, log_ghost, rules, tables)
    for row in range(used.pairs, pair_count):
        pairs.number[row] = used.pair_number + row - used.pairs
    next_pair = used.pair_number + pair_count - used.pairs
    return Used(count, pair_count, next_source, next_pair), source_of


def adopted(
    tables: tuple[Sources, Pairs, Tracks],
    new: IntArray,
    stamp_ns: int,
    assumed: Assumed,
    rules: Reliability,
    number: int,
) -> tuple[Pairs, Tracks, int]:
    """Return the pairs, the tracks and the next number of a pair, with pairs of new tracks.

    `new` are the rows of the tracks. The weight of a pair is the ratio of the density of the ghost
    at the track to that of reports anywhere: the reports themselves have updated the ghost, which
    then stands for all of them.
    """
    sources, pairs, tracks = tables
    owned = np.zeros(len(sources.number))
    row = sources.number.searchsorted(pairs.source)
    np.add.at(owned, row, pairs.owned)
    count = np.bincount(row, minlength=len(owned))
    age_s = (stamp_ns - sources.last_ns).astype(np.float64) * 1e-9
    (free,) = ((age_s < RECENT_S) & (owned < 0.5) & (count < MOST_PAIRS)).nonzero()
    age_s, receiver = age_s[free], sources.receiver[free]
    mean, spread = sources.mean[free, :4], sources.covariance[free, :4, :4]
    mean, spread = moved(mean, spread, age_s, rules.unsteady * rules.noise_density)
    spread[:, [0, 1], [0, 1]] += assumed.offset_std[receiver, None] ** 2
    uniform = assumed.log_area[receiver] + assumed.log_speeds[receiver]
    heard_ns, heard = tracks.heard_ns.copy(), tracks.heard.copy()
    begun = []
    for track in new.tolist():
        paired = set(pairs.source[pairs.label == tracks.label[track]].tolist())
        error = mean - tracks.mean[track]
        total = spread + tracks.covariance[track]
        square = np.einsum("ni,ni->n", error, np.linalg.solve(total, error[:, :, None])[:, :, 0])
        log_weight = uniform - 0.5 * (square + np.linalg.slogdet(2.0 * np.pi * total)[1])
        for index in np.flatnonzero(square < rules.gate).tolist():
            source = int(free[index])
            if int(sources.number[source]) in paired:
                continue
            begun.append((source, track, float(min(log_weight[index], 25.0))))
            if log_weight[index] > LIKELY:
                heard_ns[track], heard[track] = sources.last_ns[source], sources.number[source]
    first, longer = len(pairs.label), extended(pairs, len(begun))
    for index, (source, track, weight) in enumerate(begun):
        at = first + index
        offset_std = float(assumed.offset_std[sources.receiver[source]])
        own = int(sources.number[source]), int(tracks.label[track]), int(tracks.time_ns[track])
        write_pair(longer, at, *own, offset_std)
        longer.mean[at, :4] = tracks.mean[track]
        longer.covariance[at, :4, :4] = tracks.covariance[track]
        longer.number[at], longer.log_weight[at] = number + index, weight
    tracks = frozen(tracks._replace(heard_ns=heard_ns, heard=heard))
    return frozen(longer), tracks, number + len(begun)
