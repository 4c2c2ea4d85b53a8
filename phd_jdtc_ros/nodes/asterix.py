"""The live bridge: radars' UDP to clouds, estimates to UDP.

It publishes the sectors, or slices of time, that datagrams complete; a timer sends the tracks.
Sectors that wait for late plots are published after a time without datagrams, or at the end.
"""

from __future__ import annotations

import socket
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import RejectedMessageError, names
from phd_jdtc_ros.asterix import records
from phd_jdtc_ros.asterix.clocks import StreamClock
from phd_jdtc_ros.asterix.plot_stream import PERIOD_NS, Cloud, PlotStream, RadarState
from phd_jdtc_ros.asterix_bridge import configuration
from phd_jdtc_ros.asterix_bridge.clouds import cloud_of, topic_of
from phd_jdtc_ros.asterix_bridge.tracks import MAX_PREDICTION_S, TrackOutput, track_output
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.targets.modes import ModeSpace
from phd_jdtc_ros.parameter_files.from_arguments import config_of
from phd_jdtc_ros.parameter_files.sections import ParameterFile
from phd_jdtc_ros.quoting import counted, counts_text
from phd_jdtc_ros.transport import sockets
from phd_jdtc_ros.transport.network import Datagram
from phd_jdtc_ros.transport.sockets import Input

from .common import parameters, runtime, topics
from .common.health import HealthReports, ThrottledWarnings, first, status_of
from .common.parameters import TrackerParameters
from .common.receiving import Moment, ReceivingNode, nothing_received
from .common.runtime import steady_timer

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
# A radar without messages for this time is silent, seconds.
SILENT_S = 15.0
# Other categories, and radars without settings, are no faults.
EXPECTED = frozenset({"other_category", "unknown_radar", "no_detection"})


def of_input(at: Moment, stream: PlotStream, lost: int, inputs: Sequence[str]) -> DiagnosticStatus:
    """Return the status of all received datagrams; for `lost` ones there was no room."""
    counts = +stream.counts
    faults = {reason: count for reason, count in counts.items() if reason not in EXPECTED}
    quiet_s = at.quiet_s("datagrams", stream.datagrams)
    quiet = nothing_received("datagram", quiet_s, inputs)
    losing = at.recent("lost", lost)
    malformed = at.recent("faults", sum(faults.values()))
    condition = first(
        at.inactive,
        (WARN, inputs and quiet_s > SILENT_S, quiet),
        (WARN, losing, f"{counted(lost, 'datagram[s]')} lost: they come too fast"),
        (WARN, malformed, f"malformed: {counts_text(faults)}"),
        (OK, True, counted(stream.datagrams, "datagram[s]")),
    )
    trailers = sum(stream.blocks.known_trailers().values())
    values = {"datagrams": stream.datagrams, "lost": lost, "trailers": trailers, **counts}
    return status_of(at.node, "input", condition, values)


def of_radar(at: Moment, number: int, state: RadarState) -> DiagnosticStatus:
    """Return the status of a radar by its number: what was read, and how its clock is off."""
    offset_s, shift_s = state.clock.offset_s, state.clock.shift_ns * 1e-9
    values = {
        "plots": state.plots,
        "positions": state.positions,
        "service_messages": state.services,
        "clouds": state.reports,
        "revolution_s": state.assembler.revolution_s,
        "clock_offset_s": offset_s,
        "clock_shift_s": shift_s,
        **+state.counts,
    }
    name = state.settings.name
    messages = state.plots + state.services + state.positions
    late = state.counts["late_plots"]
    quiet_s = at.quiet_s(f"{name} messages", messages)
    quiet = f"silent for {quiet_s:.0f} s" if messages else "no messages yet"
    sources = " and ".join(dict.fromkeys(state.sources.values()))
    second = at.recent(f"{name} second", state.counts["second_source"])
    places = at.recent(f"{name} places", state.counts["second_place"])
    arriving_late = at.recent(f"{name} late", late)
    condition = first(
        at.inactive,
        (WARN, quiet_s > SILENT_S, quiet),
        (WARN, second, f"two sources: {sources} used, {state.other_source} ignored"),
        (
            WARN,
            places,
            "two places: several radars have this SAC/SIC, or it moves; the first is used",
        ),
        (WARN, shift_s, f"its clock is {-offset_s:+.1f} s off; its times are shifted"),
        (WARN, arriving_late, f"{counted(late, 'plot[s] came after [its|their]')} cloud was sent"),
        (OK, True, f"{_taken(state)} in {counted(state.reports, 'cloud[s]')}"),
    )
    return status_of(at.node, name, condition, values, f"{number >> 8}/{number & 255}")


def _taken(state: RadarState) -> str:
    """Return in words what has been taken of a source."""
    positions = counted(state.positions, "position[s]") if state.positions else ""
    plots = counted(state.plots, "plot[s]") if state.plots or not positions else ""
    return " and ".join(filter(None, (plots, positions)))


def of_output(
    at: Moment, output: str, sent: Counter[str], dropped: Mapping[str, int], clouds: int, hint: str
) -> DiagnosticStatus:
    """Return the status of the output to an address, which is empty for none.

    `dropped` are the numbers of clouds that are not sent, by reason, and `clouds` that of received
    ones. `hint` is the fault of a topic without estimates, empty if they are published.
    """
    counts = {reason: count for reason, count in dropped.items() if reason != "lost"}
    dropping = at.recent("dropped", sum(counts.values()))
    quiet_s = at.quiet_s("estimates", clouds)
    quiet = "; ".join(filter(None, (f"no estimates for {quiet_s:.0f} s", hint)))
    condition = first(
        (OK, not output, "nowhere to send tracks"),
        at.inactive,
        (WARN, dropping, counts_text(counts)),
        (WARN, quiet_s > SILENT_S, quiet),
        (OK, True, f"{counted(sent['tracks'], 'track[s]')} sent to {output}"),
    )
    return status_of(at.node, "output", condition, {**sent, **counts})


# The topic of the estimates to send, unless it is remapped.
ESTIMATES = names.estimates("filtered")


class AsterixBridge(ReceivingNode):
    """The bridge, which receives and sends while it is active."""

    INPUT_DEPTH = 10

    def __init__(self, files: Sequence[ParameterFile] = ()) -> None:
        super().__init__("asterix_bridge")
        given = parameters.given_values(self, files)
        self._bridge = configuration.resolve(given, configuration.TABLE)
        self._values = self._bridge.values
        parameters.declare(self, self._bridge.table, self._values)
        self._warnings = ThrottledWarnings(self.get_logger())
        self._stream = self._new_stream()
        self._sender: socket.socket | None = None
        self._output: TrackOutput | None = None
        self._modes: ModeSpace | None = None
        self._taken_s = 0.0
        self._clouds = 0
        self._dropped: Counter[str] = Counter()
        self._sent: Counter[str] = Counter()
        # Other radars get their publishers with their first report.
        for name in self._values["radars"]:
            self.add_output(names.detections(name))
        if self._values["output"]:
            topics.subscribe(
                self, PointCloud2, ESTIMATES, self._on_estimates, self.INPUT_DEPTH, ESTIMATES
            )
            tracker = names.tracker_of(self.resolve_topic_name(ESTIMATES))
            TrackerParameters(self, tracker, self._on_parameters)
        HealthReports(self, self._statuses, lambda: self.is_active)
        steady_timer(self, PERIOD_NS * 1e-9 / 2.0, self._publish_due)
        period_s = self._values["output_period_s"]
        if self._values["output"] and period_s:
            steady_timer(self, period_s, self._send)
        self.start(self._values["autostart"])

    def _new_stream(self) -> PlotStream:
        return self._bridge.stream(StreamClock(0, self._values["max_clock_offset_s"]))

    def close(self) -> None:
        """Stop receiving, and log a summary; fail if nothing was received."""
        super().close()
        radars = [
            f"{state.settings.name} {_taken(state)} in {counted(state.reports, 'cloud[s]')}"
            for state in self._stream.radars.values()
        ]
        self.get_logger().info(
            f"stopped; {', '.join(radars) or 'no radars'}; "
            f"{counted(self._sent['tracks'], 'track[s]')} sent"
        )

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin without radars and tracks."""
        records.prepare()
        self._stream = self._new_stream()
        self._output = None
        return super().on_configure(state)

    @property
    def pieces(self) -> int:
        """See `ReceivingNode.pieces`."""
        return self._stream.datagrams

    def inputs(self) -> tuple[Sequence[Input], str]:
        """See `ReceivingNode.inputs`."""
        return [sockets.address(text) for text in self._values["inputs"]], self._values["interface"]

    def open(self) -> None:
        """See `ReceivingNode.open`; open the output too."""
        output = self._values["output"]
        if output:
            try:
                self._sender = sockets.sender(sockets.address(output), self._values["interface"])
            except OSError as error:
                raise OSError(error.errno, error.strerror, output) from error
            self.get_logger().info(f"sending to {output}")
        super().open()

    def stop(self) -> None:
        """See `ReceivingNode.stop`; close the output too."""
        super().stop()
        if self._sender is not None:
            self._sender.close()
            self._sender = None

    def process(self, received: Datagram) -> Iterator[object]:
        """See `ReceivingNode.process`."""
        known_ns = None if self._values["replayed"] else received.received_ns
        for found in self._stream.iter_reports(received.data, known_ns, received.source):
            for state, report in found:
                self._publish(state, report)
            yield None

    def finish(self) -> None:
        """See `ReceivingNode.finish`."""
        for state, report in self._stream.finish():
            self._publish(state, report)

    def _publish(self, state: RadarState, report: Cloud) -> None:
        topic = topic_of(report, state)
        self.add_output(topic).publish(cloud_of(report, state))

    def _publish_due(self) -> None:
        if self.is_active and not self._values["replayed"]:
            for state, report in self._stream.due(time.time_ns()):
                self._publish(state, report)

    def _on_parameters(self, values: dict[str, Any]) -> None:
        """Learn the tracker's motion modes, whose noise the accuracy of predicted tracks needs."""
        try:
            self._modes = config_of(values).model.modes
        except ConfigError:  # It is no tracker, such as `hand_over`
            return
        if self._output is not None:
            self._output.modes = self._modes

    def _on_estimates(self, cloud: PointCloud2) -> None:
        if self._sender is None:
            return
        self._clouds += 1
        alone = len(self._stream.radars) == 1
        if self._output is None:
            self._output = track_output(self._bridge, alone, self._stream.call_signs)
            self._output.modes = self._modes
        # Radars without a name in the parameters become known while the bridge runs.
        self._output.source = replace(self._output.source, monosensor=alone)
        try:
            self._output.update(cloud)
        except RejectedMessageError as error:
            self._dropped[error.reason] += 1
            topic = self.resolve_topic_name(ESTIMATES)
            self._warnings.warn(topic, f"{topic}: {error}")
            return
        self._taken_s = time.monotonic()
        if not self._values["output_period_s"]:
            self._send()

    def _send(self) -> None:
        """Send all tracks, predicted to now; in a replay, to the present time of the estimates."""
        if self._sender is None or self._output is None:
            return
        now_ns, stamp_ns = time.time_ns(), self._output.stamp_ns
        if abs(now_ns - stamp_ns) > MAX_PREDICTION_S * 1e9:
            now_ns = stamp_ns + round((time.monotonic() - self._taken_s) * 1e9)
        if not self._values["output_period_s"]:
            now_ns = stamp_ns
        for block in self._output.datagrams(now_ns):
            try:
                self._sender.send(block)
                self._sent["datagrams"] += 1
            except OSError as error:
                # A missing receiver causes this, for example, which is not a fault of the sender.
                self._dropped["not_sent"] += 1
                self._warnings.warn("output", f"{self._values['output']}: {error.strerror}")
        self._sent["tracks"] = self._output.tracks

    def _statuses(self) -> list[DiagnosticStatus]:
        self.log_subscribers()
        at, stream = self.moment, self._stream
        output, hint = self._values["output"], ""
        if output:
            hint = topics.publisher_hint(self, self.resolve_topic_name(ESTIMATES), PointCloud2)
        return [
            of_input(at, stream, self.lost, self._values["inputs"]),
            of_output(at, output, self._sent, self._dropped, self._clouds, hint),
            *(of_radar(at, number, state) for number, state in stream.radars.items()),
        ]


def main(argv: Sequence[str]) -> int:
    """Run the bridge's node."""
    files = parameters.given_files("asterix_bridge", __doc__, argv)
    return runtime.run("asterix_bridge", lambda: AsterixBridge(files), argv)
