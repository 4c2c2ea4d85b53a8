"""Rows of axes over time: means over runs, with bands of their 95 % confidence intervals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy import stats

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.report import style
from phd_jdtc_ros.report.style import GREY, INK, class_colour

from ..monte_carlo import ALL, Mean, Result

# The lag drawn over time, or the largest smaller one of the study.
SHOWN_LAG = 5
CONFIDENCE = 0.95


def rows_over_time(result: Result, keys: Sequence[str], label: str) -> tuple[Figure, list[Axes]]:
    """Return rows of axes over time that share both scales."""
    runs = f"{len(result.seeds)} {'run' if len(result.seeds) == 1 else 'runs'}"
    text = f"time from the first scan (s); {runs} of “{result.variant.name}”"
    return style.rows_over_time(len(keys), label, text, max(float(result.scores.time_s[-1]), 1.0))


def sets_of(result: Result) -> list[str]:
    """Return the sets to draw, the classes first."""
    return [*(key for key in result.scores.sets if key != ALL), ALL]


def draw_lags(
    axes: Axes,
    result: Result,
    key: str,
    name: str,
    number: str,
    title: str | None = None,
) -> None:
    """Draw a metric of filter and smoother over time, with its band and its overall mean.

    `key` is the set, which determines the colour and the usual title, and `number` the mean's
    format.
    """
    colour = INK if key == ALL else class_colour(int(key.removeprefix("class_")))
    time_s = result.scores.time_s
    for lag, label in _shown_lags(result):
        mean, half_width = band(result.over_time(name, lag, key))
        low, high = mean - half_width, mean + half_width
        if name == "class_accuracy":
            low, high = np.maximum(low, 0.0), np.minimum(high, 1.0)
        shade, width, alpha = (GREY, 1.2, 0.2) if lag == 0 else (colour, 1.6, 0.25)
        axes.fill_between(time_s, low, high, color=shade, alpha=alpha, linewidth=0)
        overall = Mean.of(result.figure(name, lag, key)).mean
        axes.plot(
            time_s,
            mean,
            "-" if len(time_s) > 1 else ".",
            color=shade,
            linewidth=width,
            label=f"{label}, mean {number.format(overall)}" if np.isfinite(overall) else label,
        )
    default = "all classes" if key == ALL else key.replace("_", " ")
    style.row_header(axes, title or default)


def _shown_lags(result: Result) -> list[tuple[int, str]]:
    """Return the lags to draw over time, with their names."""
    lags = result.scores.lags
    later = [lag for lag in lags if 0 < lag <= SHOWN_LAG] or [lag for lag in lags if lag > 0]
    names = [(0, "filter")] if 0 in lags else []
    return names + ([(max(later), f"smoother, lag {max(later)}")] if later else [])


def band(runs: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean over runs and half the width of its confidence interval, shapes (scans,).

    With fewer than two values the width is 0; without any the mean is NaN.
    """
    known = np.isfinite(runs)
    count = known.sum(axis=0)
    mean = np.where(known, runs, 0.0).sum(axis=0) / np.where(count > 0, count, np.nan)
    square = np.where(known, (runs - mean) ** 2, 0.0).sum(axis=0)
    several = np.maximum(count, 2)
    error = np.sqrt(square / (several - 1) / several)
    width = stats.t.ppf(0.5 + 0.5 * CONFIDENCE, several - 1) * error
    return mean, np.where(count > 1, width, 0.0)


def scale_from_zero(rows: Sequence[Axes]) -> None:
    """Scale rows that share an axis from zero to above all means; wide bands may exceed it."""
    for axes in rows:
        axes.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 2.5, 5, 10]))
    highest = max(float(np.max(line.get_ydata())) for axes in rows for line in axes.lines)
    rows[0].set_ylim(0.0, 1.15 * highest if highest > 0.0 else 1.0)
