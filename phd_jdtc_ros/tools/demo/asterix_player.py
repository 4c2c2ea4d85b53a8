"""Replays a bag to a tracker behind a bridge, with the detections by UDP.

They are sent from a recording of ASTERIX, sector by sector, in the lock-step of
`sensor_replay`, and self-reports from a recording of sentences with times of receipt.
"""

from __future__ import annotations

import heapq
import re
import sys
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray

from msg_adapters.encoding import names
from msg_adapters.outgoing import diagnostics
from phd_jdtc_ros.asterix import framing, records
from phd_jdtc_ros.asterix.clocks import StreamClock
from phd_jdtc_ros.asterix_bridge.configuration import Bridge, resolve
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagMessage, BagReader
from phd_jdtc_ros.exit_status import ArgumentParser
from phd_jdtc_ros.nodes.common import parameters, runtime, topics
from phd_jdtc_ros.nodes.playback import GIVE_UP_S
from phd_jdtc_ros.nodes.replay import SensorReplay
from phd_jdtc_ros.parameter_files import from_arguments, node_tables
from phd_jdtc_ros.transport import pcap, sockets
from phd_jdtc_ros.transport.network import RecordingError

from ..asterix.writing import bridge_parameters
from .asterix import LOOPBACK

# The time of receipt at the beginning of a line.
_RECEIPT = re.compile(rb"\\c:(\d+)\*")
DEPTH = 50


class Datagram(BagMessage):
    """A datagram of a sector; its log time is the stamp of the cloud that the sector becomes."""

    @property
    def stamp_ns(self) -> int:
        """Stamp of the cloud."""
        return self.log_time_ns


class Recording(BagReader):
    """A bag whose detections are in a recording of ASTERIX, as a bridge would assemble them.

    Those of `receivers` are in a recording of sentences.
    """

    def __init__(
        self, bag: Path, recording: Path, bridge: Bridge, receivers: Mapping[str, Path]
    ) -> None:
        super().__init__(bag)
        self.sentences = receivers
        self._recording, self._bridge = recording, bridge
        self.clouds: Counter[str] = Counter()  # Clouds of the sectors read, by radar
        self.detections = [names.detections(radar.name) for radar in bridge.radars.values()]

    def messages(
        self, topics: list[str] | None = None, until_ns: int | None = None
    ) -> Iterator[BagMessage]:
        """Yield the messages of other topics, and the datagrams of each sector after the last one.

        Raise `BagError` if the file is not a recording.
        """
        others = set(self.types if topics is None else topics)
        others = others.difference(self.detections, self.sentences)
        parts = [super().messages(list(others), until_ns), self._datagrams()]
        parts += [_sentences(topic, path) for topic, path in self.sentences.items()]
        yield from heapq.merge(*parts, key=attrgetter("log_time_ns"))

    def _datagrams(self) -> Iterator[BagMessage]:
        """Yield datagrams with the stamps that the clouds get from a bridge that is `replayed`."""
        stream = self._bridge.stream(StreamClock())
        waiting: list[bytes] = []
        try:
            with pcap.open_recording(self._recording, Counter()) as data:
                for received in framing.datagrams(data, None, Counter()):
                    waiting.append(received.data)
                    for state, report in stream.feed(received.data):
                        radar = state.settings.name
                        self.clouds[radar] += 1
                        yield from (
                            Datagram(names.detections(radar), report.stamp_ns, each)
                            for each in waiting
                        )
                        waiting.clear()
        except RecordingError as error:
            raise BagError(f"{self._recording}: {error}") from error


def _sentences(topic: str, path: Path) -> Iterator[BagMessage]:
    """Yield the lines of a file with the times of their receipt, whole seconds in tag blocks."""
    for line in path.read_bytes().splitlines(keepends=True):
        if (found := _RECEIPT.match(line)) is not None:
            yield Datagram(topic, int(found[1]) * 10**9, line)


class UdpOutput:
    """Sends to a bridge in the place of a publisher."""

    def __init__(self, where: sockets.Address) -> None:
        self._sender = sockets.sender(where, LOOPBACK)

    def publish(self, data: bytes) -> None:
        """Send a datagram."""
        self._sender.send(data)

    def get_subscription_count(self) -> int:
        """Return enough for any wait: the demo itself waits for the bridge and its subscribers."""
        return sys.maxsize

    def wait_for_all_acked(self, _: Any) -> bool:
        """Return True, because datagrams are not acknowledged."""
        return True


class AsterixPlayer(SensorReplay):
    """A replay whose detections go to a bridge."""

    def __init__(self, given: Namespace, flags: dict[str, Any]) -> None:
        records.prepare()
        config = from_arguments.load_config(given.tracker, names.TRACKER)
        bridge = resolve(bridge_parameters(config))
        topics_of = [own.topic for own in config.receivers] if given.sentences else []
        receivers = dict.fromkeys(topics_of, given.sentences)
        self._bag = Recording(Path(flags["bag"]), given.recording, bridge, receivers)
        self._udp = dict.fromkeys(self._bag.detections, UdpOutput(given.send))
        if given.sentences:
            self._udp |= dict.fromkeys(topics_of, UdpOutput(given.send_sentences))
        self._received: Counter[str] = Counter()
        super().__init__(flags, bag=self._bag)
        qos = topics.reliable(DEPTH)
        self.create_subscription(DiagnosticArray, names.DIAGNOSTICS, self._on_health, qos)

    def _output(self, topic: str, message_class: Any) -> Any:
        return self._udp.get(topic) or super()._output(topic, message_class)

    def _drain(self) -> None:
        """Wait until the tracker has received all sectors, before it is flushed."""
        if self._received == self._bag.clouds:
            super()._drain()
        elif time.monotonic() - self._since > GIVE_UP_S:
            received, sent = self._received.total(), self._bag.clouds.total()
            self._fail(f"the tracker has received only {received} of {sent} sectors")

    def _on_health(self, message: DiagnosticArray) -> None:
        """Store how many messages of each radar the tracker has received."""
        for status in message.status:
            for radar in self._bag.clouds:
                if status.name == names.health(radar):
                    self._received[radar] = int(diagnostics.values_of(status)["received"])


def main(argv: Sequence[str]) -> int:
    """Run the player; other flags than its own are those of `sensor_replay`."""
    name = "asterix_player"
    parser = ArgumentParser(name, description=__doc__)
    parser.add_argument("--recording", type=Path, required=True, help="of ASTERIX")
    parser.add_argument("--send", required=True, type=sockets.address, metavar="HOST:PORT")
    parser.add_argument("--sentences", type=Path, help="recording of AIS")
    parser.add_argument("--send-sentences", type=sockets.address, metavar="HOST:PORT")
    parser.add_argument("--tracker", type=Path, required=True, help="its parameter file")
    others, _ = parameters.split(name, argv)
    given, flags = parser.parse_known_args(others)
    make = partial(AsterixPlayer, given, node_tables.flags(flags))
    return runtime.run(name, make, argv[len(others) :])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
