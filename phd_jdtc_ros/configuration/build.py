"""The configuration: parameters are checked as a whole and turned into a tracker.

The tables of parameters are in `parameters` and `radar_parameters`; what becomes of a radar's is in
`radar_build`. Decibels and degrees are converted only in these two.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import repeat
from typing import Any

import numpy as np

from phd_jdtc_ros.core.attributes.height import HeightModel
from phd_jdtc_ros.core.attributes.identity import ADDRESSES, CODES, IdentityModel
from phd_jdtc_ros.core.attributes.memory import AttributeModel
from phd_jdtc_ros.core.engine import Lag
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
from phd_jdtc_ros.core.smc.correction import CORRECTORS
from phd_jdtc_ros.core.targets import amplitude_density
from phd_jdtc_ros.core.targets.birth import BirthTerm
from phd_jdtc_ros.core.targets.modes import ClassModel, ModeSpace
from phd_jdtc_ros.core.targets.motion import MOTIONS, MotionModel
from phd_jdtc_ros.core.targets.spawn import SpawnModel
from phd_jdtc_ros.core.tracks.common_stamp import Schedule
from phd_jdtc_ros.core.tracks.region import Region
from phd_jdtc_ros.core.tracks.reporting_rule import ReportingRule, rule_of

from .checks import CHECKS, square
from .parameters import BIRTH, MOTION, REPLACED, schema
from .radar_build import platform_of, radar_input, radar_model, site_of, watch_of
from .radar_input import RadarInput
from .schema import ConfigError, unknown

# An address stays with its aircraft; but a track may have taken over another's.
ADDRESS_KEPT_S = 1e6
# A jump of the stamps back by more than this begins a new run.
RESET_THRESHOLD_SCANS = 3.0


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
    lag : Lag
    schedule : Schedule
        When estimates go out.
    rule : ReportingRule
        When tracks are reported.
    seed : int
    max_gap_s : float
        Longest time between consecutive scans of one run, seconds.
    reorder_scans : int
        Number of the newest scans that are held back for late reports.
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
    lag: Lag
    schedule: Schedule
    rule: ReportingRule
    seed: int
    max_gap_s: float
    reorder_scans: int
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
        return max(parts, default=0.0) + float(self.values["reorder_s"]) + max(late_s, 0.0)

    def grouper(self) -> ScanGrouper:
        """Return a new grouper of the radars' reports into scans."""
        return ScanGrouper(
            len(self.inputs),
            self.reset_threshold_s,
            self.max_gap_s,
            self.reorder_scans,
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
    faults += [_replaced(name) for name in given if name in REPLACED]
    faults += unknown((name for name in given if name not in REPLACED), table)
    if not faults:
        faults = [fault for check in CHECKS for fault in check(values)]
    if not faults and values["world_origin"] and plane_about is None:
        faults = ["world_origin: given, must be empty here: this is computed in the plane only"]
    if faults:
        raise ConfigError(faults)
    origin = values["world_origin"]
    return _build(values, plane_about(origin) if plane_about is not None and origin else None)


def _replaced(name: str) -> str:
    """Return what is wrong with a parameter that is no longer there."""
    return f"{name}: no longer a parameter, use {REPLACED[name]}"


def _build(values: dict[str, Any], plane: Plane | None) -> TrackerConfig:
    sites = [site_of(values, name, plane) for name in values["radars"]]
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
            particles=values["detection_births.particles"],
            most=values["max_particles"],
            least_mass=values["detection_births.least_probability"],
        ),
        spawn=_spawn(values, modes),
        amplitudes=_amplitudes(values),
        radars=tuple(map(radar_model, repeat(values), values["radars"], sites)),
        attributes=_attributes(values),
    )
    return TrackerConfig(
        values=values,
        world_frame=values["world_frame"],
        inputs=tuple(map(radar_input, repeat(values), values["radars"], sites)),
        model=model,
        engine=values["engine"],
        lag=Lag(values["lag"], values["lag_s"] or None),
        schedule=Schedule(round(values["estimates_period_s"] * 1e9)),
        rule=rule_of(
            model,
            CORRECTORS[values["corrector"]].labelled,
            values["confirm_probability"],
            values["delete_probability"],
            values["coasting_scans"],
        ),
        seed=values["seed"],
        max_gap_s=values["max_gap_scans"] * _slowest_s(values),
        reorder_scans=values["reorder_scans"],
        reorder_s=values["reorder_s"],
        plane=plane,
        late_reports=values["late_reports"],
        region=_region(values),
    )


def _region(values: Mapping[str, Any]) -> Region | None:
    if not values["region"]:
        return None
    x_min, y_min, x_max, y_max = values["region"]
    return Region(x_min, y_min, x_max, y_max, values["region_margin"])


def _slowest_s(values: Mapping[str, Any]) -> float:
    """Return the nominal interval or the longest turn, seconds: until all has been seen again."""
    turns = [values[f"{name}.rotation_s"] for name in values["radars"]]
    return float(max([values["interval_s"], *turns]))


def _attributes(values: Mapping[str, Any]) -> AttributeModel | None:
    """Return the model of identities and heights; None where no radar reports any."""
    fields_ = ("fields.code", "fields.address", "fields.height", "fields.kind")
    if not any(values[f"{name}.{member}"] for name in values["radars"] for member in fields_):
        return None
    if not CORRECTORS[values["corrector"]].labelled:
        return None
    common = {
        "equipped": values["equipped_probability"],
        "reply": values["reply_probability"],
        "garbled": values["code_garbled"],
    }
    shared = tuple(int(code, 8) for code in values["shared_codes"])
    return AttributeModel(
        code=IdentityModel(
            CODES,
            kept_s=values["code_kept_s"],
            shared=shared,
            shared_probability=values["shared_code_probability"] if shared else 0.0,
            **common,
        ),
        address=IdentityModel(ADDRESSES, kept_s=ADDRESS_KEPT_S, unique=True, **common),
        height=HeightModel(
            std=values["height_std"],
            noise_density=values["height_noise_density"],
            climb_std=values["height_climb_std"],
            garbled=values["height_garbled"],
            evidence=values["height_evidence"],
        ),
        clutter_reply=values["clutter_reply_probability"],
        ages=any(values[f"{name}.fields.kind"] for name in values["radars"]),
    )


def _amplitudes(values: Mapping[str, Any]) -> AmplitudeModel:
    if values["amplitude"] == "memory":
        return Memory(values["amplitude_jitter"])
    return Band() if values["amplitude"] == "band" else Ignored()


def _motion(values: Mapping[str, Any], name: str) -> MotionModel:
    kind = MOTIONS[values[f"{name}.model"]]
    used = {field.name for field in fields(kind)}
    return kind(**{p.name: values[f"{name}.{p.name}"] for p in MOTION if p.name in used})


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
    get = {member.name: values[f"{name}.{member.name}"] for member in BIRTH}
    motions_of_class = np.bincount(modes.class_of)
    rate = (np.array(get["rates"]) / motions_of_class)[modes.class_of]
    return BirthTerm(
        name=name,
        mean=modes.space.state(get["position"], get["velocity"], 0.0),
        std=modes.space.state(get["position_std"], get["velocity_std"], get["turn_rate_std"]),
        rate=rate,
    )


def _spawn(values: Mapping[str, Any], modes: ModeSpace) -> SpawnModel:
    classes = len(modes.classes)
    class_matrix = square(values["spawn.class_transition"])
    if class_matrix is None or not len(class_matrix):
        class_matrix = np.full((classes, classes), 1.0 / classes)
    motions_of_class = np.bincount(modes.class_of)
    mode_matrix = square(values["spawn.mode_transition"])
    if mode_matrix is None or not len(mode_matrix):
        to_mode = np.tile((1.0 / motions_of_class)[modes.class_of], (len(modes), 1))
    else:
        to_mode = np.tile(mode_matrix, (classes, classes))
    transition = class_matrix[np.ix_(modes.class_of, modes.class_of)] * to_mode
    transition /= transition.sum(axis=1, keepdims=True)
    return SpawnModel(
        rate=values["spawn.rate"],
        transition=transition,
        std=modes.space.state(
            values["spawn.position_std"],
            values["spawn.velocity_std"],
            values["spawn.turn_rate_std"],
        ),
        particles_per_target=values["spawn.particles_per_target"],
    )
