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

from .checks import FIXED, name_or
from .radar_input import RadarInput
from .radar_parameters import AUTO, RADAR

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def site_of(values: Mapping[str, Any], name: str, plane: Plane | None) -> Site | None:
    """Return where a radar stands on the earth; None if it has a position in the plane."""
    geodetic = values[f"{name}.geodetic"]
    if plane is None or not geodetic:
        return None
    return Site(tuple(geodetic), plane, math.radians(values[f"{name}.yaw_deg"]))


def radar_model(values: Mapping[str, Any], name: str, site: Site | None) -> RadarModel:
    """Return how a radar detects and measures."""
    get = {member.name: values[f"{name}.{member.name}"] for member in RADAR}
    threshold = amplitude_density.threshold_for(get["false_alarm_probability"])
    range_std = _rounded(get["range_std"], get["range_step"])
    azimuth_std = math.radians(_rounded(get["azimuth_std_deg"], get["azimuth_step_deg"]))
    return RadarModel(
        name=name,
        position=tuple(get["position"]) if site is None else site.position,
        yaw=math.radians(get["yaw_deg"]) if site is None else site.yaw,
        range_std=range_std,
        azimuth_std=azimuth_std,
        visibility=_visibility(get),
        clutter_rate=START_RATE if get["clutter_rate"] == AUTO else get["clutter_rate"],
        clutter_count=ClutterCount() if get["clutter_rate"] == AUTO else None,
        clutter_max_range=get["clutter_max_range"],
        threshold=threshold,
        range_growth=get["range_std_growth"],
        rotation_s=get["rotation_s"],
        clutter_amplitude=_clutter_amplitude(get, threshold),
        clutter_map=_clutter_map(get, range_std, azimuth_std) if get["clutter_map"] else None,
        clutter_map_speed=get["clutter_map_speed"],
        range_rate=_range_rate(get),
        cluster_distance=get["cluster_distance"],
        height_reading=_height_reading(radar_input(values, name, site)),
    )


def _height_reading(layout: RadarInput) -> HeightReading | None:
    """Return how ranges depend on heights; None where elevations tell, or nothing."""
    if not layout.height_field or layout.elevation_field:
        return None
    return HeightReading(layout.height, layout.datum, layout.site, layout.assumed_height)


def _range_rate(get: Mapping[str, Any]) -> RangeRateModel | None:
    if not get["fields.range_rate"]:
        return None
    return RangeRateModel(
        get["range_rate_std"], get["range_rate_ambiguity"], get["range_rate_span"]
    )


def _clutter_map(get: Mapping[str, Any], range_std: float, azimuth_std: float) -> ClutterMap:
    if get["pose"] == FIXED:
        return ClutterMap(PolarGrid.of_noise(range_std, azimuth_std))
    return ClutterMap(GroundGrid.of_noise(range_std, azimuth_std, get["max_range"]))


def _clutter_amplitude(get: Mapping[str, Any], threshold: float) -> ClutterAmplitude:
    if get["clutter_amplitude"] == "learned":
        return Learned(threshold)
    if get["clutter_amplitude"] == "log_normal":
        return LogNormal(get["clutter_level_db"], get["clutter_std_db"])
    return Rayleigh(amplitude_density.snr_from_db(get["clutter_level_db"]))


def _rounded(std: float, step: float) -> float:
    """Return a standard deviation after rounding to multiples of `step`."""
    return math.hypot(std, step / math.sqrt(12.0)) if step else std


def _visibility(get: Mapping[str, Any]) -> Visibility:
    table = np.reshape(get["detection_probability_over_range"], (-1, 2))
    if get["detection_probability"]:
        table = np.array([[0.0, get["detection_probability"]]])
    compass = get["azimuth_convention"] == "compass_cw"
    return Visibility(
        max_range=get["max_range"],
        min_range=get["min_range"],
        fov=_sector(get["fov_deg"][0], get["fov_deg"][1], compass),
        blind=tuple(
            _sector(begin, end, compass)
            for begin, end in np.reshape(get["blind_sectors_deg"], (-1, 2))
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


def radar_input(values: Mapping[str, Any], name: str, site: Site | None) -> RadarInput:
    """Return the layout of a radar's messages."""
    get = {member.name: values[f"{name}.{member.name}"] for member in RADAR}
    return RadarInput(
        name=name,
        topic=name_or(values, name, "topic"),
        frame=name_or(values, name, "frame"),
        message=get["message"],
        range_field=get["fields.range"],
        azimuth_field=get["fields.azimuth"],
        elevation_field=get["fields.elevation"],
        amplitude_field=get["fields.amplitude"],
        amplitude_in_db=get["amplitude_unit"] == "db",
        amplitude_offset_db=get["amplitude_offset_db"],
        compass=get["azimuth_convention"] == "compass_cw",
        azimuth_in_degrees=get["azimuth_unit"] == "deg",
        max_range=get["max_range"],
        time_field=get["fields.time"],
        time_unit_s=TIME_UNITS[get["time_unit"]],
        time_since_epoch=get["time_reference"] == "epoch",
        sector_field=get["fields.sector"],
        height_field=get["fields.height"],
        height=get["height"] if site is None else site.geodetic[2] - values["world_origin"][2],
        datum=values["world_origin"][2] if values["world_origin"] else 0.0,
        site=site,
        assumed_height=get["assumed_height"][0] if get["assumed_height"] else math.nan,
        code_field=get["fields.code"],
        address_field=get["fields.address"],
        kind_field=get["fields.kind"],
        range_std_field=get["fields.range_std"],
        azimuth_std_field=get["fields.azimuth_std"],
        range_rate_field=get["fields.range_rate"],
        range_rate_std_field=get["fields.range_rate_std"],
        range_rate_ambiguity=get["range_rate_ambiguity"],
        rotation_s=get["rotation_s"],
        sectors=get["sectors"],
        pose_topic="" if get["pose"] == FIXED else get["pose"],
        pose_message=get["pose_message"],
        pose_yaw=get["pose_yaw"],
        pose_max_age_s=get["pose_max_age_s"],
        pose_max_speed=get["pose_max_speed"],
        bias=_bias(get),
    )


def _bias(get: Mapping[str, Any]) -> RadarBias:
    compass = get["azimuth_convention"] == "compass_cw"
    return RadarBias(
        get["range_bias"],
        get["range_gain"],
        math.radians(get["azimuth_bias_deg"]) * _sense(compass, get["message"]),
        get["time_offset_s"],
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
    track = PoseTrack(radar.pose_yaw, radar.pose_max_age_s, radar.pose_max_speed, reset_threshold_s)
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
