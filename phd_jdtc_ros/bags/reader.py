"""Finds the files of rosbag2 bags in MCAP, and reads their messages in order of log time.

Supported are messages in CDR, as ROS 2 records them. Recordings of other kinds are recognised, and
the command that converts them is named: a specific fault helps more than "no such topic".
"""

from __future__ import annotations

import heapq
import shlex
import struct
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from mcap.records import Channel, Message, Schema

from msg_adapters.encoding import stamps
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.configuration.parameters.place_forms import TRANSFORM_TOPICS
from phd_jdtc_ros.quoting import printable

from . import salvage
from .salvage import MAGIC, DamageError, Index
from .writer import METADATA, Topic

# What unpacks a file, by its beginning.
_UNPACKED_BY = {
    b"\x28\xb5\x2f\xfd": "zstd -dc",
    b"\x1f\x8b": "gzip -dc",
    b"BZh": "bzip2 -dc",
    b"\xfd7zXZ\0": "xz -dc",
    b"PK\x03\x04": "unzip -p",
}


def file_fault(path: Path) -> str:
    """Return the actual kind of a file with its converter; empty if the kind is unknown."""
    sqlite = b"SQLite format 3\0"
    with path.open("rb") as stream:
        begin = stream.read(len(sqlite))
    name = shlex.quote(str(path))
    for magic, unpack in _UNPACKED_BY.items():
        if begin.startswith(magic):
            unpacked = shlex.quote(str(path.with_suffix("")))
            others = len(list(path.parent.glob(f"*{path.suffix}"))) > 1
            return (
                f"is compressed as a file; unpack it{', and all others like it' * others}: "
                f"{unpack} {name} > {unpacked}"
            )
    if begin.startswith(b"#ROSBAG V"):
        out = shlex.quote(str(path.with_suffix("")))
        return (
            f"is a ROS 1 bag; convert it: rosbags-convert --src {name} --dst {out} "
            "--dst-typestore ros2_jazzy --dst-storage mcap"
        )
    if begin == sqlite:
        bag, out = path.parent, f"{path.parent.resolve().name}_mcap"
        return (
            f"is a bag in SQLite; convert it: echo 'output_bags: [{{uri: {out}, storage_id: mcap, "
            f"all: true}}]' > convert.yaml && ros2 bag convert -i {shlex.quote(str(bag))} -o "
            f"convert.yaml, or without ROS: rosbags-convert --src {shlex.quote(str(bag))} --dst "
            f"{shlex.quote(out)} --dst-storage mcap"
        )
    return ""


def topic_fault(channel: Channel, schema: Schema | None) -> str:
    """Return the kind of a channel's messages with their converter; empty if they are supported."""
    encoding = channel.message_encoding
    if encoding == "cdr" and schema is not None:
        return ""
    known = {"ros1": "a ROS 1 message", "protobuf": "a protobuf message", "json": "a JSON message"}
    what = known.get(encoding, f"of {encoding or 'no'} encoding")
    way = "no command converts it; docs/offline_tools.md shows how a script does"
    if encoding == "ros1":
        way = (
            "convert the .bag that it comes from: rosbags-convert --src FILE.bag --dst DIR "
            "--dst-typestore ros2_jazzy --dst-storage mcap"
        )
    if schema is None:
        return f"{what} without a type; {way}"
    return f"{what} ({schema.name}); {way}"


def is_mcap(path: Path) -> bool:
    """Return whether a file has the name of an MCAP file, or begins as one."""
    if path.suffix.lower() == ".mcap":
        return True
    with path.open("rb") as stream:
        return stream.read(len(MAGIC)) == MAGIC


def find(path: Path) -> tuple[list[Path], list[str]]:
    """Return a bag's parts, of which there is at least one, and the names of missing ones.

    The parts are those that the metadata lists. If none of these is there, or without metadata,
    they are all MCAP files of the directory. One that was compressed may have been unpacked.

    Raise `BagError` if there is no such bag, or if it is of another kind.
    """
    missing: list[str] = []
    with guard(path):
        if path.is_file():
            files = [path]
        elif path.is_dir():
            listed = [_unpacked(path / name) for name in _listed(path)]
            files = [part for part in listed if part.is_file()]
            if files:
                missing = [part.name for part in listed if part not in files]
            else:
                files = _by_name(path)
        else:
            raise BagError(f"{path}: no such bag")
        for file in files:
            if not is_mcap(file):
                no_bag = (
                    "is not an MCAP file; asterix_bridge converts recordings of ASTERIX, and "
                    "report_bridge those of AIS and ADS-B; tables are for Python, see docs/csv.md"
                )
                raise BagError(f"{file}: {file_fault(file) or no_bag}")
    return files, missing


def _listed(directory: Path) -> list[str]:
    """Return the names of a bag's parts in its metadata, none if these cannot be used."""
    try:
        loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        document = yaml.load((directory / METADATA).read_bytes(), loader)
        paths = document["rosbag2_bagfile_information"]["relative_file_paths"]
        return list(dict.fromkeys(Path(part).name for part in paths))
    except (OSError, yaml.YAMLError, ValueError, TypeError, LookupError, RecursionError):
        return []


def _unpacked(part: Path) -> Path:
    plain = part.with_suffix("")
    # Extension of files that are compressed as a whole.
    return plain if part.suffix == ".zstd" and plain.is_file() else part


def _by_name(directory: Path) -> list[Path]:
    """Return the MCAP files of a directory; raise `BagError` with what it has instead."""
    # Other systems leave a hidden companion of each file, such as ``._bag_0.mcap``.
    named = (file for file in directory.iterdir() if not file.name.startswith("."))
    files = sorted(filter(Path.is_file, named))
    found = [file for file in files if file.suffix.lower() == ".mcap"]
    for file in () if found else files:
        if fault := file_fault(file):
            raise BagError(f"{file}: {fault}")
    if not found:
        raise BagError(f"{directory}: contains no MCAP file")
    return found


@contextmanager
def guard(path: Path) -> Iterator[None]:
    """Convert every exception on damaged bytes, of which there are many types, to a `BagError`."""
    try:
        yield
    except (BagError, DamageError):
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise BagError(f"{path}: cannot be read: {error.strerror}") from error
        reason = " ".join(str(error).split()) or type(error).__name__
        raise BagError(f"{path}: is damaged: {reason}", corrupt=True) from error


@dataclass(frozen=True)
class Part:
    """A file of a bag, or one of several that were joined, with its content."""

    file: Path
    index: Index

    @staticmethod
    def of(file: Path) -> list[Part]:
        """Return the parts in a file, mostly one; raise `BagError` if it cannot be read."""
        with guard(file), file.open("rb") as stream:
            return [Part(file, index) for index in salvage.indexes(stream)]


@dataclass
class PartReading:
    """One pass over a part. Chunks and messages that are damaged are left out and counted."""

    part: Part
    read: Counter[int] = field(default_factory=Counter)  # Messages by channel id
    lost_chunks: int = 0
    reason: str = ""  # Why the last chunk or message was lost

    def topic(self, message: Message) -> str:
        """Return the topic of a message of this part, by its channel."""
        return self.part.index.channels[message.channel_id].topic

    def messages(
        self, offset: int, length: int, topics: Collection[str]
    ) -> Iterator[tuple[int, Message]]:
        """Yield the messages of topics in a chunk or a run, each with its place there."""
        try:
            # A bag may have thousands of parts, which are not open at once.
            with guard(self.part.file), self.part.file.open("rb") as stream:
                records = salvage.unpack(stream, offset, length)
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
            return salvage.message_data(message.data)
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
        files, self._missing = find(path)
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
            if fault := topic_fault(channel, schema):
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
