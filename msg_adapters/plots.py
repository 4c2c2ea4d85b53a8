"""Figures as one number per message and topic, for plotting tools.

Such a message has no stamp; tools plot it at its time of arrival.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from std_msgs.msg import Float64

from phd_jdtc_ros.evaluation.metric_table import PLOTTED

from . import quantities

if TYPE_CHECKING:
    from phd_jdtc_ros.core.engine import Step
    from phd_jdtc_ros.evaluation.run_scores import ScanScore


def step_to_msg(step: Step, step_ms: float, quantity: str) -> Float64:
    """Return a number of a tracker step, see `quantities.of_tracker`; `step_ms` is its CPU time."""
    mass = {f"cardinality/class_{k}": each for k, each in enumerate(step.class_mass)}
    numbers = {"cardinality/total": step.class_mass.sum(), **mass, "step_ms": step_ms}
    return _to_msg({**step.figures, **numbers}[quantity])


def score_to_msgs(score: ScanScore) -> dict[str, Float64]:
    """Return the numbers of a scan's scores, by name."""
    return {
        quantities.of_score(score.source, key, name): _to_msg(value)
        for key, values in score.values.items()
        for name in PLOTTED
        if (value := values[name]) is not None
    }


def _to_msg(value: float) -> Float64:
    # Messages do not check types, and a number that is not a float would become garbage.
    return Float64(data=float(value))
