"""The live bridge of reports: AIS and ADS-B by UDP, TCP or serial lines to clouds.

Reports are collected for a short time, so that a busy receiver does not make a message of each.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from msg_adapters.encoding import names
from phd_jdtc_ros import report_bridge as settings
from phd_jdtc_ros.parameter_files.sections import ParameterFile
from phd_jdtc_ros.quoting import counted, counts_text
from phd_jdtc_ros.transponders import stream
from phd_jdtc_ros.transponders.messages import ADSB, AIS
from phd_jdtc_ros.transponders.stream import Batch
from phd_jdtc_ros.transport import sockets
from phd_jdtc_ros.transport.network import Datagram
from phd_jdtc_ros.transport.sockets import Input

from .common import parameters, runtime
from .common.health import HealthReports, first, status_of
from .common.receiving import Moment, ReceivingNode, nothing_received
from .common.runtime import steady_timer

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class ReportBridge(ReceivingNode):
    """The bridge, which receives while it is active."""

    # A receiver of ships or aircraft without any message for this time is silent, seconds.
    SILENT_S = 60.0

    received = "data"

    def __init__(self, files: Sequence[ParameterFile] = ()) -> None:
        super().__init__("report_bridge")
        given = parameters.given_values(self, files)
        self._values = settings.resolve(given, settings.TABLE)
        table = {parameter.name: parameter for parameter in settings.TABLE}
        parameters.declare(self, table, self._values)
        self._stream = settings.stream(self._values)
        self._missing = ""
        for network in (AIS, ADSB):
            self.add_output(names.reports(network))
        HealthReports(self, self._statuses, lambda: self.is_active)
        steady_timer(self, settings.PERIOD_S / 2.0, self._publish_due)
        self.start(self._values["autostart"])

    def close(self) -> None:
        """Stop receiving, and log a summary; fail if nothing was received."""
        super().close()
        used = counts_text(self._stream.used) or "none"
        left_out = counts_text(self._stream.counts) or "nothing"
        self.get_logger().info(f"stopped; reports: {used}; left out: {left_out}")

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin without transmitters."""
        self._stream = settings.stream(self._values)
        return super().on_configure(state)

    @property
    def pieces(self) -> int:
        """See `ReceivingNode.pieces`."""
        return self._stream.pieces

    def inputs(self) -> tuple[Sequence[Input], str]:
        """See `ReceivingNode.inputs`."""
        inputs = [sockets.input_of(text) for text in self._values["inputs"]]
        return inputs, self._values["interface"]

    def process(self, received: Datagram) -> Iterator[object]:
        """See `ReceivingNode.process`."""
        known_ns = None if self._values["replayed"] else received.received_ns
        try:
            for found in self._stream.feed(received._replace(received_ns=known_ns)):
                if found is not None:
                    self._publish(*found)
                yield None
        except ModuleNotFoundError as error:
            # The library of one format is missing; others may come on other inputs.
            fault = settings.missing(error)
            if fault != self._missing:
                self.get_logger().error(fault)
            self._missing = fault

    def finish(self) -> None:
        """See `ReceivingNode.finish`."""
        for network, batch in self._stream.finish():
            self._publish(network, batch)

    def _publish_due(self) -> None:
        if self.is_active and not self._values["replayed"]:
            for network, batch in self._stream.due(time.time_ns()):
                self._publish(network, batch)

    def _publish(self, network: str, batch: Batch) -> None:
        self.add_output(names.reports(network)).publish(settings.cloud(batch, network))

    def _statuses(self) -> list[DiagnosticStatus]:
        self.log_subscribers()
        at, used = self.moment, self._stream.used
        return [self._of_input(at), *(self._of_network(at, name) for name in used)]

    def _of_input(self, at: Moment) -> DiagnosticStatus:
        counts = self._stream.counts
        faults = {name: n for name, n in counts.items() if name not in stream.INTENDED}
        quiet_s = at.quiet_s("pieces", self.pieces)
        quiet = nothing_received(self.received, quiet_s, self._values["inputs"])
        silent = "; ".join(f"{name}: {why}" for name, why in self.disconnected.items())
        off = at.recent("off", counts["time_off"] + counts["tag_time_off"])
        rising = at.recent("faults", sum(faults.values()))
        condition = first(
            at.inactive,
            (ERROR, self._missing, self._missing),
            (WARN, silent, silent),
            (WARN, self._values["inputs"] and quiet_s > self.SILENT_S, quiet),
            (WARN, at.recent("lost", self.lost), f"{self.lost} pieces lost: they come too fast"),
            (WARN, off, f"{off} times far from their receipt, which was used instead"),
            (WARN, rising, f"left out: {counts_text(faults)}"),
            (OK, True, counted(self._stream.formats.total(), "message[s]")),
        )
        values = {"pieces": self.pieces, "lost": self.lost, **self._stream.formats, **+counts}
        return status_of(at.node, "input", condition, values)

    def _of_network(self, at: Moment, network: str) -> DiagnosticStatus:
        used = self._stream.used[network]
        quiet_s = at.quiet_s(network, used)
        condition = first(
            at.inactive,
            (WARN, quiet_s > self.SILENT_S, f"silent for {quiet_s:.0f} s"),
            (OK, True, counted(used, "report[s]")),
        )
        known = len(self._stream.transmitters.known)
        return status_of(at.node, network, condition, {"reports": used, "transmitters": known})


def main(argv: Sequence[str]) -> int:
    """Run the bridge's node."""
    files = parameters.given_files("report_bridge", __doc__ or "", argv)
    return runtime.run("report_bridge", lambda: ReportBridge(files), argv)
