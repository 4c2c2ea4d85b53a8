"""The configuration: parameters are checked as a whole and turned into a tracker.

The tables of parameters are in `parameters` and `radar_parameters`; what becomes of a radar's is in
`radar_build`. Decibels and degrees are converted only in these two.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np

from phd_jdtc_ros.core.attributes.height import HeightModel
from phd_jdtc_ros.core.attributes.identity import ADDRESSES, CODES, IdentityModel
from phd_jdtc_ros.core.attributes.memory import AttributeModel
from phd_jdtc_ros.core.engine import Lag
from phd_jdtc_ros.core.gaussian.bounds import Bounds
from phd_jdtc_ros.core.intake.antenna import SHORTEST_S
from phd_jdtc_ros.core.intake.input_checks import ReportWatch
from phd_jdtc_ros.core.intake.poses import Platform
from phd_jdtc_ros.core.intake.scans import ScanGrouper
from phd_jdtc_ros.core.intake.turns import Turns
from phd_jdtc_ros.core.models.amplitude_model import AmplitudeModel, Band, Ignored, Memory
from phd_jdtc_ros.core.models.detection_birth import DetectionBirthModel
from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.smc.resampling import ParticleBudget
from phd_jdtc_ros.core.targets import amplitude_density
from phd_jdtc_ros.core.targets.birth import BirthTerm
from phd_jdtc_ros.core.targets.modes import ClassModel, ModeSpace
from phd_jdtc_ros.core.targets.motion import MOTIONS, MotionModel
from phd_jdtc_ros.core.targets.spawn import SpawnModel
from phd_jdtc_ros.core.tracks.common_stamp import Schedule
from phd_jdtc_ros.core.tracks.region import Region
from phd_jdtc_ros.core.tracks.reporting_rule import ReportingRule, rule_of

from . import replaced
from .accuracy import MOST_PARTICLES, bounds_of, budget_of, particles_per_detection
from .checks import CHECKS, square
from .forms import lag_of
from .parameters import GROUPS, LABELLED, engine_of, every_name, schema
from .radar_build import fields_of, platform_of, radar_input, radar_model, site_of, watch_of
from .radar_input import RadarInput
from .schema import ConfigError
from .schema import refused as schema_refused

# An address stays with its aircraft; but a track may have taken over another's.
ADDRESS_KEPT_S = 1e6
# A jump of the stamps back by more than this begins a new run.
RESET_THRESHOLD_SCANS = 3.0
# Random step of ln(1 + SNR) per interval, where every target's own SNR is estimated: slow, as an
# aspect that changes within some tens of scans.
AMPLITUDE_JITTER = 0.1
# Transponders answer almost always, and one reply in a hundred is garbled.
REPLY_PROBABILITY, GARBLED_PROBABILITY = 0.95, 0.01
# An aircraft gets another code at a border of control, some half hour apart.
CODE_KEPT_S = 1800.0
# One code in five is that of flights under visual rules or of an emergency.
SHARED_CODE_PROBABILITY = 0.2
# False detections with a reply are replies to other interrogators.
CLUTTER_REPLY_PROBABILITY = 0.05
# Vertical motion of air traffic: levelling off within some ten seconds, m^2/s^3, and climbs of some
# 2000 ft/min, m/s.
HEIGHT_NOISE_DENSITY, HEIGHT_CLIMB_STD = 1.0, 10.0
# What a target spawns begins beside it and moves as it does: m, m/s and rad/s about the parent.
SPAWN_STD = (10.0, 1.0, 1e-4)
SPAWN_PARTICLES = 100
# Probability that a spawned target has its parent's motion, and that it has another one.
SPAWN_SAME_MOTION, SPAWN_OTHER_MOTION = 0.9, 0.1


class Recursion(NamedTuple):
    """The parts of the particle engine that differ between its filters, by their names there."""

    corrector: str = "bernoulli"
    death_term: str = "bernoulli"
    extraction: str = "components"


# By the value of ``engine``, where they are not those of the labelled filter.
RECURSIONS = {
    "phd": Recursion("poisson"),
    "phd_as_printed": Recursion("poisson", "paper", "clusters"),
}


@dataclass(frozen=True)
class TrackerConfig:
    """A checked configuration.

    Parameters
    ----------
    values : dict
        Value of every parameter, given or default, in the order of the table.
    world_frame : str
    inputs : tuple of RadarInput
    model : TrackerModel
    engine : str
        One of `engines.ENGINES`.
    recursion : Recursion
        That of the particle engine.
    bounds : Bounds
        Those of the Gaussian engine.
    budget : ParticleBudget
        That of the particle engine.
    lag : Lag
    schedule : Schedule
        When estimates go out.
    rule : ReportingRule
        When tracks are reported.
    seed : int
    max_gap_s : float
        Longest time between consecutive scans of one run, seconds.
    reorder_s : float
        Longest time that scans are held back for radars that are behind, seconds.
    plane : Plane or None
        The map of the earth that the world frame is; None if it is a plane anywhere.
    late_reports : str
        One of `out_of_sequence.LATE_REPORTS`.
    region : Region or None
        What is taken in and reported; None for everything.
    """

    values: dict[str, Any]
    world_frame: str
    inputs: tuple[RadarInput, ...]
    model: TrackerModel
    engine: str
    recursion: Recursion
    bounds: Bounds
    budget: ParticleBudget
    lag: Lag
    schedule: Schedule
    rule: ReportingRule
    seed: int
    max_gap_s: float
    reorder_s: float = 0.0
    plane: Plane | None = None
    late_reports: str = "drop"
    region: Region | None = None

    @property
    def reset_threshold_s(self) -> float:
        """Smallest jump of the stamps back that begins a new run, seconds."""
        return RESET_THRESHOLD_SCANS * _slowest_s(self.values)

    @property
    def least_speed(self) -> float:
        """Speed of the slowest targets that are reported, m/s.

        Those that are slower are in the clutter maps of all radars.
        """
        radars = self.model.radars
        return min(0.0 if r.clutter_map is None else r.clutter_map_speed for r in radars)

    @property
    def answer_delay_s(self) -> float:
        """How much older than a report the last scan may be that is stepped because of it, s.

        It is 0 where the two have the same stamp. A report of a turning radar becomes scans of
        parts of a turn, and one of a radar whose clock is late an earlier scan.
        """
        parts = [
            radar.rotation_s / max(radar.sectors / 2.0, 4.0)
            for radar in self.inputs
            if radar.rotation_s
        ]
        late_s = max(radar.bias.time_offset_s for radar in self.inputs)
        return max(parts, default=0.0) + self.reorder_s + max(late_s, 0.0)

    def grouper(self) -> ScanGrouper:
        """Return a new grouper of the radars' reports into scans."""
        return ScanGrouper(
            len(self.inputs),
            self.reset_threshold_s,
            self.max_gap_s,
            self.reorder_s,
        )

    def turns(self) -> tuple[Turns, ...]:
        """Return what cuts each radar's reports, in the configured order; all new."""
        return tuple(
            Turns(
                *(radar.rotation_s, radar.sectors, radar.compass, self.reset_threshold_s),
                azimuth_bias=radar.bias.azimuth,
                # Without labels all targets are one row, and no part of them is passed alone.
                shortest_s=SHORTEST_S if self.rule.labelled else math.inf,
            )
            for radar in self.inputs
        )

    @property
    def carried(self) -> dict[str, list[int]]:
        """The radars that move, by the topic of the poses of what carries them."""
        radars: dict[str, list[int]] = {}
        for index, radar in enumerate(self.inputs):
            if radar.pose_topic:
                radars.setdefault(radar.pose_topic, []).append(index)
        return radars

    @property
    def pose_message(self) -> str:
        """What the poses of all platforms are."""
        return next((radar.pose_message for radar in self.inputs if radar.pose_topic), "odometry")

    def platforms(self) -> tuple[Platform | None, ...]:
        """Return what carries each radar, in the configured order, None for one that stands."""
        return tuple(
            platform_of(radar, model, self.reset_threshold_s)
            for radar, model in zip(self.inputs, self.model.radars, strict=True)
        )

    def watches(self) -> tuple[ReportWatch, ...]:
        """Return what watches each radar's reports, in the configured order; all new."""
        return tuple(map(watch_of, self.inputs, polar_radars(self.model.radars)))


def resolve(
    given: Mapping[str, Any], plane_about: Callable[[Sequence[float]], Plane] | None = None
) -> TrackerConfig:
    """Check a configuration and build the tracker's models and settings.

    Parameters
    ----------
    given : mapping of dotted name to value
        Parameters that are not given have their defaults.
    plane_about : callable of (latitude, longitude, height) or None
        Returns the map of the earth about ``world_origin``: `earth.SystemPlane`. None where places
        on the earth are of no use.

    Raises
    ------
    ConfigError
        With all faults.
    """
    table = schema(given)
    values: dict[str, Any] = {}
    faults = []
    for name, parameter in table.items():
        value = given.get(name, parameter.default)
        coerced = parameter.coerce(value)
        if coerced is None:
            faults.append(f"{name}: {value!r} given, must be {parameter.allowed}")
        values[name] = coerced
    faults += refused(given, table)
    if not faults:
        faults = [fault for check in CHECKS for fault in check(values)]
    if not faults and values["world_origin"] and plane_about is None:
        faults = ["world_origin: given, must be empty here: this is computed in the plane only"]
    if faults:
        raise ConfigError(faults)
    origin = values["world_origin"]
    return _build(values, plane_about(origin) if plane_about is not None and origin else None)


def refused(given: Mapping[str, Any], table: Collection[str]) -> list[str]:
    """Return a fault for each parameter that is no longer there or never was.

    Parameters
    ----------
    given : mapping of dotted name to value
    table : collection of str
        Names of all parameters.
    """
    known = every_name(table, given)
    return schema_refused(
        given, table, known, {**replaced.TRACKER, **replaced.NODE}, replaced.RADAR
    )


def _build(values: dict[str, Any], plane: Plane | None) -> TrackerConfig:
    sites = [site_of(values, name, plane) for name in values["sensors"]]
    motions = {name: _motion(values, name) for name in values["motions"]}
    classes = tuple(_class(values, name, motions) for name in values["classes"])
    modes = ModeSpace(classes, values["interval_s"])
    model = TrackerModel(
        modes=modes,
        births=tuple(_birth(values, name, modes) for name in values["births"]),
        detection_births=DetectionBirthModel(
            rate=np.array(values["detection_births.rates"] or [0.0] * len(classes)),
            velocity_std=values["detection_births.velocity_std"],
            turn_rate_std=values["detection_births.turn_rate_std"],
            particles=particles_per_detection(values),
            most=MOST_PARTICLES,
            least_mass=values["detection_births.least_probability"],
        ),
        spawn=_spawn(values, modes),
        amplitudes=_amplitudes(values),
        radars=tuple(map(radar_model, repeat(values), values["sensors"], sites)),
        attributes=_attributes(values),
    )
    return TrackerConfig(
        values=values,
        world_frame=values["world_frame"],
        inputs=tuple(map(radar_input, repeat(values), values["sensors"], sites)),
        model=model,
        engine=engine_of(values),
        recursion=RECURSIONS.get(values["engine"], Recursion()),
        bounds=bounds_of(values),
        budget=budget_of(values),
        lag=Lag(*lag_of(values["lag"])),
        schedule=Schedule(round(values["estimates_period_s"] * 1e9)),
        rule=rule_of(
            model,
            values["engine"] in LABELLED,
            values["confirm_probability"],
            values["delete_probability"],
            values["coasting_scans"],
        ),
        seed=values["seed"],
        max_gap_s=values["max_gap_scans"] * _slowest_s(values),
        reorder_s=values["reorder_s"],
        plane=plane,
        late_reports=values["late_reports"],
        region=_region(values),
    )


def _region(values: Mapping[str, Any]) -> Region | None:
    if not values["region"]:
        return None
    return Region(*values["region"])


def _slowest_s(values: Mapping[str, Any]) -> float:
    """Return the nominal interval or the longest turn, seconds: until all has been seen again."""
    turns = [values[f"{name}.rotation_s"] for name in values["sensors"]]
    return float(max([values["interval_s"], *turns]))


def _attributes(values: Mapping[str, Any]) -> AttributeModel | None:
    """Return the model of identities and heights; None where no radar reports any."""
    layouts = [fields_of(values, name) for name in values["sensors"]]
    identifying = ("code", "address", "height", "kind")
    if not any(layout.get(quantity) for layout in layouts for quantity in identifying):
        return None
    if values["engine"] not in LABELLED:
        return None
    common = {
        "equipped": values["equipped_probability"],
        "reply": REPLY_PROBABILITY,
        "garbled": GARBLED_PROBABILITY,
    }
    shared = tuple(int(code, 8) for code in values["shared_codes"])
    return AttributeModel(
        code=IdentityModel(
            CODES,
            kept_s=CODE_KEPT_S,
            shared=shared,
            shared_probability=SHARED_CODE_PROBABILITY if shared else 0.0,
            **common,
        ),
        address=IdentityModel(ADDRESSES, kept_s=ADDRESS_KEPT_S, unique=True, **common),
        height=HeightModel(
            std=values["height_std"],
            noise_density=HEIGHT_NOISE_DENSITY,
            climb_std=HEIGHT_CLIMB_STD,
            garbled=GARBLED_PROBABILITY,
        ),
        clutter_reply=CLUTTER_REPLY_PROBABILITY,
        ages=any(layout.get("kind") for layout in layouts),
    )


def _amplitudes(values: Mapping[str, Any]) -> AmplitudeModel:
    if values["amplitude"] == "memory":
        return Memory(AMPLITUDE_JITTER)
    return Band() if values["amplitude"] == "band" else Ignored()


def _motion(values: Mapping[str, Any], name: str) -> MotionModel:
    kind = MOTIONS[values[f"{name}.model"]]
    used = {field.name for field in fields(kind)}
    return kind(**{p.name: values[f"{name}.{p.name}"] for p in GROUPS["motions"] if p.name in used})


def _class(values: Mapping[str, Any], name: str, motions: dict[str, MotionModel]) -> ClassModel:
    low, high = values[f"{name}.snr_band_db"]
    matrix = square(values[f"{name}.mode_transition"])
    if matrix is None:
        raise ConfigError([f"{name}.mode_transition: not square"])
    return ClassModel(
        name=name,
        snr_band=(amplitude_density.snr_from_db(low), amplitude_density.snr_from_db(high)),
        motions=tuple(motions[motion] for motion in values[f"{name}.motions"]),
        mode_transition=matrix,
        survival_probability=values[f"{name}.survival_probability"],
    )


def _birth(values: Mapping[str, Any], name: str, modes: ModeSpace) -> BirthTerm:
    get = {member.name: values[f"{name}.{member.name}"] for member in GROUPS["births"]}
    motions_of_class = np.bincount(modes.class_of)
    rate = (np.array(get["rates"]) / motions_of_class)[modes.class_of]
    return BirthTerm(
        name=name,
        mean=modes.space.state(get["position"], get["velocity"], 0.0),
        std=modes.space.state(get["position_std"], get["velocity_std"], get["turn_rate_std"]),
        rate=rate,
    )


def _spawn(values: Mapping[str, Any], modes: ModeSpace) -> SpawnModel:
    motions_of_class = np.bincount(modes.class_of)
    to_mode = np.tile((1.0 / motions_of_class)[modes.class_of], (len(modes), 1))
    count = int(motions_of_class[0])
    if count > 1 and (motions_of_class == count).all():
        same_motion = np.full((count, count), SPAWN_OTHER_MOTION / (count - 1))
        np.fill_diagonal(same_motion, SPAWN_SAME_MOTION)
        to_mode = np.tile(same_motion, (len(modes.classes), len(modes.classes)))
    transition = to_mode * (1.0 / len(modes.classes))
    transition /= transition.sum(axis=1, keepdims=True)
    return SpawnModel(
        rate=values["spawn.rate"],
        transition=transition,
        std=modes.space.state(*SPAWN_STD),
        particles_per_target=SPAWN_PARTICLES,
    )
