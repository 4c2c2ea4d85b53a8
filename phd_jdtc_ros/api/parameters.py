"""Combines the given parameters of a tracker for tables with estimated ones and defaults."""

from __future__ import annotations

import os
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from phd_jdtc_ros.calibration.tuning import proposal
from phd_jdtc_ros.calibration.tuning.findings import Findings
from phd_jdtc_ros.calibration.tuning.remarks import remarks
from phd_jdtc_ros.calibration.tuning.unspecified import unspecified
from phd_jdtc_ros.columns import ground_ranges
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.schema import ConfigError, flatten
from phd_jdtc_ros.configuration.tables import GROUPS, parameters_of, schema
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import from_arguments

from . import reports
from .reports import POSITION, TIME
from .tables import Columns

# Defaults for tables. Those of the node describe two radars and two classes; these describe one of
# each. Amplitudes and probabilities that are not known are not assumed.
DEFAULTS: Mapping[str, Any] = {
    "sensors": ["radar"],
    "classes": ["target"],
    "amplitude": "none",
    "detection_births.rates": [0.2],
    "detection_births.std": [40.0, 0.02],
}
TURN_RATE_STD = 0.02  # Of targets that are born at detections, rad/s
# Parameters of sensors without a default, by kind; the user or a recording must provide them, and
# `interval_s`.
REQUIRED_OF_SENSORS: Mapping[str, Sequence[str]] = {
    "radar": ("range_std", "azimuth_std_deg", "max_range"),
    "position": ("position_std", "area"),
}
# Optional columns, named like the parameters of `fields`, that are used if present, by kind.
RECOGNISED: Mapping[str, Sequence[str]] = {
    "radar": (
        *("amplitude", "elevation", "height", "code", "address", "detection_type", "sector"),
        *("range_std", "azimuth_std", "range_rate", "range_rate_std"),
    ),
    "position": ("velocity_std", "amplitude", "height", "code", "address", "detection_type"),
}
# Parameters that only a sensor of positions has.
OF_POSITIONS = {own.name for own in parameters_of("position")} - {
    own.name for own in parameters_of("radar")
}


@dataclass(frozen=True)
class Parameters:
    """A tracker's parameters from the user and from a recording, by dotted name."""

    given: Mapping[str, Any]
    # True for those of a parameter file: the defaults are then the node's instead of `DEFAULTS`.
    for_node: bool = False
    # Values estimated from a recording; given parameters take precedence.
    found: Mapping[str, Any] = field(default_factory=dict)

    @staticmethod
    def of(given: Any) -> Parameters:
        """Return the given parameters, from a mapping, the path of a parameter file, or None."""
        if isinstance(given, (str, os.PathLike)):
            return Parameters(_for_tables(from_arguments.load(Path(given))), for_node=True)
        if given is None or isinstance(given, Mapping):
            return Parameters(dict(flatten(given or {})))
        raise ConfigError(
            f"parameters: {type(given).__name__} given, must be a mapping or the path of a file"
        )

    @property
    def radars(self) -> Sequence[str]:
        """Names of the sensors of detections."""
        names = {**({} if self.for_node else DEFAULTS), **self.given}.get("sensors", ())
        listed = names if isinstance(names, (list, tuple)) else ()
        heard = [name for name in listed if self.given.get(f"{name}.kind") == "reports"]
        return [name for name in listed if isinstance(name, str) and name not in heard]

    def config(self, columns: Collection[str] = (), incomplete: bool = False) -> TrackerConfig:
        """Return the configuration for a table with these columns; `ConfigError` has all faults.

        Noise, range and interval may be missing in an `incomplete` one, which only reads tables.
        """
        values = self.values(columns)
        faults = [*self._of_radars(values)]
        faults += [] if self.for_node or incomplete else self._missing(values)
        of_sensors = {parameter.name for parameter in GROUPS["sensors"]}
        faults += [
            f"{name}: unknown parameter, did you mean {self.radars[0]}.{name}?"
            for name in self.given
            if name in of_sensors and self.radars
        ]
        faults += [
            f"{name}.pose: {values[f'{name}.pose']!r} given, must be fixed: tables have no poses"
            for name in self.radars
            if values.get(f"{name}.pose", "fixed") != "fixed"
        ]
        faults += [
            f"{name}.units.time_reference: must be epoch where fields.time is {TIME}, the column "
            "that separates scans"
            for name in self.radars
            if values.get(f"{name}.fields.time") == TIME
            and values.get(f"{name}.units.time_reference") != "epoch"
        ]
        if faults:
            raise ConfigError(*faults)
        return resolve(values, SystemPlane)

    def values(self, columns: Collection[str] = ()) -> dict[str, Any]:
        """Return the parameters that differ from the node's, for a table with these columns."""
        # Those of sensors, by kind.
        sensor_defaults = {
            "radar": {"fields.amplitude": "", "detection_probability": 0.9},
            "position": {},
        }
        if self.for_node:
            return {**self.found, **self.given}
        known = {**self._usable(), **self.given}
        values = dict(DEFAULTS)
        for name in self.radars:
            kind = known.get(f"{name}.kind", self._kind_of(name, columns))
            kind = kind if kind in sensor_defaults else next(iter(sensor_defaults))
            usual = {**sensor_defaults[kind], **_fields(kind, columns)}
            values.update({f"{name}.{what}": value for what, value in usual.items()})
            # A given rate stays.
            is_given = f"{name}.clutter_rate" in known
            if kind == "position":
                values[f"{name}.kind"] = kind
                if f"{name}.clutter_rate" in self.given:
                    values[f"{name}.learn"] = ["noise", "detection"]
            else:
                values[f"{name}.learn"] = [] if is_given else ["clutter"]
                if f"{name}.max_range" in known:
                    values[f"{name}.clutter_max_range"] = known[f"{name}.max_range"]
            if known.get(f"{name}.fields.time") == TIME:
                values[f"{name}.units.time_reference"] = "epoch"
        births = known.get("detection_births.std", ())
        if len(births) == 1:
            known["detection_births.std"] = [*births, TURN_RATE_STD]
        return {**values, **known}

    def _kind_of(self, name: str, columns: Collection[str]) -> str:
        """Return the kind of a sensor whose table has these columns, or that has such parameters.

        Positions beside ranges are not used.
        """
        if not columns:
            is_given = any(f"{name}.{what}" in self.given for what in OF_POSITIONS)
            return "position" if is_given else "radar"
        x, y, distance = (
            self.given.get(f"{name}.fields.{what}", what) for what in (*POSITION, "range")
        )
        return "position" if distance not in columns and {x, y} <= {*columns} else "radar"

    def _of_radars(self, values: Mapping[str, Any]) -> Iterator[str]:
        """Yield a fault for each parameter of a radar that is given for positions."""
        for name in [] if self.for_node else self.radars:
            if values.get(f"{name}.kind") != "position" or f"{name}.kind" in self.given:
                continue
            for what in REQUIRED_OF_SENSORS["radar"]:
                if f"{name}.{what}" in self.given:
                    yield (
                        f"{name}.{what}: given, but the table has x and y and no range: positions, "
                        "with position_std and area"
                    )

    def with_origin(self, columns: Columns) -> Parameters:
        """Return a copy for a recording, with the middle of its latitudes and longitudes."""
        origin = reports.middle(columns)
        return self if origin is None else replace(self, found={"world_origin": origin})

    def with_units(self, columns: Columns) -> Parameters:
        """Return a copy for a recording, with the units of elevations as their values show them."""
        found: dict[str, Any] = {}
        for name in self.radars:
            own = columns.get(self.given.get(f"{name}.fields.elevation", "elevation"))
            if own is not None:
                of_radar = columns["radar"] == name if "radar" in columns else slice(None)
                values = np.asarray(own[of_radar], dtype=np.float64)
                found[f"{name}.units.elevation"] = ground_ranges.unit_of(values)
        return replace(self, found={**self.found, **found})

    def in_plane(self, columns: Columns) -> Columns:
        """Return columns with positions in the place of latitudes and longitudes."""
        return reports.in_plane(columns, self._origin)

    def seem_wrong(self, columns: Columns) -> str:
        """Return the sentence about places that seem to be wrong; empty if they do not."""
        return reports.seem_wrong(columns, self._origin)

    @property
    def _origin(self) -> Sequence[float]:
        origin: Sequence[float] = {**self.found, **self.given}.get("world_origin", ())
        return origin

    def _usable(self) -> dict[str, Any]:
        """Return the estimated parameters that fit the given classes and motion models."""
        table = schema({**DEFAULTS, **self.found, **self.given})
        found = {name: value for name, value in self.found.items() if name in table}
        if "classes" in self.given:
            found.pop("detection_births.rates", None)
        return found

    def _missing(self, values: Mapping[str, Any]) -> list[str]:
        """Return a fault for each required parameter that is missing."""
        of_sensors = [
            f"{name}.{what}"
            for name in self.radars
            for what in REQUIRED_OF_SENSORS.get(values.get(f"{name}.kind", "radar"), ())
        ]
        return [
            f"{name}: is missing, must be given or estimated by fit"
            for name in ("interval_s", *of_sensors)
            if name not in values
        ]

    def remarks(self, findings: Mapping[str, Findings]) -> Iterator[str]:
        """Yield the remarks on what the findings propose and the user has not given."""
        for radar, each in findings.items():
            for text in remarks(each, self.given, radar):
                yield f"{radar}: {text}"

    def with_findings(
        self, findings: Mapping[str, Findings], columns: Collection[str]
    ) -> Parameters:
        """Return a copy with the findings of a recording; given parameters take precedence."""
        found = {} if self.for_node else unspecified(findings)
        found |= {
            k: v for k, v in self.found.items() if k.endswith(("world_origin", ".units.elevation"))
        }
        found["interval_s"] = proposal.interval_s(findings)
        for radar, each in findings.items():
            if not self.for_node:
                kind = "position" if each.of_places else "radar"
                own = {"kind": kind, **_fields(kind, columns)}
                found.update({f"{radar}.{what}": value for what, value in own.items()})
            rows = proposal.rows(each, self.given, radar)
            found.update({f"{radar}.{row.name}": row.value for row in rows if row.proposed})
        return replace(self, found=found)


def _for_tables(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a live node's file as those of its tracker for tables.

    Tables have absolute times, in seconds, and no poses: a radar that moves gives a warning.
    """
    found = from_arguments.without_node(given)
    for name, value in given.items():
        radar, _, what = name.partition(".")
        if what == "fields.time" and value == TIME:
            found |= {f"{radar}.units.time_reference": "epoch", f"{radar}.units.time": "s"}
        elif what == "pose" and value != "fixed":
            del found[name]
            text = f"{name}: {value!r} is not used, because tables have no poses: {radar} rests"
            warnings.warn(text, stacklevel=4)
    return found


def _fields(kind: str, columns: Collection[str]) -> dict[str, str]:
    """Return the field parameters of a sensor of a kind for the recognised columns."""
    names = {what: what for what in RECOGNISED[kind] if what in columns}
    if "kind" in columns:  # The clouds of ASTERIX plots have that name too
        names.setdefault("detection_type", "kind")
    return {f"fields.{what}": column for what, column in names.items()}
