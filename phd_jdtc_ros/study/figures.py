"""The pictures of a run: pure functions from a record and its scores to figures.

Maps are in kilometres with equal scales (`maps`), times count from the run's first stamp
(`timelines`). A class has the same colour, line and marker in every picture (`style`). Nothing here
touches matplotlib's global state, so figures can be drawn from any thread.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from phd_jdtc_ros.core.evaluation import SOURCES, Evaluation

from . import maps, timelines
from .record import Record


class Picture(NamedTuple):
    """A figure on disk.

    Parameters
    ----------
    title : str
    caption : str
        What it shows and what to look at.
    path : pathlib.Path
    """

    title: str
    caption: str
    path: Path


def write_all(record: Record, evaluation: Evaluation, directory: Path) -> list[Picture]:
    """Write every picture that the run has data for as a PNG, 1200 pixels wide.

    Parameters
    ----------
    record : Record
    evaluation : Evaluation
        The scores of `record`.
    directory : pathlib.Path
        Made if it does not exist.

    Returns
    -------
    list of Picture
        In the order in which to read them.
    """
    directory.mkdir(parents=True, exist_ok=True)
    pictures = []
    for chart in CHARTS:
        if chart.has_data(record, evaluation):
            path = directory / f"{chart.name}.png"
            FigureCanvasAgg(chart.draw(record, evaluation)).print_png(path)
            caption = chart.caption.format(p=evaluation.order, c=evaluation.cutoff)
            pictures.append(Picture(chart.title, caption, path))
    return pictures


@dataclass(frozen=True)
class Chart:
    """One kind of picture.

    Parameters
    ----------
    name : str
        Of the file, without suffix.
    title, caption : str
        The caption may use ``{p}`` and ``{c}``.
    has_data : callable of (Record, Evaluation)
    draw : callable of (Record, Evaluation)
    """

    name: str
    title: str
    caption: str
    has_data: Callable[[Record, Evaluation], bool]
    draw: Callable[[Record, Evaluation], Figure]


def _has_truth(record: Record, _: Evaluation) -> bool:
    return any(len(truth.state) for truth in record.truth)


def _has_detections(record: Record, _: Evaluation) -> bool:
    return any(len(plot.position) for plot in record.plots)


def _has_positions(record: Record, evaluation: Evaluation) -> bool:
    return _has_truth(record, evaluation) or any(len(run) for run in record.smoothed)


def _has_scores(_: Record, evaluation: Evaluation) -> bool:
    return any(evaluation.scores[source] for source in SOURCES)


CHARTS = (
    Chart(
        "scenario",
        "Scenario",
        "The true trajectories: colour and line are the class, the number is the target's, the "
        "circle its start, the arrow head its end. Look for where trajectories cross or run side "
        "by side: dots of equal time show whether the targets were there together.",
        _has_truth,
        lambda record, _: maps.scenario(record),
    ),
    Chart(
        "measurements",
        "Detections",
        "All detections of all radars over the whole run, in the world frame. Darker is stronger. "
        "Clutter is pale, spread over the whole coverage and densest near the radars; the trail "
        "of a strong target is dark, that of a weak one paler.",
        _has_detections,
        lambda record, _: maps.measurements(record),
    ),
    Chart(
        "trajectories",
        "Estimated trajectories",
        "Smoothed estimates, coloured by estimated class, over the true trajectories where they "
        "are known; a few estimates carry the ellipse that holds 95 % of their probability. "
        "Look for points of the other colour on a trajectory (a wrong class), points off every "
        "trajectory (a false target) and gaps (a missed one).",
        _has_positions,
        lambda record, _: maps.trajectories(record),
    ),
    Chart(
        "number_error",
        "Number of targets, error by class",
        "Estimated minus true number of targets. Zero is right, below is a missed target, above a "
        "false one. Grey spikes without a coloured line over them are errors of the filter that "
        "the smoother repaired; opposite spikes in two classes at one time are one target taken "
        "for the other class.",
        _has_scores,
        timelines.number_error,
    ),
    Chart(
        "ospa",
        "OSPA distance by class and of all targets",
        "OSPA distance (p = {p:g}, c = {c:g} m) of filtered and smoothed estimates; dashed lines "
        "are the means over the run. Lower is better. Peaks are scans with a wrong number of "
        "targets, the level between them is the error in position.",
        _has_scores,
        timelines.ospa,
    ),
    Chart(
        "ospa_parts",
        "What the OSPA distance is made of",
        "The same distance of all targets in two parts: position errors of matched targets, and "
        "missing or false targets. For p = {p:g} the p-th powers of the parts add. It tells "
        "whether smoothing gained in position, in number, or in both.",
        _has_scores,
        timelines.ospa_parts,
    ),
)
