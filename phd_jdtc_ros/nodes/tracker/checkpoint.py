"""A tracker's snapshot as a file: written atomically, and checked before it is used.

The file is a magic line, the SHA-256 of the rest, and a numpy archive of arrays. The facts and the
tracker's configuration are JSON text in two of them. Nothing in the file is executed or unpickled,
and sizes are checked before they are used: the archive's members are stored uncompressed and are
together no larger than the file.
"""

from __future__ import annotations

import contextlib
import errno
import glob
import hashlib
import io
import json
import math
import os
import stat
import tempfile
import time
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.core.engine import Engine
from phd_jdtc_ros.core.snapshot import Snapshot

from ..common.runtime import WARNING_PERIOD_S

MAGIC = b"phd_jdtc_ros checkpoint 3\n"
# Of a file. Its content and its arrays are in memory together, at most 256 MB.
MOST_BYTES = 120 << 20
# Of the texts, and of the archive's directory, whose parsing takes some twenty times the memory.
MOST_TEXT = 2 << 20
# The record that ends an archive, and what stands before it in one of more than 4 GB.
_END, _END_64 = b"PK\x05\x06", b"PK\x06\x07"
_END_SIZE, _END_64_SIZE = 22, 20
# What a killed tracker left half written is deleted after this time.
LEFTOVER_S = 60.0
DIGEST_SIZE = hashlib.sha256().digest_size
STAMP, FACTS, CONFIGURATION = "stamp_ns", "facts", "configuration"


class CheckpointError(Exception):
    """A checkpoint cannot be used; the message says why."""


def write(path: Path, snapshot: Snapshot, configuration: Mapping[str, Any]) -> None:
    """Store a snapshot; the previous file stays until the new one is complete on the disk.

    Parameters
    ----------
    path : Path
        In an existing directory.
    configuration : mapping
        Parameters by name; only a tracker with the same ones may continue from the snapshot.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    texts = {
        STAMP: snapshot.stamp_ns,
        FACTS: snapshot.facts,
        CONFIGURATION: dict(configuration),
    }
    # Values are Any, because savez has options beside the arrays, which may have any name.
    stored: dict[str, Any] = {name: _text(value) for name, value in texts.items()}
    stored |= {f"array.{name}": array for name, array in snapshot.arrays.items()}
    payload = io.BytesIO()
    np.savez(payload, **stored)
    body = payload.getvalue()
    if len(MAGIC) + DIGEST_SIZE + len(body) > MOST_BYTES:
        raise OSError(errno.EFBIG, f"{len(body) >> 20} MB, at most {MOST_BYTES >> 20} MB")
    # A name that nobody can foresee, and never through a link that somebody has put there.
    handle, temporary = tempfile.mkstemp(".tmp", f".{path.name}.", path.parent)
    try:
        with open(handle, "wb") as file:
            file.write(MAGIC + hashlib.sha256(body).digest() + body)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        Path(temporary).unlink(missing_ok=True)


def read(path: Path, configuration: Mapping[str, Any]) -> Snapshot:
    """Return a stored snapshot.

    Raises
    ------
    CheckpointError
        If the file is missing, damaged, of another format, or of a tracker with other parameters.
    """
    try:
        content = _content(path)
    except OSError as error:
        raise CheckpointError(f"{path}: {error.strerror}") from error
    if not content.startswith(MAGIC):
        raise CheckpointError(f"{path}: not a checkpoint of this version")
    start = len(MAGIC) + DIGEST_SIZE
    digest, body = content[len(MAGIC) : start], memoryview(content)[start:]
    if hashlib.sha256(body).digest() != digest:
        raise CheckpointError(f"{path}: damaged, its checksum does not match")
    try:
        arrays = _arrays(content)
        stamp_ns, facts, stored = (
            json.loads(_short(arrays.pop(key))) for key in (STAMP, FACTS, CONFIGURATION)
        )
        if not isinstance(facts, dict) or not isinstance(stored, dict):
            raise ValueError("its facts are no mappings")
    except Exception as error:  # of any kind: a forged archive makes its decoders raise many
        reason = f"{type(error).__name__}: {error}"
        raise CheckpointError(f"{path}: not a checkpoint, {reason[:200]}") from error
    expected = json.loads(json.dumps(dict(configuration)))
    other = sorted(name for name in {*stored, *expected} if stored.get(name) != expected.get(name))
    if other:
        raise CheckpointError(f"{path}: of a tracker with another {', '.join(other)}")
    held = {name.removeprefix("array."): array for name, array in arrays.items()}
    return Snapshot(stamp_ns, held, facts)


def _content(path: Path) -> bytes:
    """Return a regular file's bytes, once it is known not to be too large."""
    # A pipe would be waited for.
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "not a regular file")
        if status.st_size > MOST_BYTES:
            raise OSError(errno.EFBIG, f"{status.st_size >> 20} MB, at most {MOST_BYTES >> 20} MB")
        with open(handle, "rb", closefd=False) as file:
            return file.read(MOST_BYTES)
    finally:
        os.close(handle)


def _arrays(content: bytes) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of an archive, whose declared sizes are checked before they are read.

    Raises
    ------
    ValueError
        If a member is compressed, or they are larger than the file, or one is no array of numbers
        of its own length. Decoders raise errors of their own.
    """
    end = content[-_END_SIZE:]
    if not end.startswith(_END) or content[-_END_SIZE - _END_64_SIZE :].startswith(_END_64):
        raise ValueError("it does not end as an archive of ours")
    if int.from_bytes(end[12:16], "little") > MOST_TEXT:
        raise ValueError("it has too many members")
    # The archive is behind the magic line and the digest, which zip allows.
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = archive.infolist()
        if any(member.compress_type != zipfile.ZIP_STORED for member in members):
            raise ValueError("a member is compressed")
        if sum(member.file_size for member in members) > len(content):
            raise ValueError("its members are larger than the file")
        return {
            member.filename.removesuffix(".npy"): _array(archive.read(member)) for member in members
        }


def _short(text: npt.NDArray[Any]) -> bytes:
    """Return a text's bytes."""
    if text.nbytes > MOST_TEXT:
        raise ValueError(f"{text.nbytes} bytes of text, at most {MOST_TEXT}")
    return text.tobytes()


def _array(data: bytes) -> npt.NDArray[Any]:
    """Return the array that a member's bytes are."""
    stream = io.BytesIO(data)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("an array's header is of another version")
    shape, by_column, kind = np.lib.format.read_array_header_1_0(stream)
    size = math.prod(shape) * kind.itemsize
    if kind.kind not in "iuf" or min(shape, default=0) < 0 or len(data) - stream.tell() != size:
        raise ValueError(f"an array of shape {shape} and type {kind} does not fit its bytes")
    flat = np.frombuffer(data, kind, offset=stream.tell())
    return flat.reshape(shape, order="F" if by_column else "C")


def _forget_leftovers(path: Path) -> None:
    """Delete what killed trackers left half written beside a checkpoint."""
    with contextlib.suppress(OSError):
        for entry in path.parent.glob(f".{glob.escape(path.name)}.*.tmp"):
            if time.time() - entry.lstat().st_mtime > LEFTOVER_S:
                entry.unlink()


class Checkpoints:
    """A tracker's checkpoints: one is read at the start, and new ones are written.

    Parameters
    ----------
    every : int
        Scans between checkpoints; 0 to write on request only.
    max_age_s : float
        Longest time from the checkpoint's last scan to the first scan after a restart, seconds.
    configuration : mapping
        Parameters of the tracker, without those that can change while it runs.
    """

    def __init__(
        self, path: Path, every: int, max_age_s: float, configuration: Mapping[str, Any], log: Any
    ) -> None:
        self._path, self._every, self._max_age_s = path, every, max_age_s
        self._configuration, self._log = configuration, log
        self._scans = 0
        self._stored: Snapshot | None = None
        _forget_leftovers(path)
        try:
            self._stored = read(path, configuration)
        except CheckpointError as error:
            # A missing file is normal: before the first run there is none.
            if not isinstance(error.__cause__, FileNotFoundError):
                log.warning(f"starting cold: {error}")

    def resume(self, engine: Engine, stamp_ns: int) -> None:
        """Continue from the checkpoint, if there is one, before the first scan is stepped."""
        stored, self._stored = self._stored, None
        if stored is None:
            return
        try:
            if stored.stamp_ns is None:
                raise ValueError("it holds no scan")
            age_s = (stamp_ns - stored.stamp_ns) * 1e-9
            if not 0.0 < age_s <= self._max_age_s:
                raise ValueError(
                    f"it ends {age_s:.1f} s before the first scan, at most {self._max_age_s:g} s "
                    "are allowed"
                )
            engine.restore(stored)
        except (TypeError, ValueError, OverflowError) as error:
            self._log.warning(f"starting cold: {self._path}: {error}")
            return
        self._log.info(f"going on from {self._path}, {age_s:.1f} s old")

    def stepped(self, engine: Engine) -> None:
        """Count a scan, and write a checkpoint if one is due."""
        self._scans += 1
        if self._every and self._scans % self._every == 0:
            self.save(engine)

    def save(self, engine: Engine) -> str | None:
        """Write a checkpoint; return None, or why it could not be written."""
        if not self._scans:
            return "no scan has been taken in yet"
        try:
            write(self._path, engine.snapshot(), self._configuration)
        except OSError as error:
            text = f"no checkpoint: {self._path}: {error.strerror}"
            self._log.error(text, throttle_duration_sec=WARNING_PERIOD_S)
            return text
        return None

    def discard(self) -> None:
        """Delete the checkpoint, because its run has ended."""
        self._stored, self._scans = None, 0
        try:
            self._path.unlink(missing_ok=True)
        except OSError as error:
            text = f"the checkpoint of a run that is over stays: {self._path}: {error.strerror}"
            self._log.error(text, throttle_duration_sec=WARNING_PERIOD_S)


def _text(value: Any) -> Any:
    return np.frombuffer(json.dumps(value).encode(), dtype=np.uint8)
