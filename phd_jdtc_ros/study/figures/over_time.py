"""Figures over time of the study's first variant of this package's tracker."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter

from ..monte_carlo import ALL, TRACKERS, Result
from .rows import draw_lags, rows_over_time, scale_from_zero, sets_of


def ospa_over_time(results: Sequence[Result]) -> Figure:
    """Draw the mean OSPA of filter and smoother, one row per class and one for all targets."""
    main = _main(results)
    keys = sets_of(main)
    figure, rows = rows_over_time(main, keys, "OSPA (m)")
    for axes, key in zip(rows, keys, strict=True):
        draw_lags(axes, main, key, "ospa", "{:.0f} m")
        axes.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 2.5, 5, 10]))
    scale_from_zero(rows)
    return figure


def parts_over_time(results: Sequence[Result]) -> Figure:
    """Draw the localisation part and the cardinality part of all targets' mean OSPA."""
    main = _main(results)
    titles = {
        "localization": "all classes: localisation part",
        "cardinality": "all classes: cardinality part",
    }
    figure, rows = rows_over_time(main, list(titles), "part of OSPA (m)")
    for axes, (name, title) in zip(rows, titles.items(), strict=True):
        draw_lags(axes, main, ALL, name, "{:.0f} m", title)
        axes.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 2.5, 5, 10]))
    scale_from_zero(rows)
    return figure


def number_error_over_time(results: Sequence[Result]) -> Figure:
    """Draw the mean of |n_est - n_true|, one row per class and one for all targets."""
    main = _main(results)
    keys = sets_of(main)
    figure, rows = rows_over_time(main, keys, "|number error|")
    for axes, key in zip(rows, keys, strict=True):
        draw_lags(axes, main, key, "cardinality_abs_error", "{:.3f}")
        axes.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 2.5, 5, 10]))
    scale_from_zero(rows)
    return figure


def class_accuracy_over_time(results: Sequence[Result]) -> Figure:
    """Draw the share of matched targets with the right class, by class and for all targets."""
    main = _main(results)
    keys = sets_of(main)
    figure, rows = rows_over_time(main, keys, "right class")
    for axes, key in zip(rows, keys, strict=True):
        draw_lags(axes, main, key, "class_accuracy", "{:.2%}")
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    lowest = np.nanmin([np.nan_to_num(line.get_ydata(), nan=1.0) for a in rows for line in a.lines])
    span = max(1.3 * (1.0 - lowest), 0.02)
    rows[0].set_ylim(1.0 - span, 1.0 + 0.05 * span)
    return figure


def has_main(results: Sequence[Result]) -> bool:
    """Return whether a study has a variant of this package's tracker."""
    return any(result.variant.kind in TRACKERS for result in results)


def _main(results: Sequence[Result]) -> Result:
    """Return the study's first variant of this package's tracker."""
    return next(result for result in results if result.variant.kind in TRACKERS)
