"""The subscriptions of the tracker, and the use of the messages of each input.

Sensors of positions that are configured as radars are recognised by their clouds. A cloud with x
and y and without a range is of no use for a radar. The first ones are held until they show the
sensor's noise and area, as `tune` finds them; none is lost.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.lifecycle import LifecycleNode
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import RejectedMessageError, interfaces, names, point_cloud
from msg_adapters.incoming import moving_radars, positions, recognised
from msg_adapters.incoming.moving_radars import MovingRadars
from msg_adapters.incoming.readers import Reader, reader_of
from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.columns.position_selection import EVERYWHERE
from phd_jdtc_ros.columns.report_selection import Told
from phd_jdtc_ros.columns.selection import Report
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.place_forms import STATIC_TRANSFORMS, TRANSFORM_TOPICS
from phd_jdtc_ros.configuration.parameters.position import Fields, PositionParameters
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.configuration.parameters.sensor import SensorParameters
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.intake.clocks import CLOCK
from phd_jdtc_ros.core.intake.poses import PoseFault
from phd_jdtc_ros.core.pipeline import POSE_MISSING, Drops
from phd_jdtc_ros.quoting import counted

from ..common import topics
from ..common.health import Rhythm, ThrottledWarnings
from . import endpoints
from .endpoints import Listener
from .health import InputHealth
from .settings import Settings

# Poses come much more often than scans, and wait while one is stepped; and transforms of a whole
# fleet may come on one topic.
POSE_DEPTH, TRANSFORM_DEPTH = 200, 1000


class Inputs:
    """Subscribes to every radar and platform; as `Notices` it counts their unused messages.

    `radars` are in the configured order; `platforms`, by topic, carry radars and send their poses.
    """

    def __init__(self, node: LifecycleNode, settings: Settings) -> None:
        self._node = node
        self._settings = settings
        config = settings.config
        nominal_s = config.model.modes.interval_s
        self.radars = [
            InputHealth(
                radar.name,
                topics.full_name(node, radar.topic, f"{radar.name}.topic"),
                Rhythm(nominal_s),
            )
            for radar in config.inputs
        ]
        self.platforms = {
            topic: InputHealth(
                f"{'static frames' if topic == STATIC_TRANSFORMS else 'pose'} of "
                f"{', '.join(config.inputs[index].name for index in carried)}",
                topics.full_name(node, topic, f"{config.inputs[carried[0]].name}.pose"),
                Rhythm(nominal_s),
                shared=topic in TRANSFORM_TOPICS,
            )
            for topic, carried in config.radars_by_platform.items()
        }
        # A receiver is silent while it hears no one.
        self.receivers = [
            InputHealth(
                own.name, topics.full_name(node, own.topic, f"{own.name}.topic"), Rhythm(nominal_s)
            )
            for own in config.receivers
        ]
        self._now_s = self._checked_s = time.monotonic()
        self._warnings = ThrottledWarnings(node.get_logger())
        self._warned: set[str] = set()
        # The radars' listeners, in their order, then the platforms' and the receivers'.
        self._listeners: list[Listener] = []

    def note_learned(self, figures: Mapping[str, float]) -> None:
        """Pass on what was learned of each radar, from a step's figures to the radar's health."""
        for health in (*self.radars, *self.receivers):
            health.learned = anomalies.figures_of(health.name, figures)

    def subscribe(
        self,
        on_message: Callable[[int, Reader, Any, Mapping[str, int]], None],
        on_pose: Callable[[str, bytes, Mapping[str, int]], None],
        on_self_reports: Callable[[int, Any, Mapping[str, int]], None],
    ) -> None:
        """Subscribe to all inputs.

        `on_message` receives a radar's index and reader, the message, and its information;
        `on_pose` a platform's topic, the serialised message, and its information;
        `on_self_reports` a receiver's index, the message, and its information. Raise
        `ConfigError` if a message's package is not installed, or a topic's QoS override is not
        valid.
        """
        config = self._settings.config
        for index, (radar, health) in enumerate(zip(config.inputs, self.radars, strict=True)):
            reader = reader_of(radar)
            kind = _message_class(f"{radar.name}.message: {radar.message}", reader.type_name)
            take = partial(on_message, index, reader)
            depth = queue_depth(radar)
            self._listeners.append(Listener(self._node, kind, radar.topic, take, health, depth))
        types = moving_radars.types_of(config)
        for topic, health in self.platforms.items():
            first = config.inputs[config.radars_by_platform[topic][0]]
            kind = _message_class(f"{first.name}.pose: {first.pose.message}", types[topic])
            listener = Listener(
                self._node,
                kind,
                topic,
                partial(on_pose, topic),
                health,
                TRANSFORM_DEPTH if health.shared else POSE_DEPTH,
                raw=True,
                latched=topic == STATIC_TRANSFORMS,
            )
            self._listeners.append(listener)
        cloud = _message_class("message: reports", names.CLOUD)
        for index, (own, health) in enumerate(zip(config.receivers, self.receivers, strict=True)):
            take = partial(on_self_reports, index)
            self._listeners.append(Listener(self._node, cloud, own.topic, take, health))

    def take_poses(self, awaited: Callable[[], int | None]) -> None:
        """Process poses from the queue while a cloud waits for one.

        `awaited` returns the index of the waiting cloud's radar. The executor takes one message of
        each topic in turn, so after a long step the next cloud could overtake the poses that the
        waiting one needs, which would then be dropped. Further poses stay in the queue, because a
        platform remembers a limited number of them, and a later cloud may need the oldest.
        """
        config = self._settings.config
        end = len(self.radars) + len(self.platforms)
        poses = dict(zip(self.platforms, self._listeners[len(self.radars) : end], strict=True))
        for _ in range(POSE_DEPTH * len(poses)):
            radar = awaited()
            if radar is None:
                return
            subscription = poses[config.inputs[radar].pose.topic].subscription
            with subscription.handle:
                taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
            if taken is None:
                return
            subscription.callback(*taken)

    def destroy(self) -> None:
        """Destroy all subscriptions."""
        while self._listeners:
            self._listeners.pop().destroy()

    def retune(self, settings: Settings) -> None:
        """Use changed values of the mutable parameters."""
        self._settings = settings

    def begin_series(self) -> None:
        """Let every input begin a new series with its next message."""
        for health in self._all():
            health.begin_series()

    def on_unreadable(self, radar: int, error: RejectedMessageError) -> None:
        """Count a message that is not a valid report."""
        self._drop(self.radars[radar], error.reason, f"scan rejected: {error}")

    def on_report(self, radar: int, report: Report) -> None:
        """Count the dropped points; warn once if amplitudes that would classify are missing."""
        health, now_s = self.radars[radar], time.monotonic()
        health.detections += len(report.detections) + report.dropped.total()
        for reason, count in report.dropped.items():
            text = f"{counted(count, 'point[s]')} dropped: {reason}"
            if health.note_dropped(reason, count, text, now_s):
                self._warnings.warn((health.name, reason), f"{health.name}: {text}")
        config = self._settings.config
        source = config.inputs[radar]
        missing = source.measures_amplitude and report.detections.amplitude is None
        if missing and config.classifies_by_amplitude and source.name not in self._warned:
            self._warned.add(source.name)
            text = anomalies.no_amplitude(source)
            self._node.get_logger().warning(f"{source.topic}: {text}")

    def on_rejection(self, radar: int, reason: str, report: Report) -> None:
        """Count a report of which no part belongs to a scan."""
        self._drop(self.radars[radar], reason, f"scan rejected: {reason} stamp")

    def on_drops(self, radar: int, drops: Drops, why: str = "") -> None:
        """Count the reports that were dropped while they waited."""
        words = {POSE_MISSING: why, CLOCK: anomalies.clock_off(drops.clock_offset_s)}
        for reason, count in drops.reports.items():
            text = f"{counted(count, 'scan[s]')} rejected: {words.get(reason, f'{reason} stamp')}"
            self._drop(self.radars[radar], reason, text, count)

    def on_anomalies(self, radar: int, counts: Counter[str]) -> None:
        """Count input that contradicts its configuration; warn of it, of single faults if many."""
        source, health = self._settings.config.inputs[radar], self.radars[radar]
        health.anomalies += counts
        for what, text in zip(counts, anomalies.of(source, counts), strict=True):
            if what not in anomalies.OF_DETECTIONS | anomalies.OF_CLOUDS:
                health.warn(text)
            elif anomalies.is_answered(source, what) or not health.note_single(
                what, counts[what], text, time.monotonic()
            ):
                continue
            self._warnings.warn((source.name, what), f"{source.topic}: {text}")

    def on_revolution_period(self, radar: int, revolution_s: float) -> None:
        """Record a radar's estimated rotation period, seconds, or 0; warn of a new estimate."""
        health, source = self.radars[radar], self._settings.config.inputs[radar]
        if revolution_s and revolution_s != health.revolution_found_s:
            text = anomalies.revolution_found(source, revolution_s)
            health.warn(text)
            self._warnings.warn((source.name, "revolution_found"), f"{source.topic}: {text}")
        health.revolution_found_s = revolution_s

    def on_told(self, receiver: int, told: Told) -> None:
        """Count the self-reports of a message."""
        health = self.receivers[receiver]
        health.detections += len(told.reports) + told.dropped.total()
        health.rhythm.beat(time.monotonic())
        for reason, count in told.dropped.items():
            text = f"{count} self-reports dropped: {reason}"
            if health.note_dropped(reason, count, text, time.monotonic()):
                self._warnings.warn((health.name, reason), f"{health.name}: {text}")

    def on_untold(self, receiver: int, error: RejectedMessageError) -> None:
        """Count a message that has no valid self-reports."""
        text = f"self-reports rejected: {error}"
        self._drop(self.receivers[receiver], error.reason, text)

    def on_unused_reports(self, counts: Counter[str]) -> None:
        """Count self-reports that no scan used; they wait for all receivers in one queue."""
        for reason, count in counts.items():
            text = f"{count} self-reports dropped: {reason}"
            self._drop(self.receivers[0], reason, text, count)

    def on_unreadable_pose(self, topic: str, error: RejectedMessageError) -> None:
        """Count a message that is not a valid pose."""
        self._drop(self.platforms[topic], error.reason, f"pose rejected: {error}")

    def note_transforms(self, topic: str, moving: MovingRadars) -> None:
        """Note after a message whether the transforms reach from the radars to the world."""
        for each in TRANSFORM_TOPICS if topic in TRANSFORM_TOPICS else ():
            health = self.platforms[each]
            health.broken, health.holds = moving.broken, moving.holds(each)

    def on_pose(self, topic: str, faults: Sequence[PoseFault]) -> None:
        """Count a pose that some of its radars do not use, once for each cause."""
        health = self.platforms[topic]
        for fault in dict.fromkeys(faults):
            if fault is PoseFault.PARENT:
                health.anomalies["reparented"] += 1
                health.warn(anomalies.reparented())
                self._warnings.warn((topic, fault), f"{topic}: {anomalies.reparented()}")
            else:
                self._drop(health, fault.value, f"pose rejected: {anomalies.POSE_FAULTS[fault]}")
        if not faults:
            health.rhythm.beat(time.monotonic())

    def _drop(self, health: InputHealth, reason: str, text: str, count: int = 1) -> None:
        """Count unused input, and warn of it."""
        health.dropped[reason] += count
        self._warnings.warn((health.name, reason), f"{health.name}: {text}")

    def silent(self) -> frozenset[str]:
        """Return the names of the silent inputs; to be called regularly.

        The executor takes one message of every radar between two calls. So all messages that had
        arrived by the previous call have been received, however long the steps in between took.
        """
        self._checked_s, self._now_s = self._now_s, time.monotonic()
        return frozenset(health.name for health in self._all() if health.silent(self._checked_s))

    def statuses(self, now_s: float) -> list[DiagnosticStatus]:
        """Return a status for each input, after renewing subscriptions that can be improved."""
        name = self._node.get_fully_qualified_name()
        for listener in self._listeners:
            listener.improve()
        return [
            health.status(name, now_s, self._checked_s, listener.publishers())
            for health, listener in zip(self._all(), self._listeners, strict=True)
        ]

    def lost_by_overload(self, now_s: float) -> int:
        """Return the number of messages lost recently because the tracker is too slow."""
        return sum(health.lost_by_overload(now_s) for health in self.radars)

    def summary(self) -> str:
        """Return the numbers of received, lost and dropped clouds as text."""
        received = sum(health.received for health in self.radars)
        gaps = [f"{health.name} {health.gaps}" for health in self.radars if health.gaps]
        drops = [
            f"{health.name} {reason} {count}"
            for health in self._all()
            for reason, count in sorted(health.dropped.items())
        ]
        return (
            f"{received} clouds received, lost on the way: {', '.join(gaps) or 'none'}, "
            f"dropped: {', '.join(drops) or 'none'}"
        )

    def _all(self) -> tuple[InputHealth, ...]:
        return (*self.radars, *self.platforms.values(), *self.receivers)


def queue_depth(radar: SensorParameters) -> int:
    """Return the number of messages in a second, at least `INPUT_DEPTH`."""
    clouds = radar.sectors / radar.rotation_s if radar.rotation_s else 0.0
    return max(math.ceil(clouds), endpoints.INPUT_DEPTH)


def _message_class(parameter: str, type_name: str) -> Any:
    """Return a message's class; `parameter` is the name and the value that it follows from."""
    message_class = interfaces.installed_class(type_name)
    if message_class is None:
        package = type_name.split("/")[0]
        raise ConfigError(f"{parameter} given, but {package} is not installed")
    return message_class


# Numbers of clouds after which their noise is sought, and after which the defaults are used.
FIRST, LAST = 40, 320


class Held(NamedTuple):
    """A cloud that waits."""

    sensor: int  # Index of its sensor
    cloud: PointCloud2
    info: Mapping[str, int]


@dataclass
class Recognition:
    """Holds the clouds of one sensor of positions at a time."""

    # Parameters that describe targets: without any of them the clouds do.
    OF_TARGETS = ("classes", "motions", "births", "detection_births.rates")

    config: TrackerConfig
    given: Mapping[str, Any]  # Parameters that the user has set
    held: list[Held] = field(default_factory=list)
    _due: int = FIRST
    _pool: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1))
    _search: Future[dict[str, Any] | None] | None = None
    _given_up: bool = False
    # Sensors that have sent ranges and azimuths: a cloud of theirs without one of these is damaged.
    _radars: set[int] = field(default_factory=set)

    @property
    def sensor(self) -> SensorParameters:
        """The sensor whose clouds wait."""
        return self.config.inputs[self.held[0].sensor]

    def give_up(self) -> None:
        """Hold no more clouds."""
        self.held, self._given_up = [], True

    def holds(self, sensor: int, message: Any, info: Mapping[str, int]) -> bool:
        """Return whether a message waits here because it is of positions, and no radar's."""
        own = self.config.inputs[sensor]
        is_radar = isinstance(own, RadarParameters) and own.named_fields
        if not is_radar or self._given_up or not isinstance(message, PointCloud2):
            return False
        if sensor in self._radars or (self.held and self.held[0].sensor != sensor):
            return False
        fields = point_cloud.field_names(message)
        if recognised.is_of_radar(fields):
            self._radars.add(sensor)
        if not recognised.is_of_positions(fields):
            return False
        frame = message.header.frame_id
        usual = self.held[0].cloud.header.frame_id if self.held else frame
        # Without a configured frame that of the clouds is the sensor's.
        if frame != (own.frame if f"{own.name}.frame" in self.given else usual):
            return False
        self.held.append(Held(sensor, message, info))
        return True

    def found(self) -> dict[str, Any] | None:
        """Return the changes of the parameters, by dotted name; None until they are known."""
        if self._search is None and len(self.held) >= self._due:
            last, clouds = self._due >= LAST, [each.cloud for each in self.held]
            self._due *= 2
            with_targets = not any(name in self.given for name in self.OF_TARGETS)
            # The search takes seconds, in which further clouds are received.
            self._search = self._pool.submit(_changes, self.sensor, clouds, with_targets, last)
        if self._search is None or not self._search.done():
            return None
        changes, self._search = self._search.result(), None
        if changes is None:
            return None
        return {name: value for name, value in changes.items() if name not in self.given}


def _changes(
    own: SensorParameters, clouds: list[PointCloud2], with_targets: bool, last: bool
) -> dict[str, Any] | None:
    """Return the parameters that clouds show; None if they are too few and not the `last`."""
    # Few trackers recognise a sensor, and all start the sooner without.
    from phd_jdtc_ros.calibration.tuning import proposal
    from phd_jdtc_ros.calibration.tuning.area import area_of
    from phd_jdtc_ros.calibration.tuning.findings import findings
    from phd_jdtc_ros.calibration.tuning.plots import limit_plots, plots_of
    from phd_jdtc_ros.calibration.tuning.unspecified import unspecified

    name, reports, frame = own.name, [], clouds[0].header.frame_id
    shown = recognised.parameters(clouds) or {}
    # Their own times are not: a time's unit and reference belong to a whole recording.
    used = [what for what in recognised.POSITIONS if what in shown and what != "fields.time"]
    fields = {what.removeprefix("fields."): shown[what] for what in used}
    sensor = PositionParameters(
        name=name, frame=frame, area=EVERYWHERE, fields=replace(Fields(), **fields)
    )
    for cloud in clouds:
        try:
            report = positions.from_msg(cloud, sensor)
        except RejectedMessageError:
            continue
        reports.append((report.stamp_ns, report.detections))
    changes: dict[str, Any] = {f"{name}.kind": "position"}
    changes |= {f"{name}.fields.{what}": value for what, value in fields.items()}
    if frame != own.frame:
        changes[f"{name}.frame"] = frame
    places = [found.measurement for _, found in reports if len(found)]
    if not places:
        return changes if last else None
    changes[f"{name}.area"] = [*area_of(np.concatenate(places))]
    try:
        plots = plots_of(reports, places=True)
        found = findings(limit_plots(plots))
    except ValueError:  # `TuningError`, or numbers with which nothing can be computed
        return changes if last else None
    found = replace(found, field=replace(found.field, area=area_of(plots.measurement)))
    if with_targets:
        changes |= unspecified({name: found})
    changes["interval_s"] = proposal.interval_s({name: found})
    rows = proposal.rows(found, {}, name)
    return changes | {f"{name}.{row.name}": row.value for row in rows if row.proposed}
