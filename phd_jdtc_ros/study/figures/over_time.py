"""Figures over time of the study's first variant of this package's tracker."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from ..monte_carlo import ALL, Result
from .rows import draw_lags, rows_over_time, scale_from_zero, sets_of


def ospa_over_time(results: Sequence[Result]) -> Figure:
    """Draw the mean OSPA of filter and smoother, one row per class and one for all targets."""
    return _from_zero(results, "OSPA (m)", "ospa", "{:.0f} m")


def number_error_over_time(results: Sequence[Result]) -> Figure:
    """Draw the mean of |n_est - n_true|, one row per class and one for all targets."""
    return _from_zero(results, "|number error|", "cardinality_abs_error", "{:.3f}")


def parts_over_time(results: Sequence[Result]) -> Figure:
    """Draw the localisation part and the cardinality part of all targets' mean OSPA."""
    titles = {
        "localization": "all classes: localisation part",
        "cardinality": "all classes: cardinality part",
    }
    main = _main(results)
    figure, rows = rows_over_time(main, list(titles), "part of OSPA (m)")
    for axes, (name, title) in zip(rows, titles.items(), strict=True):
        draw_lags(axes, main, ALL, name, "{:.0f} m", title)
    scale_from_zero(rows)
    return figure


def class_accuracy_over_time(results: Sequence[Result]) -> Figure:
    """Draw the share of matched targets with the right class, by class and for all targets."""
    figure, rows = _by_set(results, "right class", "class_accuracy", "{:.2%}")
    for axes in rows:
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    lowest = np.nanmin([np.nan_to_num(line.get_ydata(), nan=1.0) for a in rows for line in a.lines])
    span = max(1.3 * (1.0 - lowest), 0.02)
    rows[0].set_ylim(1.0 - span, 1.0 + 0.05 * span)
    return figure


def _by_set(
    results: Sequence[Result], label: str, metric: str, number: str
) -> tuple[Figure, list[Axes]]:
    """Draw a metric over time, one row per class and one for all targets."""
    main = _main(results)
    keys = sets_of(main)
    figure, rows = rows_over_time(main, keys, label)
    for axes, key in zip(rows, keys, strict=True):
        draw_lags(axes, main, key, metric, number)
    return figure, rows


def _from_zero(results: Sequence[Result], label: str, metric: str, number: str) -> Figure:
    figure, rows = _by_set(results, label, metric, number)
    scale_from_zero(rows)
    return figure


def has_main(results: Sequence[Result]) -> bool:
    """Return whether a study has a variant of this package's tracker."""
    return any(result.variant.kind.is_engine for result in results)


def _main(results: Sequence[Result]) -> Result:
    """Return the study's first variant of this package's tracker."""
    return next(result for result in results if result.variant.kind.is_engine)
