"""The page's interactive charts of a run, and notes on what its bag does not contain."""

from __future__ import annotations

from phd_jdtc_ros.core.types import SOURCES
from phd_jdtc_ros.evaluation.evaluation import Evaluation

from ..record import Record
from . import class_chart, time_charts
from .chart import Chart


def of_record(record: Record, evaluation: Evaluation) -> list[Chart]:
    """Return every chart over time that the run has data for."""
    charts = []
    estimated = any(len(run) for source in SOURCES for run in record.of_source(source))
    if any(evaluation.scores[source] for source in SOURCES):
        charts.append(time_charts.ospa(record, evaluation))
    if record.filtered or record.smoothed or record.truth:
        charts.append(time_charts.numbers(record))
    # A single class has probability 1 throughout.
    if estimated and not record.sets.one_class:
        charts.append(class_chart.class_probabilities(record, evaluation))
    return charts


def missing(record: Record, evaluation: Evaluation) -> list[str]:
    """Return a sentence for each kind of data missing from the bag, with the consequence."""
    absent = [source for source in SOURCES if not record.of_source(source)]
    notes = [] if record.damage is None else [f"Only the intact part is shown. {record.damage}."]
    if len(absent) == len(SOURCES):
        notes.append(
            "There are no estimates in this bag, so only detections are shown. Run track_bag on "
            "it, or record the tracker's topics."
        )
    elif absent:
        notes.append(f"There are no {absent[0]} estimates in this bag.")
    if not record.truth:
        notes.append("There is no truth in this bag, so nothing can be scored.")
    elif len(absent) < len(SOURCES) and not any(evaluation.scores[s] for s in SOURCES):
        notes.append("No estimate has the stamp of a true state, so nothing can be scored.")
    if not record.plots:
        notes.append("There are no detections of the configured radars in this bag.")
    return notes
