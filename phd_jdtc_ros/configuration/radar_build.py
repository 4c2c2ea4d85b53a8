"""A radar's model, input and what else follows from its parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from phd_jdtc_ros.core.clutter.amplitude_law import ClutterAmplitude, Learned, LogNormal, Rayleigh
from phd_jdtc_ros.core.clutter.grid import GroundGrid, PolarGrid
from phd_jdtc_ros.core.clutter.map import ClutterMap
from phd_jdtc_ros.core.clutter.rate import START_RATE, ClutterCount
from phd_jdtc_ros.core.intake.input_checks import FAR, SLOW_TURN, ReportWatch
from phd_jdtc_ros.core.intake.poses import Mount, Platform, PoseTrack
from phd_jdtc_ros.core.sensors.bias import RadarBias
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.sensors.range_rate import RangeRateModel
from phd_jdtc_ros.core.sensors.sensor import Sensor
from phd_jdtc_ros.core.sensors.site import Plane, Site
from phd_jdtc_ros.core.sensors.slant_range import HeightReading
from phd_jdtc_ros.core.sensors.visibility import TURN_TOLERANCE, Visibility
from phd_jdtc_ros.core.targets import amplitude_density
from phd_jdtc_ros.core.types import FULL_TURN, Coverage

from .checks import name_or
from .forms import clutter_of, pose_of
from .radar_input import RadarInput
from .radar_parameters import AUTO, USUAL_FIELDS, Radar
from .schema import build

# Standard deviation of the level of log-normal clutter, dB: that of sea and land at low angles.
CLUTTER_STD_DB = 6.0
# Width of the interval about zero in which false detections have range rates, m/s, where the radar
# measures them without ambiguity: that of road traffic and more.
RANGE_RATE_SPAN = 200.0
# A change between two poses is a jump above this speed, which no ship or vehicle has, m/s.
POSE_MAX_SPEED = 100.0
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def site_of(values: Mapping[str, Any], name: str, plane: Plane | None) -> Site | None:
    """Return where a radar stands on the earth; None if it has a position in the plane."""
    geodetic = values[f"{name}.geodetic"]
    if plane is None or not geodetic:
        return None
    return Site(tuple(geodetic), plane, math.radians(values[f"{name}.yaw_deg"]))


def radar_model(values: Mapping[str, Any], name: str, site: Site | None) -> RadarModel:
    """Return how a radar detects and measures."""
    own = build(Radar, values, f"{name}.")
    threshold = amplitude_density.threshold_for(own.false_alarm_probability)
    azimuth_std = math.radians(own.azimuth_std_deg)
    return RadarModel(
        name=name,
        position=(own.position[0], own.position[1]) if site is None else site.position,
        yaw=math.radians(own.yaw_deg) if site is None else site.yaw,
        range_std=own.range_std,
        azimuth_std=azimuth_std,
        visibility=_visibility(own),
        clutter_rate=START_RATE if own.clutter_rate == AUTO else float(own.clutter_rate),
        clutter_count=ClutterCount() if own.clutter_rate == AUTO else None,
        clutter_max_range=own.clutter_max_range,
        threshold=threshold,
        range_growth=own.range_std_growth,
        rotation_s=own.rotation_s,
        clutter_amplitude=_clutter_amplitude(own, threshold),
        clutter_map=_clutter_map(own, azimuth_std) if own.clutter_map else None,
        clutter_map_speed=own.clutter_map_speed,
        range_rate=_range_rate(own),
        cluster_distance=own.cluster_distance,
        height_reading=_height_reading(radar_input(values, name, site)),
    )


def _height_reading(layout: RadarInput) -> HeightReading | None:
    """Return how ranges depend on heights; None where elevations tell, or nothing."""
    if not layout.height_field or layout.elevation_field:
        return None
    return HeightReading(layout.height, layout.datum, layout.site, layout.assumed_height)


def _range_rate(own: Radar) -> RangeRateModel | None:
    if not own.fields.get("range_rate"):
        return None
    return RangeRateModel(own.range_rate_std, own.range_rate_ambiguity, RANGE_RATE_SPAN)


def _clutter_map(own: Radar, azimuth_std: float) -> ClutterMap:
    if not pose_of(own.pose)[0]:
        return ClutterMap(PolarGrid.of_noise(own.range_std, azimuth_std))
    return ClutterMap(GroundGrid.of_noise(own.range_std, azimuth_std, own.max_range))


def _clutter_amplitude(own: Radar, threshold: float) -> ClutterAmplitude:
    law, level_db = clutter_of(own.clutter_amplitude)
    if law == "learned":
        return Learned(threshold)
    if law == "log_normal":
        return LogNormal(level_db, CLUTTER_STD_DB)
    return Rayleigh(amplitude_density.snr_from_db(level_db))


def _visibility(own: Radar) -> Visibility:
    given = own.detection_probability
    pairs = given if isinstance(given, list) else [0.0, given] if given else []
    table = np.reshape(pairs, (-1, 2))
    compass = own.azimuth_convention == "compass_cw"
    return Visibility(
        max_range=own.max_range,
        min_range=own.min_range,
        fov=_sector(own.fov_deg[0], own.fov_deg[1], compass),
        blind=tuple(
            _sector(begin, end, compass)
            for begin, end in np.reshape(own.blind_sectors_deg, (-1, 2))
        ),
        ranges=tuple(table[:, 0].tolist()),
        probabilities=tuple(table[:, 1].tolist()),
    )


def _sector(begin_deg: float, end_deg: float, compass: bool) -> Coverage:
    """Return the azimuths from one to another, as the radar counts them."""
    width = end_deg - begin_deg
    if width != 360.0:
        width %= 360.0
    start = 90.0 - begin_deg - width if compass else begin_deg
    return Coverage(math.radians(start), min(math.radians(width), FULL_TURN))


def fields_of(values: Mapping[str, Any], name: str) -> dict[str, str]:
    """Return the names of a cloud's fields by quantity; of those that are not used none or ''."""
    return {**USUAL_FIELDS, **build(Radar, values, f"{name}.").fields}


def radar_input(values: Mapping[str, Any], name: str, site: Site | None) -> RadarInput:
    """Return the layout of a radar's messages."""
    own = build(Radar, values, f"{name}.")
    fields = {**USUAL_FIELDS, **own.fields}
    pose_topic, pose_message, pose_yaw = pose_of(own.pose)
    antenna = [*own.position, 0.0][2]
    return RadarInput(
        name=name,
        topic=name_or(values, name, "topic"),
        frame=name_or(values, name, "frame"),
        message=own.message,
        range_field=fields.get("range", ""),
        azimuth_field=fields.get("azimuth", ""),
        elevation_field=fields.get("elevation", ""),
        amplitude_field=fields.get("amplitude", ""),
        amplitude_in_db=own.amplitude_unit == "db",
        amplitude_offset_db=own.amplitude_offset_db,
        compass=own.azimuth_convention == "compass_cw",
        azimuth_in_degrees=own.azimuth_unit == "deg",
        max_range=own.max_range,
        time_field=fields.get("time", ""),
        time_unit_s=TIME_UNITS[own.time_unit],
        time_since_epoch=own.time_reference == "epoch",
        sector_field=fields.get("sector", ""),
        height_field=fields.get("height", ""),
        height=antenna if site is None else site.geodetic[2] - values["world_origin"][2],
        datum=values["world_origin"][2] if values["world_origin"] else 0.0,
        site=site,
        assumed_height=own.assumed_height[0] if own.assumed_height else math.nan,
        code_field=fields.get("code", ""),
        address_field=fields.get("address", ""),
        kind_field=fields.get("kind", ""),
        range_std_field=fields.get("range_std", ""),
        azimuth_std_field=fields.get("azimuth_std", ""),
        range_rate_field=fields.get("range_rate", ""),
        range_rate_std_field=fields.get("range_rate_std", ""),
        range_rate_ambiguity=own.range_rate_ambiguity,
        rotation_s=own.rotation_s,
        sectors=own.sectors,
        pose_topic=pose_topic,
        pose_message=pose_message,
        pose_yaw=pose_yaw,
        pose_max_age_s=own.pose_max_age_s,
        bias=_bias(own),
    )


def _bias(own: Radar) -> RadarBias:
    compass = own.azimuth_convention == "compass_cw"
    return RadarBias(
        own.range_bias,
        own.range_gain,
        math.radians(own.azimuth_bias_deg) * _sense(compass, own.message),
        own.time_offset_s,
    )


def _sense(compass: bool, message: str) -> float:
    """Return -1 for azimuths that are clockwise, else 1; radar_scan's definition fixes it."""
    return -1.0 if compass and message == "point_cloud" else 1.0


def bias_parameters(radar: RadarInput, bias: RadarBias) -> dict[str, float]:
    """Return the parameters of a radar with these systematic errors, by dotted name."""
    sense = _sense(radar.compass, radar.message)
    return {
        f"{radar.name}.range_bias": bias.range_bias,
        f"{radar.name}.range_gain": bias.range_gain,
        f"{radar.name}.azimuth_bias_deg": math.degrees(bias.azimuth) * sense,
        f"{radar.name}.time_offset_s": bias.time_offset_s,
    }


def platform_of(radar: RadarInput, model: Sensor, reset_threshold_s: float) -> Platform | None:
    """Return what carries a radar; None if it stands."""
    if not radar.pose_topic:
        return None
    track = PoseTrack(radar.pose_yaw, radar.pose_max_age_s, POSE_MAX_SPEED, reset_threshold_s)
    return Platform(track, Mount(model.position, model.yaw))


def watch_of(radar: RadarInput, model: RadarModel) -> ReportWatch:
    """Return what compares a radar's reports with its configuration."""
    whole = model.visibility.fov.width > FULL_TURN - TURN_TOLERANCE
    ground_known = (
        radar.height_field
        or radar.elevation_field
        or radar.message != "point_cloud"
        or not math.isnan(radar.assumed_height)
    )
    return ReportWatch(
        by_sectors=radar.sectors > 1,
        whole_turn=whole and not model.visibility.blind and not radar.rotation_s,
        slant_ranges=radar.rotation_s > SLOW_TURN and radar.max_range > FAR and not ground_known,
    )
