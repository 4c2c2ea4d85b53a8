"""The interactive chart of class probabilities over time, by target."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from plotly.graph_objects import Scatter

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, Estimates, Truth
from phd_jdtc_ros.evaluation.evaluation import Evaluation
from phd_jdtc_ros.evaluation.metrics import assign

from ..record import Record
from ..sets import Sets
from ..style import class_colour
from ..units import Clock
from .chart import NEUTRAL, Chart, rows_over_time, times

CAPTION = (
    "The probability of each class for every estimate, one row per class. {colours} Near 0 or 1 "
    "the class is certain; in between, amplitudes and motion have not determined it yet."
)
BY_TRUTH = (
    "The colour is the true class of the target paired with the estimate, and a line is one "
    "target; grey crosses are estimates without a target nearby."
)
BY_ESTIMATE = "The colour is the estimated class."
# Plotly's names for the markers of classes that the pictures use.
SYMBOLS = ("circle", "triangle-up", "square", "diamond", "triangle-down", "cross")


class Key(NamedTuple):
    """Identifies the estimates of one curve."""

    name: str  # Text in the legend
    label: str  # Text at a single curve
    class_id: int | None  # Determines the colour; None for no class
    number: int  # Number of the target or the track; 0 for none, whose points are not joined


class Curve(NamedTuple):
    """Class probabilities of one curve: stamps and arrays of shape (C,)."""

    stamp_ns: list[int]
    probability: list[FloatArray]


def class_probabilities(record: Record, evaluation: Evaluation) -> Chart:
    """Return the class probabilities of all estimates over time, one row per class."""
    clock = Clock.of(record)
    names = [f"P({record.sets.class_title(k)})" for k in range(record.classes)]
    figure = rows_over_time(record, names, "probability")
    main = SMOOTHED if record.smoothed else FILTERED
    curves = _curves(record, main, evaluation.cutoff)
    if main == SMOOTHED and record.filtered:
        shares = np.concatenate([found.class_probability for found in record.filtered])
        stamps = [found.stamp_ns for found in record.filtered for _ in range(len(found))]
        curves = {Key(FILTERED, FILTERED, None, 0): Curve(stamps, list(shares)), **curves}
    named: set[str] = set()
    for key, curve in curves.items():
        for k, row in enumerate(names):
            trace = Scatter(
                x=times(clock, curve.stamp_ns),
                y=[round(float(share[k]), 4) for share in curve.probability],
                showlegend=key.name not in named,
                hovertemplate=f"{key.label}<br>{row} = %{{y:.3f}}<extra></extra>",
                **_style(key),
            )
            figure.add_trace(trace, row=k + 1, col=1)
            named.add(key.name)
    figure.update_yaxes(range=[-0.05, 1.05], tickvals=[0, 0.5, 1])
    caption = CAPTION.format(colours=BY_TRUTH if record.truth else BY_ESTIMATE)
    return Chart("classes", "Class probabilities over time", caption, figure)


def _style(key: Key) -> dict[str, Any]:
    """Return the style of a curve: its class's colour, or grey behind the others."""
    shared = {"name": key.name, "legendgroup": key.name}
    if key.class_id is None:
        symbol, size = ("circle-open", 5) if key.name == FILTERED else ("x-thin-open", 7)
        marker = {"symbol": symbol, "size": size, "color": NEUTRAL}
        return {**shared, "mode": "markers", "marker": marker}
    colour = class_colour(key.class_id)
    return {
        **shared,
        "mode": "lines+markers" if key.number else "markers",
        "line": {"color": colour, "width": 1.3},
        "marker": {"symbol": SYMBOLS[key.class_id % len(SYMBOLS)], "size": 4, "color": colour},
    }


def _curves(record: Record, source: str, cutoff: float) -> dict[Key, Curve]:
    """Return the estimates of a source by true target, or by estimated class without truth."""
    truth = {entry.stamp_ns: entry for entry in record.truth}
    curves: dict[Key, Curve] = {}
    for found in record.of_source(source):
        keys = (
            _by_target(source, found, truth.get(found.stamp_ns), cutoff, record.sets)
            if record.truth
            else _by_estimate(source, found, record.sets)
        )
        for key, probability in zip(keys, found.class_probability, strict=True):
            curve = curves.setdefault(key, Curve([], []))
            curve.stamp_ns.append(found.stamp_ns)
            curve.probability.append(probability)
    return dict(sorted(curves.items(), key=lambda item: (item[0].name, item[0].number)))


def _by_target(
    source: str, found: Estimates, targets: Truth | None, cutoff: float, sets: Sets
) -> Iterator[Key]:
    """Yield the key of each estimate, by the target that it is paired with."""
    paired: dict[int, int] = {}
    if targets is not None:
        index, estimate = assign(targets.position, found.position, cutoff)
        paired = dict(zip(estimate.tolist(), index.tolist(), strict=True))
    for row in range(len(found)):
        if targets is None or row not in paired:
            yield Key(f"{source}, near no target", "near no target", None, 0)
            continue
        number = int(targets.track_id[paired[row]])
        class_id = int(targets.class_id[paired[row]])
        truly = f"truly {sets.class_title(class_id)}"
        yield Key(f"{source}, {truly}", f"target {number}, {truly}", class_id, number)


def _by_estimate(source: str, found: Estimates, sets: Sets) -> Iterator[Key]:
    """Yield the key of each estimate, by its class and its track."""
    for class_id, number in zip(found.class_id.tolist(), found.track_id.tolist(), strict=True):
        name = sets.class_title(class_id)
        label = f"track {number}, {name}" if number else f"estimated {name}"
        yield Key(f"{source}, {name}", label, class_id, number)
