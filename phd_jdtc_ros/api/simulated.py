"""Simulates the detections and the truth of a scenario as tables."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from phd_jdtc_ros import resources
from phd_jdtc_ros.columns import identities, sent_columns
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.types import Truth
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.quoting import short
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.scenario import Scenario, paper_scenario
from phd_jdtc_ros.simulation.turning_antenna import SimulatedReport, check_sites, truth_and_reports

from .reports import TIME
from .tables import Column, structured_array

SHIPPED = Path("config", "scenarios")


class Simulated(NamedTuple):
    """A simulated run, with structured arrays."""

    # Plots of all radars in the order of time, as `Tracker` accepts them; a scan without detections
    # is a row with NaN.
    detections: Column
    truth: Column  # ``time label class x y vx vy height``, as `evaluate` accepts it
    parameters: dict[str, Any]  # All parameters of a `Tracker` for these radars, by dotted name


def simulate(
    scenario: Mapping[str, Any] | str | os.PathLike[str] | None = None, *, seed: int
) -> Simulated:
    """Simulate radars and targets.

    Parameters
    ----------
    scenario : mapping, str, path or None
        A scenario as in ``docs/scenarios.md``, the path of such a file, or the name of a shipped
        scenario such as ``one_radar``; None for the reference scenario.
    seed : int
        Equal seeds give equal tables, which match the output of the executable ``simulate``.

    Raises
    ------
    ConfigError
        A ValueError with all faults of the scenario.
    """
    if not isinstance(seed, (int, np.integer)) or seed < 0:
        raise ConfigError(f"seed: {short(repr(seed))} given, must be a whole number from 0 on")
    document = _document(scenario)
    config = _config(from_arguments.scenario_parameters(document))
    radars = polar_radars(config.model.radars)
    run = paper_scenario(radars) if document is None else scenario_file.resolve(document, radars)
    if run.platform is not None:
        raise ConfigError("platform: given, must be absent, because tables have no poses")
    check_sites(config.radars)
    names = [kind.name for kind in config.model.modes.classes]
    truths, reports = truth_and_reports(run, config.radars, seed)
    return Simulated(
        _detections(reports, config.radars), _truth(truths, run, names), dict(config.values)
    )


def _document(scenario: Mapping[str, Any] | str | os.PathLike[str] | None) -> Any:
    if scenario is None or isinstance(scenario, Mapping):
        return scenario
    path = Path(scenario)
    if len(path.parts) != 1:
        return yaml_files.load(path)
    shipped = resources.find(SHIPPED / f"{path}.yaml")
    if shipped.is_file():
        return yaml_files.load(shipped)
    if not path.suffix and not os.path.exists(path):
        names = sorted(file.stem for file in resources.find(SHIPPED).glob("*.yaml"))
        raise ConfigError(
            f"scenario: {short(repr(str(path)))} given, must be a mapping, the path of a file, "
            f"or one of {', '.join(names)}"
        )
    return yaml_files.load(path)


def _config(parameters: Mapping[str, Any]) -> TrackerConfig:
    """Return a configuration with absolute detection times, as in tables."""
    config = resolve(parameters, SystemPlane)
    given = {"fields.time": TIME, "time_reference": "epoch", "time_unit": "s", "fields.sector": ""}
    timed = [radar.name for radar in config.radars if radar.fields.time]
    changes = {f"{name}.{key}": value for name in timed for key, value in given.items()}
    return resolve({**config.values, **changes}, SystemPlane)


def _detections(reports: Sequence[SimulatedReport], inputs: Sequence[RadarParameters]) -> Column:
    """Return reports as a table with the columns of all radars."""
    own = [sent_columns.names_of(radar.fields).values() for radar in inputs]
    names = [name for name in dict.fromkeys(chain.from_iterable(own)) if name != TIME]
    dtype = [
        (TIME, np.float64),
        ("radar", f"U{max(len(radar.name) for radar in inputs)}"),
        *((name, np.float64) for name in names),
    ]
    parts = []
    for index, stamp_ns, found, _ in reports:
        radar = inputs[index]
        sent = sent_columns.of(found, stamp_ns, radar) if len(found) else {}
        time = sent[TIME] if radar.fields.time and sent else stamp_ns / 1e9
        columns = {
            name: _number(sent[name]) if name in own[index] and sent else np.nan for name in names
        }
        parts.append((max(len(found), 1), {TIME: time, "radar": radar.name, **columns}))
    return structured_array(dtype, parts)


def _number(column: Column) -> Column:
    """Return a column as floats, with NaN for absent codes and addresses."""
    none = column == identities.NONE if column.dtype == np.uint32 else np.zeros(len(column), bool)
    return np.where(none, np.nan, column.astype(np.float64))


def _truth(truths: Sequence[Truth], run: Scenario, class_names: Sequence[str]) -> Column:
    highest = max([-1, *(target.class_id for target in run.targets)])
    names = [*class_names, *(f"class_{k}" for k in range(len(class_names), highest + 1))]
    dtype = [
        *((TIME, np.float64), ("label", np.int64), ("class", f"U{max(map(len, names))}")),
        *((name, np.float64) for name in ("x", "y", "vx", "vy", "height")),
    ]
    parts = []
    for each in truths:
        (x, y), (vx, vy) = each.position.T, each.velocity.T
        height = np.nan if each.height is None else each.height[:, 0]
        columns = each.stamp_ns / 1e9, each.track_id, np.array(names)[each.class_id]
        values = (*columns, x, y, vx, vy, height)
        parts.append((len(each.track_id), {n: v for (n, _), v in zip(dtype, values, strict=True)}))
    return structured_array(dtype, parts)
