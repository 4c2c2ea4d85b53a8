"""A figure: the goal, the measured value, and whether the goal is reached."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

# Seconds after which a measurement in a process of its own has failed.
PROCESS_S = 300.0


@dataclass(frozen=True)
class Figure:
    """One row of the table.

    Parameters
    ----------
    name, goal : str
    measured : str or None
        As text with numbers; None if it could not be measured.
    reached : bool or None
    reason : str
        Why it was not measured.
    details : mapping
        The numbers behind `measured`, for the summary.
    """

    name: str
    goal: str
    measured: str | None
    reached: bool | None
    reason: str = ""
    details: Mapping[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return the figure as it is written to the summary."""
        found: dict[str, Any] = {
            "figure": self.name,
            "goal": self.goal,
            "measured": self.measured,
            "reached": self.reached,
        }
        if self.reason:
            found["reason"] = self.reason
        return {**found, "details": dict(self.details)}


class NotMeasurableError(Exception):
    """A figure cannot be measured here; the message says why."""


def unmeasured(name: str, goal: str, reason: str) -> Figure:
    """Return a figure that could not be measured."""
    return Figure(name, goal, None, None, reason)


def measured_or_why(
    name: str, goal: str, measure: Callable[[], tuple[str, bool, Mapping[str, Any]]]
) -> Figure:
    """Return the figure that `measure` gives as text, whether the goal is reached, and details.

    If the measurement fails, the goal is missed, and the other figures are still measured.
    """
    try:
        text, reached, details = measure()
    except NotMeasurableError as error:
        return unmeasured(name, goal, str(error))
    except Exception as error:  # of any kind, also a fault of the measurement itself
        return Figure(name, goal, f"failed: {type(error).__name__}: {error}", False)
    return Figure(name, goal, text, reached, details=details)


def in_own_process(module: str, *arguments: str) -> Any:
    """Run a module of this folder in a process of its own, and return the JSON that it prints.

    Raises
    ------
    RuntimeError
        If it fails, with the end of its error output.
    """
    done = subprocess.run(
        [sys.executable, "-m", module, *arguments],
        capture_output=True,
        text=True,
        timeout=PROCESS_S,
        check=False,
        cwd=Path(__file__).parents[1],
    )
    if done.returncode:
        raise RuntimeError(done.stderr[-500:])
    return json.loads(done.stdout)


def all_reached(figures: Sequence[Figure]) -> bool:
    """Return whether no figure that was measured misses its goal."""
    return all(figure.reached is not False for figure in figures)
