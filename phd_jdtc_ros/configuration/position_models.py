"""The models that the parameters of a sensor of positions describe, and checks of these."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from phd_jdtc_ros.core import factors
from phd_jdtc_ros.core.intake.input_checks import PositionReportCheck
from phd_jdtc_ros.core.sensors.gaussians import SPAN, HeightPrior, ReportedHeights
from phd_jdtc_ros.core.sensors.position import PositionSensor, WatchedArea, farthest
from phd_jdtc_ros.core.sensors.range_rate import VelocityModel
from phd_jdtc_ros.core.targets import amplitude_density

from . import radar_models
from .parameters.position import PositionParameters
from .parameters.tracker import PHD, Parts


def position_model(own: PositionParameters) -> PositionSensor:
    """Return the model of a sensor's detections and measurements."""
    return PositionSensor(
        name=own.name,
        position=(own.position[0], own.position[1]),
        yaw=math.radians(own.yaw_deg),
        threshold=amplitude_density.threshold_for(own.false_alarm_probability),
        clutter_rate=own.clutter_rate,
        cluster_distance=own.cluster_distance,
        std=(own.position_std, own.position_std),
        visibility=WatchedArea(own.area, own.detection_probability),
        velocity_model=VelocityModel(own.velocity_std) if own.fields.vx and own.fields.vy else None,
        height_prior=own.height_prior,
        reported_heights=None if own.height_prior is None else _heights(own, own.height_prior),
    )


def _heights(own: PositionParameters, prior: HeightPrior) -> ReportedHeights:
    """Return the errors of the heights in space: of z, or else of pressure altitudes."""
    # Undetected targets and clutter have the prior's heights: a uniform law of its deviation.
    span = min(SPAN, math.sqrt(12.0) * prior.std)
    if own.fields.height:
        return ReportedHeights(pressure=True, span=span)
    return ReportedHeights(own.position_std, garbled=0.0, span=span)


def position_factors(own: PositionParameters) -> tuple[factors.Factor, ...]:
    """Return what else is assumed of a sensor's detections, in the order in which it applies."""
    learn = set(own.learn)
    found = (
        "detection" in learn and factors.Detection(farthest(own.area)),
        "noise" in learn and factors.Noise.of(np.array([True, True, False])),
        "outliers" in learn and factors.Outliers(),
        "clutter" in learn and factors.ClutterRate.beginning_with(own.clutter_rate),
        factors.Limit(),
        factors.Bursts(),
        own.height_prior is not None and own.fields.height and factors.Pressure(*own.air),
    )
    return tuple(factor for factor in found if isinstance(factor, factors.Factor))


def report_check(own: PositionParameters) -> PositionReportCheck:
    """Return the checks of a sensor's reports."""
    return PositionReportCheck()


def _tracker(own: PositionParameters, parts: Parts) -> Iterator[str]:
    if (engine := parts.tracking.engine) in PHD:
        yield f"{own.name}.kind: position given, must be radar with engine {engine}"


def _velocity(own: PositionParameters, parts: Parts) -> Iterator[str]:
    for one, other in (("vx", "vy"), ("vy", "vx")):
        if getattr(own.fields, one) and not getattr(own.fields, other):
            yield f"{own.name}.fields.{other}: '' given, must be a name with fields.{one}"


def _place(own: PositionParameters, parts: Parts) -> Iterator[str]:
    for what in ("x", "y"):
        if not getattr(own.fields, what):
            yield f"{own.name}.fields.{what}: '' given, must be a name"


CHECKS = (_tracker, _place, _velocity, radar_models.pose, radar_models.repeated_fields)
