"""Reads rosbag2 bags in MCAP in order of log time, and salvages damaged ones."""

from __future__ import annotations

import heapq
import struct
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.records import Channel, Message, Schema

from msg_adapters.encoding import stamps
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.configuration.parameters.place_forms import TRANSFORM_TOPICS
from phd_jdtc_ros.quoting import printable

from . import chunks, parts, salvage
from .chunks import DamageError
from .salvage import Index
from .writer import Topic


@dataclass(frozen=True)
class Part:
    """A file of a bag, or one of several that were joined, with its content."""

    file: Path
    index: Index

    @staticmethod
    def of(file: Path) -> list[Part]:
        """Return the parts in a file, mostly one; raise `BagError` if it cannot be read."""
        with parts.guard(file), file.open("rb") as stream:
            return [Part(file, index) for index in salvage.indexes(stream)]


@dataclass
class PartReading:
    """One pass over a part. Chunks and messages that are damaged are left out and counted."""

    part: Part
    read: Counter[int] = field(default_factory=Counter)  # Messages by channel id
    lost_chunks: int = 0
    reason: str = ""  # Why the last chunk or message was lost

    def topic(self, message: Message) -> str:
        """Return the topic of a message."""
        return self.part.index.channels[message.channel_id].topic

    def messages(
        self, offset: int, length: int, topics: Collection[str]
    ) -> Iterator[tuple[int, Message]]:
        """Yield the messages of topics in a chunk or a run, each with its place there."""
        try:
            # A bag may have thousands of parts, which are not open at once.
            with parts.guard(self.part.file), self.part.file.open("rb") as stream:
                records = chunks.unpack(stream, offset, length)
        except DamageError as error:
            self.reason = str(error)
            self.lost_chunks += 1
            return
        for position, record in enumerate(records):
            if isinstance(record, Message) and record.channel_id in self.part.index.channels:
                self.read[record.channel_id] += 1
                if self.topic(record) in topics:
                    yield position, record

    def data(self, message: Message) -> bytes | None:
        """Return a message's CDR bytes; None if these are lost."""
        try:
            return chunks.message_data(message.data)
        except DamageError as error:
            self.reason = str(error)
            self.read[message.channel_id] -= 1
            return None

    def fault(self, partly: bool) -> str:
        """Return the fault if messages were lost, with the reason; empty if none were.

        If chunks were left unread on purpose (`partly`), the statistics cannot be checked.
        """
        index, read = self.part.index, self.read
        damage = self.reason or index.damage
        # The number of messages per channel is optional in a file.
        counts = read if partly else index.counts or read
        unknown = partly or index.expected is None
        expected = read.total() if unknown else index.expected
        if expected != read.total() or counts != read:
            damage = damage or "its statistics do not match its messages"
        if not damage:
            return ""
        if index.unfinished and not self.reason:
            return (
                f"{self.part.file}: was not finished, as when a recorder is killed: the "
                f"{index.counts.total()} messages in it are intact, later ones are lost"
            )
        if index.lost_bytes:
            damage += f"; {index.lost_bytes} of its bytes are lost"
        if self.lost_chunks:
            damage += f"; {self.lost_chunks} of {len(index.chunks)} chunks are lost"
        if expected != read.total():
            damage += f"; it declares {expected} messages, {read.total()} can be read"
        return f"{self.part.file}: is damaged: {damage}"


# Upper bound of messages, bytes, that wait for earlier messages from later in the file. Recorders
# write messages as they arrive, so only few wait.
MAX_WAITING = 2**27
_MESSAGE_COST = 2**8  # Bytes of a waiting message in addition to its data


@dataclass(frozen=True)
class BagMessage:
    """One recorded message; its data is CDR."""

    topic: str
    log_time_ns: int
    data: bytes

    @property
    def stamp_ns(self) -> int:
        """Stamp of the message's header; the log time if the stamp cannot be read.

        Of transforms it is that of the first one.
        """
        try:
            stamp_ns = stamps.of_cdr(self.data, 8 if self.topic in TRANSFORM_TOPICS else 4)
        except (IndexError, struct.error):
            return self.log_time_ns
        return stamp_ns if stamp_ns >= 0 else self.log_time_ns


class BagReader:
    """Reads a bag: a rosbag2 directory with its MCAP files, or such a file alone.

    The messages of several files are one recording, also where the files overlap in time.

    `types` has the type of each readable topic, `foreign` why each other topic cannot be read, and
    with which tool it can be converted, and `counts` the number of messages by topic. The first and
    the last message have the log times `start_ns` and `end_ns`. Messages on the topics `restamped`,
    which begin with a header, are yielded with their log time as their stamp.

    Raise `BagError` if the bag is missing, of another kind, or damaged without any readable topic.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.restamped: frozenset[str] = frozenset()
        files, self._missing = parts.find(path)
        self._parts = [part for file in files for part in Part.of(file)]
        filled = [part.index for part in self._parts if part.index.counts.total()]
        self.start_ns = min((index.start_ns for index in filled), default=0)
        self.end_ns = max((index.end_ns for index in filled), default=0)
        self.types: dict[str, str] = {}
        self.counts: Counter[str] = Counter()
        self.foreign: dict[str, str] = {}
        for channel, schema, count in self._channels():
            # Names are printed in many places, and a hostile one could command a terminal.
            channel.topic = printable(channel.topic)
            if fault := parts.topic_fault(channel, schema):
                self.foreign[channel.topic] = fault
            elif schema is not None:
                self.types[channel.topic] = printable(schema.name)
                self.counts[channel.topic] += count
        damaged = [part for part in self._parts if part.index.damage]
        if damaged and not self.types and not self.foreign:
            first = damaged[0]
            raise BagError(f"{first.file}: is damaged: {first.index.damage}", corrupt=True)

    def _channels(self) -> Iterator[tuple[Channel, Schema | None, int]]:
        """Yield every channel of the parts with its type, if it has one, and its messages."""
        for part in self._parts:
            for channel in part.index.channels.values():
                schema = part.index.schemas.get(channel.schema_id)
                yield channel, schema, part.index.counts[channel.id]

    def topic(self, name: str, depth: int = 10) -> Topic:
        """Return a topic with this bag's description, for copying it to another bag."""
        channel, schema = next(
            (channel, schema)
            for channel, schema, _ in self._channels()
            if channel.topic == name and schema is not None
        )
        return Topic(
            name,
            self.types[name],
            depth,
            definition=schema.data.decode() if schema.encoding == "ros2msg" else "",
            type_hash=channel.metadata.get("topic_type_hash", ""),
        )

    def require(self, needed: Mapping[str, str]) -> None:
        """Raise `BagError` if topics are missing or of other types, and name what they are."""
        found = {**dict.fromkeys(needed, "missing"), **self.foreign, **self.types}
        wrong = [
            f"{topic} is {found[topic]}, must be {wanted}"
            for topic, wanted in needed.items()
            if found[topic] != wanted
        ]
        if wrong:
            raise BagError(f"{self.path}: {'; '.join(wrong)}")

    def messages(
        self, topics: list[str] | None = None, until_ns: int | None = None
    ) -> Iterator[BagMessage]:
        """Yield the messages of `topics` (all if None) in order of log time.

        If `until_ns` is given, chunks that begin after it are not read.

        Raise `BagError` at the end if a file is damaged or missing; all intact chunks, and all
        intact messages outside of chunks, have been yielded by then. Raise it immediately if
        messages of more than `MAX_WAITING` bytes would have to wait for earlier ones from later in
        the files.
        """
        wanted = self.types if topics is None else topics
        passes = [PartReading(part) for part in self._parts]
        waiting = 0
        # The queue is ordered by log time and has chunks (or runs) that are still unread, and
        # messages of those that were read: log time, part, offset in its file, place, entry. For an
        # unread chunk these are its earliest log time, its part and offset, -1 and its length.
        queue: list[tuple[int, int, int, int, Any]] = [
            (start, number, offset, -1, length)
            for number, part in enumerate(self._parts)
            for start, offset, length in (*part.index.chunks, *part.index.runs)
        ]
        heapq.heapify(queue)
        while queue:
            time_ns, number, offset, place, entry = heapq.heappop(queue)
            if until_ns is not None and time_ns > until_ns:
                break
            reading = passes[number]
            if place >= 0:
                waiting -= len(entry.data) + _MESSAGE_COST
                data = reading.data(entry)
                topic = reading.topic(entry)
                if data is not None and topic in self.restamped:
                    data = stamps.restamped(data, entry.log_time)
                if data is not None:
                    yield BagMessage(topic, entry.log_time, data)
                continue
            for position, message in reading.messages(offset, entry, wanted):
                waiting += len(message.data) + _MESSAGE_COST
                heapq.heappush(queue, (message.log_time, number, offset, position, message))
            if waiting > MAX_WAITING:
                raise BagError(
                    f"{reading.part.file}: its messages are too far out of order: sorting them "
                    f"would take more than {MAX_WAITING // 2**20} MiB of memory"
                )
        self._require_all(passes, until_ns)

    def _require_all(self, passes: list[PartReading], until_ns: int | None) -> None:
        """Raise `BagError` if messages were lost, with the reasons of all parts."""
        faults = [
            reading.fault(until_ns is not None and until_ns < reading.part.index.end_ns)
            for reading in passes
        ]
        if self._missing:
            lost = ", ".join(self._missing)
            faults.append(f"{self.path}: its metadata lists files that are missing: {lost}")
        if any(faults):
            raise BagError("; ".join(filter(None, faults)), corrupt=True)
