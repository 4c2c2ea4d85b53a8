"""The models that parameters describe; degrees and decibels are converted here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields

import numpy as np

from phd_jdtc_ros.core.factors.transponder import (
    ADDRESSES,
    CODES,
    AttributeModel,
    HeightModel,
    IdentityModel,
)
from phd_jdtc_ros.core.intake.poses import Mount, Platform, PoseTrack
from phd_jdtc_ros.core.models.amplitude_model import AmplitudeModel, Band, Ignored, Memory
from phd_jdtc_ros.core.models.detection_birth import DetectionBirthModel
from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.models.zones import EXCLUSION, Zone
from phd_jdtc_ros.core.sensors.position import PositionSensor
from phd_jdtc_ros.core.sensors.sensor import Sensor
from phd_jdtc_ros.core.state_space import PLANAR, SPATIAL, StateSpace
from phd_jdtc_ros.core.targets import amplitude_density
from phd_jdtc_ros.core.targets.birth import BirthTerm
from phd_jdtc_ros.core.targets.modes import ClassModel, ModeSpace
from phd_jdtc_ros.core.targets.motion import MOTIONS, MotionModel
from phd_jdtc_ros.core.targets.spawn import SpawnModel

from .parameters.sensor import SensorParameters
from .parameters.tracker import LABELLED, SPACE, Birth, Motion, Parts, TargetClass, Tracking
from .sensor_kinds import KINDS

# A pose that implies a larger speed is a jump, m/s: no ship or vehicle is as fast.
POSE_MAX_SPEED = 100.0
# Random step of ln(1 + SNR) per interval, if each target's own SNR is estimated: the aspect of a
# target changes within some tens of scans.
AMPLITUDE_JITTER = 0.1
# Transponders reply almost always, and one reply in a hundred is garbled.
REPLY_PROBABILITY, GARBLED_PROBABILITY = 0.95, 0.01
# Probability that a reply's address is garbled: its parity excludes most of these.
ADDRESS_GARBLED_PROBABILITY = 1e-4
# Mean time for which an aircraft keeps its code, s: it gets another one at a border of control.
CODE_KEPT_S = 1800.0
# Mean time for which a track keeps its address, s: an address belongs to one aircraft, but a track
# can have taken over another aircraft.
ADDRESS_KEPT_S = 1e6
# Share of targets with a shared code: flights under visual rules, and emergencies.
SHARED_CODE_PROBABILITY = 0.2
# Probability of a reply in a false detection: replies to other interrogators.
CLUTTER_REPLY_PROBABILITY = 0.05
# Standard deviation of reported heights, m: they are in steps of 100 ft.
HEIGHT_STD = 7.6
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
    parts: Parts, inputs: Sequence[SensorParameters], zones: Sequence[Zone] = ()
) -> TrackerModel:
    """Return the models of targets and sensors."""
    top = parts.tracking
    space = SPATIAL if top.state == SPACE else PLANAR
    motions = {name: _motion(own, space) for name, own in parts.motions.items()}
    classes = tuple(_class(name, own, motions) for name, own in parts.classes.items())
    modes = ModeSpace(classes, top.interval_s)
    return TrackerModel(
        modes=modes,
        births=tuple(_birth(name, own, modes, top) for name, own in parts.births.items()),
        detection_births=DetectionBirthModel(
            rate=np.array(top.birth_rates_of(len(classes))),
            velocity_std=top.birth_velocity_std,
            turn_rate_std=top.birth_turn_rate_std,
            climb_std=top.birth_climb_std,
            least_mass=top.birth_least_probability,
            excluded=tuple(zone for zone in zones if zone.kind == EXCLUSION),
        ),
        spawn=_spawn(top.spawn_rate, modes),
        amplitudes=_amplitudes(parts, inputs),
        radars=tuple(KINDS[sensor.kind].model(sensor) for sensor in inputs),
        factors={sensor.name: KINDS[sensor.kind].factors(sensor) for sensor in inputs},
        attributes=_attributes(parts),
        height_prior=top.height_prior if space.vertical else None,
    )


def _attributes(parts: Parts) -> AttributeModel | None:
    """Return the model of identities and heights; None if no sensor reports any."""
    top, fields_of = parts.tracking, [sensor.fields for sensor in parts.sensors.values()]
    # In space a height is a measurement of the state.
    planar = top.state != SPACE
    reported = any(
        own.code or own.address or (own.height and planar) or own.detection_type
        for own in fields_of
    )
    if not reported or top.engine not in LABELLED:
        return None
    transponder = top.equipped_probability, REPLY_PROBABILITY
    shared = tuple(int(code, 8) for code in top.shared_codes)
    return AttributeModel(
        code=IdentityModel(
            CODES,
            *transponder,
            GARBLED_PROBABILITY,
            kept_s=CODE_KEPT_S,
            shared=shared,
            shared_probability=SHARED_CODE_PROBABILITY if shared else 0.0,
        ),
        address=IdentityModel(
            ADDRESSES,
            *transponder,
            ADDRESS_GARBLED_PROBABILITY,
            kept_s=ADDRESS_KEPT_S,
            unique=True,
        ),
        height=HeightModel(
            std=HEIGHT_STD,
            noise_density=HEIGHT_NOISE_DENSITY,
            climb_std=HEIGHT_CLIMB_STD,
            garbled=GARBLED_PROBABILITY,
        ),
        clutter_reply=CLUTTER_REPLY_PROBABILITY,
        ages=any(own.detection_type for own in fields_of),
        replies=any(own.code or own.address for own in fields_of),
    )


def _amplitudes(parts: Parts, inputs: Sequence[SensorParameters]) -> AmplitudeModel:
    use = parts.tracking.amplitude
    if use == "auto":
        # Without amplitudes nothing shows the SNR, and a PHD filter keeps none of a target.
        shown = any(own.fields.amplitude for own in inputs) and len(parts.classes) > 1
        use = "memory" if shown and parts.tracking.engine == "gaussian" else "band"
    if use == "memory":
        return Memory(AMPLITUDE_JITTER)
    return Band() if use == "band" else Ignored()


def _motion(own: Motion, space: StateSpace) -> MotionModel:
    kind = MOTIONS[own.model]
    used = {entry.name for entry in fields(kind)} & {entry.name for entry in fields(own)}
    return kind(space=space, **{name: getattr(own, name) for name in used})


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


def _birth(name: str, own: Birth, modes: ModeSpace, top: Tracking) -> BirthTerm:
    prior, climb_std = top.height_prior, top.birth_climb_std
    position_std, velocity_std, turn_std = own.std
    return BirthTerm(
        name=name,
        mean=modes.space.state(own.position, own.velocity, 0.0, (prior.mean, 0.0)),
        std=modes.space.state(position_std, velocity_std, turn_std, (prior.std, climb_std)),
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
        std=modes.space.state(*SPAWN_STD, SPAWN_STD[:2]),
        particles_per_target=SPAWN_PARTICLES,
    )


def platform_of(
    sensor: SensorParameters, model: Sensor, reset_threshold_s: float
) -> Platform | None:
    """Return the platform of a sensor; None if the sensor does not move."""
    if not sensor.pose.topic:
        return None
    track = PoseTrack(sensor.pose.yaw, sensor.pose_max_age_s, POSE_MAX_SPEED, reset_threshold_s)
    positions = isinstance(model, PositionSensor)
    return Platform(track, Mount(model.position, model.yaw), positions)
