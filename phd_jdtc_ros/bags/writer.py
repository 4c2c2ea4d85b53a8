"""Writes rosbag2 bags in MCAP, which rosbag2 accepts as its own."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import yaml
from mcap.writer import CompressionType, Writer

from msg_adapters.encoding import interfaces
from phd_jdtc_ros import interruption
from phd_jdtc_ros.bags import BagError

METADATA = "metadata.yaml"
# The infinite duration of rosbag2.
_ENDLESS = {"sec": 9223372036, "nsec": 854775807}


@dataclass(frozen=True)
class Topic:
    """A recorded topic."""

    name: str
    type_name: str  # Such as ``sensor_msgs/msg/PointCloud2``
    depth: int = 10  # Offered history depth
    transient_local: bool = False
    # Definition and hash of the type, as MCAP and rosbag2 store them; empty for a type of the
    # installed package.
    definition: str = ""
    type_hash: str = ""

    @property
    def offered_qos(self) -> list[dict[str, Any]]:
        """The offered QoS profile as rosbag2 writes it."""
        return [
            {
                "history": "keep_last",
                "depth": self.depth,
                "reliability": "reliable",
                "durability": "transient_local" if self.transient_local else "volatile",
                "deadline": _ENDLESS,
                "lifespan": _ENDLESS,
                "liveliness": "automatic",
                "liveliness_lease_duration": _ENDLESS,
                "avoid_ros_namespace_conventions": False,
            }
        ]


class BagWriter:
    """Writes a bag: a directory with one uncompressed MCAP file and its metadata.

    Use it as a context manager; the bag is complete when the block ends, also if an interruption
    ends it. Raise `BagError` if the directory exists or cannot be created.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._file_name = f"{directory.name}_0.mcap"
        try:
            directory.mkdir(parents=True)
            self._stream: BinaryIO = (directory / self._file_name).open("wb")
        except FileExistsError:
            raise BagError(f"{directory}: already exists, a bag is not overwritten") from None
        except OSError as error:
            raise BagError(f"{directory}: cannot be written: {error.strerror}") from None
        # Small chunks limit the loss, because a damaged byte costs one chunk.
        self._writer = Writer(self._stream, chunk_size=2**14, compression=CompressionType.NONE)
        # The library's version is left out, because the bytes must depend on the content only.
        self._writer.start(profile="ros2", library="phd_jdtc_ros")
        self._channels: dict[str, int] = {}
        self._topics: dict[str, Topic] = {}
        self._schemas: dict[str, int] = {}
        self._counts: Counter[str] = Counter()
        self._why_closed = "closed"
        self._first_ns: int | None = None
        self._last_ns = 0

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def add_topic(self, topic: Topic) -> None:
        """Declare a topic before messages are written to it."""
        if topic.type_name not in self._schemas:
            self._schemas[topic.type_name] = self._writer.register_schema(
                topic.type_name,
                "ros2msg",
                (topic.definition or interfaces.definition(topic.type_name)).encode(),
            )
        self._channels[topic.name] = self._writer.register_channel(
            topic=topic.name,
            message_encoding="cdr",
            schema_id=self._schemas[topic.type_name],
            metadata={
                "offered_qos_profiles": yaml.safe_dump(topic.offered_qos, sort_keys=False),
                "topic_type_hash": _type_hash(topic),
            },
        )
        self._topics[topic.name] = topic

    def write(self, topic: str, data: bytes, log_time_ns: int) -> None:
        """Write one message's CDR bytes; raise `BagError` if writing fails or has failed."""
        if self._stream.closed:
            raise BagError(f"{self._directory}: cannot be written: {self._why_closed}")
        with self._writing():
            self._writer.add_message(
                channel_id=self._channels[topic],
                log_time=log_time_ns,
                publish_time=log_time_ns,
                sequence=self._counts[topic],
                data=data,
            )
            self._counts[topic] += 1
            first = self._first_ns
            self._first_ns = log_time_ns if first is None else min(first, log_time_ns)
            self._last_ns = max(self._last_ns, log_time_ns)

    def close(self) -> None:
        """Finish the file and write the metadata."""
        if self._stream.closed:
            return
        with interruption.step():
            try:
                with self._writing():
                    self._writer.finish()
                    text = yaml.safe_dump(self._metadata(), sort_keys=False)
                    (self._directory / METADATA).write_text(text)
            finally:
                with contextlib.suppress(OSError):  # The first failure has been reported
                    self._stream.close()

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            with interruption.step():
                yield
        except OSError as error:
            with contextlib.suppress(OSError):
                self._stream.close()
            self._why_closed = f"closed after an error: {error.strerror}"
            raise BagError(f"{self._directory}: cannot be written: {error.strerror}") from error

    def _metadata(self) -> dict[str, Any]:
        start = {"nanoseconds_since_epoch": self._first_ns or 0}
        duration = {"nanoseconds": self._last_ns - (self._first_ns or 0)}
        total = sum(self._counts.values())
        return {
            "rosbag2_bagfile_information": {
                "version": 9,
                "storage_identifier": "mcap",
                "duration": duration,
                "starting_time": start,
                "message_count": total,
                "topics_with_message_count": [
                    {
                        "topic_metadata": {
                            "name": topic.name,
                            "type": topic.type_name,
                            "serialization_format": "cdr",
                            "offered_qos_profiles": topic.offered_qos,
                            "type_description_hash": _type_hash(topic),
                        },
                        "message_count": self._counts[topic.name],
                    }
                    for topic in self._topics.values()
                ],
                "compression_format": "",
                "compression_mode": "",
                "relative_file_paths": [self._file_name],
                "files": [
                    {
                        "path": self._file_name,
                        "starting_time": start,
                        "duration": duration,
                        "message_count": total,
                    }
                ],
                "custom_data": None,
                "ros_distro": "jazzy",
            }
        }


def _type_hash(topic: Topic) -> str:
    return topic.type_hash or interfaces.type_hash(topic.type_name)
