"""Growth of the smoother's cost with the particles per target, and with the targets."""

from __future__ import annotations

from functools import partial
from typing import Any

from ..timing import Case, exponent, interleaved, spread
from . import forms, recursion
from .recursion import Window
from .smoothing import DEATH_TERM, LAG, PER_TARGET, cached_smoother, product_smoother

TARGETS = 20
PER_TARGET_LADDER = (125, 250, 500, 1000, 2000)
TARGETS_LADDER = (5, 10, 20, 50, 100, 200)
# The dense form takes three seconds at this size, and four times as long at twice the size.
DENSE_PARTICLES = 6000


def measure(quick: bool) -> dict[str, Any]:
    """Return the cost of every form over both series of sizes, with the exponents of growth."""
    last = 3 if quick else None
    particles = {
        count: recursion.window(TARGETS, count, LAG, seed=1) for count in PER_TARGET_LADDER[:last]
    }
    targets = {
        count: recursion.window(count, PER_TARGET, LAG, seed=1) for count in TARGETS_LADDER[:last]
    }
    return {
        "particles_per_target": {"targets": TARGETS, **_ladder(particles, quick)},
        "targets": {"particles_per_target": PER_TARGET, **_ladder(targets, quick)},
    }


def _ladder(windows: dict[int, Window], quick: bool) -> dict[str, Any]:
    cases = {
        (form, size): case
        for size, window in windows.items()
        for form, case in _cases(window, quick).items()
    }
    measured = interleaved(cases)
    forms_: dict[str, Any] = {}
    for form in dict.fromkeys(form for form, _ in cases):
        cost = {size: spread(measured[form, size]) for size in windows if (form, size) in cases}
        medians = [times["median_ms"] for times in cost.values()]
        forms_[form] = {
            "size": list(cost),
            "times": list(cost.values()),
            "exponent": exponent(list(cost), medians) if len(cost) > 1 else None,
        }
    return {
        "particles": {size: window.particles for size, window in windows.items()},
        "forms": forms_,
    }


def _cases(window: Window, quick: bool) -> dict[str, Case]:
    rounds = 3 if quick else 9
    cases = {"smoother": Case(product_smoother(window), rounds)}
    copies = [forms.copies(phd) for phd in window.stored]
    cases["k-d tree"] = Case(cached_smoother(window, copies, forms.k_d_tree), 3)
    limit = partial(forms.whiten_sort_gather, *window.last, window.model, window.dt)
    cases["limit"] = Case(limit, rounds)
    if window.particles <= DENSE_PARTICLES and not quick:
        form = partial(forms.smooth, copies, *window.assumed, DEATH_TERM, forms.dense)
        cases["dense"] = Case(form, 1)
    return cases
