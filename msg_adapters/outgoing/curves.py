"""Figures as one number per message, each on the topic ``~/plot/NAME``, for tools that draw curves.

Such a message has no stamp; tools draw it at its time of arrival.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from std_msgs.msg import Float64

from phd_jdtc_ros.core.types import SOURCES
from phd_jdtc_ros.evaluation.metric_table import CURVES

if TYPE_CHECKING:
    from phd_jdtc_ros.core.engine import Step
    from phd_jdtc_ros.evaluation.run_scores import ScanScore


# Figures with a curve, of each engine.
FIGURES = {
    "gaussian": ("hypotheses", "origins"),
    **dict.fromkeys(("phd", "phd_as_printed"), ("particles", "effective_sample_size")),
    "phd_gaussian": ("gaussians",),
}


def of_tracker(classes: int, engine: str | None = "gaussian") -> tuple[str, ...]:
    """Return the names of the tracker's numbers; without `engine` the engine's own are left out."""
    sets = ("total", *(f"class_{k}" for k in range(classes)))
    figures = FIGURES.get(engine or "", ())
    return (*(f"cardinality/{key}" for key in sets), "step_ms", *figures)


def of_evaluator(classes: int) -> tuple[str, ...]:
    """Return the names of the evaluator's numbers."""
    sets = ("all", *(f"class_{k}" for k in range(classes)))
    return tuple(
        of_score(source, key, name) for source in SOURCES for key in sets for name in CURVES
    )


def of_score(source: str, key: str, name: str) -> str:
    """Return the name of a score of an estimate source and a set of targets."""
    return f"{source}/{key}/{name}"


def of_step(step: Step, step_ms: float) -> dict[str, float]:
    """Return the numbers of a tracker step by name, see `of_tracker`; `step_ms` is its CPU time."""
    mass = {f"cardinality/class_{k}": each for k, each in enumerate(step.class_mass.tolist())}
    total = {"cardinality/total": float(step.class_mass.sum())}
    return {**step.figures, **total, **mass, "step_ms": step_ms}


def score_to_msgs(score: ScanScore) -> dict[str, Float64]:
    """Return the numbers of a scan's scores, by name."""
    return {
        of_score(score.source, key, name): to_msg(value)
        for key, values in score.values.items()
        for name in CURVES
        if (value := values[name]) is not None
    }


def to_msg(value: float) -> Float64:
    """Return the message of a number."""
    # Messages do not check types, and a number that is not a float would become garbage.
    return Float64(data=float(value))
