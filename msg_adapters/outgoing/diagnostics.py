"""Encodes figures as DiagnosticArray messages: scores, cardinality, health.

The metrics are imported where scores are encoded, because a tracker has none and starts the sooner
without.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Float64

from phd_jdtc_ros.core.types import SOURCES

from ..encoding import cdr, stamps

if TYPE_CHECKING:
    from phd_jdtc_ros.core.engine import Step

    # This is imported for types only: the module imports scipy's optimiser, which a tracker does
    # not need.
    from phd_jdtc_ros.evaluation.run_scores import ScanScore


def status(
    name: str,
    values: Mapping[str, object],
    level: bytes = DiagnosticStatus.OK,
    message: str = "",
    hardware_id: str = "",
) -> DiagnosticStatus:
    """Return a status; floats are written with all digits, so that reading them is exact."""
    return DiagnosticStatus(
        level=level,
        name=name,
        message=message,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=_text_of(value)) for key, value in values.items()],
    )


def _text_of(value: object) -> str:
    return repr(float(value)) if isinstance(value, float) else str(value)


def array(stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> DiagnosticArray:
    """Return statuses as one message, at a stamp in nanoseconds."""
    return DiagnosticArray(header=stamps.header(stamp_ns, ""), status=statuses)


def step_to_cdr(stamp_ns: int, step: Step, step_ms: float, class_names: Sequence[str]) -> bytes:
    """Return the figures of a tracker step, see `figures_to_cdr`; `step_ms` is its CPU time, ms."""
    values = {
        "total": float(step.class_mass.sum()),
        **dict(zip(class_names, step.class_mass.tolist(), strict=True)),
        **step.figures,
        "unresolved": sum(found.unresolved for found in step.filtered),
        "step_ms": step_ms,
    }
    return figures_to_cdr(stamp_ns, values)


def figures_to_cdr(stamp_ns: int, values: Mapping[str, object]) -> bytes:
    """Return a tracker's figures by name, as a serialised array of one status.

    It is written as bytes, because there is one per scan (see `cdr`).
    """
    writer = cdr.Writer()
    writer.header(stamp_ns, "")
    writer.put("I", 1)
    writer.put("c", DiagnosticStatus.OK)
    for text in ("tracker/cardinality", "", ""):
        writer.string(text)
    writer.put("I", len(values))
    for name, value in values.items():
        writer.string(name)
        writer.string(_text_of(value))
    return writer.message()


def values_of(message: DiagnosticStatus) -> dict[str, str]:
    """Return a status's key-value pairs."""
    return {pair.key: pair.value for pair in message.values}


def score_to_msg(score: ScanScore, cutoff: float, order: float) -> DiagnosticArray:
    """Encode a scan's scores: statuses ``filtered/all``, ``filtered/class_0`` and so on."""
    from phd_jdtc_ros.evaluation.run_scores import PUBLISHED

    parameters = {"cutoff": cutoff, "order": order}
    statuses = [
        status(f"{score.source}/{key}", {**{n: values[n] for n in PUBLISHED}, **parameters})
        for key, values in score.values.items()
    ]
    return array(score.stamp_ns, statuses)


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
    from phd_jdtc_ros.evaluation.run_scores import CURVES

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
    from phd_jdtc_ros.evaluation.run_scores import CURVES

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
