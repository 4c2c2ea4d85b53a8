"""The goals of the benchmark, each with the measured value."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial, reduce
from operator import getitem
from typing import Any, NamedTuple, TypeAlias

from . import backends, late
from .asterix_rates import CLOUDS
from .backends import NUMBA, NUMPY
from .recursion import GAUSSIAN, PARTICLES
from .step_growth import MEMORY_TARGETS
from .steps import PAPER
from .turning import BY_SECTORS, ONE_CLOUD

# The Gaussian engine's most milliseconds of a step, by scene and backend.
GAUSSIAN_STEPS_MS = {
    PAPER: {NUMPY: 4.0},
    "200 targets": {NUMPY: 40.0, NUMBA: 15.0},
    "1000 targets": {NUMPY: 200.0, NUMBA: 60.0},
}


# Of a turn of 4 s in 16 parts: so long a plot waits for its sector's end.
SECTOR_S = 0.25


# Takes a value from the summary; raises `LookupError`, `TypeError` or `ValueError` without it.
Value: TypeAlias = "Callable[[Mapping[str, Any]], float]"


def at(*path: str) -> Value:
    """Return the value that stands at a path of keys in the summary."""
    return lambda summary: float(reduce(getitem, path, summary))


def ratio(over: Value, under: Value) -> Value:
    """Return the ratio of two values."""
    return lambda summary: over(summary) / under(summary)


class Goal(NamedTuple):
    """One figure.

    Parameters
    ----------
    name : str
    bound : float
    at_most : bool
        Whether the bound is an upper one.
    value : callable
    source : str
        The part of the summary that gives the reason if it was not measured.
    allowance : callable
        What is added to the bound.
    """

    name: str
    bound: float
    at_most: bool
    value: Value
    source: str
    allowance: Value = lambda _: 0.0


def judged(summary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return every figure as ``{name, value, goal, at_most, reached}``.

    Without a measured value, `value` and `reached` are None, and ``reason`` says why.
    """
    return [_judge(goal, summary) for goal in _goals()]


def _judge(goal: Goal, summary: Mapping[str, Any]) -> dict[str, Any]:
    figure: dict[str, Any] = {
        "name": goal.name,
        "value": None,
        "goal": goal.bound,
        "at_most": goal.at_most,
        "reached": None,
    }
    try:
        value = goal.value(summary)
        bound = goal.bound + goal.allowance(summary)
    except (LookupError, TypeError, ValueError):
        return {**figure, "reason": _reason(goal, summary)}
    reached = value <= bound if goal.at_most else value >= bound
    return {**figure, "value": value, "goal": bound, "reached": reached}


def _reason(goal: Goal, summary: Mapping[str, Any]) -> str:
    if f"({NUMBA})" in goal.name and NUMBA not in backends.available():
        return backends.reason_missing(NUMBA)
    if goal.source not in summary:
        return "left out of this run"
    part = summary[goal.source]
    reasons = list(_reasons(part))
    return reasons[0] if reasons else "left out of the quick run"


def _reasons(entry: Any) -> Iterator[str]:
    """Yield the reasons that a part of the summary and what is in it give."""
    if isinstance(entry, Mapping):
        if "reason" in entry:
            yield str(entry["reason"])
        for each in entry.values():
            yield from _reasons(each)


def _goals() -> list[Goal]:
    goals = [
        Goal(
            f"the same kernel: {form}, N = 1e4 ({NUMPY}), times",
            bound,
            False,
            _alike(form, part),
            part,
        )
        for form, part, bound in (
            ("dense products, as in the paper", "paper_smoother", 30.0),
            ("dense products", "smoother", 30.0),
            ("dense products by origin", "smoother", 4.0),
        )
    ]
    against_dense = {NUMPY: {"2e3": 250.0, "1e4": 2500.0}, NUMBA: {"2e3": 1000.0, "1e4": 8000.0}}
    for backend, bounds in against_dense.items():
        for size, bound in bounds.items():
            name = f"against the paper's kernel, dense and naive, N = {size} ({backend}), times"
            ratio = _against_paper("dense, naive", size, backend)
            goals.append(Goal(name, bound, False, ratio, "paper_smoother"))
    for backend, bound in ((NUMPY, 2.5), (NUMBA, 8.0)):
        name = f"against a k-d tree for the paper's kernel, least of all N ({backend}), times"
        goals.append(Goal(name, bound, False, _least_against_tree(backend), "paper_smoother"))
    goals += [
        Goal("largest error of a weight", 1e-3, True, _error("largest_relative"), "smoother"),
        Goal("error of all weights, L1", 1e-5, True, _error("l1"), "smoother"),
        Goal("growth in targets, exponent", 1.1, True, _exponent("targets"), "growth"),
        Goal(
            "growth in particles a target, exponent",
            1.4,
            True,
            _exponent("particles_per_target"),
            "growth",
        ),
        Goal("one lag, share of a kernel", 0.06, True, _lag_share, "smoother"),
        Goal("cached kernel, bytes a particle and lag", 200.0, True, _kept, "smoother"),
        Goal("step, reference scenario, ms", 15.0, True, _step(PAPER, NUMPY), "steps"),
        Goal("step against Stone Soup's GM-PHD, times", 1.0, False, _against_gm_phd(), "peers"),
    ]
    for backend, bound in ((NUMPY, 150.0), (NUMBA, 75.0)):
        name = f"step, 200 targets ({backend}), ms"
        goals.append(Goal(name, bound, True, _step("200 targets", backend), "steps"))
    return [
        *goals,
        Goal(
            "ASTERIX plots to clouds, per second",
            20_000.0,
            False,
            at("asterix", "plots_per_s", CLOUDS),
            "asterix",
        ),
        Goal(
            "ASTERIX in to ASTERIX out, 100 aircraft, p99, s beyond a sector",
            0.1,
            True,
            lambda summary: at("asterix", "live", "latency_s", "p99")(summary) - SECTOR_S,
            "asterix",
        ),
        Goal(
            "node, 1000 detections and 200 estimates, ms",
            2.0,
            True,
            at("messages", "total_ms"),
            "messages",
        ),
        *(
            Goal(
                f"{engine}: step ready for late reports, against dropping them, times",
                1.1,
                True,
                partial(_late, engine=engine, name=late.READY),
                "late",
            )
            for engine in late.ENGINES
        ),
        Goal(
            "latency over DDS beyond the step, p99, ms",
            10.0,
            True,
            at("live", PARTICLES, "beyond_step_ms", "p99"),
            "live",
        ),
        *_of_turning_radars(),
        *_of_gaussian(),
    ]


def _late(summary: Mapping[str, Any], engine: str, name: str) -> float:
    return late.ratio(summary["late"], engine, name)


def _of_gaussian() -> list[Goal]:
    """Return the goals of the Gaussian engine."""
    goals = []
    for scene, of_backends in GAUSSIAN_STEPS_MS.items():
        for backend, bound in of_backends.items():
            median = _step(scene, backend, GAUSSIAN)
            name = f"gaussian: step, {scene} ({backend}), ms"
            goals.append(Goal(name, bound, True, median, "steps"))
    return [
        *goals,
        Goal(
            f"gaussian: turn of 50 aircraft by 16 sectors ({NUMPY}), ms",
            20.0,
            True,
            _turn(BY_SECTORS, GAUSSIAN),
            "turning",
        ),
        Goal(
            "gaussian: growth of a step in targets, 200 to 5000, exponent",
            1.1,
            True,
            _step_exponent,
            "step_growth",
        ),
        Goal("gaussian: memory, 1000 targets, MB", 200.0, True, _memory, "step_growth"),
    ]


def _of_turning_radars() -> list[Goal]:
    return [
        Goal(
            "latency of a detection by sectors over DDS, p99, s",
            # A sector is 0.25 s long, and its first detection waits for its end. After it comes
            # a step.
            0.3,
            True,
            _sector_latency("latency_s"),
            "turning",
            lambda summary: 1e-3 * _sector_latency("step_ms")(summary),
        ),
        Goal(
            f"turn of 50 aircraft ({NUMPY}), ms",
            150.0,
            True,
            _turn(ONE_CLOUD),
            "turning",
        ),
        Goal(
            "a turn by 16 sectors against one cloud, times",
            1.5,
            True,
            ratio(_turn(BY_SECTORS), _turn(ONE_CLOUD)),
            "turning",
        ),
    ]


def _median(part: str, size: str, form: str) -> Value:
    return at(part, size, "times", form, "median_ms")


def _step(scene: str, backend: str, engine: str = PARTICLES) -> Value:
    return at("steps", scene, "engines", engine, "backends", backend, "step", "median_ms")


def _turn(form: str, engine: str = PARTICLES) -> Value:
    return at("turning", "cost", engine, NUMPY, form, "median_ms")


def _sector_latency(of: str) -> Value:
    return at("turning", "latency", PARTICLES, of, "p99")


def _against_paper(form: str, size: str, backend: str) -> Value:
    """Return the ratio of the cost of the paper's kernel in this form to the smoother's cost."""
    ours = _median("smoother", size, f"smoother [{backend}]")
    return ratio(_median("paper_smoother", size, form), ours)


def _alike(form: str, part: str) -> Value:
    """Return the ratio of the costs of the same kernel, both in NumPy, in this form and in ours."""
    own = _median(part, "1e4", f"smoother [{NUMPY}]")
    return ratio(_median(part, "1e4", form.partition(",")[0]), own)


def _least_against_tree(backend: str) -> Value:
    return lambda summary: min(
        _against_paper("k-d tree", size, backend)(summary) for size in summary["paper_smoother"]
    )


def _exponent(ladder: str) -> Value:
    return at("growth", ladder, "forms", f"smoother [{NUMPY}]", "exponent")


def _against_gm_phd() -> Value:
    return ratio(
        at("peers", "GM-PHD", "median_ms"), at("peers", f"particles [{NUMPY}]", "median_ms")
    )


def _error(kind: str) -> Value:
    def worst(summary: Mapping[str, Any]) -> float:
        sizes = [*summary["smoother"].values(), *summary["paper_smoother"].values()]
        measured = [size["error"] for size in sizes if "error" in size]
        return max(errors[kind] for by_backend in measured for errors in by_backend.values())

    return worst


def _lag_share(summary: Mapping[str, Any]) -> float:
    return max(
        _median("smoother", size, "backward")(summary)
        / found["lag"]
        / _median("smoother", size, f"build [{NUMPY}]")(summary)
        for size, found in summary["smoother"].items()
    )


def _kept(summary: Mapping[str, Any]) -> float:
    return max(
        size["memory"]["kept, bytes a particle and lag"] for size in summary["smoother"].values()
    )


def _step_exponent(summary: Mapping[str, Any]) -> float:
    if summary["quick"]:
        raise LookupError("few targets, which are not equally dense")
    return at("step_growth", "forms", f"{GAUSSIAN} [{NUMPY}]", "exponent")(summary)


def _memory(summary: Mapping[str, Any]) -> float:
    memory = summary["step_growth"]["memory"]
    if memory["targets"] < MEMORY_TARGETS:
        raise LookupError("few targets")
    return float(memory["MB"][GAUSSIAN])
