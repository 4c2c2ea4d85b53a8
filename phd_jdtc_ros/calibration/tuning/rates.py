"""Detection probability, clutter rate, coverage and copies, estimated from plots and tracks.

A copy of a plot is at a constant distance in the same look, or at the same place in a later one. It
has the errors of its plot, which no plot of another target or look has: where many differences of
plots agree far better than independent errors allow, each plot was recorded twice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial import cKDTree

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.intake.sectors import smallest_arc
from phd_jdtc_ros.core.types import FULL_TURN

from .area import area_of
from .noise import least_std
from .plots import Plots, Timing
from .tracks import MOST_MISSES, Tracks, clutter_ranges

# A cell is land clutter if it has plots in at least the share `LAND_SHARE` of all looks, and at
# least `LEAST_LAND_PLOTS`. It is `CELL_SIGMA` standard deviations wide in range and in azimuth.
LAND_SHARE, LEAST_LAND_PLOTS, CELL_SIGMA = 0.15, 5.0, 3.0
# Crowded areas: cells of these numbers in range and azimuth with `CROWD` times the mean number of
# untracked plots, and at least `LEAST_CROWD` of them.
CELLS, CROWD, LEAST_CROWD = (32, 64), 10.0, 10
# Plots beside a track's plot: nearer than this many standard deviations of the difference of two
# plots, in range and in azimuth, and half a look apart at most. Others up to twice as far away show
# how many are there by chance.
BESIDE_SIGMA, BESIDE_LOOKS = 3.0, 0.5
# Half the windows of positions whose slope is compared with a measured velocity, in plots; the
# least number of such comparisons; the median of the square of a normal number; and the standard
# deviations of a slope from which on a target moves.
WINDOWS, LEAST_COMPARED, ONE, MOVES = (2, 4, 8, 16), 30, 0.4549, 5.0


@dataclass(frozen=True)
class Rate:
    """A figure with its standard deviation and the number of samples behind it."""

    value: float
    std: float
    count: int


def detection_probability(plots: Plots, timing: Timing, tracks: Tracks) -> Rate:
    """Return the share of looks with a detection between each track's first and last plot.

    These two plots do not count, because they limit the track: it begins and ends with a detection.
    """
    looks = hits = 0
    for own in tracks.plots:
        first, last = own[0], own[-1]
        elapsed = plots.time_s[last] - plots.time_s[first], plots.cloud[last] - plots.cloud[first]
        between = max(int(np.round(timing.looks(*elapsed))) - 1, 0)
        looks += between
        hits += min(len(own) - 2, between)
    # Laplace's rule: one hit and one miss are added.
    value = (hits + 1.0) / (looks + 2.0)
    return Rate(value, float(np.sqrt(value * (1.0 - value) / (looks + 3.0))), looks)


def ends(plots: Plots, timing: Timing, tracks: Tracks) -> Rate:
    """Return the number of tracks that end before the recording, for each look at a track.

    It bounds the rate at which targets disappear, because the linker also ends the tracks of
    targets that it loses. A track whose last plot is in the last looks may go on.
    """
    looks, count, last_cloud = 0.0, 0, len(plots.cloud_s) - 1
    for own in tracks.plots:
        first, last = own[0], own[-1]
        elapsed = plots.time_s[last] - plots.time_s[first], plots.cloud[last] - plots.cloud[first]
        looks += float(timing.looks(*elapsed))
        left = timing.looks(plots.duration_s - plots.time_s[last], last_cloud - plots.cloud[last])
        count += bool(left > MOST_MISSES)
    # Laplace's rule, as for detections.
    value = (count + 1.0) / (looks + 2.0)
    return Rate(value, float(np.sqrt(count + 1.0) / (looks + 2.0)), count)


def looks_of(plots: Plots, timing: Timing) -> float:
    """Return the number of looks (revolutions or clouds) of a recording."""
    if not timing.rotation_s:
        return float(len(plots.cloud_s))
    whole = 0 if timing.sectors else 1
    part = timing.cloud_interval_s / timing.rotation_s if timing.sectors else 0.0
    return plots.duration_s / timing.rotation_s + whole + part


def clutter_rate(
    plots: Plots,
    timing: Timing,
    tracks: Tracks,
    rows: IntArray | None = None,
    of_targets: float = 0.0,
) -> Rate:
    """Return the mean number of plots per look outside tracks; only of `rows` if these are given.

    `of_targets` is the supposed number of plots outside tracks that are of targets. The standard
    deviation is the larger of a Poisson count's and that between ten parts of the recording, and
    includes that of the number of these targets, which is as uncertain as the number of tracks.
    """
    free = np.setdiff1d(np.arange(len(plots)) if rows is None else rows, tracks.claimed)
    looks = looks_of(plots, timing)
    value = max(len(free) - of_targets, 0.0) / looks
    std = np.sqrt(max(len(free), 1.0)) / looks
    if looks >= 20.0:
        edges = np.linspace(0.0, plots.duration_s, 11)
        parts, _ = np.histogram(plots.time_s[free], edges)
        std = max(std, float(np.std(parts * 10.0 / looks)) / np.sqrt(10.0))
    if of_targets:
        std = np.hypot(std, of_targets / looks / np.sqrt(len(tracks.plots)))
    return Rate(value, float(std), max(len(free) - round(of_targets), 0))


@dataclass(frozen=True)
class Field:
    """A radar's coverage."""

    min_range: float  # Range of the nearest plot, metres
    max_range: float  # Range of the farthest plot, metres
    # Range up to which plots that belong to no track are uniform in range, metres.
    clutter_range: float
    # First azimuth and counter-clockwise width of the coverage, radians; None if plots are all
    # around.
    arc: tuple[float, float] | None
    # The area of places, see `area.area_of`; empty for ranges.
    area: tuple[float, ...] = ()


def outside_land(plots: Plots, looks: float, range_std: float, azimuth_std: float) -> IntArray:
    """Return the plots outside land clutter, which recurs in the same cells of a stationary radar.

    Places have no map of clutter: what recurs among them may be people who stand. The recording has
    `looks` revolutions or clouds; the standard deviations are those of a plot, metres and radians.
    """
    if np.ptp(plots.pose, axis=0).any() or plots.places:
        return np.arange(len(plots))
    row = np.floor(plots.measurement[:, 0] / (CELL_SIGMA * range_std))
    column = np.floor((plots.measurement[:, 1] + np.pi) / (CELL_SIGMA * azimuth_std))
    columns = np.ceil(FULL_TURN / (CELL_SIGMA * azimuth_std) + 1.0)
    cell = row * columns + column
    cells, place, count = np.unique(cell, return_inverse=True, return_counts=True)
    place = place.ravel()
    first, second = (np.bincount(place, plots.time_s**power) / count for power in (1, 2))
    spread = np.sqrt(np.maximum(second - first**2, 0.0))
    # The times of a land cell's plots are spread over the recording, unlike those of a target that
    # stops for a while: their standard deviation is at least this share of that of uniform times.
    lasting = spread >= 0.7 * plots.duration_s / np.sqrt(12.0)
    _, width = smallest_arc(plots.measurement[:, 1])
    covered = (np.ptp(row) + 1.0) * (width / (CELL_SIGMA * azimuth_std) + 1.0)
    mean = len(plots) / covered
    # Where plots are dense, a cell of land also has this many standard deviations of a Poisson
    # number more than the mean of all cells.
    by_chance = mean + 5.0 * np.sqrt(mean)
    land = lasting & (count >= max(LAND_SHARE * looks, LEAST_LAND_PLOTS, by_chance))
    # The plots at the edge of the noise are in the cells around it.
    around = np.add.outer(np.arange(-1, 2) * columns, np.arange(-1, 2)).ravel()
    kept: IntArray = np.flatnonzero(~np.isin(cell, np.add.outer(cells[land], around)))
    return kept


def crowded(plots: Plots, free: IntArray) -> IntArray:
    """Return all plots in the areas of a stationary radar where untracked plots are dense.

    They are dense for their range. `free` has the indices of the untracked plots. Rain, sea or a
    town fill such areas without returning from the same places.
    """
    if np.ptp(plots.pose, axis=0).any() or plots.places or not len(free):
        return np.zeros(0, dtype=np.int64)
    distance, azimuth = plots.measurement.T
    start, width = smallest_arc(azimuth)
    # The cells divide the coverage, so that the mean is that of places that the radar sees.
    share = distance / distance.max(), (azimuth - start) % FULL_TURN / max(width, 1e-9)
    place = [
        np.minimum((part * count).astype(np.int64), count - 1)
        for part, count in zip(share, CELLS, strict=True)
    ]
    cell = place[0] * CELLS[1] + place[1]
    count = np.bincount(cell[free], minlength=CELLS[0] * CELLS[1])
    middle = (np.arange(CELLS[0]) + 0.5) / CELLS[0] * distance.max()
    ratio = np.exp(clutter_ranges(plots, free).log_ratio(middle))
    usual = np.repeat(ratio, CELLS[1]) * len(free) / count.size
    dense = count >= np.maximum(CROWD * usual, LEAST_CROWD)
    found: IntArray = np.flatnonzero(dense[cell])
    return found


def beside(
    plots: Plots,
    timing: Timing,
    tracks: Tracks,
    range_std: float,
    azimuth_std: float,
    rows: IntArray,
) -> float:
    """Return the share of the tracks' plots with a further plot of the same target beside them.

    It is 0 if chance explains the plots beside tracks. Only the untracked ones of the plots `rows`
    count, and plots of other tracks that are so near that both tracks are of one target. The
    standard deviations are those of a plot, metres and radians.
    """
    free, claimed = np.setdiff1d(rows, tracks.claimed), tracks.claimed
    share, sigma = 0.0, np.sqrt(2.0)
    # Plots of two tracks of one target are mostly nearer than this many such standard deviations,
    # and those of targets side by side are not.
    for others, reach in ((free, BESIDE_SIGMA), (claimed, 1.0)):
        if not len(others):
            continue
        near, around = (
            _neighbours(
                plots,
                others,
                claimed,
                (far * sigma * range_std, far * sigma * azimuth_std),
                timing.look_s,
            )
            for far in (reach, 2.0 * reach)
        )
        itself = len(claimed) if others is claimed else 0
        near, around = near - itself, around - itself
        # The area from one to two times the reach is three times as large as the inner one.
        by_chance = (around - near) / 3.0
        further = near - by_chance
        # The number of plots beside tracks must differ by this many standard deviations from
        # chance.
        if further > 4.0 * np.sqrt(near + by_chance / 3.0):
            share += float(further / len(claimed))
    return share


def side_by_side(
    plots: Plots, timing: Timing, range_std: float, azimuth_std: float, rows: IntArray
) -> float:
    """Return the share of the plots `rows`, two at least, with another one of them beside it."""
    sigma = BESIDE_SIGMA * np.sqrt(2.0)
    place = _scaled(plots, (sigma * range_std, sigma * azimuth_std), timing.look_s)[rows]
    distance, _ = cKDTree(place).query(place, k=2, p=np.inf)
    return float((distance[:, 1] <= 1.0).mean())


def without_neighbours(
    plots: Plots, timing: Timing, range_std: float, azimuth_std: float
) -> IntArray:
    """Return the plots without those of the same look beside an earlier one; see `beside`."""
    sigma = BESIDE_SIGMA * np.sqrt(2.0)
    reach = sigma * range_std, sigma * azimuth_std
    tree = cKDTree(_scaled(plots, reach, timing.look_s))
    pairs = tree.query_pairs(1.0, p=np.inf, output_type="ndarray")
    kept: IntArray = np.setdiff1d(np.arange(len(plots)), pairs.max(axis=1))
    return kept


def _neighbours(
    plots: Plots, rows: IntArray, places: IntArray, reach: tuple[float, float], look_s: float
) -> int:
    """Return how often one of the plots `rows` is within reach of one of the plots `places`.

    The reach is in range and azimuth, metres and radians.
    """
    scaled = _scaled(plots, reach, look_s)
    tree, others = (cKDTree(scaled[own]) for own in (rows, places))
    return int(tree.count_neighbors(others, 1.0, p=np.inf))


def _scaled(plots: Plots, reach: tuple[float, float], look_s: float) -> FloatArray:
    """Return ranges, azimuths and times in units of a reach and of a look's part, (N, 3)."""
    measured = np.column_stack([plots.measurement, plots.time_s])
    scaled: FloatArray = measured / [*reach, BESIDE_LOOKS * look_s]
    return scaled


class Velocities(NamedTuple):
    """What the measured velocities or range rates of tracks show."""

    noise: Rate  # Standard deviation along each axis, m/s
    ratio: float  # Of them to the changes of place; 1 if units agree, NaN if hardly any moves


def velocities(plots: Plots, tracks: Tracks, std: float) -> Velocities | None:
    """Return what measured velocities or range rates show; None if that is nothing.

    A velocity is compared with the slope of its track's positions, or a
    range rate with that of its ranges, whose noise is `std`, around it: in the shortest window in
    which the slope is more precise than that. Medians are robust against manoeuvres and wrong
    links.
    """
    if plots.velocity is None:
        return None
    found, position = None, plots.travelled
    for half in WINDOWS:
        long = [own for own in tracks.plots if len(own) > 2 * half]
        if not long:
            break
        window = np.concatenate([sliding_window_view(own, 2 * half + 1) for own in long])
        off = plots.time_s[window]
        off = off - off.mean(axis=1, keepdims=True)
        spread = (off**2).sum(axis=1)
        slope = (off[:, :, None] * position[window]).sum(axis=1) / spread[:, None]
        measured = plots.velocity[window[:, half]]
        error = measured - slope
        if plots.ambiguity:
            error -= plots.ambiguity * np.rint(error / plots.ambiguity)
        square = error**2
        square = square[np.isfinite(square).all(axis=1)]
        if len(square) < LEAST_COMPARED:
            break
        total, of_slope = float(np.median(square)) / ONE, std**2 * float(np.median(1.0 / spread))
        value = float(np.sqrt(max(total - of_slope, 0.1 * total)))
        noise = Rate(value, value / float(np.sqrt(len(square))), len(square))
        moves = np.abs(slope) > MOVES * std / np.sqrt(spread)[:, None]
        ratio = (measured / np.where(moves, slope, np.nan))[np.isfinite(measured) & moves]
        clear = len(ratio) >= LEAST_COMPARED and not plots.ambiguity
        found = Velocities(noise, float(np.median(ratio)) if clear else math.nan)
        if of_slope < 0.3 * total:
            break
    return found


@dataclass(frozen=True)
class Elevations:
    """What a radar in space shows of elevations and heights."""

    noise: Rate  # Standard deviation of elevations, radians
    limits: tuple[float, float]  # Least and largest elevation, radians
    # Mean and standard deviation of the heights of tracked targets above the radar, metres.
    heights: tuple[float, float]


def elevations(plots: Plots, tracks: Tracks) -> Elevations | None:
    """Return what the elevations of tracked plots show; None if they are too few.

    Their noise is that of third differences along a track, which a steady acceleration does not
    change. Medians are robust against manoeuvres and wrong links.
    """
    # Number of plots in a third difference.
    difference = 4
    if plots.elevation is None:
        return None
    squares, tracked = [], []
    for track in tracks.plots:
        own = track[np.isfinite(plots.elevation[track])]
        tracked.append(own)
        if len(own) < difference:
            continue
        window = sliding_window_view(own, difference)
        time_s = plots.time_s[window]
        apart = time_s[:, :, None] - time_s[:, None, :]
        apart[:, range(difference), range(difference)] = 1.0
        with np.errstate(divide="ignore", invalid="ignore"):  # Plots of the same time
            weight = 1.0 / apart.prod(axis=2)
            weight /= np.sqrt((weight**2).sum(axis=1, keepdims=True))
        squares.append((weight * plots.elevation[window]).sum(axis=1) ** 2)
    square = np.concatenate(squares) if squares else np.zeros(0)
    square = square[np.isfinite(square)]
    if len(square) < LEAST_COMPARED:
        return None
    value = float(np.sqrt(np.median(square) / ONE))
    rows = np.concatenate(tracked)
    height = plots.measurement[rows, 0] * np.sin(plots.elevation[rows])
    known = plots.elevation[np.isfinite(plots.elevation)]
    return Elevations(
        # Differences of overlapping windows are correlated.
        Rate(value, value * float(np.sqrt(difference / len(square))), len(rows)),
        (float(known.min()), float(known.max())),
        (float(height.mean()), float(height.std())),
    )


def field_of(plots: Plots, claimed: IntArray) -> Field:
    """Return the coverage of the radar, from at least one plot.

    `claimed` has the indices of the plots that belong to a track.
    """
    if plots.places:
        distance = np.hypot(*plots.measurement.T)
        farthest = float(distance.max())
        return Field(float(distance.min()), farthest, farthest, None, area_of(plots.measurement))
    distance, azimuth = plots.measurement.T
    free = np.setdiff1d(np.arange(len(plots)), claimed)
    clutter = float(distance.max())
    if len(free) > 1:
        # The largest of n uniform numbers is n / (n + 1) of their limit on average; a single plot
        # far beyond the others is ignored.
        farthest = float(np.quantile(distance[free], 1.0 - 1.0 / len(free)))
        clutter = min(farthest * (len(free) + 1.0) / len(free), clutter)
    start, width = smallest_arc(azimuth)
    gap = FULL_TURN - width
    # A field of view is proposed only if a gap in azimuth without plots is wider than this,
    # radians, and than this many times their mean spacing in azimuth.
    partly = gap > np.radians(20.0) and gap > 12.0 * width / len(plots)
    return Field(
        float(distance.min()), float(distance.max()), clutter, (start, width) if partly else None
    )


# Differences agree within this share of a plot's standard deviation.
AGREE = 0.1
# Distances of copies in the same look, in standard deviations of a plot: nearer ones are merged
# whatever they are (see `rates.beside`), and farther ones are not searched for.
NEAREST, FARTHEST = np.sqrt(2.0), 20.0
# Largest delay of a copy, and largest difference of times in one look, in looks.
LATEST, SAME = 2.5, 0.5


@dataclass(frozen=True)
class Copies:
    """Copies of plots."""

    distance: float  # Of a copy in the same look, metres; 0 for later copies
    delay_s: float  # Of a later copy, seconds; 0 in the same look
    rows: IntArray  # Indices of the copies


def find_copies(plots: Plots, timing: Timing, std: float) -> Copies | None:
    """Return the copies among plots of a standard deviation, metres; None without enough.

    There are none where plots have hardly any error, or are rounded as coarsely as they err.
    """
    if std < 10.0 * least_std(plots.places)[0] or _is_rounded(plots.measurement[:, 0], std):
        return None
    of_plots = plots.position, plots.time_s, timing, std
    return _beside(*of_plots) or _later(*of_plots)


def _is_rounded(value: FloatArray, std: float) -> bool:
    """Return whether values have a step that is no smaller than differences that agree."""
    steps = np.diff(np.unique(value))
    return not len(steps) or bool(steps.min() > 0.5 * AGREE * std)


def _beside(place: FloatArray, time_s: FloatArray, timing: Timing, std: float) -> Copies | None:
    """Return the copies in the same look, all at one distance and in one direction."""
    scaled = np.column_stack([place / (FARTHEST * std), time_s / (SAME * timing.look_s)])
    pairs = cKDTree(scaled).query_pairs(1.0, p=np.inf, output_type="ndarray")
    pairs = np.concatenate([pairs, pairs[:, ::-1]])  # Either one may be the copy
    difference = place[pairs[:, 1]] - place[pairs[:, 0]]
    far = np.hypot(*difference.T) > NEAREST * std
    pairs, difference = pairs[far], difference[far]
    if not len(pairs):
        return None
    cells = np.floor(difference / (AGREE * std))
    _, cell, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    middle = difference[cell.reshape(-1) == np.argmax(count)].mean(axis=0)
    agree = np.hypot(*(difference - middle).T) < AGREE * std
    return _if_many(Copies(float(np.hypot(*middle)), 0.0, np.unique(pairs[agree, 1])), len(place))


def _later(place: FloatArray, time_s: FloatArray, timing: Timing, std: float) -> Copies | None:
    """Return the copies at the places of their plots in later looks."""
    scaled = np.column_stack([place / (AGREE * std), time_s / (LATEST * timing.look_s)])
    pairs = np.sort(cKDTree(scaled).query_pairs(1.0, p=np.inf, output_type="ndarray"), axis=1)
    delay_s = time_s[pairs[:, 1]] - time_s[pairs[:, 0]]
    pairs, delay_s = pairs[delay_s > SAME * timing.look_s], delay_s[delay_s > SAME * timing.look_s]
    # What rests may be at one place in many looks; a copy is there twice.
    first, second = pairs.T
    alone = ~np.isin(first, second) & ~np.isin(second, first)
    if not alone.any():
        return None
    copies = Copies(0.0, float(np.median(delay_s[alone])), np.unique(second[alone]))
    return _if_many(copies, len(place))


def _if_many(found: Copies, plots: int) -> Copies | None:
    # Copies are found if at least this share of the plots is of copies and of what they copy.
    return found if 2 * len(found.rows) >= 0.5 * plots else None
