"""Scores of this package and of other trackers on the Autoferry dataset."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict

from rich.box import SIMPLE_HEAD
from rich.table import Table

from phd_jdtc_ros import resources
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.exit_status import ArgumentParser
from phd_jdtc_ros.parameter_files import from_arguments

from ..runner import Figures, Study, half_width, mean
from . import bags, scores
from .scores import Score


def _add_arguments(parser: ArgumentParser) -> None:
    bags.add_dataset_arguments(parser, nargs="?")


def _measure(arguments: argparse.Namespace, seed: int) -> Figures:
    if arguments.directory is not None:
        recordings = bags.select_recordings(arguments)
    elif arguments.scenario:
        raise BagError("directory: must be the directory of the dataset's CSV files")
    else:
        recordings = [bags.of_bag(resources.bag(bags.SHIPPED))]
    changes = from_arguments.from_arguments(arguments.params_file, arguments.assignments)
    found: list[Score] = []
    for recording in recordings:
        if seed != arguments.seed:
            own = bags.parameters(lidar=False), changes, seed
            found += scores.particle_scores(recording, *own)
            continue
        with_lidar = bags.parameters(lidar=True) if recording.of("lidar") else None
        try:
            given = bags.parameters(lidar=False), with_lidar, changes
            found += scores.scores_of(recording, *given, seed)
        except ImportError as error:
            raise BagError(f"Stone Soup: {error}") from error
    return {"scores": list(map(asdict, found))}


def _combined(found: Sequence[Figures]) -> Figures:
    """Return the first seed's figures, with the particles' means over all seeds."""
    by_seed = [
        [each for each in one["scores"] if each["tracker"] == scores.PARTICLES] for one in found
    ]
    averages = iter(mean(by_seed))
    return {
        "scores": [
            {**next(averages), "scenario": each["scenario"]}
            if each["tracker"] == scores.PARTICLES
            else each
            for each in found[0]["scores"]
        ],
        "runs": len(found),
        "half_width": half_width([_mean_gospa(one) for one in by_seed]) if found[1:] else None,
    }


def _mean_gospa(particles: Sequence[Figures]) -> Figures:
    """Return the mean GOSPA over scenarios, by source."""
    over = scores.means([Score(**each) for each in particles])
    return {source: figures["gospa"] for (_, source), figures in over.items()}


def _scores(found: Figures) -> list[Score]:
    return [Score(**each) for each in found["scores"]]


def _tables(found: Figures) -> list[Table | str]:
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
    if found["runs"] == 1:
        return [shown]
    widths = " and ".join(f"{width:.1f} m {name}" for name, width in found["half_width"].items())
    return [shown, f"particles: the mean of {found['runs']} seeds, 95 % within {widths}"]


STUDY = Study(
    name="autoferry",
    purpose=(
        "Our figures on the Autoferry dataset beside Stone Soup's; without a directory on the "
        "shipped bag."
    ),
    measure=_measure,
    tables=_tables,
    goals=lambda found: scores.goals_of(_scores(found)),
    combined=_combined,
    has_parameters=True,
    add_arguments=_add_arguments,
)
