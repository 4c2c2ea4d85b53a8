"""The models that parameters describe, and checks of all parameters together.

Degrees and decibels are converted here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace

import numpy as np

from phd_jdtc_ros.core.factors.transponder import (
    ADDRESSES,
    CODES,
    AttributeModel,
    HeightModel,
    IdentityModel,
)
from phd_jdtc_ros.core.intake.posed_reports import Platform
from phd_jdtc_ros.core.intake.poses import Mount, PoseTrack
from phd_jdtc_ros.core.models.amplitude_model import AmplitudeModel, Band, Ignored, Memory
from phd_jdtc_ros.core.models.detection_birth import DetectionBirthModel
from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.models.zones import EXCLUSION, Zone
from phd_jdtc_ros.core.sensors.position import PositionSensor
from phd_jdtc_ros.core.sensors.sensor import Sensor
from phd_jdtc_ros.core.state_space import PLANAR, SPATIAL, StateSpace
from phd_jdtc_ros.core.targets import amplitude_density
from phd_jdtc_ros.core.targets.birth import BirthTerm, SpawnModel
from phd_jdtc_ros.core.targets.modes import ClassModel, ModeSpace
from phd_jdtc_ros.core.targets.motion import MOTIONS, MotionModel

from .parameters.reports import ReportsParameters
from .parameters.sensor import SensorParameters
from .parameters.tracker import LABELLED, PHD, SPACE, Birth, Motion, Parts, TargetClass, Tracking
from .tables import GROUPS, KINDS, TOP, model_of

Faults = Iterator[str]


def _names(parts: Parts) -> Faults:
    taken = {parameter.name.split(".")[0]: "a parameter" for parameter in TOP}
    for group in GROUPS:
        listed = getattr(parts.tracking, group)
        if not listed and group != "births":
            yield f"{group}: [] given, must name at least one"
        for name in listed:
            if "." in name or name in taken:
                reason = "must not contain a dot" if "." in name else f"is already {taken[name]}"
                yield f"{group}: {name!r} given, {reason}"
            taken[name] = f"one of {group}"


def _classes(parts: Parts) -> Faults:
    for name, own in parts.classes.items():
        low, high = own.snr_band_db
        # The bounds are compared as the likelihood does it: far below 0 dB, 1 + d rounds to 1 for
        # both.
        if not 1.0 + amplitude_density.snr_from_db(low) < 1.0 + amplitude_density.snr_from_db(high):
            yield f"{name}.snr_band_db: [{low}, {high}] given, the second must be larger"
        known = parts.tracking.motions
        if not own.motions or not set(own.motions) <= set(known):
            yield f"{name}.motions: {own.motions} given, must be among motions {known}"
        size, key, flat = len(own.motions), f"{name}.mode_transition", own.mode_transition
        if len(flat) != size**2:
            yield f"{key}: {len(flat)} numbers given, must be {size}x{size}, row by row"
        elif np.abs(np.reshape(flat, (size, size)).sum(axis=1) - 1.0).max(initial=0.0) > 1e-6:
            yield f"{key}: {flat} given, every row must sum to 1"


def _tracking(parts: Parts) -> Faults:
    # Fewer particles do not represent a target.
    least_per_target = 10
    top = parts.tracking
    if top.late_reports == "rework" and not top.lag.positive:
        yield "late_reports: 'rework' given with lag 0, needs a lag above 0"
    per_target, per_birth = top.particles
    if 0 < per_target < least_per_target:
        yield f"particles: {per_target} given, must be 0 or at least {least_per_target}"
    if per_birth & (per_birth - 1):
        yield f"particles: {per_birth} per birth term given, must be a power of two"
    confirm, delete = top.existence
    if 0.0 < confirm < delete and top.engine in LABELLED:
        yield (
            f"existence: [{confirm}, {delete}] given, the second must be at most the first, or 0"
        )
    if top.engine in PHD:
        yield from _beyond_the_paper(top)
    for code in top.shared_codes:
        if len(code) != 4 or set(code) - set("01234567"):
            yield f"shared_codes: {code[:10]!r} given, must be four octal digits"


def _beyond_the_paper(top: Tracking) -> Faults:
    """Yield a fault for each setting that the paper's PHD filters do not have."""
    for name, given, allowed in (
        ("late_reports", top.late_reports, ("drop",)),
        ("estimates_period_s", top.estimates_period_s, (0.0,)),
        ("detection_births.rates", top.birth_rates, ([],)),
        ("amplitude", top.amplitude, ("auto", "band", "none")),
        ("state", top.state, ("plane",)),
        ("conflicts.distance", [*filter(None, top.conflicts_distance)], ([],)),
        ("zones", top.zones, ("",)),
    ):
        if given not in allowed:
            words = " or ".join(map(str, allowed))
            yield f"{name}: {given} given, must be {words} with engine {top.engine}"


def _births(parts: Parts) -> Faults:
    top, count = parts.tracking, len(parts.classes)
    if len(top.birth_rates) not in (0, 1, count):
        yield (
            f"detection_births.rates: {top.birth_rates} given, must be empty, one number for all "
            f"classes, or {count} numbers, one per class"
        )
    for name, own in parts.births.items():
        if len(own.rates) != count or sum(own.rates) <= 0.0:
            yield (
                f"{name}.rates: {own.rates} given, must be {count} numbers, one per class, not all "
                "0"
            )
        elif top.engine in LABELLED and sum(own.rates) > 1.0:
            yield (
                f"{name}.rates: {own.rates} given, must sum to at most 1: but for engine phd a "
                "birth term is at most one target per scan"
            )


def _addresses(parts: Parts) -> Faults:
    for key in ("topic", "frame"):
        listed = parts.sensors | parts.receivers
        used = [getattr(sensor, key) for sensor in listed.values()]
        for name, own in zip(listed, used, strict=True):
            if used.count(own) > 1:
                yield f"{name}.{key}: {own!r} given, another sensor has it too"


def faults(parts: Parts) -> list[str]:
    """Return every fault of parameters that do not fit together."""
    checks = (_names, _classes, _tracking, _births, _addresses)
    found = [fault for check in checks for fault in check(parts)]
    every = [*parts.sensors.values(), *parts.receivers.values()]
    for kind, own in KINDS.items():
        sensors = [sensor for sensor in every if sensor.kind == kind]
        found += [fault for check in own.checks for each in sensors for fault in check(each, parts)]
    return found


# A pose that implies a larger speed is a jump, m/s: no ship or vehicle is as fast.
POSE_MAX_SPEED = 100.0
# Random step of ln(1 + SNR) per interval, if each target's own SNR is estimated: the aspect of a
# target changes within some tens of scans.
AMPLITUDE_JITTER = 0.1
# Transponders reply almost always, and one reply in a hundred is garbled.
REPLY_PROBABILITY, GARBLED_PROBABILITY = 0.95, 0.01
# Mean time for which an aircraft keeps its code, s: it gets another one at a border of control.
CODE_KEPT_S = 1800.0
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
    velocity_std, turn_rate_std, climb_std = top.birth_std
    motions = {name: _motion(own, space) for name, own in parts.motions.items()}
    classes = tuple(_class(name, own, motions) for name, own in parts.classes.items())
    modes = ModeSpace(classes, top.interval_s)
    return TrackerModel(
        modes=modes,
        births=tuple(_birth(name, own, modes, top) for name, own in parts.births.items()),
        detection_births=DetectionBirthModel(
            rate=np.array(top.birth_rates_of(len(classes))),
            velocity_std=velocity_std,
            turn_rate_std=turn_rate_std,
            climb_std=climb_std,
            least_mass=top.birth_least_probability,
            excluded=tuple(zone for zone in zones if zone.kind == EXCLUSION),
        ),
        spawn=_spawn(top.spawn_rate, modes),
        amplitudes=_amplitudes(parts, inputs),
        radars=tuple(model_of(sensor) for sensor in inputs),
        factors={sensor.name: KINDS[sensor.kind].factors(sensor) for sensor in inputs},
        attributes=_attributes(parts),
        height_prior=top.height_prior if space.vertical else None,
        receivers=tuple(
            own.receiver([*parts.classes])
            for own in parts.receivers.values()
            if isinstance(own, ReportsParameters)
        ),
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
            # Probability that a reply's address is garbled: its parity excludes most of these.
            1e-4,
            # Mean time for which a track keeps its address, s: an address belongs to one aircraft,
            # but a track can have taken over another aircraft.
            kept_s=1e6,
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
    prior, climb_std = top.height_prior, top.birth_std[2]
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
    in_space, positions = sensor.height_prior is not None, isinstance(model, PositionSensor)
    pitch, roll = map(math.radians, sensor.tilt_deg)
    limits = sensor.pose_max_age_s, POSE_MAX_SPEED, reset_threshold_s
    track = PoseTrack(sensor.pose.yaw, *limits, in_space=in_space)
    mount = Mount(model.position, model.yaw)
    if in_space:
        mount = replace(mount, height=sensor.height, tilt=(pitch, roll))
    return Platform(track, mount, positions)
