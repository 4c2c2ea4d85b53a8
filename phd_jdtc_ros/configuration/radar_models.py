"""The models that a radar's parameters describe; degrees and decibels are converted here."""

from __future__ import annotations

import math

import numpy as np

from phd_jdtc_ros.core.clutter.amplitude_law import ClutterAmplitude, Learned, LogNormal, Rayleigh
from phd_jdtc_ros.core.clutter.grid import GroundGrid, PolarGrid
from phd_jdtc_ros.core.clutter.map import ClutterMap
from phd_jdtc_ros.core.clutter.multipath import Multipath
from phd_jdtc_ros.core.clutter.rate import ClutterCount
from phd_jdtc_ros.core.intake.input_checks import (
    FAR,
    RADIANS_AS_DEGREES,
    SLOW_TURN,
    ReportCheck,
)
from phd_jdtc_ros.core.learned.correlation import Correlation
from phd_jdtc_ros.core.learned.detection_factor import DetectionFactor
from phd_jdtc_ros.core.learned.noise_factor import NoiseFactor
from phd_jdtc_ros.core.learned.outliers import Outliers
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.sensors.range_rate import RangeRateModel
from phd_jdtc_ros.core.sensors.site import LEAST_STD
from phd_jdtc_ros.core.sensors.slant_range import HeightProjection
from phd_jdtc_ros.core.sensors.visibility import TURN_TOLERANCE, Visibility
from phd_jdtc_ros.core.targets import amplitude_density
from phd_jdtc_ros.core.types import FULL_TURN, Coverage

from .parameters.radar import RadarParameters

# Standard deviation of the level of log-normal clutter, dB: sea and land at low grazing angles.
CLUTTER_STD_DB = 6.0
# Width of the interval about zero that contains false range rates, m/s, for radars that measure
# range rates without ambiguity: road traffic with some margin.
RANGE_RATE_SPAN = 200.0
# Share of its range within which no radar has all detections, unless they are not in metres.
NEAR = 0.002


def radar_model(radar: RadarParameters) -> RadarModel:
    """Return the model of a radar's detections and measurements."""
    threshold = amplitude_density.threshold_for(radar.false_alarm_probability)
    range_std, azimuth_std = radar.range_std.start, math.radians(radar.azimuth_std_deg.start)
    rate, detection, fields = radar.clutter_rate, radar.detection_probability, radar.fields
    rate_std = radar.range_rate_std
    # In the order of `Sensor.noise_components`.
    of_rates = rate_std.learned and bool(fields.range_rate)
    learned = radar.range_std.learned, radar.azimuth_std_deg.learned, of_rates
    return RadarModel(
        name=radar.name,
        position=radar.site.position if radar.site else (radar.position[0], radar.position[1]),
        yaw=radar.site.yaw if radar.site else math.radians(radar.yaw_deg),
        range_std=range_std,
        azimuth_std=azimuth_std,
        visibility=_visibility(radar),
        clutter_rate=rate.start,
        clutter_count=ClutterCount() if rate.learned else None,
        clutter_max_range=radar.clutter_max_range,
        threshold=threshold,
        range_growth=radar.range_std_growth,
        rotation_s=radar.rotation_s,
        clutter_amplitude=_clutter_amplitude(radar, threshold),
        clutter_map=_clutter_map(radar, range_std, azimuth_std) if radar.clutter_map else None,
        clutter_map_speed=radar.clutter_map_speed,
        detection_factor=DetectionFactor(radar.max_range) if detection.learned else None,
        noise_factor=NoiseFactor(np.array(learned)) if any(learned) else None,
        correlation=Correlation(*detection.correlation) if detection.correlation else None,
        outliers=Outliers() if radar.range_std.outliers else None,
        multipath=Multipath() if rate.multipath else None,
        least_std=LEAST_STD if radar.site else (0.0, 0.0),
        range_rate=RangeRateModel(rate_std.start, radar.range_rate_ambiguity, RANGE_RATE_SPAN)
        if fields.range_rate
        else None,
        cluster_distance=radar.cluster_distance,
        height_projection=HeightProjection(
            radar.height, radar.datum, radar.site, radar.assumed_height
        )
        if fields.height and not fields.elevation
        else None,
    )


def _clutter_map(radar: RadarParameters, range_std: float, azimuth_std: float) -> ClutterMap:
    if not radar.pose.topic:
        return ClutterMap(PolarGrid.of_noise(range_std, azimuth_std))
    return ClutterMap(GroundGrid.of_noise(range_std, azimuth_std, radar.max_range))


def _clutter_amplitude(radar: RadarParameters, threshold: float) -> ClutterAmplitude:
    law, level_db = radar.clutter_amplitude
    if law == "learned":
        return Learned(threshold)
    if law == "log_normal":
        return LogNormal(level_db, CLUTTER_STD_DB)
    return Rayleigh(amplitude_density.snr_from_db(level_db))


def _visibility(radar: RadarParameters) -> Visibility:
    edges, table = radar.blind_sectors_deg, radar.detection_probability.start
    return Visibility(
        max_range=radar.max_range,
        min_range=radar.min_range,
        fov=_sector(radar.fov_deg[0], radar.fov_deg[1], radar.compass),
        blind=tuple(
            _sector(begin, end, radar.compass)
            for begin, end in zip(edges[::2], edges[1::2], strict=True)
        ),
        ranges=tuple(distance for distance, _ in table),
        probabilities=tuple(probability for _, probability in table),
    )


def _sector(begin_deg: float, end_deg: float, compass: bool) -> Coverage:
    """Return the azimuths from one to another, as the radar counts them."""
    width = end_deg - begin_deg
    if width != 360.0:
        width %= 360.0
    start = 90.0 - begin_deg - width if compass else begin_deg
    return Coverage(math.radians(start), min(math.radians(width), FULL_TURN))


def report_check(radar: RadarParameters) -> ReportCheck:
    """Return the checks of a radar's reports against its configuration."""
    visibility = _visibility(radar)
    whole = visibility.fov.width > FULL_TURN - TURN_TOLERANCE
    ground_known = (
        radar.fields.height
        or radar.fields.elevation
        or not radar.named_fields
        or radar.assumed_height is not None
    )
    return ReportCheck(
        reports_sectors=radar.sectors > 1,
        sees_whole_turn=whole and not visibility.blind and not radar.rotation_s,
        lacks_ground_ranges=radar.rotation_s > SLOW_TURN
        and radar.max_range > FAR
        and not ground_known,
        may_be_radians=radar.named_fields
        and radar.azimuth_in_degrees
        and visibility.fov.width > 2.0 * RADIANS_AS_DEGREES,
        near=NEAR * radar.max_range,
    )
