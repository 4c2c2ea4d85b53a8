"""Which pictures a study has, and how they are written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..figures import Picture
from ..monte_carlo import Result, slug
from .over_lag import ospa_against_lag
from .over_time import (
    class_accuracy_over_time,
    has_main,
    number_error_over_time,
    ospa_over_time,
    parts_over_time,
)


class Chart(NamedTuple):
    """One kind of picture of a case.

    Parameters
    ----------
    name : str
        Of the file, without suffix.
    title, caption : str
    has_data : callable of the case's results
    draw : callable of the case's results
    """

    name: str
    title: str
    caption: str
    has_data: Callable[[Sequence[Result]], bool]
    draw: Callable[[Sequence[Result]], Figure]


CHARTS = (
    Chart(
        "ospa_against_lag",
        "OSPA distance against lag",
        "Mean OSPA distance of all targets over runs and scans against the number of later scans "
        "that an estimate has seen; lag 0 is the filter. Bars are 95 % intervals. The dashed "
        "line is a smoother that is told which detection is whose: nothing can come far below it.",
        bool,
        ospa_against_lag,
    ),
    Chart(
        "ospa_over_time",
        "OSPA distance over time",
        "Mean over runs of filter and smoother, by class and of all targets; bands are 95 % "
        "intervals of the mean. Peaks are where targets appear, cross or vanish.",
        has_main,
        ospa_over_time,
    ),
    Chart(
        "parts_over_time",
        "What the OSPA distance is made of",
        "The localisation and the cardinality part of the same distance.",
        has_main,
        parts_over_time,
    ),
    Chart(
        "number_error_over_time",
        "Number of targets, absolute error",
        "Mean over runs of the absolute error of the number of targets.",
        has_main,
        number_error_over_time,
    ),
    Chart(
        "class_accuracy_over_time",
        "Right class",
        "Share of the targets with an estimate nearby whose estimate has their class.",
        has_main,
        class_accuracy_over_time,
    ),
)


def write_all(results: Sequence[Result], directory: Path) -> list[Picture]:
    """Write every picture of a study as a PNG, 1200 pixels wide, a directory for each case.

    Parameters
    ----------
    results : sequence of Result
    directory : pathlib.Path
        Made if it does not exist.

    Returns
    -------
    list of Picture
        Case by case, in the order in which to read them.
    """
    pictures = []
    for case in dict.fromkeys(result.case for result in results):
        here = [result for result in results if result.case == case]
        for chart in CHARTS:
            if chart.has_data(here):
                path = directory / slug(case) / f"{chart.name}.png"
                path.parent.mkdir(parents=True, exist_ok=True)
                FigureCanvasAgg(chart.draw(here)).print_png(path)
                pictures.append(Picture(f"{case}: {chart.title}", chart.caption, path))
    return pictures
