"""Plays a recording of ASTERIX by UDP, as fast as a tracker behind a bridge answers.

As `sensor_replay` in lock-step, with a bridge between: a sector is sent once the tracker has
stepped all scans that those before have closed. The truth of a bag is published beside it. In the
end the tracker is flushed.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from enum import Enum, auto
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters import diagnostics, names
from phd_jdtc_ros.asterix import records
from phd_jdtc_ros.asterix.transport import udp
from phd_jdtc_ros.asterix_bridge import pace, settings
from phd_jdtc_ros.asterix_bridge.settings import Bridge
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

NAME = "asterix_player"
QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
# While playing, answers say when to go on.
TICK_S = 0.05
# Endpoints are connected a moment after the graph shows them.
START_S, SETTLE_S = 60.0, 0.5
# The evaluator scores the truth and records it.
TRUTH_SUBSCRIBERS = 2


class State(Enum):
    """What the player is doing."""

    WAITING = auto()
    PLAYING = auto()
    DRAINING = auto()
    FLUSHING = auto()


class AsterixPlayer(RunnableNode):
    """Sends the datagrams of a recording.

    Parameters
    ----------
    bag : BagReader
        With the truth.
    bridge : Bridge
        As the bridge has it.
    where : udp.Address
        That the bridge receives from.
    interface : str
        Address of the network interface, for a group.
    config : TrackerConfig
        As the tracker has it.
    """

    def __init__(
        self,
        recording: Path,
        bag: BagReader,
        bridge: Bridge,
        where: udp.Address,
        interface: str,
        config: TrackerConfig,
    ) -> None:
        super().__init__(NAME)
        records.prepare()
        self._steps = pace.steps(recording, bridge, config, bag.messages([names.TRUTH]))
        self._upcoming = next(self._steps, None)
        self._ready = False
        self._scans = self._answers = 0
        self._expected: Counter[str] = Counter()
        self._received: Counter[str] = Counter()
        self._flushed: Future | None = None
        self._state, self._since_s = State.WAITING, time.monotonic()
        self._begin_ns = bag.start_ns
        self._line = ProgressLine(0.0, (bag.end_ns - bag.start_ns) * 1e-9)
        self._sender = udp.sender(where, interface)
        self._truth = self.create_publisher(PointCloud2, names.TRUTH, QOS)
        self.create_subscription(DiagnosticArray, names.cardinality(), self._on_answer, QOS)
        self.create_subscription(DiagnosticArray, names.DIAGNOSTICS, self._on_health, QOS)
        self._flush = self.create_client(Trigger, f"{names.TRACKER}/flush")
        self.create_timer(TICK_S, self._tick)

    def close(self) -> None:
        """Stop the progress line, and log what was sent."""
        self._line.stop()
        self._sender.close()
        listed = ", ".join(f"{radar} {count}" for radar, count in self._expected.items())
        self.get_logger().info(f"sent sectors: {listed or 'none'}")

    def _tick(self) -> None:
        work: dict[State, Callable[[], None]] = {
            State.WAITING: self._wait,
            State.PLAYING: self._play,
            State.DRAINING: self._drain,
            State.FLUSHING: self._finish,
        }
        work[self._state]()

    def _enter(self, state: State) -> None:
        self._state, self._since_s = state, time.monotonic()

    def _waited_s(self) -> float:
        return time.monotonic() - self._since_s

    def _wait(self) -> None:
        """Wait until the tracker and the evaluator are there, and then a moment more."""
        there = (
            self._truth.get_subscription_count() >= TRUTH_SUBSCRIBERS
            and self.count_publishers(names.cardinality()) > 0
            and self._flush.service_is_ready()
        )
        if there and not self._ready:
            self._ready = True
            self._since_s = time.monotonic()
        elif self._ready and self._waited_s() > SETTLE_S:
            self._enter(State.PLAYING)
        elif self._waited_s() > START_S:
            self._fail("neither a tracker nor an evaluator is there")

    def _play(self) -> None:
        while (step := self._upcoming) is not None:
            # Plots may go ahead, because they are of the next sector.
            if step.clouds and self._answers < self._scans:
                if self._waited_s() > GIVE_UP_S:
                    self._fail(f"no answer on {names.cardinality()} for {GIVE_UP_S:g} s")
                return
            self._send(step)
            self._upcoming = next(self._steps, None)
        self._enter(State.DRAINING)

    def _send(self, step: pace.Step) -> None:
        for message in step.truth:
            self._truth.publish(message.data)
        if step.data:
            self._sender.send(step.data)
        self._scans += step.scans
        for radar, stamp_ns in step.clouds:
            self._expected[radar] += 1
            self._line.show((stamp_ns - self._begin_ns) * 1e-9, "playing", 1)

    def _drain(self) -> None:
        """Wait until the tracker has received every sector, and flush it."""
        if self._received == self._expected:
            self._flushed = self._flush.call_async(Trigger.Request())
            self._enter(State.FLUSHING)
        elif self._waited_s() > GIVE_UP_S:
            found = f"{self._received.total()} of {self._expected.total()}"
            self._fail(f"the tracker has received {found} sectors only")

    def _finish(self) -> None:
        if self._flushed is not None and self._flushed.done():
            answer = self._flushed.result()
            if answer.success:
                self.exit_status = OK
            else:
                self._fail(f"service {self._flush.srv_name} refused: {answer.message}")
        elif self._waited_s() > GIVE_UP_S:
            self._fail(f"service {self._flush.srv_name} did not answer")

    def _fail(self, reason: str) -> None:
        self.get_logger().error(reason)
        self.exit_status = FAILED

    def _on_answer(self, _: DiagnosticArray) -> None:
        self._answers += 1
        if self._state is State.PLAYING:
            self._since_s = time.monotonic()
            self._play()

    def _on_health(self, message: DiagnosticArray) -> None:
        """Take in how many messages of each radar the tracker has received."""
        for status in message.status:
            for radar in self._expected:
                if status.name == names.health(radar):
                    self._received[radar] = int(diagnostics.values_of(status)["received"])


def _parser() -> ArgumentParser:
    parser = ArgumentParser(NAME, description=__doc__)
    parser.add_argument("recording", type=Path, help="of ASTERIX")
    parser.add_argument("--bag", required=True, help=f"with the truth; {command.BAG}")
    parser.add_argument("--send", required=True, type=udp.address, metavar="HOST:PORT")
    parser.add_argument("--interface", default="", help="address of the interface, for a group")
    parser.add_argument("--params-file", type=Path, required=True, help="of the tracker")
    return parser


def main(argv: Sequence[str]) -> int:
    """Run the player."""
    others, _ = arguments.split(NAME, argv)
    given = _parser().parse_args(others)

    def work() -> int:
        config = tracker_params.load(given.params_file, names.TRACKER)
        bridge = settings.resolve(bridge_parameters(config))
        bag = BagReader(Path(given.bag))

        def player() -> AsterixPlayer:
            return AsterixPlayer(given.recording, bag, bridge, given.send, given.interface, config)

        return runtime.run(NAME, player, argv[len(others) :])

    return command.guarded(NAME, work)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
