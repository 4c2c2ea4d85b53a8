"""The scores of the other engine on a bag that one engine has tracked live."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.engines import ENGINES
from phd_jdtc_ros.configuration.parameters import LABELLED
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.report import load
from phd_jdtc_ros.report.table import metrics

from . import command
from .track_bag import track_bag


def other_engine(config: TrackerConfig) -> TrackerConfig | None:
    """Return the configuration with the other engine; None if that lacks something of it."""
    if config.values["engine"] not in LABELLED:
        return None
    other = next(name for name in ENGINES if name != config.engine)
    try:
        return resolve({**config.values, "engine": other}, SystemPlane)
    except ConfigError:
        return None


def scores(bag: Path, config: TrackerConfig, directory: Path) -> dict[str, Any]:
    """Track a bag offline and return its scores in the form of `metrics.json`.

    Parameters
    ----------
    bag : Path
        With the truth.
    config : TrackerConfig
    directory : Path
        Of the new bag with the estimates.

    """
    tracker = track_bag(BagReader(bag), config, directory, f"tracking with {config.engine}")
    run = load.record(directory, config)
    evaluation = run.evaluate(command.CUTOFF, command.ORDER)
    return metrics(evaluation, np.array(tracker.step_ms), config.engine)
