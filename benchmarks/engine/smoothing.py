"""The smoother's cost against the other forms, and the error caused by its gate."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from phd_jdtc_ros.core.smc.kernel import backward_kernel
from phd_jdtc_ros.core.smc.kernel.backward_kernel import Transition
from phd_jdtc_ros.core.smc.particle_set import ParticleSet
from phd_jdtc_ros.core.smc.smoother import DeathTerm, backward_pass, bernoulli_death_term

from ..timing import Case, interleaved, peak_bytes, spread
from . import forms, recursion
from .recursion import Window, chain

LAG = 5
PER_TARGET = 500
# Number of targets and whether the dense form can run, by number of particles.
SIZES = {"2e3": (4, True), "1e4": (20, True), "1e5": (200, False)}
DEATH_TERM: DeathTerm = bernoulli_death_term
# Weights below this share of the total are not compared one by one.
LEAST_SHARE = 1e-9


def measure(quick: bool, engine: str = "particles") -> dict[str, Any]:
    """Return the times, memory and errors by number of particles.

    The filter determines which rows the kernel joins: rows of one origin, or as in the paper all
    rows, with births and spawned targets in mu.
    """
    sizes = list(SIZES.items())[: 1 if quick else None]
    return {name: _measure_size(*size, quick, engine) for name, size in sizes}


def _measure_size(targets: int, dense_runs: bool, quick: bool, engine: str) -> dict[str, Any]:
    window = recursion.window(targets, PER_TARGET, LAG, seed=0, engine=engine)
    copies = [forms.copies(phd) for phd in window.stored]
    found: list[ParticleSet] = []

    def dense() -> None:
        found[:] = [forms.smooth(copies, *window.assumed, DEATH_TERM, forms.dense)]

    rounds = 3 if quick else 15 if targets <= 20 else 7
    cases = {
        "smoother": Case(product_smoother(window), rounds),
        "build": Case(partial(_build, window), rounds),
        "backward": Case(partial(_backward, window.stored, window.links()), rounds),
        "k-d tree": Case(cached_smoother(window, copies, forms.k_d_tree), min(rounds, 5)),
        "k-d tree, unique particles": Case(
            cached_smoother(window, window.stored, forms.k_d_tree), min(rounds, 5)
        ),
    }
    few = 1 if quick else 3 if targets <= 4 else 2
    if window.corrector.labelled:
        by_label = cached_smoother(window, window.stored, forms.dense_by_label)
        cases["dense products by origin"] = Case(by_label, min(rounds, 5))
    if dense_runs:
        products = cached_smoother(window, window.stored, forms.dense_products)
        cases["dense products"] = Case(products, few)
        cases["dense, naive"] = Case(dense, few)
    times = interleaved(cases)
    result: dict[str, Any] = {
        "targets": targets,
        "lag": LAG,
        "particles": window.particles,
        "unique_particles": window.rows,
        "pairs": int(window.links()[-1].ratio.nnz),
        "times": {name: spread(values) for name, values in times.items()},
        "memory": _memory(window, copies, dense_runs),
    }
    if dense_runs:
        result["error"] = gate_error(window, found[0])
    else:
        # Only pairs of one class are in K, half of all pairs with two classes.
        gigabytes = 8 * 0.5 * window.particles**2 / 1e9
        reason = f"one kernel of the dense form has {gigabytes:.0f} GB"
        result["dense"] = {"value": None, "reason": reason}
    return result


def product_smoother(window: Window) -> Callable[[], None]:
    """Return a function that smooths one scan as the tracker does: one kernel, then all lags."""
    links = window.links()

    def smooth() -> None:
        _build(window)
        _backward(window.stored, links)

    return smooth


def cached_smoother(
    window: Window, stored: Sequence[ParticleSet], link: forms.Link
) -> Callable[[], None]:
    """Return a function that does the same with the cached kernels of another form."""
    links = [link(earlier, later, *window.assumed) for earlier, later in itertools.pairwise(stored)]

    def smooth() -> None:
        link(stored[-2], stored[-1], *window.assumed)
        _backward(stored, links)

    return smooth


def _build(window: Window) -> Transition:
    earlier, later = window.last
    return backward_kernel.build(earlier, later, *window.assumed)


def _backward(stored: Sequence[ParticleSet], links: Sequence[Transition]) -> None:
    """Smooth the weights backward over the whole window."""
    deque(backward_pass(chain(stored, links), DEATH_TERM), maxlen=0)


def gate_error(window: Window, dense: ParticleSet) -> dict[str, float]:
    """Compare smoothed weights with those of the oldest set's copies, smoothed by `forms.dense`.

    ``largest_relative`` is of weights above `LEAST_SHARE` of the total; ``l1`` is the error of all
    weights as a share of the total.
    """
    *_, smoothed = backward_pass(chain(window.stored, window.links()), DEATH_TERM)
    row = np.repeat(np.arange(len(smoothed)), smoothed.multiplicity)
    exact = np.bincount(row, dense.weight, minlength=len(smoothed)).astype(float)
    counted = exact > LEAST_SHARE * exact.sum()
    relative = np.abs(smoothed.weight[counted] / exact[counted] - 1.0)
    return {
        "largest_relative": float(relative.max()),
        "l1": float(np.abs(smoothed.weight - exact).sum() / exact.sum()),
    }


def _memory(
    window: Window, copies: Sequence[ParticleSet], dense_runs: bool
) -> dict[str, float | None]:
    """Return the peak memory of a kernel in each form, and the memory of a cached kernel."""
    link = window.links()[-1]
    kept = link.survival.nbytes + sum(
        array.nbytes for array in (link.ratio.data, link.ratio.indices, link.ratio.indptr)
    )
    last = (copies[-2], copies[-1], *window.assumed)
    peak = {"build": peak_bytes(partial(_build, window))}
    peak["k-d tree"] = peak_bytes(lambda: forms.k_d_tree(*last))
    megabytes: dict[str, float | None] = {f"{k}, MB": v / 1e6 for k, v in peak.items()}
    megabytes["dense, MB"] = peak_bytes(lambda: forms.dense(*last)) / 1e6 if dense_runs else None
    megabytes["kept, bytes a particle and lag"] = kept / window.particles
    return megabytes
