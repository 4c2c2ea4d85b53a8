"""The live tracker of a configured node: decodes messages, feeds the pipeline, and publishes."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.lifecycle import LifecycleNode

from msg_adapters.incoming import self_reports
from msg_adapters.incoming.moving_radars import MovingRadars
from msg_adapters.incoming.readers import Reader, reader_of
from msg_adapters.outgoing import manual
from msg_adapters.outgoing.outputs import CONFLICTS, MANUAL, SCAN, STEP, StepResult
from phd_jdtc_ros import output_files
from phd_jdtc_ros.calibration.comparison import Comparison, Monitor
from phd_jdtc_ros.calibration.innovations import InnovationMonitor
from phd_jdtc_ros.calibration.registration.monitor import RegistrationMonitor
from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.configuration.parameters.tracker import PHD
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.conflicts.watch import Watch
from phd_jdtc_ros.core.engine import Step
from phd_jdtc_ros.core.pipeline import Event, RunEnded, Stepped, start_cold
from phd_jdtc_ros.core.tracks.manual import Manual
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, Estimates, Pose
from phd_jdtc_ros.feed import Feed, StepClock

from ..common.health import WARNING_MEMORY_S, Rhythm
from ..common.runtime import steady_timer
from .checkpoint import Checkpoints, require_replaceable
from .health import (
    Load,
    OutputHealth,
    StepHealth,
    conflict_status,
    registration_status,
    reports_status,
)
from .inputs import Inputs
from .outputs import Outputs
from .settings import Settings

# Largest age of a usable checkpoint, seconds: the targets of an older one have moved on.
CHECKPOINT_MAX_AGE_S = 60.0


class LiveTracker:
    """Subscribes to every radar, steps the engine scan by scan, and publishes the estimates.

    `holds` takes a message that the sensor's kind cannot read, and returns whether it has.
    Invalid names of topics, and invalid QoS overrides, raise `ConfigError`.
    """

    def __init__(
        self,
        node: LifecycleNode,
        settings: Settings,
        holds: Callable[[int, Any, Mapping[str, int]], bool] = lambda sensor, message, info: False,
    ) -> None:
        self._node, self._holds = node, holds
        self._settings = settings
        config = settings.config
        nominal_s = config.model.modes.interval_s
        self.inputs = Inputs(node, settings)
        self._step_health = StepHealth(Rhythm(nominal_s), Rhythm(nominal_s), config.engine)
        self._load = Load(WARNING_MEMORY_S)
        self._output_health = OutputHealth()
        self._latest: Estimates | None = None
        self._innovations = InnovationMonitor(config.model)
        self._registration: RegistrationMonitor | None = None
        if "registration" in settings.node["outputs"] and len(config.inputs) > 1:
            self._registration = RegistrationMonitor(config.model)
        monitors: list[Monitor] = [self._innovations, *filter(None, [self._registration])]
        self._comparison = Comparison(config.model, monitors)
        self._active = False
        self._step_clock = StepClock()
        self._watch = Watch(config.conflicts)
        self._outputs = Outputs(node, settings, self._output_health, self._own_pose, self._manual)
        # The timer is never started if scans wait without a limit.
        self._max_wait_s = settings.node["max_wait_s"]
        period_s = self._max_wait_s or 1.0
        self._max_wait_timer = steady_timer(node, period_s, self._on_max_wait, autostart=False)
        try:
            self._checkpoints = self._make_checkpoints()
            # Publishers discover the subscriptions while the engine loads its compiled loops.
            self.inputs.subscribe(self._on_message, self._on_pose, self._on_self_reports)
            # The first scan of a run continues from the checkpoint, if there is one.
            begin = start_cold if self._checkpoints is None else self._checkpoints.resume
            self._moving = MovingRadars(config)
            show, why = self._publish_filtered, self._moving.missing
            self._feed = Feed(config, self.inputs, [self._comparison], begin, show, why)
            self._pipeline = self._feed.pipeline
        except Exception:
            self.destroy()
            raise

    def _own_pose(self, stamp_ns: int) -> Pose | None:
        return self._pipeline.own_pose(stamp_ns)

    def _manual(self) -> Manual:
        return self._pipeline.manual

    def _make_checkpoints(self) -> Checkpoints | None:
        values = self._settings.node
        if not values["checkpoint.path"]:
            return None
        engine = self._settings.config.engine
        if engine in PHD:
            raise ConfigError(
                f"checkpoint.path: {values['checkpoint.path']} given, must be empty with engine "
                f"{engine}"
            )
        path = Path(os.path.expanduser(values["checkpoint.path"]))
        if lack := output_files.why_closed(path.parent):
            raise ConfigError(f"checkpoint.path: {path} given, {lack}")
        try:
            require_replaceable(path)
        except OSError as error:
            raise ConfigError(f"checkpoint.path: {path} given, {error.strerror}") from error
        fixed = {
            name: value
            for name, value in self._settings.config.values.items()
            if name not in self._settings.mutable
        }
        return Checkpoints(
            path,
            values["checkpoint.every"],
            # The time of a restart is a gap, and the limit of gaps applies to it too.
            min(CHECKPOINT_MAX_AGE_S, self._settings.config.max_gap_s),
            fixed,
            self._node.get_logger(),
        )

    def destroy(self) -> None:
        """Destroy all subscriptions, timers and publishers."""
        self.inputs.destroy()
        self._node.destroy_timer(self._max_wait_timer)
        self._outputs.destroy()

    def start(self) -> None:
        """Process messages from now on; messages before this are neither received nor lost."""
        self.inputs.begin_series()
        self._active = True

    def stop(self) -> int:
        """Flush, and ignore later messages; return the result of `flush`."""
        published = self.flush()
        self._active = False
        return published

    def retune(self, settings: Settings) -> None:
        """Use changed values of the mutable parameters from the next scan on."""
        self._settings = settings
        self.inputs.retune(settings)
        self._pipeline.retune(settings.config.model, settings.config.rule)
        self._comparison.retune(settings.config.model)
        self._outputs.retune(settings)

    def flush(self) -> int:
        """Publish all pending estimates and begin a new run; return the number of smoothed ones."""
        published = 0
        with self._step_clock:
            for event in self._feed.flush():
                self._publish(event)
                source = event if isinstance(event, RunEnded) else event.step
                published += len(source.smoothed)
            self._step_clock.discard()
        return published

    def save(self) -> str | None:
        """Write a checkpoint; return None, or the reason if it could not be written."""
        if self._checkpoints is None:
            return "checkpoint.path is not set"
        return self._checkpoints.save(self._pipeline.engine)

    def reset(self) -> None:
        """Begin a new run without publishing."""
        self._feed.reset()
        self._forget_run()
        self._outputs.clear()

    def _forget_run(self) -> None:
        if self._checkpoints is not None:
            self._checkpoints.discard()
        self._outputs.begin_run()
        self._watch.begin_run()
        self._step_health.begin_series()
        self._max_wait_timer.cancel()

    def _on_message(
        self, index: int, reader: Reader, message: Any, info: Mapping[str, int]
    ) -> None:
        """Take in a report of a radar, and process the scans that it closes."""
        if not self._active or self._holds(index, message, info):
            return
        self.inputs.take_poses(lambda: self._pipeline.awaited_pose)
        begin_s = time.monotonic()
        health = self.inputs.radars[index]
        health.note_message(begin_s, info.get("publication_sequence_number"), self._load.worked_s)
        radar, waiting = self._settings.config.inputs[index], self._pipeline.waiting
        received_ns = self._node.get_clock().now().nanoseconds
        with self._step_clock:
            events = self._feed.message(index, lambda: reader.from_msg(message, radar), received_ns)
            if events is not None:
                health.rhythm.beat(time.monotonic())
                closed = self._handle(events)
                self._update_max_wait_timer(new_scan=bool(closed) or not waiting)
        self._load.add(begin_s, time.monotonic())

    def take(self, index: int, message: Any, info: Mapping[str, int]) -> None:
        """Take in a message of a sensor, by its index, that was held until now."""
        self._on_message(index, reader_of(self._settings.config.inputs[index]), message, info)

    def _on_self_reports(self, index: int, message: Any, info: Mapping[str, int]) -> None:
        """Take in what transmitters report of themselves; it is used with the next scans."""
        if not self._active:
            return
        begin_s, own = time.monotonic(), self._settings.config.receivers[index]
        health = self.inputs.receivers[index]
        health.note_message(begin_s, info.get("publication_sequence_number"), self._load.worked_s)
        with self._step_clock:
            self._handle(
                self._feed.self_reports(index, lambda: self_reports.from_msg(message, own))
            )
        self._load.add(begin_s, time.monotonic())

    def _on_pose(self, topic: str, data: bytes, info: Mapping[str, int]) -> None:
        """Take in poses of platforms, and process the scans that waited for them.

        Transforms are taken in before the start too, because static ones come only once.
        """
        begin_s, health = time.monotonic(), self.inputs.platforms[topic]
        if not (self._active or health.shared):
            return
        health.note_message(begin_s, info.get("publication_sequence_number"), self._load.worked_s)
        with self._step_clock:
            events = self._feed.pose(topic, partial(self._moving.read, topic, data))
            self._update_max_wait_timer(new_scan=bool(self._handle(events or ())))
        self.inputs.note_transforms(topic, self._moving)
        self._load.add(begin_s, time.monotonic())

    def _update_max_wait_timer(self, new_scan: bool) -> None:
        """Start the timer if a new scan waits for reports; cancel it if no scan waits."""
        if not self._pipeline.waiting:
            self._max_wait_timer.cancel()
        elif new_scan and self._max_wait_s:
            self._max_wait_timer.reset()

    def _on_max_wait(self) -> None:
        begin_s = time.monotonic()
        self._max_wait_timer.cancel()
        with self._step_clock:
            closed = self._handle(self._feed.close_scans())
        self._step_health.closed_by_wait += closed
        self._load.add(begin_s, time.monotonic())

    def _handle(self, events: Iterable[Event]) -> int:
        """Publish the pipeline's events; return the number of scans that were stepped."""
        scans = 0
        for event in events:
            self._publish(event)
            scans += isinstance(event, Stepped)
        return scans

    def _publish_filtered(self, filtered: tuple[Estimates, ...]) -> None:
        """Publish filtered estimates at once: they do not wait for the smoothing of the scan."""
        self._latest = filtered[-1] if filtered else self._latest
        for estimates in filtered:
            self._outputs.publish(FILTERED, estimates.stamp_ns, estimates)

    def _publish(self, event: Event) -> None:
        if isinstance(event, RunEnded):
            self._end_run(event)
            return
        step = event.step
        for smoothed in step.smoothed:
            self._outputs.publish(SMOOTHED, smoothed.stamp_ns, smoothed)
        stamp_ns = event.scan.stamp_ns
        self._outputs.publish(SCAN, stamp_ns, event.scan)
        step_ms, now_s = self._step_clock.take_ms(), time.monotonic()
        self._step_health.note_step(stamp_ns, now_s, step_ms, step.targets, step.figures)
        self.inputs.note_learned(step.figures)
        if event.scans_without_targets:
            self._step_health.scans_without_targets = event.scans_without_targets
            self._node.get_logger().warning(anomalies.no_targets(event.scans_without_targets))
        if self._checkpoints is not None:
            self._checkpoints.note_step(self._pipeline.engine)
        self._outputs.publish(
            STEP, stamp_ns, StepResult(stamp_ns, step, step_ms, self._pipeline.engine)
        )
        self._watch_conflicts(stamp_ns, step)

    def _watch_conflicts(self, stamp_ns: int, step: Step) -> None:
        """Publish the conflicts if they are due, and log new alarms."""
        own, engine = self._pipeline.own_ship(stamp_ns), self._pipeline.engine
        watched = self._watch.step(stamp_ns, step.filtered, engine, own, self._pipeline.manual)
        if watched is not None:
            found, alarms = watched
            self._outputs.publish(CONFLICTS, stamp_ns, found)
            for alarm in alarms:
                self._node.get_logger().warning(f"alarm: {alarm}")

    def operate(self, verb: str, given: Sequence[Any]) -> str:
        """Do manual work with a service's values, and publish it; return it in words.

        Raise `ValueError` for what cannot be done.
        """
        command = manual.of_request(verb, given, self._settings.config.known_plane)
        done = self._pipeline.operate(command)
        stamp_ns = self._pipeline.stamp_ns
        self._outputs.publish(MANUAL, stamp_ns, (stamp_ns, command))
        self._node.get_logger().info(f"by hand: {done}")
        return done

    def acknowledge(self) -> str:
        """Acknowledge all alarms of conflicts; return what was done in words."""
        return f"{self._watch.alarms.acknowledge()} alarms acknowledged"

    def _end_run(self, event: RunEnded) -> None:
        """Publish the pending smoothed estimates, and begin a new run."""
        if event.reset is not None:
            self._node.get_logger().warning(anomalies.started_again(event.reset))
            self._step_health.run += 1
        for smoothed in event.smoothed:
            self._outputs.publish(SMOOTHED, smoothed.stamp_ns, smoothed)
        self._forget_run()

    def alarms(self) -> frozenset[str]:
        """Return the silent inputs, and those with a wrong clock; see `Inputs.silent`."""
        return self.inputs.silent() | {
            f"clock of {health.name}"
            for index, health in enumerate(self.inputs.radars)
            if self._pipeline.clock_offset_s(index) is not None
        }

    def statuses(self) -> list[DiagnosticStatus]:
        """Return a status for each input, step time, outputs and, if monitored, registration."""
        now_s, name = time.monotonic(), self._node.get_fully_qualified_name()
        for index, health in enumerate(self.inputs.radars):
            health.clock_offset_s = self._pipeline.clock_offset_s(index)
        for health, fit in zip(self.inputs.radars, self._innovations.fits(), strict=True):
            health.fit = fit
        lost, busy = self.inputs.lost_by_overload(now_s), self._load.share(now_s)
        latest = self._latest
        unsaved = "" if self._checkpoints is None else self._checkpoints.fault
        residuals = [] if self._registration is None else self._registration.mean_residuals()
        return [
            *self.inputs.statuses(now_s),
            self._step_health.status(name, lost, busy),
            self._output_health.status(name, now_s, unsaved, self._outputs.links),
            *([conflict_status(self._watch, name)] if self._watch.model.enabled else []),
            *(registration_status(found, name) for found in residuals),
            *([reports_status(latest, name)] if latest is not None and latest.reports else []),
        ]
