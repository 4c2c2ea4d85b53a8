"""The configuration of a tracker: parameters are checked and turned into its models."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from phd_jdtc_ros.core.conflicts.model import ConflictModel
from phd_jdtc_ros.core.gaussian.bounds import Bounds
from phd_jdtc_ros.core.intake.antenna import MIN_PERIOD_S
from phd_jdtc_ros.core.intake.clocks import Clocks, SentReport
from phd_jdtc_ros.core.intake.input_checks import ReportCheck
from phd_jdtc_ros.core.intake.posed_reports import Platform
from phd_jdtc_ros.core.intake.revolutions import Revolutions
from phd_jdtc_ros.core.intake.scans import ScanGrouper
from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.phd.resampling import ParticleBudget
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.tracks.reporting_rule import ReportingRule, rule_of

from . import models, zones
from .models import platform_of, tracker_model
from .parameters import replaced
from .parameters.radar import RadarParameters
from .parameters.reports import ReportsParameters
from .parameters.sensor import SensorParameters
from .parameters.tracker import LABELLED, SPACE, Parts, Tracking
from .schema import ConfigError, Parameter, build, check
from .schema import name_faults as schema_faults
from .tables import GROUPS, KINDS, entries, parts_of, schema, unlisted

# Former parameters with their replacements: without a prefix, and of each part.
_FORMER = ({**replaced.TRACKER, **replaced.NODE}, {**replaced.RADAR, **replaced.BIRTH})

# Number of values of a known ``world_origin``; an unknown place has its height alone.
KNOWN_PLACE = 3
# Bounds for all targets together, far above the needs of a thousand targets.
MOST_HYPOTHESES, MOST_PARTICLES = 50_000, 200_000


class Accuracy(NamedTuple):
    """The numbers that one value of ``accuracy`` stands for."""

    hypotheses: int  # Largest number of association hypotheses of a target
    # Share of a hypothesis above which a motion mode becomes a hypothesis of its own; with 1 motion
    # modes are mixed.
    least_mode: float
    # Numbers of a PHD filter's particles per target and birth term.
    per_target: int
    per_birth: int


ACCURACY = {
    "fast": Accuracy(8, 1.0, 1500, 2048),
    "normal": Accuracy(8, 0.05, 1500, 2048),
    "high": Accuracy(16, 0.02, 3000, 4096),
}


@dataclass(frozen=True, kw_only=True)
class TrackerConfig(Tracking):
    """A checked configuration: the tracker's parameters, and the models built from all of them."""

    # Value of every parameter, given or default, by dotted name in the order of the table.
    values: dict[str, Any]
    inputs: tuple[SensorParameters, ...]  # In the configured order
    receivers: tuple[ReportsParameters, ...]  # Of self-reports, in the configured order
    model: TrackerModel
    bounds: Bounds  # Bounds of the Gaussian engine's mixtures
    budget: ParticleBudget  # Numbers of particles of the engines with particles
    rule: ReportingRule  # Confirmation and deletion of tracks
    # The map projection of the world frame; None for a world without a place on the earth.
    plane: Plane | None = None
    conflicts: ConflictModel  # What counts as a danger

    @property
    def known_plane(self) -> Plane | None:
        """The map projection if its place on the earth is known; for latitudes and longitudes."""
        return self.plane if len(self.values["world_origin"]) == KNOWN_PLACE else None

    @property
    def radars(self) -> tuple[RadarParameters, ...]:
        """The inputs as radars; raises `ConfigError` if a sensor is of another kind."""
        radars = tuple(each for each in self.inputs if isinstance(each, RadarParameters))
        if len(radars) < len(self.inputs):
            raise ConfigError(
                *(
                    f"{each.name}.kind: {each.kind} given, must be radar here"
                    for each in self.inputs
                    if not isinstance(each, RadarParameters)
                )
            )
        return radars

    def require_plane(self, what: str) -> None:
        """Raise `ConfigError` in space, for what is estimated in the plane only."""
        if self.state == SPACE:
            raise ConfigError(f"state: {SPACE} given, must be plane for {what}")

    @property
    def classifies_by_amplitude(self) -> bool:
        """Whether amplitudes distinguish classes of targets."""
        return self.amplitude != "none" and len(self.model.modes.classes) > 1

    @property
    def _slowest_s(self) -> float:
        """The nominal interval or the longest configured revolution, seconds."""
        return max([self.interval_s, *(radar.rotation_s for radar in self.inputs)])

    @property
    def max_gap_s(self) -> float:
        """Longest time between consecutive scans of one run, seconds."""
        return self.max_gap_scans * self._slowest_s

    @property
    def reset_threshold_s(self) -> float:
        """Smallest backward jump of the stamps that begins a new run, seconds."""
        # A backward jump of the stamps by more intervals or revolutions than this starts a new run.
        return 3.0 * self._slowest_s

    @property
    def least_speed(self) -> float:
        """Speed of the slowest targets that are reported, m/s.

        Slower targets are in the clutter maps of all radars.
        """
        own = (each.clutter_map_speed if each.clutter_map else 0.0 for each in self.inputs)
        return min(own, default=0.0)

    @property
    def answer_delay_s(self) -> float:
        """Largest difference between a report's stamp and that of its last scan, seconds.

        A report of a turning radar becomes scans of parts of a revolution, and the report of a
        radar with a late clock an earlier scan. Otherwise a report and its scan have one stamp.
        A scan waits for reports that cover a time, unless it is reprocessed with late ones.
        """
        slices_s = [
            radar.rotation_s / max(radar.sectors / 2.0, 4.0)
            for radar in self.inputs
            if radar.rotation_s
        ]
        held_s = [
            ScanGrouper.HELD * radar.rotation_s / max(radar.sectors, 1)
            for radar in self.inputs
            if radar.fields.time and len(self.inputs) > 1 and self.late_reports != "rework"
        ]
        late_s = max((radar.bias.time_offset_s for radar in self.inputs), default=0.0)
        return max(slices_s, default=0.0) + max(self.reorder_s, *held_s, 0.0) + max(late_s, 0.0)

    def clocks(self) -> Clocks[SentReport]:
        """Return a new comparison of the sensors' stamps."""
        return Clocks(len(self.inputs), self.reset_threshold_s, self.max_gap_s)

    def grouper(self) -> ScanGrouper:
        """Return a new grouper of the radars' reports into scans."""
        return ScanGrouper(len(self.inputs), self.reset_threshold_s, self.max_gap_s, self.reorder_s)

    def revolutions(self) -> tuple[Revolutions, ...]:
        """Return new slicers of the radars' revolutions, in the configured order."""
        return tuple(
            Revolutions(
                configured_period_s=radar.rotation_s,
                sectors=radar.sectors,
                compass=radar.units.compass,
                fine=bool(radar.pose.topic),
                reset_threshold_s=self.reset_threshold_s,
                azimuth_bias=radar.bias.azimuth,
                # Filters without labels update all targets at once, so that revolutions are not
                # cut.
                min_period_s=MIN_PERIOD_S if self.rule.labelled and radar.may_turn else math.inf,
            )
            for radar in self.inputs
        )

    @property
    def radars_by_platform(self) -> dict[str, list[int]]:
        """Indices of the moving radars, by the topics of their platform's poses."""
        radars: dict[str, list[int]] = {}
        for index, radar in enumerate(self.inputs):
            for topic in radar.pose.topics:
                radars.setdefault(topic, []).append(index)
        return radars

    @property
    def pose_message(self) -> str:
        """Message of the poses of all platforms."""
        return next((radar.pose.message for radar in self.inputs if radar.pose.topic), "odometry")

    def platforms(self) -> tuple[Platform | None, ...]:
        """Return the platform of each radar, in the configured order, None for a fixed radar."""
        return tuple(
            platform_of(radar, model, self.reset_threshold_s)
            for radar, model in zip(self.inputs, self.model.radars, strict=True)
        )

    def report_checks(self) -> tuple[ReportCheck, ...]:
        """Return new checks of each sensor's reports, in the configured order."""
        return tuple(KINDS[sensor.kind].report_check(sensor) for sensor in self.inputs)


def resolve(
    given: Mapping[str, Any], plane_about: Callable[[Sequence[float]], Plane] | None = None
) -> TrackerConfig:
    """Check a configuration and build the tracker's models; raise `ConfigError` with all faults.

    `plane_about` returns the map projection about ``world_origin`` (latitude, longitude, height),
    as `earth.SystemPlane` does. If it is None, no ``world_origin`` is allowed.
    """
    table = schema(given)
    checked = _without_unknown_members(given, table)
    values, faults = check(
        table.values(), checked, *_FORMER, entries(given), partial(unlisted, given)
    )
    if faults:
        raise ConfigError(*faults)
    parts = parts_of(values)
    faults = models.faults(parts)
    origin = parts.tracking.world_origin
    if not faults and origin and plane_about is None:
        faults = ["world_origin: given, must be empty here: this is computed in the plane only"]
    if faults:
        raise ConfigError(*faults)
    return _config(values, parts, plane_about(origin) if plane_about and origin else None)


def _without_unknown_members(
    given: Mapping[str, Any], table: Mapping[str, Parameter]
) -> Mapping[str, Any]:
    """Return the given parameters, without those of unknown parts if a list of names is faulty."""
    # Only the faulty list is then reported, and not each parameter of the parts named in it.
    lists = (group for group in GROUPS if group in given)
    if all(table[group].coerce(given[group]) is not None for group in lists):
        return given
    return {name: value for name, value in given.items() if name in table or "." not in name}


def name_faults(
    given: Mapping[str, Any], table: Collection[str], values: Mapping[str, Any]
) -> list[str]:
    """Return a fault for each parameter that is not in the table; see `schema.name_faults`.

    `values` has the lists of names.
    """
    return schema_faults(given, table, *_FORMER, entries(given), partial(unlisted, values))


def _config(values: dict[str, Any], parts: Parts, plane: Plane | None) -> TrackerConfig:
    top = parts.tracking
    inputs = tuple(
        sensor if plane is None else sensor.on_earth(plane) for sensor in parts.sensors.values()
    )
    receivers = [own for own in parts.receivers.values() if isinstance(own, ReportsParameters)]
    if top.state == SPACE:
        inputs = tuple(sensor.in_space(top.height_prior, top.air) for sensor in inputs)
    places = zones.read(top.zones, plane if len(values["world_origin"]) == KNOWN_PLACE else None)
    level, model = ACCURACY[top.accuracy], tracker_model(parts, inputs, places)
    labelled, per_target = top.engine in LABELLED, top.particles[0] or level.per_target
    return build(
        TrackerConfig,
        values,
        values=values,
        inputs=inputs,
        receivers=tuple(own if plane is None else own.on_earth(plane) for own in receivers),
        model=model,
        bounds=Bounds(
            hypotheses=level.hypotheses,
            # A hypothesis with a smaller share of its target has no visible effect.
            least_share=1e-4,
            # Square Mahalanobis distance within which two hypotheses are merged.
            merge_distance=4.0,
            least_existence=top.birth_least_probability,
            most=MOST_HYPOTHESES,
            least_mode=level.least_mode,
        ),
        budget=ParticleBudget(
            per_target=per_target,
            # Fewer particles of one origin and class do not represent it.
            least=min(200, per_target),
            per_birth_term=top.particles[1] or level.per_birth,
            most=MOST_PARTICLES,
        ),
        rule=rule_of(model, labelled, *top.existence, *top.coasting, top.report_resting),
        plane=plane,
        conflicts=ConflictModel(
            distance=top.conflicts_distance[0],
            height=top.conflicts_distance[1],
            horizon_s=top.conflicts_horizon_s,
            alarms_per_hour=top.conflicts_alarms_per_hour,
            zones=places,
        ),
    )
