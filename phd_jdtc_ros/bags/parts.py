"""Finds the files of a bag: a recorder may split it into several MCAP files, its parts."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import yaml

from . import foreign
from .chunks import DamageError
from .errors import BagError
from .mcap_index import MAGIC

METADATA = "metadata.yaml"
# Extension of files that are compressed as a whole.
_PACKED = ".zstd"
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
                raise BagError(f"{file}: {foreign.file_fault(file) or 'is not an MCAP file'}")
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
    return plain if part.suffix == _PACKED and plain.is_file() else part


def _by_name(directory: Path) -> list[Path]:
    """Return the MCAP files of a directory; raise `BagError` with what it has instead."""
    files = sorted(filter(Path.is_file, directory.iterdir()))
    found = [file for file in files if file.suffix.lower() == ".mcap"]
    for file in () if found else files:
        if fault := foreign.file_fault(file):
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
