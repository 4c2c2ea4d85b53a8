"""The live tracker: detections in, filtered and smoothed estimates out.

A managed node. Its lifecycle and its parameters are here; the processing of scans is in `live`.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from msg_adapters import diagnostics, names
from phd_jdtc_ros.configuration import tracker_node
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.exit_status import USAGE, faults_of
from phd_jdtc_ros.parameter_files.sections import ParameterFile

from ..common import arguments, parameters, runtime, transitions
from ..common.runtime import RunnableNode
from ..common.status_log import StatusLog
from . import endpoints, manager_bond
from .live import LiveTracker
from .manager_bond import ManagerBond
from .name_claim import NameClaim

HEALTH_PERIOD_S = 1.0
# The file in `config` that has the defaults.
DEFAULT_PROFILE = "defaults"
# How often radars are checked for silence.
WATCH_PERIOD_S = 0.1


_DONE = SetParametersResult(successful=True)


class Tracker(LifecycleNode, RunnableNode):
    """The tracker as a lifecycle node.

    Unconfigured it has only parameters and services, configured it has all topics, and active it
    tracks. Deactivating publishes the scans that are still held back; activating begins a new run.
    """

    def __init__(self, files: Sequence[ParameterFile] = ()) -> None:
        super().__init__("tracker")
        # First, so that others are discovered in the background while the rest is made.
        self._claim = NameClaim(self, self._give_way)
        given = parameters.given(self, files)
        self._source = _source(given, parameters.sources(self, files))
        self._settings = tracker_node.resolve(given)
        # While the tracker is not configured, these may differ from the settings, and not fit.
        self._values = self._settings.values
        parameters.declare(self, self._settings.table, self._values, frozenset(self._values))
        self._live: LiveTracker | None = None
        self._bond: ManagerBond | None = None
        self._fault: Exception | None = None
        self._summary = "never configured"
        self._shown: tuple[Any, float] = (None, 0.0)
        self._log = StatusLog(self.get_logger())
        self._health = self.create_publisher(
            DiagnosticArray, "/diagnostics", endpoints.output_qos()
        )
        self.create_service(Trigger, "~/flush", self._on_flush)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_service(Trigger, "~/checkpoint", self._on_checkpoint)
        # By the wall clock, because a paused replay stops simulated time.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(WATCH_PERIOD_S, self._watch, clock=steady)
        transitions.guard(self)
        if self._settings.node["autostart"]:
            self._start()
        else:
            self.get_logger().info("unconfigured; waiting for a transition")

    def _give_way(self) -> None:
        if self.exit_status is None:
            self.exit_status = USAGE
            self.get_logger().error(
                f"another tracker runs as {self.get_fully_qualified_name()}: this one ends; "
                "give it a namespace or another name (-r __ns:=/NAME, -r __node:=NAME)"
            )

    def _start(self) -> None:
        self.trigger_configure()
        if self._fault is not None:
            raise self._fault
        self.trigger_activate()

    def close(self) -> None:
        """Log a summary of the run, and write a checkpoint if one is configured.

        Neither is done if another node has the name, and so the checkpoint, or if a step has
        failed.
        """
        self._release()
        if self.exit_status is not None:
            return
        if self._live is not None:
            if self._phase == "active":
                self._live.save()
            self._summary = self._live.summary()
        self.get_logger().info(f"stopped; {self._summary}")

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make the engine and all topics; if that fails, stay unconfigured."""
        self._fault = None
        try:
            self._settings = tracker_node.resolve(self._values)
            self._live = LiveTracker(self, self._settings)
        except Exception as error:  # the transition's response has no room for the reason
            self._fault = error
            self.get_logger().error("not configured: " + "\n".join(faults_of(error)))
            return TransitionCallbackReturn.FAILURE
        model = self._settings.config.model
        if not model.births and not model.detection_births.enabled:
            self.get_logger().warning(
                "neither births nor detection_births.rates are set: no target can ever appear"
            )
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Track from now on."""
        done = super().on_activate(state)
        self._log.forget()
        self._configured.start()
        self.get_logger().info(self._what_is_tracked())
        # One that starts by itself has no manager that would wait for a bond.
        if not self._settings.node["autostart"]:
            self._bond = manager_bond.form(self)
        return done

    def _what_is_tracked(self) -> str:
        config = self._settings.config
        classes = [kind.name for kind in config.model.modes.classes]
        radars = [
            f"{radar.name} on {self.resolve_topic_name(radar.topic)}" for radar in config.inputs
        ]
        return (
            f"tracking {_counted('class', 'classes', classes)} with "
            f"{_counted('radar', 'radars', radars)}, {self._source}"
        )

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish the scans held back, then stop receiving and publishing."""
        self._release()
        published = self._configured.stop()
        self.get_logger().info(
            f"deactivated, {published} smoothed estimates published; {self._configured.summary()}"
        )
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Remove all topics."""
        self._tear_down()
        self.get_logger().info("cleaned up; every parameter may change until the next configure")
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish the scans held back if active, and remove all topics."""
        if state.label == "active":
            self._configured.stop()
        self._tear_down()
        self.get_logger().info(f"shut down from {state.label}; {self._summary}")
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Become unconfigured again after a transition that failed half-way."""
        self._tear_down()
        return super().on_error(state)

    def _release(self) -> None:
        """Tell a lifecycle manager that the tracker stops by intention."""
        if self._bond is not None:
            self._bond.end()
            self._bond = None

    def _tear_down(self) -> None:
        self._release()
        if self._live is not None:
            self._summary = self._live.summary()
            self._live.destroy()
            self._live = None

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Check a change as a whole, and apply it from the next scan on.

        While the tracker is not configured, every parameter may change, and the change is applied
        by the next configure. rclpy would check one parameter after the other and report only the
        first fault.
        """
        table = self._values
        others = [p for p in parameter_list if p.name not in table and self.has_parameter(p.name)]
        given = {p.name: p.value for p in parameter_list if p not in others}
        # What a file repeats, as of the node's own dump, is no change. 2 and 2.0 are one number.
        changes = {
            name: value
            for name, value in given.items()
            if name not in table or not parameters.same(value, table[name])
        }
        if not changes:
            return super().set_parameters_atomically(others) if others else _DONE
        if self._live is None:
            return self._edit(others, changes)
        try:
            changed = tracker_node.changed(self._settings, changes)
        except ConfigError as error:
            return SetParametersResult(successful=False, reason="; ".join(error.faults))
        # The checked values: whole numbers given for real parameters have become real numbers.
        checked = [Parameter(name, value=changed.values[name]) for name in changes]
        result = super().set_parameters_atomically([*others, *checked])
        if result.successful:
            self._settings, self._values = changed, changed.values
            self._live.retune(changed)
            summary = ", ".join(f"{parameter.name} {parameter.value}" for parameter in checked)
            self.get_logger().info(f"changed: {summary}")
        return result

    def _edit(self, others: list[Parameter], changes: dict[str, Any]) -> SetParametersResult:
        """Change parameters for the next configure; the answer says what does not fit yet."""
        try:
            table, values = tracker_node.edited(self._values, changes)
        except ConfigError as error:
            return SetParametersResult(successful=False, reason="; ".join(error.faults))
        if others:
            result = super().set_parameters_atomically(others)
            if not result.successful:
                return result
        parameters.redeclare(self, table, values, changes)
        self._values = values
        summary = ", ".join(f"{name} {values[name]}" for name in changes)
        self.get_logger().info(f"changed for the next configure: {summary}")
        try:
            self._settings = tracker_node.resolve(values)
        except ConfigError as error:
            reason = f"to be completed before the next configure: {'; '.join(error.faults)}"
            return SetParametersResult(successful=True, reason=reason)
        return SetParametersResult(successful=True)

    @property
    def _configured(self) -> LiveTracker:
        """What the phases from configured on have."""
        if self._live is None:
            raise RuntimeError(f"the tracker is {self._phase}, must be configured")
        return self._live

    @property
    def _phase(self) -> str:
        return str(self._state_machine.current_state[1])

    def _on_flush(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._phase == "active"
        response.message = f"the tracker is {self._phase}"
        if response.success:
            response.message = f"{self._configured.flush()} smoothed estimates published"
        return response

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._phase == "active"
        response.message = f"the tracker is {self._phase}"
        if response.success:
            self._configured.reset()
            response.message = "reset"
        return response

    def _on_checkpoint(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        active = self._phase == "active"
        fault = self._configured.save() if active else f"the tracker is {self._phase}"
        response.success, response.message = fault is None, fault or "written"
        return response

    def _watch(self) -> None:
        """Publish the health every second, and at once when a radar becomes silent or returns."""
        now = time.monotonic()
        state = self._phase, self._configured.look() if self._phase == "active" else None
        before, published = self._shown
        if state == before and now - published < HEALTH_PERIOD_S:
            return
        self._shown = state, now
        if self._live is not None:
            self._live.improve()
        statuses = self._statuses()
        if self._phase == "active":
            self._log.take(statuses)
        stamp_ns = self.get_clock().now().nanoseconds
        self._health.publish(diagnostics.array(stamp_ns, statuses))

    def _statuses(self) -> list[DiagnosticStatus]:
        if self._phase == "active":
            return self._configured.statuses()
        name, text = self.get_fully_qualified_name(), f"the tracker is {self._phase}"
        lines = {r.name: names.hardware(r.name, name) for r in self._settings.config.inputs}
        return [
            diagnostics.status(
                names.health(line, name), {}, DiagnosticStatus.STALE, text, hardware_id
            )
            for line, hardware_id in {**lines, "step time": name, "outputs": name}.items()
        ]


def _counted(one: str, several: str, names: Sequence[str]) -> str:
    return f"{len(names)} {one if len(names) == 1 else several} ({', '.join(names)})"


def _source(given: Collection[str], files: Sequence[Path]) -> str:
    """Say where the parameters are from."""
    if files:
        return f"parameters from {', '.join(map(str, files))}"
    others = f" except {', '.join(given)}" if given else ""
    return f"by the defaults (profile {DEFAULT_PROFILE}){others}: no parameter file is given"


def main(argv: Sequence[str]) -> int:
    """Run the tracker node."""
    files = arguments.check("tracker", __doc__, argv)
    return runtime.run("tracker", lambda: Tracker(files), argv)
