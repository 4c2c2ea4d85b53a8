"""All estimates of one radar from a recording; links and noise are estimated alternately."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.configuration.parameters.radar import MOST_SECTORS
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.intake.sectors import smallest_arc

from . import rates
from .noise import Noise, agreeing, find_outliers, fit_noise
from .plots import Plots, Timing, sectors, timing_of
from .tracks import (
    Levels,
    LinkModel,
    NoiseModel,
    Tracks,
    clutter_ranges,
    first_guess,
    guess_of,
    levels,
    link_plots,
    log_target_ratio,
)

# The speed of slow targets: this quantile of the moving ones, each less SURE_SIGMA deviations.
SLOW, SURE_SIGMA = 0.1, 2.0
# The sources of fixed clutter are detected with less than this share of the targets' probability,
# or a look has so many plots of them, this share of them with another one within the noise, that
# they cannot be targets. As many that stand apart may be moored boats.
SELDOM, MULTITUDE, SIDE_BY_SIDE = 0.8, 100.0, 0.5


def moving(plots: Plots, tracks: Tracks, noise: NoiseModel) -> tuple[Tracks, FloatArray]:
    """Return the tracks of targets that have moved, and the lower bounds of their speeds, m/s."""
    position, found, slowest = plots.position, [], []
    for own in tracks.plots:
        time_s = plots.time_s[own]
        off = time_s - time_s.mean()
        velocity = off @ (position[own] - position[own].mean(axis=0)) / (off @ off)
        across = plots.across(noise.azimuth_std, own)
        std, speed = max(noise.range_std, across), float(np.hypot(*velocity))
        # A target has moved if its track is longer than this many standard deviations of a plot's
        # position.
        if speed * np.ptp(time_s) > 10.0 * std:
            found.append(own)
            slowest.append(speed - SURE_SIGMA * std / float(np.sqrt(off @ off)))
    return Tracks(tuple(found), tracks.score), np.array(slowest)


def slow_speed(
    plots: Plots, timing: Timing, tracks: Tracks, noise: NoiseModel, fixed: IntArray
) -> float:
    """Return the speed of slow targets, m/s, if the plots `fixed` are clearly clutter; otherwise 0.

    These are the plots in recurring places; without a moving target nothing is clear.
    """
    of_fixed = np.zeros(len(plots), dtype=np.bool_)
    of_fixed[fixed] = True
    others = tuple(own for own in tracks.plots if of_fixed[own].mean() < 0.5)
    movers, speeds = moving(plots, Tracks(others, tracks.score), noise)
    # Fixed clutter has at least this many times as many plots as the moving targets.
    if not len(speeds) or len(fixed) < 5.0 * len(movers.claimed):
        return 0.0
    look = timing.looks(plots.time_s, plots.cloud.astype(np.float64))[fixed].astype(np.int64)
    count = np.bincount(look)
    # The number of plots of sources with one detection probability is binomial.
    probability = 1.0 - float(count.var() / count.mean())
    seldom = probability < SELDOM * rates.detection_probability(plots, timing, movers).value
    apart = (
        rates.side_by_side(plots, timing, noise.range_std, noise.azimuth_std, fixed) < SIDE_BY_SIDE
    )
    if not seldom and (count.mean() < MULTITUDE or apart):
        return 0.0
    return max(float(np.quantile(speeds, SLOW)), 0.0)


# Largest number of rounds, and the logarithmic change of the guess below which they end.
ROUNDS, CONVERGED = 8, 0.02
# A recording needs at least these numbers of clouds, of tracks and of plots in tracks.
LEAST_CLOUDS, LEAST_TRACKS, LEAST_PLOTS = 10, 1, 30
# If plots in recurring places are more than this share of all, and clearly land clutter, they are
# left out, because tracks would jump between them.
MOST_LAND = 0.2
# The same of areas of dense clutter.
MOST_CROWDED = 0.1
# A larger share of tracks' plots with another one beside them gives targets a second track.
MOST_BESIDE = 0.03
# Smallest spectral density of the white acceleration, m^2/s^3.
LEAST_DENSITY = 1e-9
# Ratio of the standard deviation of a newborn target's velocity to the tracks'.
SPEED_MARGIN = 1.5
# Ratio of units that are often confused, of ranges or times, and the largest plausible speed, m/s.
KILO = 1000.0
FASTEST = 1000.0


class TuningError(ValueError):
    """A recording with too few data for an estimate; the message names the missing data."""


@dataclass(frozen=True)
class Findings:
    """The estimates of one radar from a recording."""

    timing: Timing
    noise: Noise  # The noise without outliers
    with_outliers: Noise | None  # The noise with outliers; None if it is not clearly more likely
    detection: rates.Rate  # Detection probability per look
    ends: rates.Rate  # Ends of tracks per look; see `rates.ends`
    clutter: rates.Rate  # False detections per look
    # Their ranges and relative densities; None if they are uniform in range.
    clutter_density: tuple[FloatArray, FloatArray] | None
    field: rates.Field
    levels: Levels | None  # None without amplitudes
    # Root mean square velocity of the tracks along each axis, metres per second.
    speed_std: float
    tracks: int  # Number of tracks
    plots: int  # Number of plots, with clutter
    looks: float  # Number of revolutions or clouds
    duration_s: float  # Length of the evaluated part of the recording, seconds
    resting: float  # Share of the plots in recurring places
    # Speed of slow targets, metres per second, if these plots are many and clearly land clutter; 0
    # if they may be of targets at rest.
    slow_speed: float
    crowded: float  # Share of the plots in areas of dense clutter, land excepted
    beside: float  # Share of the tracks' plots with a further plot of the same target
    velocity: rates.Velocities | None = None  # None without measured velocities or range rates
    elevations: rates.Elevations | None = None  # None without measured elevations
    movers: int = 0  # Number of tracks that are longer than their noise
    copies: rates.Copies | None = None  # Copies of plots, which the other figures leave out

    @property
    def false_share(self) -> float:
        """The share of the plots that belong to no track."""
        land = self.resting if self.slow_speed else 0.0  # The clutter rate leaves it out
        return land + self.clutter.count / self.plots

    @property
    def likelier_noise(self) -> Noise:
        """The noise with outliers if that is clearly more likely."""
        return self.with_outliers or self.noise

    @property
    def of_places(self) -> bool:
        """Whether the detections are positions."""
        return bool(self.field.area)


def findings(plots: Plots) -> Findings:
    """Return the estimates of one radar from a recording.

    Where targets have several plots in a look, one of them counts. Raise `TuningError` if the
    recording is too short, or has no detections or no targets distinct from clutter, or if a
    revolution has too many clouds.
    """
    _require_some(plots)
    found = _findings(plots)
    noise = found.noise.range_std, found.noise.azimuth_std
    copies = rates.find_copies(plots, found.timing, noise[0])
    if copies is not None:
        rows = np.setdiff1d(np.arange(len(plots)), copies.rows)
    elif found.beside > MOST_BESIDE:
        rows = rates.without_neighbours(plots, found.timing, *noise)
    else:
        return found
    try:
        alone = _findings(plots.only(rows))
    except TuningError:
        alone = found
    return replace(alone, beside=found.beside, copies=copies)


def _findings(plots: Plots) -> Findings:
    """Return the estimates of a recording whose targets have one plot in a look; see `findings`."""
    timing = timing_of(plots)
    if timing.cloud_interval_s <= 0.0:
        raise TuningError("all clouds have the same stamp; stamps must increase")
    if not plots.timed and timing.rotation_s > MOST_SECTORS * timing.cloud_interval_s:
        clouds = timing.rotation_s / timing.cloud_interval_s
        raise TuningError(
            f"about {clouds:.0f} clouds in a revolution of {timing.rotation_s:.3g} s, must be at "
            f"most {MOST_SECTORS}; put the detections of a revolution, or of a sector, into one "
            "cloud, with a time for each of them in the field that fields.time names"
        )
    try:
        tracks, noise, linked = _link(plots, timing)
    except TuningError as error:
        part, _ = next(sectors(plots))
        raise TuningError(f"{error}; {_units(part)}") from None
    rows = rates.outside_land(
        plots, rates.looks_of(plots, timing), noise.range_std, noise.azimuth_std
    )
    resting, slow = 1.0 - len(rows) / len(plots), 0.0
    if resting > MOST_LAND:
        fixed = np.setdiff1d(np.arange(len(plots)), rows)
        slow = slow_speed(plots, timing, tracks, noise, fixed)
    kept = rows if slow else np.arange(len(plots))
    dense = np.intersect1d(rates.crowded(plots, np.setdiff1d(rows, tracks.claimed)), rows)
    share = len(dense) / len(plots)
    if share > MOST_CROWDED:
        kept = np.setdiff1d(kept, dense)
    if len(plots) > len(kept) > LEAST_PLOTS:
        tracks, noise, linked = _without_clutter(plots, kept, timing, _Links(tracks, noise, linked))
    likeliest, noise = noise, agreeing(plots, tracks, noise)
    # With much land clutter the rate counts only the other cells, because the tracker's clutter map
    # covers the land. A map of dense areas is learned slowly, and the rate includes them.
    # The sectors that were not linked have the same share of plots of targets as the others.
    others = np.setdiff1d(kept, linked)
    of_targets = len(others) * len(tracks.claimed) / len(linked)
    clutter = rates.clutter_rate(plots, timing, tracks, rows if slow else None, of_targets)
    false = np.setdiff1d(np.intersect1d(kept, linked), tracks.claimed)
    # A new target may move as fast as those that do, whatever else is at rest.
    movers, _ = moving(plots, tracks, noise)
    speed_std = _speed_std(plots, movers if movers.plots else tracks)
    known = _without_amplitudes(plots, others)
    ratio = log_target_ratio(known, known, tracks)
    outliers = find_outliers(plots, tracks, likeliest, SPEED_MARGIN * speed_std, ratio)
    return Findings(
        timing,
        noise,
        None if outliers is None else agreeing(plots, tracks, outliers),
        rates.detection_probability(plots, timing, tracks),
        rates.ends(plots, timing, tracks),
        clutter,
        None if plots.places else clutter_ranges(plots, false).table,
        rates.field_of(plots, tracks.claimed),
        levels(known, tracks),
        speed_std,
        len(tracks.plots),
        len(plots),
        rates.looks_of(plots, timing),
        plots.duration_s,
        resting,
        slow,
        share,
        rates.beside(plots, timing, tracks, noise.range_std, noise.azimuth_std, kept),
        rates.velocities(plots, tracks, max(noise.range_std, noise.azimuth_std * plots.places)),
        rates.elevations(plots, tracks),
        len(movers.plots),
    )


class _Links(NamedTuple):
    """The tracks and the noise of a recording."""

    tracks: Tracks
    noise: Noise
    linked: IntArray  # Indices of the plots that were considered, ascending

    def within(self, rows: IntArray) -> _Links:
        """Return the same with the indices in a recording of which these plots are the `rows`."""
        tracks = Tracks(tuple(rows[own] for own in self.tracks.plots), self.tracks.score)
        return self._replace(tracks=tracks, linked=rows[self.linked])


def _link(plots: Plots, timing: Timing) -> _Links:
    """Return tracks and noise of the first sector with enough tracks; see `plots.sectors`."""
    faults = []
    for part, rows in sectors(plots):
        guess, tracks = first_guess(part, timing)
        try:
            _require_tracks(part, timing, tracks)
            _, tracks, noise = _iterate(part, timing, guess, tracks)
        except TuningError as error:
            faults.append(error)
            continue
        return _Links(tracks, noise, np.arange(len(part))).within(rows)
    raise faults[0]


def _without_clutter(plots: Plots, rows: IntArray, timing: Timing, links: _Links) -> _Links:
    """Return the links of the plots `rows` only; the given ones if these have no track."""
    try:
        return _link(plots.only(rows), timing).within(rows)
    except TuningError:
        return links


def _without_amplitudes(plots: Plots, rows: IntArray) -> Plots:
    """Return plots without the amplitudes of those in `rows`."""
    if plots.amplitude is None:
        return plots
    amplitude = plots.amplitude.copy()
    amplitude[rows] = np.nan
    return replace(plots, amplitude=amplitude)


def _iterate(
    plots: Plots, timing: Timing, guess: LinkModel, tracks: Tracks
) -> tuple[LinkModel, Tracks, Noise]:
    """Estimate noise and tracks alternately until the guess converges."""
    # The initial value of the first search for the noise.
    noise = Noise(guess.range_std, guess.azimuth_std, guess.densities, np.ones(2), 0)
    for _ in range(ROUNDS):
        ratio = log_target_ratio(plots, plots, tracks)
        noise = fit_noise(plots, tracks, noise, guess.speed_std, ratio)
        candidates = _candidates(guess, noise, plots, timing, tracks)
        found = [link_plots(plots, timing, candidate, ratio) for candidate in candidates]
        best = int(np.argmax([each.score for each in found]))
        change = np.abs(_logarithms(candidates[best]) - _logarithms(guess)).max()
        guess, tracks = candidates[best], found[best]
        if change < CONVERGED:
            break
    _require_tracks(plots, timing, tracks)
    ratio = log_target_ratio(plots, plots, tracks)
    return guess, tracks, fit_noise(plots, tracks, noise, guess.speed_std, ratio)


def _require_some(plots: Plots) -> None:
    clouds = len(plots.cloud_s)
    if clouds < LEAST_CLOUDS:
        raise TuningError(
            f"{clouds} clouds in {plots.duration_s:.1f} s, must be at least {LEAST_CLOUDS}, better "
            "a minute or twenty revolutions"
        )
    if len(plots) < LEAST_PLOTS:
        raise TuningError(
            f"{len(plots)} detections in {plots.duration_s:.1f} s, must be at least {LEAST_PLOTS} "
            "from tracked targets"
        )


def _require_tracks(plots: Plots, timing: Timing, tracks: Tracks) -> None:
    count = len(tracks.claimed)
    if len(tracks.plots) >= LEAST_TRACKS and count >= LEAST_PLOTS:
        return
    looks = plots.duration_s / timing.look_s
    raise TuningError(
        f"{len(tracks.plots)} targets with {count} detections are distinct from clutter, in "
        f"{plots.duration_s:.1f} s ({looks:.0f} looks) with {len(plots)} detections; must be at "
        f"least {LEAST_TRACKS} with {LEAST_PLOTS}: record longer, with a target that is detected "
        "in most looks"
    )


def _units(plots: Plots) -> str:
    """Return the extent of plots without targets, and whether longer ranges would have some."""
    what, scale = "ranges", np.array([KILO, 1.0])
    if plots.places:
        what, scale = "x and y", np.array([KILO, KILO])
        low, high = plots.measurement.min(axis=0), plots.measurement.max(axis=0)
        extent = (
            f"x is from {low[0]:.6g} to {high[0]:.6g} m and y from {low[1]:.6g} to {high[1]:.6g} m"
        )
    else:
        width = math.degrees(smallest_arc(plots.measurement[:, 1])[1])
        extent = (
            f"the largest range is {plots.measurement[:, 0].max():.3g} m, and azimuths span "
            f"{width:.3g} degrees"
        )
    if not plots.timed and np.median(np.bincount(plots.cloud)) <= 1.0:
        extent += (
            "; most clouds have one detection: all those of a scan must have the same stamp, or "
            "fields.time must name their own times"
        )
    longer = replace(plots, measurement=plots.measurement * scale)
    if count := _plausible_targets(longer):
        return (
            f"{extent}; {count} targets are found if {what} are {KILO:g} times as large: {what} "
            "must be in metres, probably they are in kilometres or nautical miles, or times are in "
            "milliseconds"
        )
    # A revolution of the antenna is found in seconds only.
    faster = replace(plots, cloud_s=plots.cloud_s / KILO, time_s=plots.time_s / KILO)
    if count := _plausible_targets(faster):
        return (
            f"{extent}; {count} targets are found if times are divided by {KILO:g}: times must be "
            "in seconds, probably they are in milliseconds"
        )
    return extent


def _plausible_targets(plots: Plots) -> int:
    """Return the number of targets; 0 if they are too few, or faster than any."""
    _, tracks = first_guess(plots, timing_of(plots))
    few = len(tracks.claimed) < LEAST_PLOTS
    return 0 if few or _speed_std(plots, tracks) > FASTEST else len(tracks.plots)


def _candidates(
    guess: LinkModel, noise: Noise, plots: Plots, timing: Timing, tracks: Tracks
) -> list[LinkModel]:
    """Return the guesses that some tracks suggest.

    The last one keeps the noise with which the tracks were linked, since wrong links enlarge it.
    """
    estimated = replace(
        guess,
        speed_std=SPEED_MARGIN * _speed_std(plots, tracks),
        detection_probability=float(
            # Bounds of the detection probability in linking: certain detection would allow no
            # missed plot.
            np.clip(rates.detection_probability(plots, timing, tracks).value, 0.3, 0.98)
        ),
        clutter_rate=max(rates.clutter_rate(plots, timing, tracks).value, 0.1),
    )
    calm, hard = (max(density, LEAST_DENSITY) for density in noise.densities)
    fitting = replace(
        estimated, range_std=noise.range_std, azimuth_std=noise.azimuth_std, densities=(calm, hard)
    )
    # Tracks break at manoeuvres, so that they underestimate the manoeuvres' density: one of the
    # tried guesses enlarges it. Among people who stand it may be nothing, so that this guess moves
    # those of places by some four standard deviations between two looks.
    wild = 20.0 * max(hard, calm)
    if plots.places:
        begin = guess_of(plots, timing, noise.range_std, noise.azimuth_std, estimated.speed_std)
        wild = max(wild, 64.0 * begin.densities[1])
    turning = replace(fitting, densities=(calm, wild))
    return [fitting, turning, estimated]


def _logarithms(guess: LinkModel) -> FloatArray:
    """Return the logarithms of the figures whose convergence is tested, shape (4,)."""
    numbers = [guess.range_std, guess.azimuth_std, guess.detection_probability, guess.clutter_rate]
    logarithms: FloatArray = np.log(np.array(numbers))
    return logarithms


def _speed_std(plots: Plots, tracks: Tracks) -> float:
    """Return the root mean square of the tracks' mean velocities along each axis."""
    position, squares = plots.position, []
    for own in tracks.plots:
        time_s = plots.time_s[own]
        off = time_s - time_s.mean()
        velocity = off @ (position[own] - position[own].mean(axis=0)) / (off @ off)
        squares.append(0.5 * float(velocity @ velocity))
    return float(np.sqrt(max(float(np.mean(squares)), 1e-2)))
