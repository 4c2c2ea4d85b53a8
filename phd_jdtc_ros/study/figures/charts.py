"""The list of a study's pictures, and their output as PNG."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

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
    """One kind of picture of a case."""

    name: str  # Name of the file, without suffix
    has_data: Callable[[Sequence[Result]], bool]
    draw: Callable[[Sequence[Result]], Figure]


CHARTS = (
    Chart("ospa_against_lag", bool, ospa_against_lag),
    Chart("ospa_over_time", has_main, ospa_over_time),
    Chart("parts_over_time", has_main, parts_over_time),
    Chart("number_error_over_time", has_main, number_error_over_time),
    Chart("class_accuracy_over_time", has_main, class_accuracy_over_time),
)


def write_all(results: Sequence[Result], directory: Path) -> list[Path]:
    """Write every picture of a study as a PNG, 1200 pixels wide, with one directory per case.

    Directories are created if necessary; the paths are returned case by case.
    """
    pictures = []
    for case in dict.fromkeys(result.case for result in results):
        here = [result for result in results if result.case == case]
        for chart in CHARTS:
            if chart.has_data(here):
                path = directory / slug(case) / f"{chart.name}.png"
                path.parent.mkdir(parents=True, exist_ok=True)
                FigureCanvasAgg(chart.draw(here)).print_png(path)
                pictures.append(path)
    return pictures
