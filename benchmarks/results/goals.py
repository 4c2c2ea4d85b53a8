"""The goals of the benchmark, each with the measured value."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, TypeAlias

from studies.runner import goal

from ..engine import late
from ..engine.recursion import FAST, GAUSSIAN, PARTICLES
from ..engine.steps import PAPER
from ..transport.asterix_rates import CLOUDS
from ..transport.turning import AT_EVERY_SECTOR, BY_SECTORS, ONE_CLOUD

# Duration of one of the 16 sectors of a turn of 4 s: a plot waits for the end of its sector.
SECTOR_S = 0.25

# How the reason begins for which a value is not measured on purpose.
LEFT_OUT = "left out"

# Takes a value from the summary; raises `LookupError`, `TypeError` or `ValueError` without it.
Value: TypeAlias = "Callable[[Mapping[str, Any]], float]"


def at(*path: str | int) -> Value:
    """Return a function that takes the value at a path of keys from the summary."""

    def value(summary: Mapping[str, Any]) -> float:
        found: Any = summary
        for key in path:
            found = found[key]
        return float(found)

    return value


def ratio(over: Value, under: Value) -> Value:
    """Return the ratio of two values."""
    return lambda summary: over(summary) / under(summary)


class Goal(NamedTuple):
    """One figure."""

    name: str
    bound: float
    at_most: bool  # True if the bound is an upper one
    value: Value
    source: str  # The part of the summary that gives the reason if the value was not measured
    allowance: Value = lambda _: 0.0  # Value that is added to the bound


def judge(summary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return every figure as ``{name, value, goal, at_most, reached}``.

    Without a measured value, `value` and `reached` are None, and ``reason`` gives the reason.
    """
    return [_judge(goal, summary) for goal in GOALS]


def _judge(own: Goal, summary: Mapping[str, Any]) -> dict[str, Any]:
    try:
        value, bound = own.value(summary), own.bound + own.allowance(summary)
    except (LookupError, TypeError, ValueError):
        reason = f"{LEFT_OUT} of this run"
        if own.source in summary:
            reason = next(_reasons(summary[own.source]), f"{LEFT_OUT} of the quick run")
        return {**goal(own.name, None, own.bound, own.at_most), "reason": reason}
    return goal(own.name, value, bound, own.at_most)


def is_missing(figure: Mapping[str, Any]) -> bool:
    """Return whether a figure of `judge` should have a value and has none."""
    return figure["value"] is None and not figure["reason"].startswith(LEFT_OUT)


def _reasons(entry: Any) -> Iterator[str]:
    """Yield the reasons in a part of the summary, at any depth."""
    if isinstance(entry, Mapping):
        if "reason" in entry:
            yield str(entry["reason"])
        for each in entry.values():
            yield from _reasons(each)


# --- values ---------------------------------------------------------------------------------------


def _median(part: str, size: str, form: str) -> Value:
    return at(part, size, "times", form, "median_ms")


def _step(scene: str, engine: str = PARTICLES) -> Value:
    return at("steps", scene, "engines", engine, "times", "step", "median_ms")


def _turn(form: str, engine: str = PARTICLES) -> Value:
    return at("turning", "cost", engine, form, "median_ms")


def _against_paper(form: str, size: str) -> Value:
    """Return the ratio of the cost of the paper's kernel in this form to the smoother's cost."""
    ours = _median("smoother", size, "smoother")
    return ratio(_median("paper_smoother", size, form), ours)


def _against_own(form: str, part: str) -> Value:
    """Return the ratio of the costs of one kernel in this form and in ours."""
    return ratio(_median(part, "1e4", form), _median(part, "1e4", "smoother"))


def _least_against_tree(summary: Mapping[str, Any]) -> float:
    return min(_against_paper("k-d tree", size)(summary) for size in summary[PAPERS])


def _exponent(ladder: str) -> Value:
    return at("growth", ladder, "forms", "smoother", "exponent")


def _error(kind: str) -> Value:
    def worst(summary: Mapping[str, Any]) -> float:
        sizes = [*summary["smoother"].values(), *summary["paper_smoother"].values()]
        measured = [size["error"] for size in sizes if "error" in size]
        return float(max(errors[kind] for errors in measured))

    return worst


def _lag_share(summary: Mapping[str, Any]) -> float:
    return max(
        _median("smoother", size, "backward")(summary)
        / float(found["lag"])
        / _median("smoother", size, "build")(summary)
        for size, found in summary["smoother"].items()
    )


def _cached(summary: Mapping[str, Any]) -> float:
    key = "kept, bytes a particle and lag"
    return float(max(size["memory"][key] for size in summary["smoother"].values()))


def _late(engine: str) -> Value:
    return lambda summary: late.ratio(summary["late"], engine, late.READY)


def _step_growth(*path: str | int) -> Value:
    """Return a value of `step_growth`, but not of a quick run, which has few targets."""

    def value(summary: Mapping[str, Any]) -> float:
        if summary["quick"]:
            raise LookupError("few targets")
        return at("step_growth", *path)(summary)

    return value


def _beyond_sector(summary: Mapping[str, Any]) -> float:
    return at("asterix", "live", "latency_s", "p99")(summary) - SECTOR_S


def _step_s(summary: Mapping[str, Any]) -> float:
    return 1e-3 * at("turning", "latency", PARTICLES, "step_ms", "p99")(summary)


# --- goals ----------------------------------------------------------------------------------------


def _most(
    source: str, name: str, bound: float, value: Value, allowance: Value | None = None
) -> Goal:
    return Goal(name, bound, True, value, source, *([allowance] if allowance else []))


def _least(source: str, name: str, bound: float, value: Value) -> Goal:
    return Goal(name, bound, False, value, source)


PAPERS, GROWTH = "paper_smoother", ("forms", FAST)
GOALS: tuple[Goal, ...] = (
    *(
        _least(part, f"the same kernel: {name}, N = 1e4, times", bound, _against_own(form, part))
        for name, form, part, bound in (
            ("dense products, as in the paper", "dense products", PAPERS, 30.0),
            ("dense products", "dense products", "smoother", 30.0),
            ("dense products by origin", "dense products by origin", "smoother", 4.0),
        )
    ),
    *(
        _least(
            PAPERS,
            f"against the paper's kernel, dense and naive, N = {size}, times",
            bound,
            _against_paper("dense, naive", size),
        )
        for size, bound in (("2e3", 250.0), ("1e4", 2500.0))
    ),
    _least(
        PAPERS,
        "against a k-d tree for the paper's kernel, least of all N, times",
        2.5,
        _least_against_tree,
    ),
    _most("smoother", "largest error of a weight", 1e-3, _error("largest_relative")),
    _most("smoother", "error of all weights, L1", 1e-5, _error("l1")),
    _most("growth", "growth in targets, exponent", 1.1, _exponent("targets")),
    _most(
        "growth", "growth in particles a target, exponent", 1.4, _exponent("particles_per_target")
    ),
    _most("smoother", "one lag, share of a kernel", 0.06, _lag_share),
    _most("smoother", "cached kernel, bytes a particle and lag", 200.0, _cached),
    _most("steps", "step, reference scenario, ms", 12.0, _step(PAPER)),
    _least(
        "peers",
        "step against Stone Soup's GM-PHD, times",
        1.0,
        ratio(at("peers", "GM-PHD", "median_ms"), at("peers", PARTICLES, "median_ms")),
    ),
    _most("steps", "step, 200 targets, ms", 100.0, _step("200 targets")),
    _least(
        "asterix", "ASTERIX plots to clouds, per second", 2e4, at("asterix", "plots_per_s", CLOUDS)
    ),
    _most(
        "asterix",
        "ASTERIX in to ASTERIX out, 100 aircraft, p99, s beyond a sector",
        0.1,
        _beyond_sector,
    ),
    _most(
        "messages", "node, 1000 detections and 200 estimates, ms", 1.5, at("messages", "total_ms")
    ),
    *(
        _most(
            "late",
            f"{engine}: step ready for late reports, against dropping them, times",
            1.1,
            _late(engine),
        )
        for engine in late.ENGINES
    ),
    _most(
        "live",
        "latency over DDS beyond the step, p99, ms",
        10.0,
        at("live", PARTICLES, "beyond_step_ms", "p99"),
    ),
    # A sector is 0.25 s long, and its first detection waits for its end. After it comes a step.
    _most(
        "turning",
        "latency of a detection by sectors over DDS, p99, s",
        0.3,
        at("turning", "latency", PARTICLES, "latency_s", "p99"),
        _step_s,
    ),
    _least("replay_clock", "clock of the replay, Hz", 70.0, at("replay_clock", "rate_hz")),
    _most("turning", "turn of 50 aircraft, ms", 150.0, _turn(ONE_CLOUD)),
    _most(
        "turning",
        "a turn by 16 sectors against one cloud, times",
        1.5,
        ratio(_turn(BY_SECTORS), _turn(ONE_CLOUD)),
    ),
    *(
        _most("steps", f"gaussian: step, {scene}, ms", bound, _step(scene, GAUSSIAN))
        for scene, bound in ((PAPER, 1.0), ("200 targets", 8.0), ("1000 targets", 35.0))
    ),
    *(
        _most("steps", f"{FAST}: step, {scene}, ms", bound, _step(scene, FAST))
        for scene, bound in (("200 targets", 8.0), ("1000 targets", 35.0))
    ),
    *(
        _most("turning", f"gaussian: turn of 50 aircraft, {form}, ms", bound, _turn(form, GAUSSIAN))
        for form, bound in ((ONE_CLOUD, 4.0), (BY_SECTORS, 10.0), (AT_EVERY_SECTOR, 20.0))
    ),
    *(
        _least(
            "peers",
            f"gaussian: step against Stone Soup's {peer}, times",
            20.0,
            ratio(at("peers", peer, "median_ms"), at("peers", GAUSSIAN, "median_ms")),
        )
        for peer in ("GM-PHD", "GNN", "JPDA")
    ),
    *(
        _most(
            "live",
            f"gaussian: latency over DDS, {part}, ms",
            bound,
            at("live", GAUSSIAN, "estimate_ms", part),
        )
        for part, bound in (("p50", 4.0), ("p99", 8.0))
    ),
    *(
        _most("step_growth", name, bound, _step_growth(*path))
        for name, bound, path in (
            (f"{FAST}: step, 5000 targets, ms", 250.0, (*GROWTH, "times", -1, "median_ms")),
            (
                f"{FAST}: growth of a step in targets, 200 to 5000, exponent",
                1.1,
                (*GROWTH, "exponent"),
            ),
            ("gaussian: memory, 1000 targets, MB", 120.0, ("memory", "MB", GAUSSIAN)),
        )
    ),
)
