"""The topics of a bag that are played, its scans in order, its time, and lock-step.

In lock-step a scan is published after the estimate of the previous scan has arrived.
"""

from __future__ import annotations

import importlib.util
import re
import time
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.validate_full_topic_name import validate_full_topic_name
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from msg_adapters.encoding import interfaces, names
from msg_adapters.incoming.readers import READERS
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagMessage, BagReader
from phd_jdtc_ros.configuration import scene
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.types import FILTERED
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import bag_parameters
from phd_jdtc_ros.quoting import short

from .common.parameters import TrackerParameters

# Transient local topics, whose messages from before the selected part are published too.
LATCHED = (names.STATIC_FRAMES,)
# Topics that the replay itself, every node, or the nodes that the bag is played to publish.
LEFT_OUT = ("/clock", "/rosout", "/parameter_events", names.DIAGNOSTICS)


@dataclass(frozen=True)
class Playable:
    """The part of a bag that is played."""

    classes: dict[str, Any]
    scan_topics: tuple[str, ...]  # Detections and truth, whose stamps define the scans
    detections: tuple[str, ...]  # The scan topics to which a tracker replies with an estimate
    truth: tuple[str, ...]  # The other scan topics
    manual: tuple[str, ...]  # The topic of manual work, if that is repeated
    skipped: tuple[str, ...]  # One line per topic that cannot be published


def select(bag: BagReader, wanted: list[str]) -> Playable:
    """Return the part of a bag that is played.

    If no topics are `wanted`, it has all but those that the tracker, the evaluator and every node
    publish; of these only manual work, which is done again. Raise `BagError` if a wanted topic is
    missing or cannot be published, if detections, the truth or manual work have a wrong type, or if
    there is nothing to play.
    """
    bag.require({topic: "a ROS 2 message" for topic in wanted if topic in bag.foreign})
    missing = [topic for topic in wanted if topic not in bag.types]
    if missing:
        raise BagError(
            f"{bag.path}: {', '.join(missing)} missing; it has {', '.join(sorted(bag.types))}"
        )
    # Trackers are recognised by their estimates.
    end = names.estimates(FILTERED, "")
    trackers = (topic.removesuffix(end) + "/" for topic in bag.types if topic.endswith(end))
    left_out = f"{names.TRACKER}/", f"{names.EVALUATOR}/", *trackers
    selected = wanted or [
        topic
        for topic in sorted(bag.types)
        if topic not in LEFT_OUT and not topic.startswith(left_out)
    ]
    detections = [topic for topic in selected if topic.endswith(names.DETECTIONS_SUFFIX)]
    truth = [topic for topic in selected if topic == names.TRUTH]
    readable = {reader.type_name for reader in READERS.values()}
    bag.require({t: names.CLOUD for t in [*detections, *truth] if bag.types[t] not in readable})
    if not detections:
        # A driver may publish its detections under another name.
        detections = [t for t in selected if bag.types[t] in readable]
        detections = [topic for topic in detections if topic not in truth]
    manual = tuple({names.manual()} & {*(wanted or bag.types)})
    bag.require(dict.fromkeys(manual, names.FIGURES))
    selected = [topic for topic in selected if topic not in manual]
    classes: dict[str, Any] = {}
    skipped = [] if wanted else [f"{t}: is {what}, not played" for t, what in bag.foreign.items()]
    for topic in selected:
        found = _message_class(bag.types[topic])
        if found is None:
            skipped.append(f"{topic}: type {bag.types[topic]} is not installed, not played")
        elif not _is_topic_name(topic):
            skipped.append(f"{topic}: is not a valid topic name, not played")
        else:
            classes[topic] = found
    if not classes or (wanted and skipped):
        reason = "; ".join(skipped) or f"it has {', '.join(sorted(bag.types)) or 'no topic'}"
        raise BagError(f"{bag.path}: has nothing to play: {reason}")
    detections = [topic for topic in detections if topic in classes]
    scans, lines = (*detections, *truth), tuple(map(short, skipped))
    return Playable(classes, scans, tuple(detections), tuple(truth), manual, lines)


def _is_topic_name(topic: str) -> bool:
    try:
        return bool(validate_full_topic_name(topic))
    except InvalidTopicNameException:
        return False


def _message_class(type_name: str) -> Any:
    """Return a message class, None without its package; a bag's name imports no other package."""
    match = re.fullmatch(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)", type_name)
    if match is None:
        return None
    spec = importlib.util.find_spec(match[1])
    folders = (spec.submodule_search_locations if spec else None) or []
    if not any((Path(folder) / "msg" / "__init__.py").is_file() for folder in folders):
        return None
    try:
        found = interfaces.message_class(type_name)
    except (ImportError, AttributeError):
        return None
    return found if hasattr(found, "get_fields_and_field_types") else None


def begin(node: Node, bag: Path, estimates_topic: str) -> None:
    """Compare the parameters beside a bag, if any, with the tracker's, once it is there."""
    tracker, found, _ = estimates_topic.rpartition(names.estimates("filtered", ""))
    try:
        recorded = bag_parameters.read(bag)
        if recorded is None or not found:
            return
        expected = resolve(recorded, SystemPlane).values
    except ConfigError as error:
        # The bag can be played all the same.
        node.get_logger().warning(f"the parameters beside the bag are not compared: {error}")
        return

    def compare(given: dict[str, Any]) -> None:
        wrong = scene.differences(expected, given)
        if wrong:
            node.get_logger().warning(
                f"the bag was recorded with other parameters than {tracker} has: "
                f"{'; '.join(wrong)}; those of the bag are in {bag_parameters.path_of(bag)}"
            )

    TrackerParameters(node, tracker, compare)


# A message between two detections of one stamp is published with them. One recorded this long after
# the last detections no longer waits for more of the same stamp.
TOGETHER_NS = 1_000_000_000


@dataclass(frozen=True)
class Group:
    """Messages that are published together."""

    messages: tuple[BagMessage, ...]  # In order of log time; not empty
    stamp_ns: int | None  # Stamp of the scan; None if no message is of a scan topic

    @property
    def log_time_ns(self) -> int:
        """Log time of the first message."""
        return self.messages[0].log_time_ns


class Playback:
    """Reads a selected part of a bag, scan by scan, one scan ahead.

    Messages of the scan topics with one stamp are one group, together with all messages recorded
    between them; every other message is a group of its own.

    The stamps of the scan topics define the scans. `start_s` are skipped, and `duration_s` are
    played, all if that is 0. `upcoming` is the next group, None at the end; the fault of a damaged
    bag, `damage`, is known once the end is reached. The selected part was recorded from `first_ns`
    to `last_ns`. Raise `BagError` if there is nothing to play.
    """

    def __init__(
        self,
        bag: BagReader,
        topics: Collection[str],
        scan_topics: Collection[str],
        start_s: float,
        duration_s: float,
    ) -> None:
        self._bag = bag
        self._topics = topics
        self._scan_topics = frozenset(scan_topics)
        # The time is clipped to the bag's length, because very large values would overflow in
        # nanoseconds.
        longest_s = (bag.end_ns - bag.start_ns) / 1e9 + 1.0
        self.first_ns = bag.start_ns + round(min(start_s, longest_s) * 1e9)
        self.last_ns = bag.end_ns
        if duration_s:
            end_ns = self.first_ns + round(min(duration_s, longest_s) * 1e9)
            self.last_ns = min(self.last_ns, end_ns)
        self.damage: BagError | None = None
        self.seek(self.first_ns)
        if self.upcoming is None:
            raise self.damage or BagError(f"{bag.path}: contains nothing in the selected part")

    def seek(self, time_ns: int) -> None:
        """Go to the first group recorded at or after `time_ns`."""
        self._source = self._groups(time_ns)
        self.upcoming = next(self._source, None)

    def advance(self) -> None:
        """Go to the next group."""
        self.upcoming = next(self._source, None)

    def seconds(self, time_ns: int) -> float:
        """Return a log time as seconds since the bag's start."""
        return (time_ns - self._bag.start_ns) / 1e9

    def time_ns(self, seconds: float) -> int:
        """Return seconds since the bag's start as a log time."""
        return self._bag.start_ns + round(seconds * 1e9)

    def _groups(self, from_ns: int) -> Iterator[Group]:
        scan: list[BagMessage] = []
        after: list[BagMessage] = []
        for message in self._read(self._topics, self.last_ns):
            if message.log_time_ns < from_ns:
                continue
            of_scan = message.topic in self._scan_topics
            if of_scan and scan and message.stamp_ns == scan[0].stamp_ns:
                scan += [*after, message]
                after = []
            elif of_scan:
                yield from _groups_of(scan, after)
                scan, after = [message], []
            else:
                after.append(message)
                if not scan or message.log_time_ns - scan[-1].log_time_ns > TOGETHER_NS:
                    yield from _groups_of(scan, after)
                    scan, after = [], []
        yield from _groups_of(scan, after)

    def before(self, time_ns: int, topics: Collection[str]) -> Iterator[BagMessage]:
        """Return the messages of `topics` recorded before `time_ns`; stop reading there."""
        return takewhile(lambda message: message.log_time_ns < time_ns, self._read(topics))

    def _read(self, topics: Collection[str], until_ns: int | None = None) -> Iterator[BagMessage]:
        try:
            yield from self._bag.messages(list(topics), until_ns)
        except BagError as error:
            self.damage = error


def _groups_of(scan: list[BagMessage], after: list[BagMessage]) -> Iterator[Group]:
    if scan:
        yield Group(tuple(scan), scan[0].stamp_ns)
    for message in after:
        yield Group((message,), None)


class BagClock:
    """A replay's position in its bag as a log time; `rate` is relative to the recording."""

    def __init__(self, rate: float, now_ns: int) -> None:
        self._rate = rate
        self.now_ns = now_ns
        self.restart()

    def restart(self) -> None:
        """Let the bag's time run on from its present value."""
        self._wall_start_s = time.monotonic()
        self._start_ns = self.now_ns

    def is_due(self, log_time_ns: int) -> bool:
        """Return whether a log time is due; if it is not, advance the clock towards it."""
        elapsed_ns = (time.monotonic() - self._wall_start_s) * 1e9 * self._rate
        due = log_time_ns - self._start_ns <= elapsed_ns
        if not due:
            self.now_ns = self._start_ns + int(elapsed_ns)
        return bool(due)


class ProgressLine:
    """A line on the terminal with the bag's time; not drawn if there is no terminal."""

    def __init__(self, first_s: float, last_s: float) -> None:
        console = Console()
        self._progress = Progress(
            TextColumn("replay {task.fields[doing]}"),
            BarColumn(),
            TextColumn("{task.fields[time]:.1f} of {task.fields[last]:.1f} s"),
            TextColumn("{task.fields[scans]} scans"),
            TimeElapsedColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        self._first_s = first_s
        self._length_s = max(last_s - first_s, 1e-9)
        self._scans = 0
        self._task = self._progress.add_task(
            "replay", total=self._length_s, scans=0, time=first_s, last=last_s, doing="waiting"
        )
        self._progress.start()

    def show(self, time_s: float, doing: str, scans: int = 0) -> None:
        """Show the bag's time and the activity, and add to the count of scans."""
        self._scans += scans
        self._progress.update(
            self._task,
            completed=time_s - self._first_s,
            scans=self._scans,
            time=time_s,
            doing=doing,
        )

    def stop(self) -> None:
        """Stop drawing; the line stays."""
        self._progress.stop()


# A tracker may publish an estimate only after a later stamp (radars without a common scan). So
# without a reply for PATIENCE_S further stamps may be published, up to MAX_OUTSTANDING.
PATIENCE_S = 1.0
MAX_OUTSTANDING = 4
GIVE_UP_S = 30.0


class LockStep:
    """The published stamps that wait for a reply.

    Times are seconds of one monotonic clock.

    `delay_s` is the largest age of a reply relative to its stamp, in the bag's time. Until the bag
    has played so long no reply is awaited, because the tracker may still wait for other radars.
    """

    def __init__(self, delay_s: float = 0.0) -> None:
        self._delay_ns = round(delay_s * 1e9)
        self._outstanding: list[int] = []
        self._first_ns: int | None = None
        self._since_s = 0.0
        self._running_since_s = 0.0

    def begin(self) -> None:
        """Drop all awaited stamps, because the bag has jumped."""
        self._outstanding.clear()
        self._first_ns = None

    def restart(self, now_s: float) -> None:
        """Restart the time until giving up: during a pause no other stamp could be published."""
        self._running_since_s = now_s

    def expect(self, stamp_ns: int, now_s: float) -> None:
        """Await the estimate of a stamp."""
        self._first_ns = stamp_ns if self._first_ns is None else self._first_ns
        if stamp_ns - self._delay_ns < self._first_ns:
            return
        if not self._outstanding:
            self._since_s = now_s
        self._outstanding.append(stamp_ns)

    def receive(self, stamp_ns: int, now_s: float) -> None:
        """Take in an estimate, which is the reply to its own stamp and all earlier ones.

        An estimate of a stamp after the awaited ones is a late one from before `begin`, for
        instance from the end of a bag that has started again. It is ignored.
        """
        if not self._outstanding or stamp_ns > self._outstanding[-1]:
            return
        while self._outstanding and self._outstanding[0] <= stamp_ns + self._delay_ns:
            self._outstanding.pop(0)
            self._since_s = now_s

    def may_follow(self, now_s: float) -> bool:
        """Return whether the next stamp may be published."""
        return not self._outstanding or (
            self._waited_s(now_s) > PATIENCE_S and len(self._outstanding) < MAX_OUTSTANDING
        )

    def is_settled(self, now_s: float) -> bool:
        """Return whether no more replies are expected unless another stamp is published."""
        return not self._outstanding or self._waited_s(now_s) > PATIENCE_S

    def has_timed_out(self, now_s: float) -> bool:
        """Return whether there has been no reply for `GIVE_UP_S`."""
        waited_s = now_s - max(self._since_s, self._running_since_s)
        return bool(self._outstanding) and waited_s > GIVE_UP_S

    def _waited_s(self, now_s: float) -> float:
        return now_s - self._since_s
