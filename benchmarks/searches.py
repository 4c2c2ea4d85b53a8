"""The cost of a backward kernel with each search, which justifies two searches."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.pair_search import grid, sweep
from phd_jdtc_ros.core.pair_search.candidates import Candidates, Pairs, near_chunks
from phd_jdtc_ros.core.smc.kernel import backward_kernel, transition_density

from . import recursion
from .smoothing import PER_TARGET
from .timing import Case, interleaved, spread

TARGETS = (4, 200)
# Corrector by where pairs are searched.
PLACES = {"within origins": "particles", "anywhere": "phd"}
GRID, SWEEP = "grid", "sweep"


def measure(quick: bool) -> dict[str, Any]:
    """Return the cost of a kernel by place, number of targets, and search."""
    sizes = TARGETS[:1] if quick else TARGETS
    return {place: {str(n): _measure(n, place) for n in sizes} for place in PLACES}


def _measure(targets: int, place: str) -> dict[str, Any]:
    window = recursion.window(targets, PER_TARGET, 2, seed=0, engine=PLACES[place])
    pair = window.stored[-2:]

    def build(search: str) -> Callable[[], None]:
        def call() -> None:
            with searching(search, place):
                backward_kernel.build(*pair, *window.assumed)

        return call

    cases = {search: Case(build(search), 5) for search in (GRID, SWEEP)}
    return {name: spread(times) for name, times in interleaved(cases).items()}


@contextmanager
def searching(search: str, place: str) -> Iterator[None]:
    """Build kernels by another search within the context."""
    if search == SWEEP and place == "within origins":
        with mock.patch.object(transition_density, "within_groups", _sweep_within_groups):
            yield
    elif search == GRID and place == "anywhere":
        with mock.patch.object(transition_density, "candidates", _grid_candidates):
            yield
    else:
        yield


def _sweep_within_groups(
    query: FloatArray, group: IntArray, point: FloatArray, point_group: IntArray, radius: float
) -> Iterator[Pairs]:
    return near_chunks(sweep.candidates(query, group, point, point_group, radius))


def _grid_candidates(
    query: FloatArray,
    block: IntArray,
    point: FloatArray,
    point_block: IntArray,
    radius: float | FloatArray,
) -> Candidates:
    reach = np.full(len(query), radius)
    found = grid.grid_candidates(query, block, point, point_block, float(reach.max()))
    return replace(found, limit=reach**2)
