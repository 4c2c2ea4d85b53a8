"""A figure: the goal, the measured value, and whether the goal is reached."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeAlias

# Seconds after which a measurement in a process of its own has failed.
PROCESS_S = 300.0


@dataclass(frozen=True)
class Figure:
    """One row of the table."""

    name: str
    goal: str
    measured: str | None  # As text with numbers; None if it could not be measured
    reached: bool | None
    reason: str = ""  # Why it was not measured
    # The numbers behind `measured`, for the summary.
    details: Mapping[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return the figure as it is written to the summary."""
        return {
            "figure": self.name,
            "goal": self.goal,
            "measured": self.measured,
            "reached": self.reached,
            **({"reason": self.reason} if self.reason else {}),
            "details": dict(self.details),
        }


class NotMeasurableError(Exception):
    """A figure cannot be measured here; the message gives the reason."""


# The result of a measurement: text, whether the goal is reached, and the numbers behind it.
Found: TypeAlias = "tuple[str, bool, Mapping[str, Any]]"
P = ParamSpec("P")


def wrong_counts(
    wanted: Mapping[str, int], counted: Mapping[str, Any]
) -> tuple[dict[str, int], dict[str, tuple[int, int]], str]:
    """Compare the counts in diagnostics with the wanted ones.

    Returns the counts, the wrong ones with the wanted ones, and a text.
    """
    found = {key: int(counted.get(key, 0)) for key in wanted}
    wrong = {key: (found[key], count) for key, count in wanted.items() if found[key] != count}
    return found, wrong, f"counted wrongly: {wrong}" if wrong else "every one counted"


def such_as(wrong: Mapping[str, Any]) -> str:
    """Return the first of the faults as the end of a text; empty without any."""
    return f", such as {next(iter(wrong.items()))}" if wrong else ""


def measures(
    name: str, goal: str | Callable[..., str]
) -> Callable[[Callable[P, Found]], Callable[P, Figure]]:
    """Make a figure of what a function finds.

    If the measurement fails, the goal is missed, and the other figures are still measured.

    The goal is in words, or a function of the same arguments that returns it.
    """

    def decorated(measure: Callable[P, Found]) -> Callable[P, Figure]:
        @wraps(measure)
        def measured(*args: P.args, **kwargs: P.kwargs) -> Figure:
            words = goal if isinstance(goal, str) else goal(*args, **kwargs)
            try:
                text, reached, details = measure(*args, **kwargs)
            except NotMeasurableError as error:
                return Figure(name, words, None, None, str(error))
            except Exception as error:  # It may be any, also a fault of the measurement itself
                return Figure(name, words, f"failed: {type(error).__name__}: {error}", False)
            return Figure(name, words, text, reached, details=details)

        measured.__dict__["is_measurement"] = True
        return measured

    return decorated


def in_own_process(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function of this folder in a process of its own; arguments and result are JSON."""
    called = "robustness.harness.figures", function.__module__, function.__name__
    done = subprocess.run(
        [sys.executable, "-m", *called],
        input=json.dumps(arguments),
        capture_output=True,
        text=True,
        timeout=PROCESS_S,
        check=False,
        cwd=Path(__file__).parents[2],
    )
    if done.returncode:
        raise RuntimeError(done.stderr[-500:])
    return json.loads(done.stdout)


def peak_mb() -> float:
    """Return the peak memory of this process, MB."""
    # Not `getrusage`, whose figure begins with that of the parent process.
    text = Path("/proc/self/status").read_text()
    return int(text.partition("VmHWM:")[2].split()[0]) / 1024.0


def all_reached(figures: Sequence[Figure]) -> bool:
    """Return whether no figure that was measured misses its goal."""
    return all(figure.reached is not False for figure in figures)


if __name__ == "__main__":
    module, function = sys.argv[1:]
    print(json.dumps(getattr(importlib.import_module(module), function)(*json.load(sys.stdin))))
