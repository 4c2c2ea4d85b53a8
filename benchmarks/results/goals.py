"""The goals of the benchmark, each with the measured value."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, TypeAlias

from studies.runner import goal

from ..engine import late
from ..engine.recursion import FAST, GAUSSIAN
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


def _step(scene: str, form: str) -> Value:
    return at("steps", scene, "forms", form, "times", "step", "median_ms")


def _turn(form: str) -> Value:
    return at("turning", "cost", form, "median_ms")


def _late(summary: Mapping[str, Any]) -> float:
    return late.ratio(summary["late"], late.READY)


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
    return 1e-3 * at("turning", "latency", "step_ms", "p99")(summary)


# --- goals ----------------------------------------------------------------------------------------


def _most(
    source: str, name: str, bound: float, value: Value, allowance: Value | None = None
) -> Goal:
    return Goal(name, bound, True, value, source, *([allowance] if allowance else []))


def _least(source: str, name: str, bound: float, value: Value) -> Goal:
    return Goal(name, bound, False, value, source)


GROWTH = ("forms", FAST)
GOALS: tuple[Goal, ...] = (
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
    _most(
        "late", "gaussian: step ready for late reports, against dropping them, times", 1.1, _late
    ),
    _most(
        "live",
        "gaussian: latency over DDS beyond the step, p99, ms",
        10.0,
        at("live", "beyond_step_ms", "p99"),
    ),
    # A sector is 0.25 s long, and its first detection waits for its end. After it comes a step.
    _most(
        "turning",
        "gaussian: latency of a detection by sectors over DDS, p99, s",
        0.3,
        at("turning", "latency", "latency_s", "p99"),
        _step_s,
    ),
    _least("replay_clock", "clock of the replay, Hz", 70.0, at("replay_clock", "rate_hz")),
    *(
        _most("steps", f"gaussian: step, {scene}, ms", bound, _step(scene, GAUSSIAN))
        for scene, bound in ((PAPER, 1.0), ("200 targets", 8.0), ("1000 targets", 35.0))
    ),
    *(
        _most("steps", f"{FAST}: step, {scene}, ms", bound, _step(scene, FAST))
        for scene, bound in (("200 targets", 8.0), ("1000 targets", 35.0))
    ),
    *(
        _most("turning", f"gaussian: turn of 50 aircraft, {form}, ms", bound, _turn(form))
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
            at("live", "estimate_ms", part),
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
