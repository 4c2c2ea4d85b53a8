"""The engines by their names in a configuration.

Each is imported when the first one of its kind is made, because that loads numba and what it has
compiled, and compiles what is new.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from phd_jdtc_ros.core import backend
from phd_jdtc_ros.core.engine import Engine

from .build import TrackerConfig
from .schema import ConfigError

if TYPE_CHECKING:
    from phd_jdtc_ros.core.gaussian.engine import GaussianEngine
    from phd_jdtc_ros.core.smc.engine import ParticleEngine
    from phd_jdtc_ros.core.smc.filter import ParticleFilter


def new_engine(config: TrackerConfig) -> Engine:
    """Return a new engine of the configured kind.

    Raises
    ------
    ConfigError
        If the environment asks for a backend that is not available, see `backend`.
    """
    try:
        backend.load(COMPILED[config.engine])
    except (ImportError, ValueError) as error:
        raise ConfigError([str(error)]) from error
    return ENGINES[config.engine](config)


def particle_engine(config: TrackerConfig) -> ParticleEngine:
    """Return a new particle engine."""
    from phd_jdtc_ros.core.smc.engine import ParticleEngine
    from phd_jdtc_ros.core.smc.extraction import EXTRACTIONS
    from phd_jdtc_ros.core.smc.smoother import DEATH_TERMS

    values = config.values
    return ParticleEngine(
        forward=particle_filter(config),
        lag=config.lag,
        schedule=config.schedule,
        death_term=DEATH_TERMS[str(values["death_term"])],
        extraction=EXTRACTIONS[str(values["extraction"])],
        rule=config.rule,
    )


def particle_filter(config: TrackerConfig) -> ParticleFilter:
    """Return a new forward filter of the particle engine."""
    from phd_jdtc_ros.core.association import marginals  # noqa: F401, not during the first scan
    from phd_jdtc_ros.core.smc.correction import CORRECTORS
    from phd_jdtc_ros.core.smc.filter import ParticleFilter
    from phd_jdtc_ros.core.smc.resampling import ParticleBudget

    values = config.values
    budget = ParticleBudget(
        per_target=values["particles_per_target"],
        least=values["least_particles"],
        per_birth_term=values["particles_per_birth"],
        most=values["max_particles"],
    )
    return ParticleFilter(config.model, CORRECTORS[values["corrector"]], budget, config.seed)


def gaussian_engine(config: TrackerConfig) -> GaussianEngine:
    """Return a new engine of Gaussian mixtures."""
    from phd_jdtc_ros.core.gaussian.engine import GaussianEngine
    from phd_jdtc_ros.core.gaussian.filter import GaussianFilter
    from phd_jdtc_ros.core.gaussian.reduction import Bounds

    values = config.values
    bounds = Bounds(
        hypotheses=values["hypotheses_per_target"],
        least_share=values["least_hypothesis"],
        merge_distance=values["merge_distance"],
        least_existence=values["detection_births.least_probability"],
        most=values["max_hypotheses"],
        least_mode=values["least_mode"],
    )
    return GaussianEngine(
        forward=GaussianFilter(config.model, bounds),
        lag=config.lag,
        schedule=config.schedule,
        rule=config.rule,
    )


# The modules with an engine's compiled loops.
COMPILED = {
    "particles": ("pair_search.compiled", "pair_search.compiled_kernel"),
    "gaussian": (),
}
ENGINES: dict[str, Callable[[TrackerConfig], Engine]] = {
    "particles": particle_engine,
    "gaussian": gaussian_engine,
}
