"""The models that parameters describe; degrees and decibels are converted here."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace

import numpy as np

from phd_jdtc_ros.core.attributes.height import HeightModel
from phd_jdtc_ros.core.attributes.identity import ADDRESSES, CODES, IdentityModel
from phd_jdtc_ros.core.attributes.records import AttributeModel
from phd_jdtc_ros.core.clutter.amplitude_law import ClutterAmplitude, Learned, LogNormal, Rayleigh
from phd_jdtc_ros.core.clutter.grid import GroundGrid, PolarGrid
from phd_jdtc_ros.core.clutter.map import ClutterMap
from phd_jdtc_ros.core.clutter.multipath import Multipath
from phd_jdtc_ros.core.clutter.rate import ClutterCount
from phd_jdtc_ros.core.intake.input_checks import FAR, SLOW_TURN, ReportWatch
from phd_jdtc_ros.core.intake.poses import Mount, Platform, PoseTrack
from phd_jdtc_ros.core.learned.correlation import Correlation
from phd_jdtc_ros.core.learned.detection_factor import DetectionFactor
from phd_jdtc_ros.core.learned.noise_factor import NoiseFactor
from phd_jdtc_ros.core.models.amplitude_model import AmplitudeModel, Band, Ignored, Memory
from phd_jdtc_ros.core.models.detection_birth import DetectionBirthModel
from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.sensors.outliers import Outliers
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.sensors.range_rate import RangeRateModel
from phd_jdtc_ros.core.sensors.sensor import Sensor
from phd_jdtc_ros.core.sensors.site import Plane, Site
from phd_jdtc_ros.core.sensors.slant_range import HeightProjection
from phd_jdtc_ros.core.sensors.visibility import TURN_TOLERANCE, Visibility
from phd_jdtc_ros.core.targets import amplitude_density
from phd_jdtc_ros.core.targets.birth import BirthTerm
from phd_jdtc_ros.core.targets.modes import ClassModel, ModeSpace
from phd_jdtc_ros.core.targets.motion import MOTIONS, MotionModel
from phd_jdtc_ros.core.targets.spawn import SpawnModel
from phd_jdtc_ros.core.types import FULL_TURN, Coverage

from .parameters import LABELLED, Birth, Motion, Parts, TargetClass
from .radar_parameters import RadarParameters

# Standard deviation of the level of log-normal clutter, dB: sea and land at low grazing angles.
CLUTTER_STD_DB = 6.0
# Width of the interval about zero that contains false range rates, m/s, for radars that measure
# range rates without ambiguity: road traffic with some margin.
RANGE_RATE_SPAN = 200.0
# A pose that implies a larger speed is a jump, m/s: no ship or vehicle is as fast.
POSE_MAX_SPEED = 100.0
# Random step of ln(1 + SNR) per interval, if each target's own SNR is estimated: the aspect of a
# target changes within some tens of scans.
AMPLITUDE_JITTER = 0.1
# Transponders answer almost always, and one reply in a hundred is garbled.
REPLY_PROBABILITY, GARBLED_PROBABILITY = 0.95, 0.01
# Mean time for which an aircraft keeps its code, s: it gets another one at a border of control.
CODE_KEPT_S = 1800.0
# Mean time for which a track keeps its address, s: an address belongs to one aircraft, but a track
# can have taken over another aircraft.
ADDRESS_KEPT_S = 1e6
# Share of targets with a shared code: flights under visual rules, and emergencies.
SHARED_CODE_PROBABILITY = 0.2
# Probability of a reply in a false detection: replies to other interrogators.
CLUTTER_REPLY_PROBABILITY = 0.05
# Vertical motion of air traffic: levelling off within some ten seconds, m^2/s^3, and climbs of some
# 2000 ft/min, m/s.
HEIGHT_NOISE_DENSITY, HEIGHT_CLIMB_STD = 1.0, 10.0
# Standard deviations of a spawned target about its parent: m, m/s and rad/s.
SPAWN_STD = (10.0, 1.0, 1e-4)
SPAWN_PARTICLES = 100
# Probability that a spawned target has its parent's motion, and that it has another one, if its
# class has both.
SPAWN_SAME_MOTION, SPAWN_OTHER_MOTION = 0.9, 0.1


def tracker_model(
    parts: Parts, inputs: Sequence[RadarParameters], per_detection: int, most: int
) -> TrackerModel:
    """Return the models of targets and radars.

    `per_detection` are the particles per target born at a detection, and `most` all together.
    """
    top = parts.tracking
    motions = {name: _motion(own) for name, own in parts.motions.items()}
    classes = tuple(_class(name, own, motions) for name, own in parts.classes.items())
    modes = ModeSpace(classes, top.interval_s)
    return TrackerModel(
        modes=modes,
        births=tuple(_birth(name, own, modes) for name, own in parts.births.items()),
        detection_births=DetectionBirthModel(
            rate=np.array(top.birth_rates or [0.0] * len(classes)),
            velocity_std=top.birth_velocity_std,
            turn_rate_std=top.birth_turn_rate_std,
            particles=per_detection,
            most=most,
            least_mass=top.birth_least_probability,
        ),
        spawn=_spawn(top.spawn_rate, modes),
        amplitudes=_amplitudes(parts, inputs),
        radars=tuple(map(radar_model, inputs)),
        attributes=_attributes(parts),
    )


# --- targets --------------------------------------------------------------------------------------


def _attributes(parts: Parts) -> AttributeModel | None:
    """Return the model of identities and heights; None if no radar reports any."""
    top, fields_of = parts.tracking, [radar.fields for radar in parts.radars.values()]
    reported = any(own.code or own.address or own.height or own.kind for own in fields_of)
    if not reported or top.engine not in LABELLED:
        return None
    transponder = top.equipped_probability, REPLY_PROBABILITY, GARBLED_PROBABILITY
    shared = tuple(int(code, 8) for code in top.shared_codes)
    return AttributeModel(
        code=IdentityModel(
            CODES,
            *transponder,
            kept_s=CODE_KEPT_S,
            shared=shared,
            shared_probability=SHARED_CODE_PROBABILITY if shared else 0.0,
        ),
        address=IdentityModel(ADDRESSES, *transponder, kept_s=ADDRESS_KEPT_S, unique=True),
        height=HeightModel(
            std=top.height_std,
            noise_density=HEIGHT_NOISE_DENSITY,
            climb_std=HEIGHT_CLIMB_STD,
            garbled=GARBLED_PROBABILITY,
        ),
        clutter_reply=CLUTTER_REPLY_PROBABILITY,
        ages=any(own.kind for own in fields_of),
    )


def _amplitudes(parts: Parts, inputs: Sequence[RadarParameters]) -> AmplitudeModel:
    use = parts.tracking.amplitude
    if use == "auto":
        # Particles are too few for an SNR of each, and without amplitudes nothing shows the SNR.
        shown = any(own.fields.amplitude for own in inputs) and len(parts.classes) > 1
        use = "memory" if shown and parts.tracking.engine == "gaussian" else "band"
    if use == "memory":
        return Memory(AMPLITUDE_JITTER)
    return Band() if use == "band" else Ignored()


def _motion(own: Motion) -> MotionModel:
    kind = MOTIONS[own.model]
    used = {entry.name for entry in fields(kind)} & {entry.name for entry in fields(own)}
    return kind(**{name: getattr(own, name) for name in used})


def _class(name: str, own: TargetClass, motions: Mapping[str, MotionModel]) -> ClassModel:
    low, high = map(amplitude_density.snr_from_db, own.snr_band_db)
    size = len(own.motions)
    return ClassModel(
        name=name,
        snr_band=(low, high),
        motions=tuple(motions[motion] for motion in own.motions),
        mode_transition=np.reshape(own.mode_transition, (size, size)),
        survival_probability=own.survival_probability,
    )


def _birth(name: str, own: Birth, modes: ModeSpace) -> BirthTerm:
    return BirthTerm(
        name=name,
        mean=modes.space.state(own.position, own.velocity, 0.0),
        std=modes.space.state(own.position_std, own.velocity_std, own.turn_rate_std),
        rate=np.array(own.rates)[modes.class_of] * modes.motion_share,
    )


def _spawn(rate: float, modes: ModeSpace) -> SpawnModel:
    same = np.array([[of_child == own for of_child in modes.motions] for own in modes.motions])
    classes = np.eye(len(modes.classes))[modes.class_of]
    # Numbers of the motions of each mode's class that are the parent's, and that are not.
    like, unlike = ((found @ classes)[:, modes.class_of] for found in (same, ~same))
    to_mode = np.where(
        same,
        SPAWN_SAME_MOTION / np.maximum(like, 1.0),
        SPAWN_OTHER_MOTION / np.maximum(unlike, 1.0),
    )
    transition = to_mode / (to_mode @ classes)[:, modes.class_of] * (1.0 / len(modes.classes))
    transition /= transition.sum(axis=1, keepdims=True)
    return SpawnModel(
        rate=rate,
        transition=transition,
        std=modes.space.state(*SPAWN_STD),
        particles_per_target=SPAWN_PARTICLES,
    )


# --- radars ---------------------------------------------------------------------------------------


def on_earth(radar: RadarParameters, plane: Plane | None) -> RadarParameters:
    """Return a radar with its place on the earth, if the world has a map projection."""
    if plane is None:
        return radar
    place, yaw = radar.geodetic, math.radians(radar.yaw_deg)
    site = Site((place[0], place[1], place[2]), plane, yaw) if place else None
    return replace(radar, site=site, datum=plane.origin[2])


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


def platform_of(radar: RadarParameters, model: Sensor, reset_threshold_s: float) -> Platform | None:
    """Return the platform of a radar; None if the radar does not move."""
    if not radar.pose.topic:
        return None
    track = PoseTrack(radar.pose.yaw, radar.pose_max_age_s, POSE_MAX_SPEED, reset_threshold_s)
    return Platform(track, Mount(model.position, model.yaw))


def watch_of(radar: RadarParameters, model: Sensor) -> ReportWatch:
    """Return the checks of a radar's reports against its configuration; none for other kinds."""
    if not isinstance(model, RadarModel):
        return ReportWatch()
    whole = model.visibility.fov.width > FULL_TURN - TURN_TOLERANCE
    ground_known = (
        radar.fields.height
        or radar.fields.elevation
        or not radar.named_fields
        or radar.assumed_height is not None
    )
    return ReportWatch(
        by_sectors=radar.sectors > 1,
        whole_turn=whole and not model.visibility.blind and not radar.rotation_s,
        slant_ranges=radar.rotation_s > SLOW_TURN and radar.max_range > FAR and not ground_known,
    )
