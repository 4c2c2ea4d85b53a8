"""One file of a bag: its content, and what a pass over it has read and lost."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from mcap.records import Message

from . import chunks, mcap_index, parts
from .chunks import DamageError
from .salvage import Index


@dataclass(frozen=True)
class Part:
    """A file of a bag, with its content."""

    file: Path
    index: Index

    @staticmethod
    def of(file: Path) -> Part:
        """Return the part in a file; raise `BagError` if it cannot be read."""
        with parts.guard(file), file.open("rb") as stream:
            return Part(file, mcap_index.index(stream))


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
