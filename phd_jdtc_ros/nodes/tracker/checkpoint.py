"""A tracker's snapshot as a file: written atomically, and checked before it is used.

The file has a magic line, the SHA-256 of the rest, the length of the header in four bytes, the
header, and the bytes of the arrays. The header is JSON: the stamp, the snapshot's JSON values
(``facts``), the tracker's configuration, and type and shape of each array. Nothing in the file is
executed, and sizes are checked before they are used.
"""

from __future__ import annotations

import contextlib
import errno
import glob
import hashlib
import json
import math
import os
import stat
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros import output_files
from phd_jdtc_ros.core.engine import Engine
from phd_jdtc_ros.core.snapshot import Snapshot

from ..common.health import WARNING_PERIOD_S

# Checkpoints of other versions are not read, but replaced.
OF_ANY_VERSION = b"phd_jdtc_ros checkpoint "
MAGIC = OF_ANY_VERSION + b"8\n"
# Largest file; its content and its arrays are in memory together, at most 256 MB.
MAX_BYTES = 120 << 20
LENGTH_SIZE, DIGEST_SIZE = 4, hashlib.sha256().digest_size
STAMP, FACTS, CONFIGURATION, ARRAYS = "stamp_ns", "facts", "configuration", "arrays"


class CheckpointError(Exception):
    """A checkpoint cannot be used; the message gives the reason."""


def write(path: Path, snapshot: Snapshot, configuration: Mapping[str, Any]) -> None:
    """Store a snapshot; the previous file stays until the new one is complete on the disk.

    Only a tracker with the same `configuration`, parameters by name, may continue from it. The
    directory must exist. Raise `OSError` if the file cannot be written, or would replace what is no
    checkpoint.
    """
    header = {
        STAMP: snapshot.stamp_ns,
        FACTS: snapshot.json_values,
        CONFIGURATION: dict(configuration),
        ARRAYS: {name: [array.dtype.str, array.shape] for name, array in snapshot.arrays.items()},
    }
    text = json.dumps(header).encode()
    arrays = (array.tobytes() for array in snapshot.arrays.values())
    body = b"".join((len(text).to_bytes(LENGTH_SIZE, "little"), text, *arrays))
    if len(MAGIC) + DIGEST_SIZE + len(body) > MAX_BYTES:
        raise OSError(errno.EFBIG, f"{len(body) >> 20} MB, at most {MAX_BYTES >> 20} MB")
    # The name is unpredictable, and a symbolic link is never followed.
    handle, temporary = tempfile.mkstemp(".tmp", f".{path.name}.", path.parent)
    try:
        with open(handle, "wb") as file:
            file.write(MAGIC + hashlib.sha256(body).digest() + body)
            file.flush()
            os.fsync(file.fileno())
        require_replaceable(path)
        os.replace(temporary, path)
    finally:
        Path(temporary).unlink(missing_ok=True)


def require_replaceable(path: Path) -> None:
    """Raise `OSError` with what is at a path if it is neither a checkpoint nor nothing."""
    output_files.require_replaceable(path, "checkpoint", OF_ANY_VERSION)


def read(path: Path, configuration: Mapping[str, Any]) -> Snapshot:
    """Return a stored snapshot; raise `CheckpointError` with the reason if it cannot be used."""
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
        header, arrays = _decode(body)
        stamp_ns, json_values, stored = (header[key] for key in (STAMP, FACTS, CONFIGURATION))
        if not isinstance(json_values, dict) or not isinstance(stored, dict):
            raise ValueError(f"{FACTS} and {CONFIGURATION} must be mappings")
    except Exception as error:  # Forged headers make numpy raise many kinds.
        reason = f"{type(error).__name__}: {error}"
        raise CheckpointError(f"{path}: not a checkpoint, {reason[:200]}") from error
    expected = json.loads(json.dumps(dict(configuration)))
    other = sorted(name for name in {*stored, *expected} if stored.get(name) != expected.get(name))
    if other:
        raise CheckpointError(f"{path}: of a tracker with another {', '.join(other)}")
    return Snapshot(stamp_ns, arrays, json_values)


def _content(path: Path) -> bytes:
    """Return a regular file's bytes, after a check of its size."""
    # Opening a pipe without O_NONBLOCK would block.
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "not a regular file")
        if status.st_size > MAX_BYTES:
            raise OSError(errno.EFBIG, f"{status.st_size >> 20} MB, at most {MAX_BYTES >> 20} MB")
        with open(handle, "rb", closefd=False) as file:
            return file.read(MAX_BYTES)
    finally:
        os.close(handle)


def _decode(body: memoryview) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """Return the header and the arrays that it describes, or raise one of many kinds of errors."""
    # Largest header, whose parsing needs some twenty times its size.
    max_header = 2 << 20
    size = int.from_bytes(body[:LENGTH_SIZE], "little")
    if size > max_header:
        raise ValueError(f"a header of {size} bytes, at most {max_header} are allowed")
    position = LENGTH_SIZE + size
    header = json.loads(bytes(body[LENGTH_SIZE:position]))
    arrays: dict[str, npt.NDArray[Any]] = {}
    for name, (kind, shape) in header[ARRAYS].items():
        dtype, count = np.dtype(kind), math.prod(shape)
        if dtype.kind not in "iuf" or min(shape, default=0) < 0:
            raise ValueError(f"an array of type {kind} and shape {shape}, must be of numbers")
        # The copy is aligned and writable, unlike the view of the file's bytes.
        arrays[name] = np.frombuffer(body, dtype, count, position).reshape(shape).copy()
        position += count * dtype.itemsize
    if position != len(body):
        raise ValueError(f"{len(body)} bytes, its header and arrays have {position}")
    return header, arrays


class Checkpoints:
    """Reads a tracker's checkpoint at the start, and writes new ones.

    A checkpoint is written after every `every` scans, or only on request if `every` is 0. A
    restarted tracker continues from it if the first scan is at most `max_age_s` later and the
    parameters in `configuration`, those that cannot change while the tracker runs, are the same.

    `fault` is the reason why the last one could not be written or deleted; empty if it was.
    """

    # Incomplete files of a killed tracker are deleted after this time.
    LEFTOVER_S = 60.0

    def __init__(
        self, path: Path, every: int, max_age_s: float, configuration: Mapping[str, Any], log: Any
    ) -> None:
        self._path, self._every, self._max_age_s = path, every, max_age_s
        self._configuration, self._log = configuration, log
        self._scans = 0
        self.fault = ""
        self._stored: Snapshot | None = None
        with contextlib.suppress(OSError):
            for entry in path.parent.glob(f".{glob.escape(path.name)}.*.tmp"):
                if time.time() - entry.lstat().st_mtime > self.LEFTOVER_S:
                    entry.unlink()
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
                raise ValueError("it contains no scan")
            age_s = (stamp_ns - stored.stamp_ns) * 1e-9
            engine.restore(stored)
            if not 0.0 < age_s <= self._max_age_s:
                # As after a jump of the stamps; see `Pipeline`. Track numbers go on.
                if age_s > 0.0:
                    engine.interrupt()
                else:
                    engine.flush()
                raise ValueError(
                    f"it ends {age_s:.1f} s before the first scan, at most {self._max_age_s:g} s "
                    "are allowed"
                )
        except (TypeError, ValueError, OverflowError) as error:
            self._log.warning(f"starting cold: {self._path}: {error}")
            return
        self._log.info(f"continuing from {self._path}, {age_s:.1f} s old")

    def note_step(self, engine: Engine) -> None:
        """Count a scan, and write a checkpoint if one is due."""
        self._scans += 1
        if self._every and self._scans % self._every == 0:
            self.save(engine)

    def save(self, engine: Engine) -> str | None:
        """Write a checkpoint; return None, or the reason if it could not be written."""
        if not self._scans:
            return "no scan has been processed yet"
        self.fault = ""
        try:
            write(self._path, engine.snapshot(), self._configuration)
        except OSError as error:
            self._fail("no checkpoint", error)
        return self.fault or None

    def discard(self) -> None:
        """Delete the checkpoint, because its run has ended."""
        self._stored, self._scans = None, 0
        self.fault = ""
        try:
            require_replaceable(self._path)
            self._path.unlink(missing_ok=True)
        except OSError as error:
            self._fail("the checkpoint of the ended run was not deleted", error)

    def _fail(self, what: str, error: OSError) -> None:
        self.fault = f"{what}: {self._path}: {error.strerror}"
        self._log.error(self.fault, throttle_duration_sec=WARNING_PERIOD_S)
