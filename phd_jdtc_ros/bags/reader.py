"""Reads rosbag2 bags in MCAP in order of log time, and salvages damaged ones."""

from __future__ import annotations

import heapq
import struct
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.records import Message

from msg_adapters.encoding import stamps

from . import chunks, foreign, mcap_index
from .errors import BagError
from .writer import Topic

# Upper bound of messages, bytes, that wait for earlier messages from later in the file. Recorders
# write messages as they arrive, so only few wait.
MAX_WAITING = 2**27
_MESSAGE_COST = 2**8  # bytes of a waiting message in addition to its data


@dataclass(frozen=True)
class BagMessage:
    """One recorded message; its data is CDR."""

    topic: str
    log_time_ns: int
    data: bytes

    @property
    def stamp_ns(self) -> int:
        """Stamp of the message's header; the log time if the stamp cannot be read."""
        try:
            stamp_ns = stamps.of_cdr(self.data)
        except (IndexError, struct.error):
            return self.log_time_ns
        return stamp_ns if stamp_ns >= 0 else self.log_time_ns


class BagReader:
    """Reads a bag: a rosbag2 directory with one MCAP file, or such a file alone.

    `types` has the type of each readable topic, `foreign` why each other topic cannot be read, and
    with which tool it can be converted, and `counts` the number of messages by topic. The first and
    the last message have the log times `start_ns` and `end_ns`.

    Raise `BagError` if the bag is missing, of another kind, or damaged without any readable topic.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = _mcap_file(path)
        with _guard(self._file), self._file.open("rb") as stream:
            self._index = mcap_index.index(stream)
        self.start_ns, self.end_ns = self._index.start_ns, self._index.end_ns
        self.types: dict[str, str] = {}
        self.counts: Counter[str] = Counter()
        self.foreign: dict[str, str] = {}
        for channel in self._index.channels.values():
            schema = self._index.schemas.get(channel.schema_id)
            if fault := foreign.topic_fault(channel, schema):
                self.foreign[channel.topic] = fault
            elif schema is not None:
                self.types[channel.topic] = schema.name
                self.counts[channel.topic] += self._index.counts[channel.id]
        if self._index.damage and not self.types and not self.foreign:
            raise BagError(f"{self._file}: is damaged: {self._index.damage}", corrupt=True)

    def topic(self, name: str, depth: int = 10) -> Topic:
        """Return a topic with this bag's description, for copying it to another bag."""
        channels = [c for c in self._index.channels.values() if c.topic == name]
        schema = self._index.schemas[channels[0].schema_id]
        return Topic(
            name,
            self.types[name],
            depth,
            definition=schema.data.decode() if schema.encoding == "ros2msg" else "",
            type_hash=channels[0].metadata.get("topic_type_hash", ""),
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

        Raise `BagError` at the end if a part of the file is damaged; all intact chunks, and all
        intact messages outside of chunks, have been yielded by then. Raise it immediately if
        messages of more than `MAX_WAITING` bytes would have to wait for earlier ones from later in
        the file.
        """
        lost: list[str] = []
        wanted = self.types if topics is None else topics
        read: Counter[int] = Counter()
        waiting = 0
        with _guard(self._file), self._file.open("rb") as stream:
            # The queue is ordered by log time and has chunks (or runs) that are still unread, and
            # messages of those that were read: log time, offset in the file, place, entry. For an
            # unread chunk these are its earliest log time, its offset, -1 and its length.
            queue: list[tuple[int, int, int, Any]] = [
                (start, offset, -1, length)
                for start, offset, length in (*self._index.chunks, *self._index.runs)
            ]
            heapq.heapify(queue)
            while queue:
                time_ns, offset, place, entry = heapq.heappop(queue)
                if until_ns is not None and time_ns > until_ns:
                    break
                if place >= 0:
                    waiting -= len(entry.data) + _MESSAGE_COST
                    topic = self._index.channels[entry.channel_id].topic
                    yield BagMessage(topic, entry.log_time, entry.data)
                    continue
                try:
                    records = chunks.unpack(stream, offset, entry)
                except chunks.DamageError as error:
                    lost.append(str(error))
                    continue
                for position, record in enumerate(records):
                    if isinstance(record, Message) and record.channel_id in self._index.channels:
                        read[record.channel_id] += 1
                        if self._index.channels[record.channel_id].topic in wanted:
                            waiting += len(record.data) + _MESSAGE_COST
                            heapq.heappush(queue, (record.log_time, offset, position, record))
                if waiting > MAX_WAITING:
                    raise BagError(
                        f"{self._file}: its messages are too far out of order: sorting them would "
                        f"take more than {MAX_WAITING // 2**20} MiB of memory"
                    )
        self._require_all(read, lost, partly=until_ns is not None and until_ns < self.end_ns)

    def _require_all(self, read: Counter[int], lost: Sequence[str], partly: bool) -> None:
        """Raise `BagError` if messages were lost, with the chunks' reasons or by the statistics."""
        # If chunks were left unread on purpose (`partly`), the statistics cannot be checked.
        damage = lost[-1] if lost else self._index.damage
        # The number of messages per channel is optional in a file.
        counts = read if partly else self._index.counts or read
        unknown = partly or self._index.expected is None
        expected = read.total() if unknown else self._index.expected
        if expected != read.total() or counts != read:
            damage = damage or "its statistics do not match its messages"
        if not damage:
            return
        if self._index.unfinished and not lost:
            raise BagError(
                f"{self._file}: was not finished, as when a recorder is killed: the "
                f"{self._index.counts.total()} messages in it are intact, later ones are lost",
                corrupt=True,
            )
        if self._index.lost_bytes:
            damage += f"; {self._index.lost_bytes} of its bytes are lost"
        if lost:
            damage += f"; {len(lost)} of {len(self._index.chunks)} chunks are lost"
        if expected != read.total():
            damage += f"; it declares {expected} messages, {read.total()} can be read"
        raise BagError(f"{self._file}: is damaged: {damage}", corrupt=True)


@contextmanager
def _guard(path: Path) -> Iterator[None]:
    """Convert every exception on damaged bytes, of which there are many types, to a `BagError`."""
    try:
        yield
    except BagError:
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise BagError(f"{path}: cannot be read: {error.strerror}") from error
        reason = " ".join(str(error).split()) or type(error).__name__
        raise BagError(f"{path}: is damaged: {reason}", corrupt=True) from error


def _mcap_file(path: Path) -> Path:
    with _guard(path):
        is_file, is_directory = path.is_file(), path.is_dir()
    if is_file:
        if path.suffix != ".mcap":
            raise BagError(f"{path}: {_foreign_fault(path) or 'is not an MCAP file'}")
        return path
    if not is_directory:
        raise BagError(f"{path}: no such bag")
    files = sorted(path.glob("*.mcap"))
    if len(files) == 1:
        return files[0]
    others = () if files else filter(Path.is_file, sorted(path.iterdir()))
    for other in others:
        if fault := _foreign_fault(other):
            raise BagError(f"{other}: {fault}")
    raise BagError(f"{path}: contains {len(files)} MCAP files, must contain one")


def _foreign_fault(path: Path) -> str:
    with _guard(path):
        return foreign.file_fault(path)
