"""What a recording says of one radar, all together: links and noise are found in turn."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray

from .field import Field, elsewhere, field_of
from .levels import Levels, levels, log_ratio
from .noise import Noise, fitted
from .plots import Plots
from .rates import Rate, clutter_rate, detection_probability, looks_of
from .rotation import Timing, timing
from .start import first_guess
from .tracks import Guess, Tracks, linked

# Rounds at most, and the change of all of the guess, as a logarithm, after which none follows.
ROUNDS, SETTLED = 8, 0.02
# What is needed: clouds, tracks, and plots of theirs.
LEAST_CLOUDS, LEAST_TRACKS, LEAST_PLOTS = 10, 1, 30
# With a larger share of plots from places that answer again and again, those are left out: tracks
# would jump about on land.
MOST_LAND = 0.2
# Bounds of what is linked with: certain detection would let no plot be missed.
PROBABILITIES = (0.3, 0.98)
# Of the white acceleration, m^2/s^3.
LEAST_DENSITY = 1e-9
# How much stronger than the tracks tell manoeuvres may be, as densities.
WILDER = 20.0


class TuningError(ValueError):
    """A recording that says too little; the text says what is missing."""


@dataclass(frozen=True)
class Findings:
    """What a recording says of one radar.

    Parameters
    ----------
    timing : Timing
    noise : Noise
    detection : Rate
        Detection probability per look.
    clutter : Rate
        False detections per look.
    field : Field
    levels : Levels or None
        None without amplitudes.
    speed_std : float
        Root mean square of the tracks' velocities along each axis, metres per second.
    tracks : int
        Number of tracks.
    plots : int
        Number of plots, of tracks and of none.
    looks : float
        Turns or clouds.
    duration_s : float
        Of what was looked at, seconds.
    land : float
        Share of the plots that are at places which answer again and again.
    """

    timing: Timing
    noise: Noise
    detection: Rate
    clutter: Rate
    field: Field
    levels: Levels | None
    speed_std: float
    tracks: int
    plots: int
    looks: float
    duration_s: float
    land: float


def findings(plots: Plots) -> Findings:
    """Return what a recording says of one radar.

    Parameters
    ----------
    plots : Plots

    Raises
    ------
    TuningError
        If it is too short, has no detections or no targets that can be told from clutter.
    """
    _require_some(plots)
    when = timing(plots)
    if when.cloud_interval_s <= 0.0:
        raise TuningError("all clouds have one stamp, must have stamps that rise")
    guess, tracks = first_guess(plots, when)
    _require_tracks(plots, when, tracks)
    guess, tracks, noise = _settled(plots, when, guess, tracks)
    rows = elsewhere(plots, looks_of(plots, when), noise.range_std, noise.azimuth_std)
    land = 1.0 - len(rows) / len(plots)
    if land > MOST_LAND and len(rows) > LEAST_PLOTS:
        tracks, noise = _beside_land(plots, rows, when, tracks, noise)
    # With a map of clutter, that of land does not count.
    clutter = clutter_rate(plots, when, tracks, rows if land > MOST_LAND else None)
    return Findings(
        when,
        noise,
        detection_probability(plots, when, tracks),
        clutter,
        field_of(plots, tracks.claimed),
        levels(plots, tracks),
        _speed_std(plots, tracks),
        len(tracks.plots),
        len(plots),
        looks_of(plots, when),
        plots.duration_s,
        land,
    )


def _beside_land(
    plots: Plots, rows: IntArray, when: Timing, tracks: Tracks, noise: Noise
) -> tuple[Tracks, Noise]:
    """Return tracks and noise of some plots only, or those given if there are no tracks then."""
    part = plots.only(rows)
    guess, found = first_guess(part, when)
    try:
        _require_tracks(part, when, found)
        _, found, noise = _settled(part, when, guess, found)
    except TuningError:
        return tracks, noise
    return Tracks(tuple(rows[own] for own in found.plots), found.score), noise


def _settled(
    plots: Plots, when: Timing, guess: Guess, tracks: Tracks
) -> tuple[Guess, Tracks, Noise]:
    """Find noise and tracks in turn, as long as the tracks' score becomes better."""
    noise = _as_noise(guess)
    for _ in range(ROUNDS):
        ratio = log_ratio(plots, plots, tracks)
        noise = fitted(plots, tracks, noise, guess.speed_std, ratio)
        candidates = _candidates(guess, noise, plots, when, tracks)
        found = [linked(plots, when, candidate, ratio) for candidate in candidates]
        best = int(np.argmax([each.score for each in found]))
        change = np.abs(_logarithms(candidates[best]) - _logarithms(guess)).max()
        guess, tracks = candidates[best], found[best]
        if change < SETTLED:
            break
    _require_tracks(plots, when, tracks)
    ratio = log_ratio(plots, plots, tracks)
    return guess, tracks, fitted(plots, tracks, noise, guess.speed_std, ratio)


def _require_some(plots: Plots) -> None:
    clouds = len(plots.cloud_s)
    if clouds < LEAST_CLOUDS:
        raise TuningError(
            f"{clouds} clouds in {plots.duration_s:.1f} s, must be at least {LEAST_CLOUDS}, better "
            "a minute or twenty turns"
        )
    if len(plots) < LEAST_PLOTS:
        raise TuningError(
            f"{len(plots)} detections in {plots.duration_s:.1f} s, must be at least {LEAST_PLOTS} "
            "of targets that are followed"
        )


def _require_tracks(plots: Plots, when: Timing, tracks: Tracks) -> None:
    count = len(tracks.claimed)
    if len(tracks.plots) >= LEAST_TRACKS and count >= LEAST_PLOTS:
        return
    looks = plots.duration_s / when.look_s
    raise TuningError(
        f"{len(tracks.plots)} targets with {count} detections can be told from clutter, in "
        f"{plots.duration_s:.1f} s ({looks:.0f} looks) with {len(plots)} detections; must be at "
        f"least {LEAST_TRACKS} with {LEAST_PLOTS}: record longer, with a target that is detected "
        "in most looks"
    )


def _as_noise(guess: Guess) -> Noise:
    """Return where the first search for the noise begins."""
    return Noise(guess.range_std, guess.azimuth_std, guess.densities, np.ones(2), 0)


def _candidates(
    guess: Guess, noise: Noise, plots: Plots, when: Timing, tracks: Tracks
) -> list[Guess]:
    """Return guesses as some tracks tell them.

    One has the noise that the tracks were linked with: plots linked wrongly enlarge it.
    """
    told = replace(
        guess,
        speed_std=1.5 * _speed_std(plots, tracks),
        detection_probability=float(
            np.clip(detection_probability(plots, when, tracks).value, *PROBABILITIES)
        ),
        clutter_rate=max(clutter_rate(plots, when, tracks).value, 0.1),
    )
    calm, hard = (max(density, LEAST_DENSITY) for density in noise.densities)
    fitting = replace(
        told, range_std=noise.range_std, azimuth_std=noise.azimuth_std, densities=(calm, hard)
    )
    # Where targets manoeuvre, tracks break and say little of it.
    wild = replace(fitting, densities=(calm, WILDER * max(hard, calm)))
    return [fitting, wild, told]


def _logarithms(guess: Guess) -> FloatArray:
    """Return the logarithms of what must settle, shape (4,)."""
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
