"""The engines by their names, and the pipeline of a configuration.

Each engine is imported when the first one of its kind is made, because that loads numba and
compiled code, and compiles new code.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING

from phd_jdtc_ros.core.engine import Engine, OnFiltered, ignore_filtered
from phd_jdtc_ros.core.intake.input_checks import ResultCheck
from phd_jdtc_ros.core.intake.out_of_sequence import OutOfSequence
from phd_jdtc_ros.core.intake.turn_history import TurnHistory
from phd_jdtc_ros.core.pipeline import Pipeline, SensorStages, start_cold
from phd_jdtc_ros.core.tracks.region import Everywhere

from .build import TrackerConfig

if TYPE_CHECKING:
    from phd_jdtc_ros.core.gaussian.engine import GaussianEngine
    from phd_jdtc_ros.core.smc.engine import ParticleEngine
    from phd_jdtc_ros.core.smc.filter import ParticleFilter


def new_engine(config: TrackerConfig) -> Engine:
    """Return a new engine of the configured kind."""
    return ENGINES[config.engine](config)


def particle_engine(config: TrackerConfig) -> ParticleEngine:
    """Return a new particle engine."""
    from phd_jdtc_ros.core.smc.engine import ParticleEngine
    from phd_jdtc_ros.core.smc.extraction import EXTRACTIONS
    from phd_jdtc_ros.core.smc.smoother import DEATH_TERMS
    from phd_jdtc_ros.core.tracks.common_stamp import Schedule

    return ParticleEngine(
        forward=particle_filter(config),
        lag=config.lag,
        schedule=Schedule(round(config.estimates_period_s * 1e9)),
        death_term=DEATH_TERMS[config.recursion.death_term],
        extraction=EXTRACTIONS[config.recursion.extraction],
        rule=config.rule,
    )


def particle_filter(config: TrackerConfig) -> ParticleFilter:
    """Return a new forward filter of the particle engine."""
    from phd_jdtc_ros.core.smc.correction import CORRECTORS
    from phd_jdtc_ros.core.smc.filter import ParticleFilter

    corrector = CORRECTORS[config.recursion.corrector]
    # Compiled functions are loaded now and not during the first scan.
    importlib.import_module("phd_jdtc_ros.core.association.marginals")
    return ParticleFilter(config.model, corrector, config.budget, config.seed)


def gaussian_engine(config: TrackerConfig) -> GaussianEngine:
    """Return a new engine of Gaussian mixtures."""
    from phd_jdtc_ros.core.gaussian.engine import GaussianEngine
    from phd_jdtc_ros.core.gaussian.filter import GaussianFilter
    from phd_jdtc_ros.core.tracks.common_stamp import Schedule

    # Compiled functions are loaded now and not during the first scan.
    _ = [sensor.of_gaussians for sensor in config.model.radars]
    return GaussianEngine(
        forward=GaussianFilter(config.model, config.bounds),
        lag=config.lag,
        schedule=Schedule(round(config.estimates_period_s * 1e9)),
        rule=config.rule,
    )


ENGINES: dict[str, Callable[[TrackerConfig], Engine]] = {
    "particles": particle_engine,
    "gaussian": gaussian_engine,
}


def new_pipeline(
    config: TrackerConfig,
    begin: Callable[[Engine, int], None] = start_cold,
    on_filtered: OnFiltered = ignore_filtered,
) -> Pipeline:
    """Return a pipeline with a new engine; see `Pipeline` for `begin` and `on_filtered`."""
    engine, platforms = new_engine(config), config.platforms()
    reprocesses = config.late_reports == "rework"
    histories = (TurnHistory(own, reprocesses and not any(platforms)) for own in config.turns())
    stages = zip(config.report_checks(), histories, platforms, strict=True)
    return Pipeline(
        config.clocks(),
        config.grouper(),
        engine,
        begin,
        sensors=[SensorStages(*each) for each in stages],
        results=ResultCheck(config.model.modes.interval_s),
        out_of_sequence=OutOfSequence(engine, len(config.inputs), reprocesses),
        region=config.region or Everywhere(),
        configured=(config.model, config.rule),
        on_filtered=on_filtered,
    )
