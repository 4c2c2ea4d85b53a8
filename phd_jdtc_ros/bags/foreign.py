"""Recognises recordings of other kinds, and names the command that converts them.

Supported are MCAP files whose messages are CDR, as ROS 2 records them. A specific fault for
everything else helps more than "no such topic" or "no MCAP file".
"""

from __future__ import annotations

import shlex
from pathlib import Path

from mcap.records import Channel, Schema

CDR = "cdr"
_SQLITE, _ZSTD, _ROS1 = b"SQLite format 3\0", b"\x28\xb5\x2f\xfd", b"#ROSBAG V"
_GZIP = b"\x1f\x8b"
_LONGEST = max(map(len, (_SQLITE, _ZSTD, _ROS1)))
_NO_CONVERTER = "no command converts it; docs/offline_tools.md shows how a script does"
# Description of encodings other than CDR, by their MCAP names.
_ENCODINGS = {
    "ros1": (
        "a ROS 1 message",
        "convert the .bag that it comes from: rosbags-convert --src FILE.bag --dst DIR "
        "--dst-typestore ros2_jazzy --dst-storage mcap",
    ),
    "protobuf": ("a protobuf message", _NO_CONVERTER),
    "json": ("a JSON message", _NO_CONVERTER),
}


def file_fault(path: Path) -> str:
    """Return the actual kind of a file with its converter; empty if the kind is unknown."""
    with path.open("rb") as stream:
        begin = stream.read(_LONGEST)
    name = shlex.quote(str(path))
    if begin.startswith((_ZSTD, _GZIP)):
        unpacked = shlex.quote(str(path.with_suffix("")))
        others = len(list(path.parent.glob(f"*{path.suffix}"))) > 1
        return f"is compressed as a file; unpack it{', and all others like it' * others}: " + (
            f"zstd -d {name} -o {unpacked}"
            if begin.startswith(_ZSTD)
            else f"gzip -dc {name} > {unpacked}"
        )
    if begin.startswith(_ROS1):
        out = shlex.quote(str(path.with_suffix("")))
        return (
            f"is a ROS 1 bag; convert it: rosbags-convert --src {name} --dst {out} "
            "--dst-typestore ros2_jazzy --dst-storage mcap"
        )
    if begin == _SQLITE:
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
    if channel.message_encoding == CDR and schema is not None:
        return ""
    kind = f"{channel.message_encoding or 'no'} encoding"
    known, way = _ENCODINGS.get(channel.message_encoding, (f"of {kind}", _NO_CONVERTER))
    if schema is None:
        return f"{known} without a type; {way}"
    return f"{known} ({schema.name}); {way}"
