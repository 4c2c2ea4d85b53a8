"""Damaged and malicious bags: recovered messages, errors and memory."""

from __future__ import annotations

import random
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.reader import make_reader
from mcap.records import Chunk, ChunkIndex, Message
from mcap.stream_reader import breakup_chunk
from mcap.writer import CompressionType, Writer

from msg_adapters.encoding import interfaces, names
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagMessage, BagReader

from ..harness.figures import Found, in_own_process, measures, peak_mb
from ..harness.scans import BAG
from .small_chunks import rewritten

OFFSETS = 1000
EDGE = 40
MOST_MB = 256.0
BOMB_SIZE = 2**29
# Opcode and length, before a record's content.
RECORD_HEAD = 9


@dataclass(frozen=True)
class Part:
    """A chunk of the undamaged bag: its place in the file and its messages."""

    begin: int
    end: int
    messages: frozenset[BagMessage]


@dataclass
class Tally:
    """The outcomes of reading the damaged copies."""

    intact: int = 0
    recovered: int = 0
    silent: int = 0
    unclear: int = 0
    copies: int = 0
    worst: str = ""

    def add(
        self, what: str, whole: Sequence[Part], every: frozenset[BagMessage], path: Path
    ) -> None:
        """Read a damaged copy in which the chunks `whole` are intact."""
        found, error = outcome(path)
        read = set(found)
        recovered = sum(part.messages <= read for part in whole)
        self.copies += 1
        self.intact += len(whole)
        self.recovered += recovered
        if recovered < len(whole) and not self.worst:
            self.worst = f"{what}: {recovered} of {len(whole)} chunks; {error}"
        if not read <= every or len(found) != len(read) or (error is None and read != every):
            self.silent += 1
            self.worst = self.worst or f"{what}: a silent difference"
        if error is not None and (not error.corrupt or "\n" in str(error)):
            self.unclear += 1


def outcome(path: Path) -> tuple[list[BagMessage], BagError | None]:
    """Return the messages of a bag up to its end or its error, and the error."""
    found = []
    try:
        for message in BagReader(path).messages():
            found.append(message)
    except BagError as error:
        return found, error
    return found, None


@measures("bag recovery", "100 % of intact chunks, 0 silent differences")
def measure_recovery(offsets: int = OFFSETS) -> Found:
    """Truncate a bag at many offsets, and change a byte at as many."""
    tally = Tally()
    with tempfile.TemporaryDirectory() as directory:
        for compression in (CompressionType.ZSTD, CompressionType.NONE):
            file = Path(directory) / f"{compression.name}.mcap"
            _damage(rewritten(BAG, file, compression), offsets // 2, tally)
    share = tally.recovered / tally.intact
    text = (
        f"{100.0 * share:.2f} % of {tally.intact} intact chunks in {tally.copies} damaged copies, "
        f"{tally.silent} silent differences, {tally.unclear} unclear errors"
    )
    reached = tally.recovered == tally.intact and not tally.silent and not tally.unclear
    return text, reached, vars(tally)


def _damage(original: Path, offsets: int, tally: Tally) -> None:
    """Truncate a file at `offsets` places and change a byte at as many; read every copy."""
    rng = random.Random(6)
    whole = original.read_bytes()
    parts = chunks_of(original)
    every = frozenset(message for part in parts for message in part.messages)
    damaged = original.with_name("damaged.mcap")
    # The first and last bytes carry the most information about the file.
    edges = [*range(EDGE), *range(len(whole) - EDGE, len(whole))]
    places = [*edges, *(rng.randrange(len(whole)) for _ in range(offsets))][:offsets]
    for length in places:
        damaged.write_bytes(whole[:length])
        intact = [part for part in parts if part.end <= length]
        tally.add(f"cut at {length}", intact, every, damaged)
    for offset in places:
        data = bytearray(whole)
        data[offset] ^= rng.randrange(1, 256)
        damaged.write_bytes(data)
        intact = [part for part in parts if not part.begin <= offset < part.end]
        tally.add(f"flip at {offset}", intact, every, damaged)


def chunks_of(file: Path) -> list[Part]:
    """Return the chunks of an undamaged file, as the mcap library reads them."""
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
        if summary is None:
            raise ValueError(f"{file}: has no summary")
        topics = {channel.id: channel.topic for channel in summary.channels.values()}
        parts = []
        for index in summary.chunk_indexes:
            stream.seek(index.chunk_start_offset + RECORD_HEAD)
            chunk = Chunk.read(ReadDataStream(stream))
            messages = [
                BagMessage(topics[record.channel_id], record.log_time, record.data)
                for record in breakup_chunk(chunk)
                if isinstance(record, Message)
            ]
            begin = index.chunk_start_offset
            parts.append(Part(begin, begin + index.chunk_length, frozenset(messages)))
    if sum(len(part.messages) for part in parts) != BagReader(file).counts.total():
        raise ValueError(f"{file}: its messages are not all different")
    return parts


@measures("hostile bag's memory", "at most 256 MB")
def measure_bomb() -> Found:
    """Open small files whose chunk unpacks to half a gigabyte."""
    found, largest = {}, 0
    with tempfile.TemporaryDirectory() as directory:
        file = Path(directory) / "bomb.mcap"
        for compression in ("zstd", "lz4"):
            data = packed(compression)
            for name, declared in {"honest": BOMB_SIZE, "lying": 1000}.items():
                write_bomb(file, compression, data, declared)
                largest = max(largest, file.stat().st_size)
                found[f"{compression} {name}"] = in_own_process(read_bomb, str(file))
    most = max(mb for _, mb in found.values())
    outcomes = {outcome for outcome, _ in found.values()}
    text = f"{most:.0f} MB for {largest / 1e3:.0f} kB ({', '.join(sorted(outcomes))})"
    return text, outcomes == {"corrupt"} and most <= MOST_MB, {"peak_mb": found}


def read_bomb(path: str) -> tuple[str, float]:
    """Return the outcome of reading a bag, and the peak memory of this process."""
    _, error = outcome(Path(path))
    what = "whole" if error is None else "corrupt" if error.corrupt else "refused"
    return what, peak_mb()


def packed(compression: str) -> bytes:
    """Return `BOMB_SIZE` bytes, one record of an unknown kind, compressed."""
    if compression == "lz4":
        packer = lz4.frame.LZ4FrameCompressor()
        begin = packer.begin()
    else:
        packer = zstandard.ZstdCompressor(level=1).compressobj(size=BOMB_SIZE)
        begin = b""
    head = b"\x80" + (BOMB_SIZE - RECORD_HEAD).to_bytes(8, "little")
    parts = [begin, packer.compress(head + bytes(2**20 - RECORD_HEAD))]
    parts += [packer.compress(bytes(2**20)) for _ in range(BOMB_SIZE // 2**20 - 1)]
    return b"".join([*parts, packer.flush()])


def write_bomb(file: Path, compression: str, data: bytes, declared: int) -> None:
    """Write a bag with one chunk of compressed data, whose unpacked size is declared."""
    with file.open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start("ros2")
        definition = interfaces.definition(names.CLOUD).encode()
        schema = writer.register_schema(names.CLOUD, "ros2msg", definition)
        writer.register_channel(names.detections("radar_1"), "cdr", schema)
        offset = stream.tell()
        record = RecordBuilder()
        Chunk(compression, data, 2, 1, 0, declared).write(record)
        chunk = record.end()
        stream.write(chunk)
        # The library has no public way to add an index.
        vars(writer)["_Writer__chunk_indices"].append(
            ChunkIndex(len(chunk), offset, compression, len(data), 2, 0, {}, 1, declared)
        )
        writer.finish()
