"""The models that a radar's parameters describe; degrees and decibels are converted here."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np

from phd_jdtc_ros.core.factors import (
    Bursts,
    ClutterMap,
    ClutterRanges,
    ClutterRate,
    CorrelatedMisses,
    Detection,
    Factor,
    GroundGrid,
    Learned,
    Limit,
    Multipath,
    Noise,
    Outliers,
    PolarGrid,
    Sectors,
)
from phd_jdtc_ros.core.factors.transponder import Pressure
from phd_jdtc_ros.core.intake.input_checks import (
    FAR,
    RADIANS_AS_DEGREES,
    SLOW_REVOLUTION,
    RadarReportCheck,
)
from phd_jdtc_ros.core.sensors.gaussians import UNKNOWN_STD
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.sensors.range_rate import RangeRateModel
from phd_jdtc_ros.core.sensors.reported_heights import HeightPrior, ReportedHeights
from phd_jdtc_ros.core.sensors.site import LEAST_STD, HeightProjection
from phd_jdtc_ros.core.sensors.spatial_radar import SpatialRadar
from phd_jdtc_ros.core.sensors.visibility import TURN_TOLERANCE, Visibility
from phd_jdtc_ros.core.state_space import SPATIAL
from phd_jdtc_ros.core.targets import amplitude_density
from phd_jdtc_ros.core.types import FULL_TURN, Coverage

from .parameters.radar import RadarParameters

# Width of the interval about zero that contains false range rates, m/s, for radars that measure
# range rates without ambiguity: road traffic with some margin.
RANGE_RATE_SPAN = 200.0
# Share of its range within which no radar has all detections, unless they are not in metres.
NEAR = 0.002


def radar_model(radar: RadarParameters) -> RadarModel:
    """Return the model of a radar's detections and measurements."""
    threshold = amplitude_density.threshold_for(radar.false_alarm_probability)
    range_std, azimuth_std = radar.range_std, math.radians(radar.azimuth_std_deg)
    named = radar.fields
    model = RadarModel(
        name=radar.name,
        position=radar.site.position if radar.site else (radar.position[0], radar.position[1]),
        yaw=radar.site.yaw if radar.site else math.radians(radar.yaw_deg),
        range_std=range_std,
        azimuth_std=azimuth_std,
        visibility=_visibility(radar),
        clutter_rate=radar.clutter_rate,
        threshold=threshold,
        rotation_s=radar.rotation_s,
        least_std=LEAST_STD if radar.site else (0.0, 0.0),
        range_rate=RangeRateModel(radar.range_rate_std, radar.range_rate_ambiguity, RANGE_RATE_SPAN)
        if named.range_rate
        else None,
        cluster_distance=radar.cluster_distance,
        height_projection=HeightProjection(
            radar.height, radar.datum, radar.site, radar.assumed_height
        )
        if named.height and not named.elevation and radar.height_prior is None
        else None,
    )
    return model if radar.height_prior is None else _in_space(radar, radar.height_prior, model)


def _in_space(radar: RadarParameters, prior: HeightPrior, model: RadarModel) -> SpatialRadar:
    """Return the model of a radar whose slant ranges and elevations are measurements."""
    low, high = map(math.radians, radar.fov_elevation_deg)
    std = math.radians(radar.elevation_std_deg) if radar.fields.elevation else UNKNOWN_STD
    common = {entry.name: getattr(model, entry.name) for entry in fields(model)}
    common |= {
        "space": SPATIAL,
        "visibility": replace(model.visibility, elevations=(low, high)),
        "least_std": (*model.least_std, 0.0),
        "reported_heights": ReportedHeights(pressure=True) if radar.fields.height else None,
    }
    return SpatialRadar(
        **common,
        height=radar.height,
        elevation_std=std,
        height_prior=prior,
        curvature=radar.curvature,
        tilt=(math.radians(radar.tilt_deg[0]), math.radians(radar.tilt_deg[1])),
    )


def radar_factors(radar: RadarParameters) -> tuple[Factor, ...]:
    """Return what else is assumed of a radar's detections, in the order in which it applies."""
    learn = set(radar.learn)
    threshold = amplitude_density.threshold_for(radar.false_alarm_probability)
    # The components of a measurement, and the range rate.
    elevation = [] if radar.height_prior is None else [bool(radar.fields.elevation)]
    noise = np.array([True, True, *elevation, bool(radar.fields.range_rate)])
    correlation = CorrelatedMisses(radar.detection_correlation, "correlation" in learn)
    speed = radar.clutter_map_speed if radar.clutter_map else 0.0
    found = (
        Sectors(),
        "detection" in learn and Detection(radar.max_range, speed),
        "noise" in learn and Noise.of(noise),
        "outliers" in learn and Outliers(),
        (correlation.learned or correlation.start) and correlation,
        "clutter" in learn and ClutterRate.beginning_with(radar.clutter_rate),
        ("clutter" in learn or radar.clutter_density) and _clutter_ranges(radar),
        radar.clutter_map and _clutter_map(radar),
        radar.clutter_amplitude == "learned" and Learned(threshold),
        Limit(),
        Bursts(),
        "multipath" in learn and Multipath(),
        radar.height_prior is not None and radar.fields.height and Pressure(*radar.air),
    )
    return tuple(factor for factor in found if isinstance(factor, Factor))


def _clutter_ranges(radar: RadarParameters) -> ClutterRanges:
    nearest, farthest = radar.min_range, radar.clutter_max_range
    limits = nearest if nearest < farthest else 0.0, farthest
    table = radar.clutter_density_range, radar.clutter_density
    return ClutterRanges.of_table("clutter" in radar.learn, limits, table)


def _clutter_map(radar: RadarParameters) -> ClutterMap:
    std = radar.range_std, math.radians(radar.azimuth_std_deg)
    moves, speed = bool(radar.pose.topic), radar.clutter_map_speed
    grid = GroundGrid.of_noise(*std, radar.max_range) if moves else PolarGrid.of_noise(*std)
    return ClutterMap(grid, speed=speed)


def _visibility(radar: RadarParameters) -> Visibility:
    edges, ranges, table = (
        radar.blind_sectors_deg,
        radar.detection_probability_range,
        radar.detection_probability,
    )
    if not isinstance(table, list):
        # A probability of 0 is that of the SNR bands.
        ranges, table = ([0.0], [table]) if table else ([], [])
    return Visibility(
        max_range=radar.max_range,
        min_range=radar.min_range,
        fov=_sector(radar.fov_deg[0], radar.fov_deg[1], radar.compass),
        blind=tuple(
            _sector(begin, end, radar.compass)
            for begin, end in zip(edges[::2], edges[1::2], strict=True)
        ),
        ranges=tuple(ranges),
        probabilities=tuple(table),
        clutter_max_range=radar.clutter_max_range,
    )


def _sector(begin_deg: float, end_deg: float, compass: bool) -> Coverage:
    """Return the azimuths from one to another, as the radar counts them."""
    width = end_deg - begin_deg
    if width != 360.0:
        width %= 360.0
    start = 90.0 - begin_deg - width if compass else begin_deg
    return Coverage(math.radians(start), min(math.radians(width), FULL_TURN))


def report_check(radar: RadarParameters) -> RadarReportCheck:
    """Return the checks of a radar's reports against its configuration."""
    visibility = _visibility(radar)
    whole = visibility.fov.width > FULL_TURN - TURN_TOLERANCE
    ground_known = (
        radar.height_prior is not None
        or radar.fields.height
        or radar.fields.elevation
        or not radar.named_fields
        or radar.assumed_height is not None
    )
    return RadarReportCheck(
        reports_sectors=radar.sectors > 1,
        sees_whole_turn=whole and not visibility.blind and not radar.rotation_s,
        lacks_ground_ranges=radar.rotation_s > SLOW_REVOLUTION
        and radar.max_range > FAR
        and not ground_known,
        may_be_radians=radar.named_fields
        and radar.azimuth_in_degrees
        and visibility.fov.width > 2.0 * RADIANS_AS_DEGREES,
        near=NEAR * radar.max_range,
    )
