"""Simulates the detections and the truth of a scenario as tables."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from msg_adapters import identities, sent_columns
from phd_jdtc_ros import resources
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.radar_parameters import RadarParameters
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.types import Detections, Truth
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.scenario import Scenario, paper_scenario, truth_at
from phd_jdtc_ros.simulation.simulate import simulate as scans_of
from phd_jdtc_ros.simulation.turning_antenna import check_sites, simulate_reports

from .reports import TIME
from .tables import Column

SHIPPED = Path("config", "scenarios")


class Simulated(NamedTuple):
    """A simulated run.

    Parameters
    ----------
    detections : structured array
        Detections of all radars in the order of time, as `Tracker` accepts them; a scan without
        detections is a row with NaN.
    truth : structured array
        ``time label class x y vx vy height``, as `evaluate` accepts it.
    parameters : dict
        All parameters of a `Tracker` for these radars, by dotted name.
    """

    detections: Column
    truth: Column
    parameters: dict[str, Any]


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
    document = _document(scenario)
    config = _config(from_arguments.scenario_parameters(document))
    radars = polar_radars(config.model.radars)
    run = paper_scenario(radars) if document is None else scenario_file.resolve(document, radars)
    if run.platform is not None:
        raise ConfigError(["platform: given, must be absent, because tables have no poses"])
    check_sites(config.inputs)
    names = [kind.name for kind in config.model.modes.classes]
    if run.turning:
        truths = [truth_at(run, scan) for scan in range(run.scans)]
        reports = [
            (each.stamp_ns, each.radar, each.detections)
            for each in simulate_reports(run, config.inputs, seed)
        ]
    else:
        seen = scans_of(run, seed)
        truths = [truth for truth, _ in seen]
        reports = list(_reports(seen))
    return Simulated(
        _detections(reports, config.inputs), _truth(truths, run, names), dict(config.values)
    )


def _document(scenario: Mapping[str, Any] | str | os.PathLike[str] | None) -> Any:
    if scenario is None or isinstance(scenario, Mapping):
        return scenario
    path = Path(scenario)
    shipped = resources.find(SHIPPED / f"{path}.yaml")
    return yaml_files.load(shipped if len(path.parts) == 1 and shipped.is_file() else path)


def _config(parameters: Mapping[str, Any]) -> TrackerConfig:
    """Return a configuration with absolute detection times, as in tables."""
    config = resolve(parameters, SystemPlane)
    timed = [radar.name for radar in config.inputs if radar.fields.time]
    return resolve(
        {
            **config.values,
            **{f"{name}.fields.time": TIME for name in timed},
            **{f"{name}.time_reference": "epoch" for name in timed},
            **{f"{name}.time_unit": "s" for name in timed},
            **{f"{name}.fields.sector": "" for name in timed},
        },
        SystemPlane,
    )


def _reports(seen: Sequence[tuple[Truth, Any]]) -> Iterator[tuple[int, int, Detections]]:
    for _, scan in seen:
        for radar, found in enumerate(scan.detections):
            if found is not None:
                yield scan.stamp_ns, radar, found


def _detections(
    reports: Sequence[tuple[int, int, Detections]], inputs: Sequence[RadarParameters]
) -> Column:
    """Return reports as a table with the columns of all radars."""
    own = [sent_columns.names_of(radar).values() for radar in inputs]
    names = [name for name in dict.fromkeys(chain.from_iterable(own)) if name != TIME]
    dtype = [
        (TIME, np.float64),
        ("radar", f"U{max(len(radar.name) for radar in inputs)}"),
        *((name, np.float64) for name in names),
    ]
    table = np.zeros(sum(max(len(found), 1) for *_, found in reports), dtype=dtype)
    begin = 0
    for stamp_ns, index, found in reports:
        radar, sent = inputs[index], {}
        rows = table[begin : begin + max(len(found), 1)]
        begin += len(rows)
        if len(found):
            sent = sent_columns.of(found, stamp_ns, radar)
        rows[TIME] = sent[TIME] if radar.fields.time and sent else stamp_ns / 1e9
        rows["radar"] = radar.name
        for name in names:
            rows[name] = _number(sent[name]) if name in own[index] and sent else np.nan
    return table


def _number(column: Column) -> Column:
    """Return a column as floats, with NaN for absent codes and addresses."""
    none = column == identities.NONE if column.dtype == np.uint32 else np.zeros(len(column), bool)
    return np.where(none, np.nan, column.astype(np.float64))


def _truth(truths: Sequence[Truth], run: Scenario, class_names: Sequence[str]) -> Column:
    known = max([-1, *(target.class_id for target in run.targets)])
    names = [*class_names, *(f"class_{k}" for k in range(len(class_names), known + 1))]
    dtype = [
        *((TIME, np.float64), ("label", np.int64), ("class", f"U{max(map(len, names))}")),
        *((name, np.float64) for name in ("x", "y", "vx", "vy", "height")),
    ]
    table = np.zeros(sum(len(each.track_id) for each in truths), dtype=dtype)
    begin = 0
    for each in truths:
        rows = table[begin : begin + len(each.track_id)]
        begin += len(rows)
        rows[TIME], rows["label"] = each.stamp_ns / 1e9, each.track_id
        rows["class"] = np.array(names)[each.class_id]
        rows["x"], rows["y"] = each.position.T
        rows["vx"], rows["vy"] = each.velocity.T
        rows["height"] = np.nan if each.height is None else each.height[:, 0]
    return table
