"""Names of the numbers that nodes publish for plots, each on the topic ``~/plot/NAME``."""

from __future__ import annotations

from phd_jdtc_ros.core.types import SOURCES
from phd_jdtc_ros.evaluation.metric_table import PLOTTED

# Plotted figures of each engine.
FIGURES = {
    "particles": ("particles", "effective_share"),
    "gaussian": ("hypotheses", "origins"),
}


def of_tracker(classes: int, engine: str | None = "gaussian") -> tuple[str, ...]:
    """Return the names of the tracker's numbers; without `engine` the engine's own are left out."""
    sets = ("total", *(f"class_{k}" for k in range(classes)))
    figures = () if engine is None else FIGURES[engine]
    return (*(f"cardinality/{key}" for key in sets), "step_ms", *figures)


def of_evaluator(classes: int) -> tuple[str, ...]:
    """Return the names of the evaluator's numbers."""
    sets = ("all", *(f"class_{k}" for k in range(classes)))
    return tuple(
        of_score(source, key, name) for source in SOURCES for key in sets for name in PLOTTED
    )


def of_score(source: str, key: str, name: str) -> str:
    """Return the name of a score of an estimate source and a set of targets."""
    return f"{source}/{key}/{name}"
