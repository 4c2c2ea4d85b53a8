"""How many hypotheses and particles represent the targets, by the wanted accuracy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from phd_jdtc_ros.core.gaussian.bounds import Bounds
from phd_jdtc_ros.core.smc.resampling import ParticleBudget

# A hypothesis of a smaller share of its target has no effect that is seen.
LEAST_HYPOTHESIS = 1e-4
# Square Mahalanobis distance within which two hypotheses are one.
MERGE_DISTANCE = 4.0
# Bounds of what all targets may cost, far above a thousand of them.
MOST_HYPOTHESES, MOST_PARTICLES = 50_000, 200_000
# Fewer particles of a label and class do not represent it.
LEAST_PARTICLES = 200


@dataclass(frozen=True)
class Accuracy:
    """What one value of ``accuracy`` stands for.

    Parameters
    ----------
    hypotheses : int
        Largest number of association hypotheses of a target.
    least_mode : float
        Share of a hypothesis that a motion needs to go on as one of its own; 1: motions are mixed.
    per_target, per_birth, per_detection : int
        Numbers of particles.
    """

    hypotheses: int
    least_mode: float
    per_target: int
    per_birth: int
    per_detection: int


ACCURACY = {
    "fast": Accuracy(8, 1.0, 1500, 2048, 256),
    "normal": Accuracy(8, 0.05, 1500, 2048, 1024),
    "high": Accuracy(16, 0.02, 3000, 4096, 2048),
}


def bounds_of(values: Mapping[str, Any]) -> Bounds:
    """Return the bounds of the Gaussian engine's mixtures."""
    level = ACCURACY[values["accuracy"]]
    return Bounds(
        hypotheses=level.hypotheses,
        least_share=LEAST_HYPOTHESIS,
        merge_distance=MERGE_DISTANCE,
        least_existence=values["detection_births.least_probability"],
        most=MOST_HYPOTHESES,
        least_mode=level.least_mode,
    )


def budget_of(values: Mapping[str, Any]) -> ParticleBudget:
    """Return the particle engine's numbers of particles."""
    level = ACCURACY[values["accuracy"]]
    per_target = values["particles_per_target"] or level.per_target
    return ParticleBudget(
        per_target=per_target,
        least=min(LEAST_PARTICLES, per_target),
        per_birth_term=values["particles_per_birth"] or level.per_birth,
        most=MOST_PARTICLES,
    )


def particles_per_detection(values: Mapping[str, Any]) -> int:
    """Return the number of particles of a target that is born at a detection."""
    return int(values["detection_births.particles"] or ACCURACY[values["accuracy"]].per_detection)
