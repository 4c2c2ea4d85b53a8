"""The live tracker: detections in, filtered and smoothed estimates out.

A managed node. Its lifecycle and its parameters are here; the processing of scans is in `live`.
"""

from __future__ import annotations

import importlib
import re
import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.context import Context
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from msg_adapters.encoding import names
from msg_adapters.outgoing import diagnostics
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core import compilation
from phd_jdtc_ros.core.state_space import SPATIAL
from phd_jdtc_ros.core.tracks.manual import VERBS
from phd_jdtc_ros.exit_status import USAGE
from phd_jdtc_ros.parameter_files.sections import ParameterFile

from ..common import parameters, runtime
from ..common.health import DEPTH, PERIOD_S, Condition, HealthReports, status_of, summary
from ..common.runtime import ManagedNode, serve, serve_values, steady_timer
from ..common.topics import reliable
from . import peers, settings
from .inputs import Recognition
from .live import LiveTracker
from .peers import ManagerBond, NameClaim

COMPILING = "the tracker is compiling, once for each installation"


@contextmanager
def report_compilation(argv: Sequence[str]) -> Iterator[None]:
    """Report each second from the moment that something is compiled until the block ends.

    `argv` includes the ROS arguments, which give the tracker its name.
    """
    ended = threading.Event()
    thread = threading.Thread(target=_publish_compiling, args=(list(argv), ended), daemon=True)
    compilation.ON_COMPILATION.append(thread.start)
    try:
        yield
    finally:
        compilation.ON_COMPILATION.remove(thread.start)
        ended.set()
        if thread.is_alive():
            # The longest time that the end of the reports may take, seconds.
            thread.join(5.0)


def _publish_compiling(argv: list[str], ended: threading.Event) -> None:
    """Publish the status until the event; the tracker itself reports faults of its arguments."""
    context = Context()
    rclpy.init(args=argv, context=context, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = Node("tracker", context=context, enable_rosout=False, start_parameter_services=False)
        name = node.get_fully_qualified_name()
        line = status_of(name, "step time", Condition(DiagnosticStatus.STALE, COMPILING))
        lines = [summary(name, [line]), line]
        output = node.create_publisher(DiagnosticArray, names.DIAGNOSTICS, reliable(DEPTH))
        is_ended = False
        while not is_ended:
            output.publish(diagnostics.array(node.get_clock().now().nanoseconds, lines))
            is_ended = ended.wait(PERIOD_S)
        node.destroy_node()
    finally:
        context.try_shutdown()


class Tracker(ManagedNode):
    """The tracker as a lifecycle node.

    Unconfigured it has only parameters and services, configured it has all topics, and active it
    tracks. Deactivating publishes the pending scans; activating begins a new run.
    """

    _DONE = SetParametersResult(successful=True)

    def __init__(self, files: Sequence[ParameterFile] = ()) -> None:
        super().__init__("tracker")
        # The claim comes first, so that other nodes are discovered in the background meanwhile.
        self._claim = NameClaim(self, self._give_way)
        given = parameters.given_values(self, files)
        self._source = _source(given, parameters.sources(self, files))
        self._settings, self._given = settings.resolve(given), given
        self._recognition = Recognition(self._settings.config, given)
        # Interval between looks at clouds that wait for the kind of their sensor, seconds.
        self._recognition_timer = steady_timer(self, 0.1, self._recognise, autostart=False)
        # While the tracker is not configured, these may differ from the settings and be invalid.
        self._values = self._settings.values
        parameters.declare(self, self._settings.table, self._values, frozenset(self._values))
        self._live: LiveTracker | None = None
        self._bond: ManagerBond | None = None
        self._summary = "never configured"
        HealthReports(self, self._statuses, lambda: self.is_active, self._state)
        for name, action in {
            "flush": self._flush,
            "reset": self._reset,
            "checkpoint": self._checkpoint,
            "acknowledge": lambda: (True, self._configured.acknowledge()),
        }.items():
            serve(self, name, partial(self._while_active, action))
        for verb in VERBS:
            serve_values(self, f"{verb}_track", partial(self._operate, verb))
        self.start(self._settings.node["autostart"])

    def _give_way(self) -> None:
        """End, because another tracker of this name was there first."""
        if self.exit_status is None:
            self.exit_status = USAGE
            self.get_logger().error(
                f"another tracker runs as {self.get_fully_qualified_name()}: this one ends; "
                "give it a namespace or another name (-r __ns:=/NAME, -r __node:=NAME)"
            )

    def close(self) -> None:
        """Log a summary and write a checkpoint, unless another has the name or a step failed."""
        self._release()
        if self.exit_status is not None:
            return
        if self._live is not None:
            if self.is_active:
                self._live.save()
            self._summary = self._live.inputs.summary()
        self.get_logger().info(f"stopped; {self._summary}")

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make the engine and all topics; if that fails, stay unconfigured."""
        try:
            self._settings = settings.resolve(self._values)
            self._recognition = Recognition(self._settings.config, self._given)
            self._live = LiveTracker(self, self._settings, self._holds)
        except Exception as error:
            return self.refuse("not configured", error)
        model = self._settings.config.model
        if not model.births and not model.detection_births.enabled:
            self.get_logger().warning(
                "neither births nor detection_births.rates are set: no target can ever appear"
            )
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Track from now on."""
        done = super().on_activate(state)
        self._configured.start()
        self.get_logger().info(self._description())
        # A tracker that starts by itself has no manager that would wait for a bond.
        if not self._settings.node["autostart"]:
            self._bond = peers.form(self)
        return done

    def _holds(self, sensor: int, message: Any, info: Mapping[str, int]) -> bool:
        """Return whether a message waits because its sensor is none of the configured kind."""
        holds = self._recognition.holds(sensor, message, info)
        if holds and self._recognition_timer.is_canceled():
            self._recognition_timer.reset()
        return holds

    def _recognise(self) -> None:
        """Track a sensor of positions as such, once its clouds have shown its parameters."""
        recognition = self._recognition
        if not (self.is_active and recognition.held):
            self._recognition_timer.cancel()
            return
        changes = recognition.found()
        if changes is None:
            return
        self._recognition_timer.cancel()
        name, held = recognition.sensor.name, recognition.held
        try:
            table, values = settings.edit(self._values, changes)
            settings.resolve(values)
        except ConfigError as error:
            recognition.give_up()
            faults = "; ".join(error.faults)
            self.get_logger().error(f"{name}: its clouds have positions, x and y: {faults}")
            return
        own = ", ".join(f"{key} {new}" for key, new in changes.items() if key.startswith(name))
        self.get_logger().info(
            f"{name}: its clouds have x and y and no range: tracked as positions, as the first "
            f"{len(held)} show: {own}"
        )
        self.trigger_deactivate()
        self.trigger_cleanup()
        parameters.redeclare(self, table, values, changes)
        self._values, self._given = values, {**self._given, **changes}
        self.trigger_configure()
        self.trigger_activate()
        for sensor, cloud, info in held if self.is_active else ():
            self._configured.take(sensor, cloud, info)

    def _description(self) -> str:
        """Return what is tracked, with which radars, and where the parameters are from."""
        config = self._settings.config
        classes = [kind.name for kind in config.model.modes.classes]
        radars = [
            f"{radar.name} on {self.resolve_topic_name(radar.topic)}" for radar in config.inputs
        ]
        return (
            f"tracking {_count_and_list('class', 'classes', classes)} with "
            f"{_count_and_list('radar', 'radars', radars)}, {self._source}"
        )

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish the pending scans, then stop receiving and publishing."""
        self._release()
        published = self._configured.stop()
        self.get_logger().info(
            f"deactivated, {published} smoothed estimates published; "
            f"{self._configured.inputs.summary()}"
        )
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Remove all topics."""
        self._tear_down()
        self.get_logger().info("cleaned up; every parameter may change until the next configure")
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish the pending scans if active, and remove all topics."""
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
        """End the bond, which tells a lifecycle manager that the stop is intended."""
        if self._bond is not None:
            self._bond.end()
            self._bond = None

    def _tear_down(self) -> None:
        self._release()
        if self._live is not None:
            self._summary = self._live.inputs.summary()
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
        # Repeated values, as in a dump of the node, are no changes. 2 and 2.0 are one number.
        changes = {
            name: value
            for name, value in given.items()
            if name not in table or not parameters.same(value, table[name])
        }
        if not changes:
            return super().set_parameters_atomically(others) if others else self._DONE
        if self._live is None:
            return self._edit(others, changes)
        try:
            changed = settings.change(self._settings, changes)
        except ConfigError as error:
            return SetParametersResult(successful=False, reason="; ".join(error.faults))
        # These are the checked values: whole numbers given for real parameters have become real
        # numbers.
        checked = [Parameter(name, value=changed.values[name]) for name in changes]
        result = super().set_parameters_atomically([*others, *checked])
        if result.successful:
            self._settings, self._values = changed, changed.values
            self._live.retune(changed)
            summary = ", ".join(f"{parameter.name} {parameter.value}" for parameter in checked)
            self.get_logger().info(f"changed: {summary}")
        return result

    def _edit(self, others: list[Parameter], changes: dict[str, Any]) -> SetParametersResult:
        """Change parameters for the next configure; the reply names those that do not fit yet."""
        try:
            table, values = settings.edit(self._values, changes)
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
            self._settings = settings.resolve(values)
        except ConfigError as error:
            reason = f"to be completed before the next configure: {'; '.join(error.faults)}"
            return SetParametersResult(successful=True, reason=reason)
        return SetParametersResult(successful=True)

    @property
    def _configured(self) -> LiveTracker:
        """The live tracker, which exists from the configuration to the clean-up."""
        if self._live is None:
            raise RuntimeError(f"the tracker is {self.phase}, must be configured")
        return self._live

    def _while_active(self, action: Callable[[], tuple[bool, str]]) -> tuple[bool, str]:
        return action() if self.is_active else (False, f"the tracker is {self.phase}")

    def _operate(self, verb: str, given: Sequence[Any]) -> tuple[bool, str]:
        try:
            return self._while_active(lambda: (True, self._configured.operate(verb, given)))
        except ValueError as error:
            return False, str(error)

    def _flush(self) -> tuple[bool, str]:
        return True, f"{self._configured.flush()} smoothed estimates published"

    def _reset(self) -> tuple[bool, str]:
        self._configured.reset()
        return True, "reset"

    def _checkpoint(self) -> tuple[bool, str]:
        fault = self._configured.save()
        return fault is None, fault or "written"

    def _state(self) -> tuple[str, frozenset[str]]:
        """Return the phase and the alarms, whose changes are published at once."""
        return self.phase, self._configured.alarms() if self.is_active else frozenset()

    def _statuses(self) -> list[DiagnosticStatus]:
        if self.is_active:
            return self._configured.statuses()
        name = self.get_fully_qualified_name()
        condition = Condition(DiagnosticStatus.STALE, f"the tracker is {self.phase}")
        lines = {r.name: names.hardware(r.name, name) for r in self._settings.config.inputs}
        return [
            status_of(name, line, condition, hardware_id=hardware_id)
            for line, hardware_id in {**lines, "step time": name, "outputs": name}.items()
        ]


def _count_and_list(one: str, several: str, names: Sequence[str]) -> str:
    return f"{len(names)} {one if len(names) == 1 else several} ({', '.join(names)})"


def _source(given: Collection[str], files: Sequence[Path]) -> str:
    """Return the origin of the parameters, in words."""
    # The file in `config` that has the defaults.
    default_profile = "defaults"
    if files:
        return f"parameters from {', '.join(map(str, files))}"
    others = f" except {', '.join(given)}" if given else ""
    return (
        f"default parameters (profile {default_profile}){others}: no parameter file sets any; for "
        "radars of your own start from a copy of config/surveillance.yaml"
    )


def _load(given: str) -> None:
    """Load the compiled functions that the parameters in a text may need.

    Until the node begins a signal ends the process at once, and the status says what is done.
    """
    needed = (
        ("", "window.fixed_lag"),
        ("", "sensors.of_gaussians.polar"),
        (r"kind\W+reports", "reports.beside"),
        (r"kind\W+position", "sensors.of_gaussians.planar"),
        (r"state\W+space", "sensors.of_gaussians.spatial"),
    )
    for words, module in needed:
        if re.search(words, given):
            importlib.import_module(f"phd_jdtc_ros.core.{module}")
    if re.search(r"state\W+space", given):
        compilation.compile_for(len(SPATIAL))


def main(argv: Sequence[str]) -> int:
    """Run the tracker node."""
    files = parameters.given_files("tracker", __doc__, argv)
    with report_compilation(argv):
        _load(" ".join([*argv, *(repr(file.sections) for file in files)]))
    return runtime.run("tracker", lambda: Tracker(files), argv)
