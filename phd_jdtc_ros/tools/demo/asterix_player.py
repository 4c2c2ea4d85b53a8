"""Plays a recording of ASTERIX by UDP, as fast as a tracker behind a bridge answers.

A sector is sent once the tracker has processed all scans that earlier sectors have completed, as
in the lock-step of `sensor_replay`. The truth of a bag is published too. At the end the tracker is
flushed.
"""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters import diagnostics, names
from phd_jdtc_ros.asterix import records
from phd_jdtc_ros.asterix.transport import udp
from phd_jdtc_ros.asterix_bridge import pace, settings
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.exit_status import FAILED, OK, ArgumentParser
from phd_jdtc_ros.nodes.common import arguments, runtime
from phd_jdtc_ros.nodes.common.runtime import RunnableNode
from phd_jdtc_ros.nodes.replay.lock_step import GIVE_UP_S
from phd_jdtc_ros.nodes.replay.progress_line import ProgressLine
from phd_jdtc_ros.parameter_files import tracker_params

from .. import command
from ..asterix.writing import bridge_parameters
from .asterix import LOOPBACK

NAME = "asterix_player"
QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
# Conditions are checked with this period, and at each answer.
TICK_S = 0.05
# Time until endpoints must be found, and from then until they are surely connected.
START_S, SETTLE_S = 60.0, 0.5
# The evaluator has two subscriptions: one scores the truth, the other records it.
TRUTH_SUBSCRIBERS = 2


class PlayerError(Exception):
    """The recording cannot be played to its end; the message gives the reason."""


class AsterixPlayer(RunnableNode):
    """Sends the datagrams of a recording to the bridge at `where`, and the truth of a bag."""

    def __init__(
        self, recording: Path, bag: BagReader, where: udp.Address, config: TrackerConfig
    ) -> None:
        super().__init__(NAME)
        records.prepare()
        bridge = settings.resolve(bridge_parameters(config))
        steps = pace.steps(recording, bridge, config, bag.messages([names.TRUTH]))
        self._answers, self._answered_s = 0, 0.0
        self._expected: Counter[str] = Counter()
        self._received: Counter[str] = Counter()
        self._begin_ns = bag.start_ns
        self._line = ProgressLine(0.0, (bag.end_ns - bag.start_ns) * 1e-9)
        self._sender = udp.sender(where, LOOPBACK)
        self._truth = self.create_publisher(PointCloud2, names.TRUTH, QOS)
        self.create_subscription(DiagnosticArray, names.cardinality(), self._on_answer, QOS)
        self.create_subscription(DiagnosticArray, names.DIAGNOSTICS, self._on_health, QOS)
        self._flush = self.create_client(Trigger, f"{names.TRACKER}/flush")
        self._playing = self._play(steps)
        self.create_timer(TICK_S, self._continue)

    def close(self) -> None:
        """Stop the progress line, and log what was sent."""
        self._line.stop()
        self._sender.close()
        listed = ", ".join(f"{radar} {count}" for radar, count in self._expected.items())
        self.get_logger().info(f"sent sectors: {listed or 'none'}")

    def _continue(self) -> None:
        try:
            next(self._playing, None)
        except PlayerError as error:
            self.get_logger().error(str(error))
            self.exit_status = FAILED

    def _play(self, steps: Iterator[pace.Step]) -> Iterator[None]:
        """Play the recording; each `yield` waits for the next tick or answer."""
        yield from self._wait(self._missing_node, START_S)
        connected_s = time.monotonic()
        while time.monotonic() - connected_s < SETTLE_S:
            yield
        scans = 0
        for step in steps:
            # Plots may go ahead, because they belong to the next sector.
            if step.clouds:
                yield from self._wait(partial(self._missing_answer, scans))
            self._send(step)
            scans += step.scans
        yield from self._wait(self._missing_sectors)
        service, flushed = self._flush.srv_name, self._flush.call_async(Trigger.Request())
        silent = f"service {service} did not answer"
        yield from self._wait(lambda: "" if flushed.done() else silent)
        answer = flushed.result()
        if not answer.success:
            raise PlayerError(f"service {service} refused: {answer.message}")
        self.exit_status = OK

    def _wait(self, missing: Callable[[], str], patience_s: float = GIVE_UP_S) -> Iterator[None]:
        """Wait until nothing is missing; the patience begins again with each answer.

        Raises
        ------
        PlayerError
            With what is missing, if the patience ends first.
        """
        begin_s = time.monotonic()
        while reason := missing():
            if time.monotonic() - max(begin_s, self._answered_s) > patience_s:
                raise PlayerError(reason)
            yield

    def _missing_node(self) -> str:
        connected = (
            self._truth.get_subscription_count() >= TRUTH_SUBSCRIBERS
            and self.count_publishers(names.cardinality()) > 0
            and self._flush.service_is_ready()
        )
        return "" if connected else "no tracker or no evaluator was found"

    def _missing_answer(self, scans: int) -> str:
        silent = f"no answer on {names.cardinality()} for {GIVE_UP_S:g} s"
        return "" if self._answers >= scans else silent

    def _missing_sectors(self) -> str:
        received, sent = self._received.total(), self._expected.total()
        missing = f"the tracker has received only {received} of {sent} sectors"
        return "" if self._received == self._expected else missing

    def _send(self, step: pace.Step) -> None:
        for message in step.truth:
            self._truth.publish(message.data)
        if step.data:
            self._sender.send(step.data)
        for radar, stamp_ns in step.clouds:
            self._expected[radar] += 1
            self._line.show((stamp_ns - self._begin_ns) * 1e-9, "playing", 1)

    def _on_answer(self, _: DiagnosticArray) -> None:
        self._answers += 1
        self._answered_s = time.monotonic()
        self._continue()

    def _on_health(self, message: DiagnosticArray) -> None:
        """Store how many messages of each radar the tracker has received."""
        for status in message.status:
            for radar in self._expected:
                if status.name == names.health(radar):
                    self._received[radar] = int(diagnostics.values_of(status)["received"])


def main(argv: Sequence[str]) -> int:
    """Run the player."""
    parser = ArgumentParser(NAME, description=__doc__)
    parser.add_argument("recording", type=Path, help="of ASTERIX")
    parser.add_argument("--bag", type=Path, required=True, help="with the truth")
    parser.add_argument("--send", required=True, type=udp.address, metavar="HOST:PORT")
    parser.add_argument("--params-file", type=Path, required=True, help="of the tracker")
    others, _ = arguments.split(NAME, argv)

    def work(given: Namespace) -> int:
        config = tracker_params.load(given.params_file, names.TRACKER)
        player = partial(AsterixPlayer, given.recording, BagReader(given.bag), given.send, config)
        return runtime.run(NAME, player, argv[len(others) :])

    return command.run(parser, others, work)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
