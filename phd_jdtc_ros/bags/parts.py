"""Finds the files of a bag: a recorder may split it into several MCAP files, its parts.

Supported are MCAP files whose messages are CDR, as ROS 2 records them. Recordings of other kinds
are recognised, and the command that converts them is named: a specific fault helps more than "no
such topic".
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import yaml
from mcap.records import Channel, Schema

from phd_jdtc_ros.bags import BagError

from .chunks import DamageError
from .salvage import MAGIC

CDR = "cdr"
_SQLITE, _ROS1 = b"SQLite format 3\0", b"#ROSBAG V"
# What unpacks a file, by its beginning.
_UNPACKED_BY = {
    b"\x28\xb5\x2f\xfd": "zstd -dc",
    b"\x1f\x8b": "gzip -dc",
    b"BZh": "bzip2 -dc",
    b"\xfd7zXZ\0": "xz -dc",
    b"PK\x03\x04": "unzip -p",
}
_LONGEST = max(map(len, (_SQLITE, _ROS1, *_UNPACKED_BY)))
_NO_BAG = (
    "is not an MCAP file; asterix_bridge converts recordings of ASTERIX, and report_bridge those "
    "of AIS and ADS-B; tables are for Python, see docs/csv.md"
)
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
    for magic, unpack in _UNPACKED_BY.items():
        if begin.startswith(magic):
            unpacked = shlex.quote(str(path.with_suffix("")))
            others = len(list(path.parent.glob(f"*{path.suffix}"))) > 1
            return (
                f"is compressed as a file; unpack it{', and all others like it' * others}: "
                f"{unpack} {name} > {unpacked}"
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


METADATA = "metadata.yaml"
_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


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
                raise BagError(f"{file}: {file_fault(file) or _NO_BAG}")
    return files, missing


def _listed(directory: Path) -> list[str]:
    """Return the names of a bag's parts in its metadata, none if these cannot be used."""
    try:
        document = yaml.load((directory / METADATA).read_bytes(), _Loader)
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
