"""Scores of this package and of other trackers on the Autoferry dataset."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from rich.box import SIMPLE_HEAD
from rich.table import Table

from phd_jdtc_ros import resources
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.exit_status import ArgumentParser
from phd_jdtc_ros.parameter_files import from_arguments

from ..runner import Figures, Study
from . import bags, scores
from .scores import Score


def _add_arguments(parser: ArgumentParser) -> None:
    bags.add_dataset_arguments(parser, nargs="?")


def _measure(arguments: argparse.Namespace, _: int) -> Figures:
    if arguments.directory is not None:
        recordings = bags.select_recordings(arguments)
    elif arguments.scenario:
        raise BagError("directory: must be the directory of the dataset's CSV files")
    else:
        recordings = [bags.of_bag(resources.bag(bags.SHIPPED))]
    changes = from_arguments.from_arguments(arguments.params_file, arguments.assignments)
    found: list[Score] = []
    for recording in recordings:
        with_lidar = bags.parameters(lidar=True) if recording.of("lidar") else None
        try:
            given = bags.parameters(lidar=False), with_lidar, changes
            found += scores.scores_of(recording, *given)
        except ImportError as error:
            raise BagError(f"Stone Soup: {error}") from error
    return {"scores": list(map(asdict, found))}


def _scores(found: Figures) -> list[Score]:
    return [Score(**each) for each in found["scores"]]


def _tables(found: Figures) -> list[Table]:
    """Return the table of figures, one row per tracker and source."""
    all_scores = _scores(found)
    title = "Autoferry: mean GOSPA in metres (c = 50 m, p = 2) by scenario"
    # The table fits a terminal of 80 columns.
    shown = Table(title=title, box=SIMPLE_HEAD, padding=0)
    shown.add_column("tracker", no_wrap=True)
    numbers = dict.fromkeys(each.scenario for each in all_scores)
    for name in (*map(str, numbers), "mean", "missed", "false", "RMS"):
        shown.add_column(name, justify="right")
    for (tracker, source), over in scores.means(all_scores).items():
        rows = [each for each in all_scores if (each.tracker, each.source) == (tracker, source)]
        cells = [f"{each.gospa:.1f}" for each in rows]
        cells += [f"{over['gospa']:.1f}", f"{over['missed']:.2f}", f"{over['false']:.2f}"]
        shown.add_row(f"{tracker}, {source}", *cells, f"{over['position_rms']:.1f}")
    return [shown]


STUDY = Study(
    name="autoferry",
    purpose=(
        "Our figures on the Autoferry dataset beside Stone Soup's; without a directory on the "
        "shipped bag."
    ),
    measure=_measure,
    tables=_tables,
    goals=lambda found: scores.goals_of(_scores(found)),
    # Nothing is random.
    combined=lambda found: found[0],
    has_parameters=True,
    add_arguments=_add_arguments,
)
