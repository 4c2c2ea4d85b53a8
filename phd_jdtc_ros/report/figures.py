"""The pictures of a run: pure functions from records to figures, and their files.

A class has the same colour, line and marker in every picture (`style`). Figures do not use
matplotlib's global state, so that they can be drawn from any thread.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure

from phd_jdtc_ros.core.types import SOURCES
from phd_jdtc_ros.evaluation.run_scores import Evaluation

from . import curves, maps, style
from .record import Record


def write_all(record: Record, evaluation: Evaluation, directory: Path) -> list[Path]:
    """Write all pictures for which the run has data, as PNG files 1200 pixels wide.

    The directory is created if necessary; the paths are returned in reading order.
    """
    directory.mkdir(parents=True, exist_ok=True)
    paths = []
    for picture in PICTURES:
        if picture.has_data(record, evaluation):
            path = directory / f"{picture.name}.png"
            style.save(picture.draw(record, evaluation), path)
            paths.append(path)
    return paths


class Picture(NamedTuple):
    """One kind of picture."""

    name: str  # Name of the file, without suffix
    has_data: Callable[[Record, Evaluation], bool]
    draw: Callable[[Record, Evaluation], Figure]


def _has_truth(record: Record, _: Evaluation) -> bool:
    return any(len(truth.state) for truth in record.truth)


def _has_detections(record: Record, _: Evaluation) -> bool:
    return any(len(plot.position) for plot in record.plots)


def _has_positions(record: Record, evaluation: Evaluation) -> bool:
    return _has_truth(record, evaluation) or any(len(run) for run in record.smoothed)


def _has_clutter(record: Record, _: Evaluation) -> bool:
    return record.clutter is not None and bool((record.clutter.density > 0.0).any())


def _has_scores(_: Record, evaluation: Evaluation) -> bool:
    return any(evaluation.scores[source] for source in SOURCES)


PICTURES = (
    Picture("scenario", _has_truth, lambda record, _: maps.scenario(record)),
    Picture("measurements", _has_detections, lambda record, _: maps.measurements(record)),
    Picture("clutter", _has_clutter, lambda record, _: maps.clutter(record)),
    Picture("trajectories", _has_positions, lambda record, _: maps.trajectories(record)),
    Picture("number_error", _has_scores, curves.number_error),
    Picture("ospa", _has_scores, curves.ospa),
    Picture("ospa_parts", _has_scores, curves.ospa_parts),
)
