"""Initial guess of noise and speeds: the guess of a grid that explains a recording best.

All guesses are compared on a part of the recording, and the best few on the whole.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from .levels import log_target_ratio
from .plots import Plots
from .rotation import Timing
from .tracks import LinkModel, Tracks, link_plots

# Grid of the targets' speeds, metres per second: first the usual one, then the others.
USUAL_SPEED, SPEEDS = 40.0, (8.0, 160.0)
# Number of the best noise guesses that are combined with every speed.
BEST = 3
# Guesses are compared on the first LOOKS looks of a recording, or on fewer, at least LEAST_LOOKS,
# if these have more than PLOTS plots.
LOOKS, PLOTS, LEAST_LOOKS = 24, 1000, 10.0


def guess_of(
    plots: Plots, timing: Timing, range_std: float, azimuth_std: float, speed_std: float
) -> LinkModel:
    """Return a guess with process noise that matches its measurement noise."""
    across = plots.across(azimuth_std, np.arange(len(plots)))
    position = min(range_std, across) if across > 0.0 else range_std
    looks = plots.duration_s / timing.look_s + 1.0
    # Displacement by a manoeuvre between two looks, in standard deviations of a plot's position.
    density = float(3.0 * (0.5 * position) ** 2 / timing.look_s**3)
    return LinkModel(
        range_std=range_std,
        azimuth_std=azimuth_std,
        densities=(0.1 * density, density),
        speed_std=speed_std,
        # Assumed detection probability before any estimate.
        detection_probability=0.85,
        clutter_rate=len(plots) / looks,
    )


def first_guess(plots: Plots, timing: Timing) -> tuple[LinkModel, Tracks]:
    """Return the guess whose tracks have the best score, and its tracks; at least one plot."""
    per_look = len(plots) / (plots.duration_s / timing.look_s + 1.0)
    looks = min(LOOKS, max(PLOTS / max(per_look, 1.0), LEAST_LOOKS))
    while True:
        part = plots.until(looks * timing.look_s)
        part = part if len(part) else plots
        best = _best_of_grid(part, timing)
        # Amid much clutter, the first targets may come later than in the first looks.
        if best[0][0].plots or len(part) == len(plots):
            break
        looks *= 2.0
    whole = [
        (link_plots(plots, timing, guess, log_target_ratio(plots, part, tracks)), guess)
        for tracks, guess in best
    ]
    tracks, guess = max(whole, key=_score)
    return guess, tracks


def _best_of_grid(plots: Plots, timing: Timing) -> list[tuple[Tracks, LinkModel]]:
    """Return the guesses that explain plots best, and their tracks, by descending score."""
    # Places may be of people.
    noises, speeds = _noises(plots), (2.0, 8.0, 160.0) if plots.places else SPEEDS
    ratio = log_target_ratio(plots, plots, Tracks((), 0.0))

    def link(noise: tuple[float, float], speed: float) -> tuple[Tracks, LinkModel]:
        guess = guess_of(plots, timing, *noise, speed)
        return link_plots(plots, timing, guess, ratio), guess

    first = sorted((link(noise, USUAL_SPEED) for noise in noises), key=_score, reverse=True)
    best = first[:BEST]
    best += [
        link((guess.range_std, guess.azimuth_std), speed)
        for _, guess in first[:BEST]
        for speed in speeds
    ]
    return sorted(best, key=_score, reverse=True)[:BEST]


def _noises(plots: Plots) -> list[tuple[float, float]]:
    """Return the grid of both standard deviations; those of places are equal and fill the area."""
    # Deviations of the range are shares of the farthest plot's range.
    ranges = (2.5e-4, 1e-3, 4e-3, 1.6e-2)
    azimuths_deg = (0.06, 0.25, 1.0, 4.0)
    if plots.places:
        middle = np.median(plots.measurement, axis=0)
        reach = float(np.quantile(np.abs(plots.measurement - middle).max(axis=1), 0.99))
        return [(share * max(reach, 1.0),) * 2 for share in ranges]
    farthest = float(np.quantile(plots.measurement[:, 0], 0.99))
    return [
        (share * farthest, float(np.radians(deg))) for share, deg in product(ranges, azimuths_deg)
    ]


def _score(found: tuple[Tracks, LinkModel]) -> float:
    return found[0].score
