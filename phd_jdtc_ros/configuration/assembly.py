"""Builds the pipeline of a configuration: the engine, and what its reports pass before."""

from __future__ import annotations

from collections.abc import Callable

from phd_jdtc_ros.core.engine import Engine
from phd_jdtc_ros.core.intake.input_checks import ResultWatch
from phd_jdtc_ros.core.intake.out_of_sequence import LATE_REPORTS
from phd_jdtc_ros.core.intake.turn_history import TurnHistory
from phd_jdtc_ros.core.pipeline import EVERYWHERE, Pipeline, start_cold

from .build import TrackerConfig
from .engines import new_engine


def new_pipeline(
    config: TrackerConfig, begin: Callable[[Engine, int], None] = start_cold
) -> Pipeline:
    """Return a pipeline with a new engine; `begin` is that of `Pipeline`."""
    engine, turns, platforms = new_engine(config), config.turns(), config.platforms()
    histories = {}
    if config.late_reports == "rework" and not any(platforms):
        histories = {index: TurnHistory(own) for index, own in enumerate(turns)}
    return Pipeline(
        config.grouper(),
        engine,
        begin,
        turns,
        config.watches(),
        ResultWatch(config.model.modes.interval_s),
        platforms,
        LATE_REPORTS[config.late_reports](engine, len(turns)),
        histories,
        config.region or EVERYWHERE,
        (config.model, config.rule),
    )
