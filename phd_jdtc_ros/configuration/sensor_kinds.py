"""The table of the kinds of sensors: the parameters of each, and the model that they describe.

A further kind is a subclass of `SensorParameters` and a row here; CONTRIBUTING lists what else it
needs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

from phd_jdtc_ros.core.factors import Factor
from phd_jdtc_ros.core.intake.input_checks import ReportCheck
from phd_jdtc_ros.core.sensors.sensor import Sensor

from . import position_models, radar_checks
from .parameters.position import PositionParameters
from .parameters.radar import RadarParameters
from .parameters.sensor import SensorParameters
from .parameters.tracker import Parts
from .radar_models import radar_factors, radar_model, report_check
from .schema import Parameter, table

S = TypeVar("S", bound=SensorParameters)


@dataclass(frozen=True)
class SensorKind(Generic[S]):
    """A kind of sensor."""

    parameters: type[S]
    model: Callable[[S], Sensor]
    # Returns what else is assumed of its detections; see `core.factors`.
    factors: Callable[[S], tuple[Factor, ...]]
    # Checks of its parameters, each with a line per fault.
    checks: tuple[Callable[[S, Parts], Iterator[str]], ...] = ()
    # Returns the checks of its reports against its configuration.
    report_check: Callable[[S], ReportCheck] = lambda _: ReportCheck()


# By the value of ``kind``. The first one is the default.
KINDS: Mapping[str, SensorKind[Any]] = {
    "radar": SensorKind(
        RadarParameters, radar_model, radar_factors, radar_checks.CHECKS, report_check
    ),
    "position": SensorKind(
        PositionParameters,
        position_models.position_model,
        position_models.position_factors,
        position_models.CHECKS,
        position_models.report_check,
    ),
}


def _table(declared: type) -> tuple[Parameter, ...]:
    """Return the parameters of a kind, `kind` with the values that it may have."""
    return tuple(
        replace(each, choices=tuple(KINDS)) if each.name == "kind" else each
        for each in table(declared)
    )


TABLES: Mapping[str, tuple[Parameter, ...]] = {
    name: _table(kind.parameters) for name, kind in KINDS.items()
}
# The parameters of all kinds, by name; the first kind's where several have one of the same name.
ALL: Mapping[str, Parameter] = {
    each.name: each for own in reversed(list(TABLES.values())) for each in own
}


def parameters_of(kind: Any) -> tuple[Parameter, ...]:
    """Return the parameters of a sensor with this `kind`, those of the first if there is none."""
    known = isinstance(kind, str) and kind in TABLES
    return TABLES[kind if known else next(iter(TABLES))]
