"""Combines the given parameters of a tracker for tables with estimated ones and defaults."""

from __future__ import annotations

import os
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from phd_jdtc_ros.calibration.tuning import proposal, unspecified
from phd_jdtc_ros.calibration.tuning.findings import Findings
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.schema import SMALL, ConfigError, flatten, number
from phd_jdtc_ros.configuration.tables import GROUPS, schema
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import from_arguments, tracker_params

from . import places, supposed_radar
from .reports import TIME
from .supposed_radar import POSITION, Area
from .tables import Columns

# Defaults for tables. Those of the node describe two radars and two classes; these describe one of
# each. Amplitudes and probabilities that are not known are not assumed.
DEFAULTS: Mapping[str, Any] = {
    "sensors": ["radar"],
    "classes": ["target"],
    "amplitude": "none",
    "detection_births.rates": [0.2],
    "detection_births.turn_rate_std": 0.02,
    "detection_births.least_probability": 0.005,
}
RADAR_DEFAULTS: Mapping[str, Any] = {
    "fields.amplitude": "",
    "detection_probability": 0.9,
}
# Parameters without a default; the user or a recording must provide them.
REQUIRED, REQUIRED_OF_RADARS = ("interval_s",), ("range_std", "azimuth_std_deg", "max_range")
# Optional columns, named like the parameters of `fields`, that are used if present.
RECOGNISED = (
    *("amplitude", "elevation", "height", "code", "address", "detection_type", "sector"),
    *("range_std", "azimuth_std", "range_rate", "range_rate_std"),
)


@dataclass(frozen=True)
class Parameters:
    """A tracker's parameters from the user and from a recording, by dotted name."""

    given: Mapping[str, Any]
    # True for those of a parameter file: the defaults are then the node's instead of `DEFAULTS`.
    for_node: bool = False
    # Values estimated from a recording; given parameters take precedence.
    found: Mapping[str, Any] = field(default_factory=dict)
    # Area of each supposed radar whose recording has positions.
    areas: Mapping[str, Area] = field(default_factory=dict)

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
        """Names of the radars."""
        names = {**({} if self.for_node else DEFAULTS), **self.given}.get("sensors", ())
        listed = names if isinstance(names, (list, tuple)) else ()
        return [name for name in listed if isinstance(name, str)]

    def config(self, columns: Collection[str] = (), incomplete: bool = False) -> TrackerConfig:
        """Return the configuration for a table with these columns; `ConfigError` has all faults.

        Noise, range and interval may be missing in an `incomplete` one, which only reads tables.
        """
        values = self.values(columns)
        faults = [] if self.for_node or incomplete else self._missing(values, columns)
        of_radars = {parameter.name for parameter in GROUPS["sensors"]}
        faults += [
            f"{name}: unknown parameter, did you mean {self.radars[0]}.{name}?"
            for name in self.given
            if name in of_radars and self.radars
        ]
        faults += [
            f"{name}.pose: {values[f'{name}.pose']!r} given, must be fixed: tables have no poses"
            for name in self.radars
            if values.get(f"{name}.pose", "fixed") != "fixed"
        ]
        faults += [
            f"{name}.time_reference: must be epoch where fields.time is {TIME}, the column that "
            "separates scans"
            for name in self.radars
            if values.get(f"{name}.fields.time") == TIME
            and values.get(f"{name}.time_reference") != "epoch"
        ]
        if faults:
            raise ConfigError(*faults)
        return resolve(values, SystemPlane)

    def values(self, columns: Collection[str] = ()) -> dict[str, Any]:
        """Return the parameters that differ from the node's, for a table with these columns."""
        if self.for_node:
            return {**self.found, **self.given}
        known = {**self._usable(), **self.given}
        values = dict(DEFAULTS)
        for name in self.radars:
            values.update({f"{name}.{what}": value for what, value in RADAR_DEFAULTS.items()})
            # A given rate stays.
            values[f"{name}.learn"] = [] if f"{name}.clutter_rate" in known else ["clutter"]
            values.update(_fields(name, columns))
            if known.get(f"{name}.fields.time") == TIME:
                values[f"{name}.time_reference"] = "epoch"
            if f"{name}.max_range" in known:
                values[f"{name}.clutter_max_range"] = known[f"{name}.max_range"]
        return {**values, **known, **self._supposed(columns)}

    def _supposed(self, columns: Collection[str]) -> dict[str, Any]:
        """Return the parameters of the supposed radars, beside the areas of positions."""
        areas = {**self._given_areas(columns), **self.areas}
        rates = {name: self.given.get(f"{name}.clutter_rate") for name in areas}
        found: dict[str, Any] = {}
        for name, area in areas.items():
            found |= supposed_radar.parameters(name, area, rates[name])
        return found

    def _given_areas(self, columns: Collection[str]) -> dict[str, Area]:
        """Return the area about (0, 0) of each supposed radar with a given maximum range."""
        reach = {
            name: number(self.given.get(f"{name}.max_range"), SMALL)
            for name in supposed_radar.names(self.radars, self.given, columns)
        }
        return {name: Area(0.0, 0.0, far, far) for name, far in reach.items() if far is not None}

    def with_origin(self, columns: Columns) -> Parameters:
        """Return a copy for a recording, with the middle of its latitudes and longitudes."""
        origin = places.middle(columns)
        return self if origin is None else replace(self, found={"world_origin": origin})

    def in_plane(self, columns: Columns) -> Columns:
        """Return columns with positions in the place of latitudes and longitudes."""
        known = {**self.found, **self.given}
        return places.in_plane(columns, known.get("world_origin", ()))

    def with_areas(self, columns: Columns) -> Parameters:
        """Return a copy for a recording, whose positions determine areas that are not given."""
        if self.for_node:
            return self
        names = supposed_radar.names(self.radars, self.given, columns)
        area = supposed_radar.area_of(columns) if names else None
        found = {} if area is None else dict.fromkeys(names, area)
        return replace(self, areas={**found, **self._given_areas(columns)})

    def _usable(self) -> dict[str, Any]:
        """Return the estimated parameters that fit the given classes and motion models."""
        table = schema({**DEFAULTS, **self.found, **self.given})
        found = {name: value for name, value in self.found.items() if name in table}
        if "classes" in self.given:
            found.pop("detection_births.rates", None)
        return found

    def _missing(self, values: Mapping[str, Any], columns: Collection[str]) -> list[str]:
        """Return a fault for each required parameter that is missing."""
        positions = {*POSITION} <= {*columns}
        of_radars = [
            f"{radar}.{what}"
            for radar in self.radars
            for what in REQUIRED_OF_RADARS
            if not (positions and what == "azimuth_std_deg")
        ]
        return [
            f"{name}: is missing, must be given or estimated by fit"
            for name in (*REQUIRED, *of_radars)
            if name not in values
        ]

    def remarks(self, findings: Mapping[str, Findings]) -> Iterator[str]:
        """Yield the remarks on what the findings propose and the user has not given."""
        for radar, each in findings.items():
            for text in proposal.remarks(each, self.given, radar):
                yield f"{radar}: {text}"

    def with_findings(
        self,
        findings: Mapping[str, Findings],
        timed: Mapping[str, bool],
        columns: Collection[str],
    ) -> Parameters:
        """Return a copy with the findings of a recording; given parameters take precedence.

        Detections of `timed` radars have individual times.
        """
        found = {} if self.for_node else unspecified.parameters(findings, timed)
        found |= {k: v for k, v in self.found.items() if k == "world_origin"}
        found["interval_s"] = proposal.interval_s(findings)
        for radar, each in findings.items():
            if not self.for_node:
                found.update(_fields(radar, columns))
            known = {**self.given, **self._supposed(columns)}
            rows = proposal.rows(each, known, radar)
            found.update({f"{radar}.{row.name}": row.value for row in rows if row.proposed})
        return replace(self, found=found)


def _for_tables(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a live node's file as those of its tracker for tables.

    Tables have absolute times, in seconds, and no poses: a radar that moves gives a warning.
    """
    found = tracker_params.without_node(given)
    for name, value in given.items():
        radar, _, what = name.partition(".")
        if what == "fields.time" and value == TIME:
            found |= {f"{radar}.time_reference": "epoch", f"{radar}.time_unit": "s"}
        elif what == "pose" and value != "fixed":
            del found[name]
            text = f"{name}: {value!r} is not used, because tables have no poses: {radar} rests"
            warnings.warn(text, stacklevel=4)
    return found


def _fields(radar: str, columns: Collection[str]) -> dict[str, str]:
    """Return the field parameters of a radar for the recognised columns."""
    names = {what: what for what in RECOGNISED if what in columns}
    if "kind" in columns:  # as in the clouds of ASTERIX plots
        names.setdefault("detection_type", "kind")
    return {f"{radar}.fields.{what}": column for what, column in names.items()}
