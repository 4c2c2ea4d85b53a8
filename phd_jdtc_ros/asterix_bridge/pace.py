"""Plans the playback of a recording: truth, datagrams, and the clouds and scans they complete."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from msg_adapters.readers import reader_of
from phd_jdtc_ros.asterix.clocks import StreamClock
from phd_jdtc_ros.asterix.plot_stream import RadarState
from phd_jdtc_ros.asterix.slices import SectorReport
from phd_jdtc_ros.asterix.transport import framing
from phd_jdtc_ros.asterix.transport.datagram import RecordingError
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.reader import BagMessage
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.types import Scan

from . import clouds
from .settings import Bridge


class Step(NamedTuple):
    """A datagram of a recording with its effects."""

    data: bytes  # Data of the datagram; empty at the end
    # Radar and stamp, ns, of each cloud that the bridge completes with this datagram.
    clouds: tuple[tuple[str, int], ...]
    scans: int  # Number of scans that the tracker steps with these clouds
    truth: tuple[BagMessage, ...]  # Truth messages to publish before the datagram


def steps(
    path: Path, bridge: Bridge, config: TrackerConfig, truth: Iterable[BagMessage]
) -> Iterator[Step]:
    """Yield the datagrams of a recording, each with the truth up to the clouds that it completes.

    The clouds have the stamps that a bridge with the same parameters and ``replayed`` gives them.
    The last step has no datagram, but the remaining truth. `BagError` is raised if the file is not
    a recording.
    """
    stream = bridge.stream(StreamClock())
    scans = _Scans(bridge, config)
    waiting = iter(truth)
    upcoming = next(waiting, None)
    try:
        with framing.open_recording(path) as data:
            for received in framing.datagrams(data, None, Counter()):
                reports = stream.feed(received.data)
                made = tuple((state.settings.name, each.stamp_ns) for state, each in reports)
                closed = sum(scans.closed_by(state, report) for state, report in reports)
                due = []
                newest_ns = max((stamp_ns for _, stamp_ns in made), default=0)
                while upcoming is not None and upcoming.stamp_ns <= newest_ns:
                    due.append(upcoming)
                    upcoming = next(waiting, None)
                yield Step(received.data, made, closed, tuple(due))
    except RecordingError as error:
        raise BagError(f"{path}: {error}") from error
    rest = () if upcoming is None else (upcoming, *waiting)
    yield Step(b"", (), 0, rest)


class _Scans:
    """Counts the scans that a tracker steps, with the tracker's own grouping of reports."""

    def __init__(self, bridge: Bridge, config: TrackerConfig) -> None:
        self._bridge = bridge
        self._inputs = config.inputs
        self._index = {radar.name: index for index, radar in enumerate(config.inputs)}
        self._turns, self._grouper = config.turns(), config.grouper()

    def closed_by(self, state: RadarState, report: SectorReport) -> int:
        name = state.settings.name
        index = self._index[name]
        cloud = clouds.cloud(report, name, state.settings.sectors, self._bridge.amplitudes(name))
        read = reader_of(self._inputs[index]).from_msg(cloud, self._inputs[index])
        pieces = self._turns[index].split(read.stamp_ns, read.detections, read.sector)
        if isinstance(pieces, Rejection):
            return 0
        found = (self._grouper.add(index, stamp_ns, piece) for stamp_ns, piece in pieces)
        return sum(
            isinstance(event, Scan)
            for events in found
            if not isinstance(events, Rejection)
            for event in events
        )
