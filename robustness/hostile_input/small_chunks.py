"""Rewrites a bag with many small chunks, of which damage destroys only a few."""

from __future__ import annotations

from pathlib import Path

from mcap.writer import CompressionType, Writer

from msg_adapters.encoding import interfaces
from phd_jdtc_ros.bags.reader import BagReader

SMALL_CHUNK = 4096


def rewritten(
    source: Path,
    file: Path,
    compression: CompressionType = CompressionType.NONE,
    chunk_size: int = SMALL_CHUNK,
) -> Path:
    """Write a bag's messages again in small chunks, as other recorders do; return the file."""
    reader = BagReader(source)
    with file.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk_size, compression=compression)
        writer.start("ros2")
        channels = {}
        for topic, kind in reader.types.items():
            schema = writer.register_schema(kind, "ros2msg", interfaces.definition(kind).encode())
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        for entry in reader.messages():
            writer.add_message(
                channels[entry.topic], entry.log_time_ns, entry.data, entry.log_time_ns
            )
        writer.finish()
    return file
