"""The engines by their names, and the pipeline of a configuration.

Each engine is imported when the first one of its kind is made, because that loads numba and
compiled code, and compiles new code.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from phd_jdtc_ros.core.engine import Engine, OnFiltered, ignore_filtered
from phd_jdtc_ros.core.intake.input_checks import ResultCheck
from phd_jdtc_ros.core.intake.out_of_sequence import OutOfSequence
from phd_jdtc_ros.core.intake.revolution_history import RevolutionHistory
from phd_jdtc_ros.core.pipeline import Pipeline, SensorStages, start_cold

from .build import TrackerConfig
from .parameters.tracker import PHD

if TYPE_CHECKING:
    from phd_jdtc_ros.core.phd.engine import PhdEngine
    from phd_jdtc_ros.core.window.fixed_lag import GaussianEngine


def new_engine(config: TrackerConfig) -> Engine:
    """Return a new engine of the configured kind."""
    return ENGINES[config.engine](config)


def gaussian_engine(config: TrackerConfig) -> GaussianEngine:
    """Return a new engine of Gaussian mixtures."""
    from phd_jdtc_ros.core.tracks.common_stamp import Schedule
    from phd_jdtc_ros.core.window.fixed_lag import GaussianEngine
    from phd_jdtc_ros.core.window.forward_filter import ForwardFilter

    # Compiled functions are loaded now and not during the first scan.
    _ = [sensor.of_gaussians for sensor in config.model.radars]
    return GaussianEngine(
        forward=ForwardFilter(config.model, config.bounds),
        lag=config.lag,
        schedule=Schedule(round(config.estimates_period_s * 1e9)),
        rule=config.rule,
    )


def phd_engine(config: TrackerConfig) -> PhdEngine[Any, Any]:
    """Return a new engine of the paper's PHD filter, with the recursion that its name says."""
    from phd_jdtc_ros.core.phd import extraction, smoothing
    from phd_jdtc_ros.core.phd.engine import PhdEngine, Recursion
    from phd_jdtc_ros.core.phd.gaussian_filter import GaussianFilter
    from phd_jdtc_ros.core.phd.particle_filter import ParticleFilter

    death_term, extract = smoothing.bernoulli_death_term, extraction.components
    if config.engine == "phd_as_printed":
        death_term, extract = smoothing.printed_death_term, extraction.clusters
    recursion: Recursion[Any, Any]
    if config.engine == "phd_gaussian":
        # Compiled functions are loaded now and not during the first scan.
        _ = [sensor.of_gaussians for sensor in config.model.radars]
        recursion = GaussianFilter(config.model)
    else:
        recursion = ParticleFilter(config.model, config.budget, config.seed, death_term, extract)
    return PhdEngine(recursion, config.lag, config.rule)


ENGINES: dict[str, Callable[[TrackerConfig], Engine]] = {
    "gaussian": gaussian_engine,
    **dict.fromkeys(PHD, phd_engine),
}


def new_pipeline(
    config: TrackerConfig,
    begin: Callable[[Engine, int], None] = start_cold,
    on_filtered: OnFiltered = ignore_filtered,
) -> Pipeline:
    """Return a pipeline with a new engine; see `Pipeline` for `begin` and `on_filtered`."""
    engine, platforms = new_engine(config), config.platforms()
    reprocesses = config.late_reports == "rework"
    histories = (
        RevolutionHistory(own, reprocesses and not any(platforms)) for own in config.revolutions()
    )
    stages = zip(config.report_checks(), histories, platforms, strict=True)
    return Pipeline(
        config.clocks(),
        config.grouper(),
        engine,
        begin,
        sensors=[SensorStages(*each) for each in stages],
        results=ResultCheck(config.model.modes.interval_s),
        out_of_sequence=OutOfSequence(engine, len(config.inputs), reprocesses),
        region=config.region,
        configured=(config.model, config.rule),
        on_filtered=on_filtered,
    )
