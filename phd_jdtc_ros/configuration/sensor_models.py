"""The models that the parameters of sensors describe, and checks of these parameters together.

First radars, then sensors of positions, then receivers of self-reports. Degrees and decibels are
converted here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields, replace
from itertools import pairwise

import numpy as np

from phd_jdtc_ros.core import factors
from phd_jdtc_ros.core.intake.input_checks import (
    FAR,
    RADIANS_AS_DEGREES,
    SLOW_REVOLUTION,
    RadarReportCheck,
)
from phd_jdtc_ros.core.sensors import wgs84
from phd_jdtc_ros.core.sensors.gaussians import SPAN, UNKNOWN_STD, HeightPrior, ReportedHeights
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.sensors.position import PositionSensor, WatchedArea, farthest
from phd_jdtc_ros.core.sensors.range_rate import RangeRateModel, VelocityModel
from phd_jdtc_ros.core.sensors.site import LEAST_STD, MAX_SITE_DISTANCE, HeightProjection
from phd_jdtc_ros.core.sensors.spatial_radar import SpatialRadar
from phd_jdtc_ros.core.sensors.visibility import TURN_TOLERANCE, Visibility
from phd_jdtc_ros.core.state_space import SPATIAL
from phd_jdtc_ros.core.targets import amplitude_density
from phd_jdtc_ros.core.types import FULL_TURN, Coverage

from .parameters.place_forms import FIXED, TF
from .parameters.position import PositionParameters
from .parameters.radar import QUANTITIES, RadarParameters
from .parameters.reports import ReportsParameters
from .parameters.sensor import SensorParameters
from .parameters.tracker import PHD, SPACE, USUAL, Parts


def _visibility_faults(radar: RadarParameters, parts: Parts) -> Iterator[str]:
    name, (begin, end), edges = radar.name, radar.fov_deg, radar.blind_sectors_deg
    if begin == end or abs(end - begin) > 360.0:
        yield f"{name}.fov_deg: [{begin}, {end}] given, must be two azimuths at most a turn apart"
    if len(edges) % 2 or any(map(float.__eq__, edges[::2], edges[1::2])):
        yield f"{name}.blind_sectors_deg: {edges} given, must be pairs of two different azimuths"
    near, far = radar.min_range, radar.max_range
    if near >= far:
        yield f"{name}.min_range: {near} given, must be below max_range, {far}"
    if radar.clutter_max_range > far:
        yield (
            f"{name}.clutter_max_range: {radar.clutter_max_range:g} given, must be at most "
            f"max_range, {far:g}, beyond which detections are ignored"
        )


def _tables(radar: RadarParameters, parts: Parts) -> Iterator[str]:
    """Yield the faults of what is given by range."""
    detection, density = radar.detection_probability, radar.clutter_density
    for name, what, given, ranges in (
        ("detection_probability", "probabilities", detection, radar.detection_probability_range),
        ("clutter_density", "densities", density, radar.clutter_density_range),
    ):
        key = f"{radar.name}.{name}_range"
        if not all(near < far for near, far in pairwise(ranges)):
            yield f"{key}: {ranges} given, must be ascending"
        elif isinstance(given, list) and len(ranges) != len(given):
            yield f"{key}: {ranges} given, must be a range for each of {len(given)} {what}"


def _clutter(radar: RadarParameters, parts: Parts) -> Iterator[str]:
    if parts.tracking.region is not None and "clutter" in radar.learn:
        yield (
            f"{radar.name}.learn: clutter given, must be left out with a region: the rate is that "
            "of the radar's whole field, of which a part is used"
        )


def _revolutions(radar: RadarParameters, parts: Parts) -> Iterator[str]:
    name = radar.name
    if radar.sectors and not radar.rotation_s:
        yield f"{name}.rotation_s: 0 given, must be above 0 with sectors"
    if radar.fields.sector and not radar.sectors:
        yield f"{name}.sectors: 0 given, must be above 0 with fields.sector"


def _beyond_the_paper(radar: RadarParameters, parts: Parts) -> Iterator[str]:
    """Yield a fault for each setting that the paper's PHD filters do not have."""
    # The quantities of a detection in the paper, with their own noise.
    paper_quantities = ("range", "azimuth", "amplitude", "range_std", "azimuth_std")
    engine = parts.tracking.engine
    if engine not in PHD:
        return
    given = (
        (radar.learn, "learn", "[]"),
        (radar.sectors, "sectors", "0"),
        (radar.rotation_s, "rotation_s", "0"),
        (radar.clutter_map and "true", "clutter_map", "false"),
        (radar.clutter_amplitude == "learned" and "learned", "clutter_amplitude", "rayleigh"),
        (radar.clutter_density, "clutter_density", "[]"),
        (radar.detection_correlation, "detection_correlation", "0"),
        *(
            (field and repr(field), f"fields.{quantity}", "''")
            for quantity in QUANTITIES
            if quantity not in paper_quantities
            for field in (getattr(radar.fields, quantity),)
        ),
    )
    for value, name, allowed in given:
        if value:
            yield f"{radar.name}.{name}: {value} given, must be {allowed} with engine {engine}"


def _fields(radar: RadarParameters, parts: Parts) -> Iterator[str]:
    return _repeated_fields(radar, parts) if radar.named_fields else iter(())


def _repeated_fields(sensor: SensorParameters, parts: Parts) -> Iterator[str]:
    """Yield a fault for each quantity of a cloud whose field another quantity has too."""
    taken: dict[str, str] = {}
    for quantity, field in vars(sensor.fields).items():
        key = f"{sensor.name}.fields.{quantity}"
        if field and field in taken:
            yield f"{key}: {field!r} given, {taken[field]} has it too"
        elif field:
            taken[field] = key


def _range_rates(radar: RadarParameters, parts: Parts) -> Iterator[str]:
    interval, std = radar.range_rate_ambiguity, radar.range_rate_std
    field = radar.fields.range_rate
    # Within a smaller interval, in standard deviations, all range rates are equally likely.
    least = 4.0
    if field and 0.0 < interval < least * std:
        yield (
            f"{radar.name}.range_rate_ambiguity: {interval:g} given, must be 0 or at least "
            f"{least:g} times range_rate_std, {std:g}"
        )
    if radar.fields.range_rate_std and not field:
        yield f"{radar.name}.fields.range_rate: '' given, must be a name with range_rate_std"


def _pose(radar: RadarParameters | PositionParameters, parts: Parts) -> Iterator[str]:
    """Yield the faults of the poses of a sensor's platform."""
    key, (topic, message, _) = f"{radar.name}.pose", radar.pose
    detections = {other.topic: other.name for other in parts.sensors.values()}
    first = next((other for other in parts.sensors.values() if other.pose.topic), radar)
    if topic and topic in detections:
        yield f"{key}: {topic!r} given, {detections[topic]} has its detections there"
    elif topic and message != first.pose.message:
        yield f"{key}: {message} given, must be {first.pose.message} as that of {first.name}"
    if message == TF and (any(radar.position[:2]) or radar.yaw_deg):
        yield (
            f"{radar.name}.position: {[*radar.position[:2]]} with yaw_deg {radar.yaw_deg:g} given, "
            f"must be 0 with pose {TF}, which places the radar"
        )


def _place(radar: RadarParameters, parts: Parts) -> Iterator[str]:
    """Yield the faults of a place on the earth in combination with other parameters."""
    name, place, origin = radar.name, radar.geodetic, parts.tracking.world_origin
    if not place:
        if radar.assumed_height is not None:
            yield f"{name}.assumed_height: given without geodetic, must be empty"
        return
    if not origin:
        yield f"world_origin: [] given, must be a place on the earth, as {name}.geodetic is one"
    else:
        apart = math.dist(wgs84.to_cartesian(*place), wgs84.to_cartesian(*origin))
        if apart > MAX_SITE_DISTANCE:
            yield (
                f"{name}.geodetic: {place} given, is {apart / 1e3:.0f} km from world_origin, must "
                f"be at most {MAX_SITE_DISTANCE / 1e3:.0f} km"
            )
    if radar.position != (*USUAL.get(f"{name}.position", [0.0, 0.0]), 0.0):
        yield f"{name}.position: given beside geodetic, must be one of the two"
    if radar.pose.topic:
        yield (
            f"{name}.pose: {radar.pose.topic!r} given, must be {FIXED} with geodetic; a moving "
            "radar is where its platform's poses in world_frame are"
        )


def _faults_in_space(radar: RadarParameters, parts: Parts) -> Iterator[str]:
    """Yield the faults of elevations, and of what radars have only in the plane."""
    name, (low, high) = radar.name, radar.fov_elevation_deg
    if low >= high:
        yield f"{name}.fov_elevation_deg: [{low}, {high}] given, the second must be larger"
    if radar.fields.elevation_std and not radar.fields.elevation:
        yield f"{name}.fields.elevation: '' given, must be a name with elevation_std"
    tilted, in_space = any(radar.tilt_deg), parts.tracking.state == SPACE
    if tilted and (radar.geodetic or not in_space):
        where = "with geodetic" if radar.geodetic else f"without state: {SPACE}"
        yield f"{name}.tilt_deg: {radar.tilt_deg} given, must be [0.0, 0.0] {where}"
    if not in_space:
        return
    moving_map = radar.clutter_map and bool(radar.pose.topic)
    given = (
        ("multipath" in radar.learn and radar.learn, "learn", "without multipath"),
        (moving_map and "true", "clutter_map", "false with a pose"),
        (radar.assumed_height is not None and radar.assumed_height, "assumed_height", "empty"),
        (not radar.named_fields and radar.message, "message", "point_cloud"),
    )
    for value, key, allowed in given:
        if value:
            yield f"{name}.{key}: {value} given, must be {allowed} with state: {SPACE}"


RADAR_CHECKS = (
    _faults_in_space,
    _tables,
    _clutter,
    _visibility_faults,
    _revolutions,
    _beyond_the_paper,
    _fields,
    _range_rates,
    _pose,
    _place,
)


# Width of the interval about zero that contains false range rates, m/s, for radars that measure
# range rates without ambiguity: road traffic with some margin.
RANGE_RATE_SPAN = 200.0


def radar_model(radar: RadarParameters) -> RadarModel:
    """Return the model of a radar's detections and measurements."""
    named = radar.fields
    model = RadarModel(
        name=radar.name,
        position=radar.site.position if radar.site else (radar.position[0], radar.position[1]),
        yaw=radar.site.yaw if radar.site else math.radians(radar.yaw_deg),
        range_std=radar.range_std,
        azimuth_std=math.radians(radar.azimuth_std_deg),
        visibility=_visibility(radar),
        clutter_rate=radar.clutter_rate,
        threshold=amplitude_density.threshold_for(radar.false_alarm_probability),
        rotation_s=radar.rotation_s,
        least_std=LEAST_STD if radar.site else RadarModel.least_std,
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


def radar_factors(radar: RadarParameters) -> tuple[factors.Factor, ...]:
    """Return what else is assumed of a radar's detections, in the order in which it applies."""
    learn = set(radar.learn)
    threshold = amplitude_density.threshold_for(radar.false_alarm_probability)
    # The components of a measurement, and the range rate.
    elevation = [] if radar.height_prior is None else [bool(radar.fields.elevation)]
    noise = np.array([True, True, *elevation, bool(radar.fields.range_rate)])
    correlation = factors.CorrelatedMisses(radar.detection_correlation, "correlation" in learn)
    speed = radar.clutter_map_speed if radar.clutter_map else 0.0
    found = (
        factors.Sectors(),
        "detection" in learn and factors.Detection(radar.max_range, speed),
        "noise" in learn and factors.Noise.of(noise),
        "outliers" in learn and factors.Outliers(),
        (correlation.learned or correlation.start) and correlation,
        "clutter" in learn and factors.ClutterRate.beginning_with(radar.clutter_rate),
        ("clutter" in learn or radar.clutter_density) and _clutter_ranges(radar),
        radar.clutter_map and _clutter_map(radar),
        radar.clutter_amplitude == "learned" and factors.Learned(threshold),
        factors.Limit(),
        factors.Bursts(),
        "multipath" in learn and factors.Multipath(),
        radar.height_prior is not None and radar.fields.height and factors.Pressure(*radar.air),
    )
    return tuple(factor for factor in found if isinstance(factor, factors.Factor))


def _clutter_ranges(radar: RadarParameters) -> factors.ClutterRanges:
    nearest, farthest = radar.min_range, radar.clutter_max_range
    limits = nearest if nearest < farthest else 0.0, farthest
    table = radar.clutter_density_range, radar.clutter_density
    return factors.ClutterRanges.of_table("clutter" in radar.learn, limits, table)


def _clutter_map(radar: RadarParameters) -> factors.ClutterMap:
    std = radar.range_std, math.radians(radar.azimuth_std_deg)
    if radar.pose.topic:
        grid: factors.GroundGrid | factors.PolarGrid = factors.GroundGrid.of_noise(
            *std, radar.max_range
        )
    else:
        grid = factors.PolarGrid.of_noise(*std)
    return factors.ClutterMap(grid, speed=radar.clutter_map_speed)


def _visibility(radar: RadarParameters) -> Visibility:
    edges, compass = radar.blind_sectors_deg, radar.units.compass
    ranges, table = radar.detection_probability_range, radar.detection_probability
    if not isinstance(table, list):
        # A probability of 0 is that of the SNR bands.
        ranges, table = ([0.0], [table]) if table else ([], [])
    return Visibility(
        max_range=radar.max_range,
        min_range=radar.min_range,
        fov=_sector(radar.fov_deg[0], radar.fov_deg[1], compass),
        blind=tuple(_sector(*ends, compass) for ends in zip(edges[::2], edges[1::2], strict=True)),
        ranges=tuple(ranges),
        probabilities=tuple(table),
        clutter_max_range=radar.clutter_max_range,
        clutter_ranges=tuple(radar.clutter_density_range),
        clutter_density=tuple(radar.clutter_density),
    )


def _sector(begin_deg: float, end_deg: float, compass: bool) -> Coverage:
    """Return the azimuths from one to another, as the radar counts them."""
    width = end_deg - begin_deg
    if width != 360.0:
        width %= 360.0
    start = 90.0 - begin_deg - width if compass else begin_deg
    return Coverage(math.radians(start), min(math.radians(width), FULL_TURN))


def radar_report_check(radar: RadarParameters) -> RadarReportCheck:
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
        unit=(math.radians(1.0) if radar.units.in_degrees else 1.0)
        if radar.named_fields and visibility.fov.width > 2.0 * RADIANS_AS_DEGREES
        else 0.0,
        zero=0.5 * math.pi if radar.units.compass else 0.0,
        # Share of its range within which no radar has all detections, unless they are not in
        # metres.
        near=0.002 * radar.max_range,
    )


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


def _coordinates(own: PositionParameters, parts: Parts) -> Iterator[str]:
    """Yield the faults of the fields of positions and velocities."""
    for what in ("x", "y"):
        if not getattr(own.fields, what):
            yield f"{own.name}.fields.{what}: '' given, must be a name"
    for one, other in (("vx", "vy"), ("vy", "vx")):
        if getattr(own.fields, one) and not getattr(own.fields, other):
            yield f"{own.name}.fields.{other}: '' given, must be a name with fields.{one}"


def _only_radars(own: SensorParameters, parts: Parts) -> Iterator[str]:
    """Yield the fault of a sensor that the paper's PHD filters do not have."""
    if (engine := parts.tracking.engine) in PHD:
        yield f"{own.name}.kind: {own.kind} given, must be radar with engine {engine}"


POSITION_CHECKS = (_only_radars, _coordinates, _pose, _repeated_fields)


def _obliged(own: ReportsParameters, parts: Parts) -> Iterator[str]:
    for name in own.obliged:
        if name not in parts.classes:
            known = ", ".join(parts.classes)
            yield f"{own.name}.obliged: {name!r} given, must be among classes {known}"


def _heard_area(own: ReportsParameters, parts: Parts) -> Iterator[str]:
    count = len(own.coverage)
    if count and (count % 2 or count < 6):
        yield (
            f"{own.name}.coverage: {count} numbers given, must be x and y of at least three corners"
        )


REPORTS_CHECKS = (_only_radars, _obliged, _heard_area)
