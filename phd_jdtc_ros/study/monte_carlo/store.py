"""Scores on disk: a file of tidy rows for each case, variant and seed."""

from __future__ import annotations

import csv
import gzip
import io
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from phd_jdtc_ros import output_files

from .definition import Variant
from .metrics import VALUES
from .scores import Scores
from .tasks import Task

# The last column is a class's row of `Scores.taken_for`: numbers separated by blanks.
HEADER = ("case", "variant", "lag", "seed", "scan", "time_s", "set", *VALUES, "taken_for")


@dataclass(frozen=True)
class Store:
    """Scores on disk, a file for each case, variant and seed."""

    directory: Path  # Created if necessary

    def path(self, task: Task, variant: Variant) -> Path:
        """Return the path of a variant's scores, with a digest of all their inputs."""
        digest = task.digests[variant.name]
        name = f"{slug(task.case)}.{slug(variant.name)}.{task.seed}.{digest}.csv.gz"
        return self.directory / name

    def write(self, task: Task, variant: Variant, scores: Scores) -> None:
        """Write scores atomically."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(HEADER)
        writer.writerows(_rows(task, variant, scores))
        self.directory.mkdir(parents=True, exist_ok=True)
        # The gzip header has no time stamp, so that equal scores give equal bytes.
        output_files.write(
            self.path(task, variant), gzip.compress(text.getvalue().encode(), 6, mtime=0)
        )

    def read(self, task: Task, variant: Variant) -> Scores | None:
        """Return stored scores, or None if there are none or they cannot be read."""
        try:
            with gzip.open(self.path(task, variant), "rt", newline="") as file:
                header, *rows = csv.reader(file)
        except (OSError, EOFError, ValueError):
            return None
        return _scores(rows) if tuple(header) == HEADER else None


def _rows(task: Task, variant: Variant, scores: Scores) -> Iterator[list[Any]]:
    """Yield scores as tidy rows in the order of the header."""
    for row, lag in enumerate(scores.lags):
        for scan, time in enumerate(scores.time_s):
            taken = [] if scores.taken_for is None else scores.taken_for[row, scan].tolist()
            # The first set, of all targets, has no class.
            texts = ["", *(" ".join(map(str, counts)) for counts in taken)]
            for name, values, text in zip(
                scores.sets, scores.values[row, scan], texts, strict=True
            ):
                fixed = [task.case, variant.name, lag, task.seed, scan, round(time, 9), name]
                yield [*fixed, *map(_cell, values.tolist()), text]


def _cell(value: float) -> str:
    """Return a value as text of 15 digits, which restores values of three decimals exactly."""
    return "" if math.isnan(value) else f"{value:.15g}"


def _scores(rows: Sequence[Sequence[str]]) -> Scores:
    lags = tuple(dict.fromkeys(int(row[2]) for row in rows))
    times = list(dict.fromkeys(row[5] for row in rows))
    sets = tuple(dict.fromkeys(row[6] for row in rows))
    values = np.array([[float(cell or "nan") for cell in row[7:-1]] for row in rows])
    shape = (len(lags), len(times), len(sets), len(VALUES))
    classes = len(sets) - 1
    taken_for = None
    if classes:
        counts = [[int(cell) for cell in row[-1].split()] for row in rows if row[-1]]
        taken_for = np.array(counts).reshape(len(lags), len(times), classes, classes)
    return Scores(lags, sets, np.array(times, dtype=float), values.reshape(shape), taken_for)


def remaining(tasks: Iterable[Task], store: Store) -> list[Task]:
    """Return the remaining tasks, each without the variants whose scores are stored."""
    rest = []
    for task in tasks:
        unscored = tuple(v for v in task.variants if store.read(task, v) is None)
        if unscored:
            rest.append(replace(task, variants=unscored))
    return rest


def slug(name: str) -> str:
    """Return a file name that is valid on all file systems."""
    return re.sub(r"[^\w]+", "_", name)
