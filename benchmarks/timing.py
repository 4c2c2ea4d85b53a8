"""Timing that is robust on a busy machine: CPU time, interleaved rounds, medians."""

from __future__ import annotations

import gc
import time
import tracemalloc
from collections.abc import Callable, Hashable, Mapping
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

CaseName = TypeVar("CaseName", bound=Hashable)


class Case(NamedTuple):
    """Something to be timed."""

    call: Callable[[], Any]
    rounds: int  # Number of calls; slow baselines need fewer


def interleaved(cases: Mapping[CaseName, Case]) -> dict[CaseName, list[float]]:
    """Return the CPU milliseconds of every call, by case.

    In each round every case is called once, so that a temporary slowdown of the machine affects
    all cases. A first, untimed call of each fills caches and compiles; cases of one or two rounds
    are so slow that they do not need it.
    """
    times: dict[CaseName, list[float]] = {name: [] for name in cases}
    for case in cases.values():
        if case.rounds > 2:
            case.call()
    collecting = gc.isenabled()
    gc.disable()
    try:
        for index in range(max(case.rounds for case in cases.values())):
            for name, case in cases.items():
                if index < case.rounds:
                    begin = time.process_time()
                    case.call()
                    times[name].append(1e3 * (time.process_time() - begin))
    finally:
        if collecting:
            gc.enable()
    return times


def spread(times_ms: list[float]) -> dict[str, float]:
    """Return the median and the quartiles of times, and their number."""
    low, median, high = np.percentile(times_ms, [25, 50, 75])
    return {
        "median_ms": float(median),
        "lower_quartile_ms": float(low),
        "upper_quartile_ms": float(high),
        "rounds": len(times_ms),
    }


def percentiles(values: npt.ArrayLike) -> dict[str, float]:
    """Return the median, the 99th percentile and the largest of values."""
    p50, p99, most = np.percentile(np.asarray(values), [50, 99, 100])
    return {"p50": float(p50), "p99": float(p99), "most": float(most)}


def peak_bytes(call: Callable[[], Any]) -> int:
    """Return the peak memory of a call in bytes, beyond that in use before."""
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        call()
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return peak - before


def exponent(size: list[float], cost: list[float]) -> float:
    """Return the slope of log cost over log size, by least squares."""
    slope, _ = np.polyfit(np.log(size), np.log(cost), 1)
    return float(slope)
