"""The mean OSPA against the lag, of all variants."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from phd_jdtc_ros.report.style import COLOURS, DPI, INK, LINES, MARKERS, WIDTH_IN, plain_axes

from ..monte_carlo import Mean, Result


def ospa_against_lag(results: Sequence[Result]) -> Figure:
    """Draw the mean OSPA of all targets against the lag, one line per variant."""
    figure = Figure(figsize=(WIDTH_IN, 5.2), dpi=DPI, layout="constrained")
    axes = figure.add_subplot()
    plain_axes(axes)
    styles = _styles(results)
    for result in results:
        lags = result.scores.lags
        means = [Mean.of(result.figure("ospa", lag)) for lag in lags]
        axes.errorbar(
            lags,
            [mean.mean for mean in means],
            yerr=[np.nan_to_num(mean.half_width) for mean in means],
            label=result.variant.name,
            capsize=2.5,
            elinewidth=0.9,
            **styles[result.variant.name],
        )
    axes.set(xlabel="lag (scans)", ylabel="mean OSPA (m)")
    _frame_means(axes, results)
    axes.set_xticks(sorted({lag for result in results for lag in result.scores.lags}))
    figure.legend(loc="outside right upper", frameon=False, fontsize=9)
    return figure


def _frame_means(axes: Axes, results: Sequence[Result]) -> None:
    """Scale the axis from zero to above all means; error bars of few runs may exceed it."""
    means = [
        Mean.of(result.figure("ospa", lag)).mean for result in results for lag in result.scores.lags
    ]
    axes.set_ylim(0.0, 1.15 * max(means) if max(means) > 0.0 else 1.0)


def _styles(results: Sequence[Result]) -> dict[str, dict[str, Any]]:
    """Return the style of each variant; known association has styles of its own."""
    styles: dict[str, dict[str, Any]] = {}
    contenders = [result.variant for result in results if not result.variant.kind.known_association]
    for index, variant in enumerate(contenders):
        styles[variant.name] = {
            "color": COLOURS[index % len(COLOURS)],
            # The markers are shifted each time the colours start again.
            "marker": MARKERS[(index + index // len(COLOURS)) % len(MARKERS)],
            "linestyle": LINES[index // len(COLOURS) % len(LINES)],
            "linewidth": 2.2 if index == 0 else 1.4,
            "markersize": 5.5,
        }
    for result in results:
        if result.variant.kind.known_association:
            dashes = (5, 3) if result.variant.kind.name == "reference" else (1, 2)
            styles[result.variant.name] = {"color": INK, "linestyle": (0, dashes), "linewidth": 1.4}
    return styles
