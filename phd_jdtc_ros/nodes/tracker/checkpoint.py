# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""A tracker's snapshot as a file: written atomically, and checked before it is used.

The file is a magic line, the SHA-256 of the rest, and a numpy archive of arrays. The facts and the
tracker's configuration are JSON text in two of them. Nothing in the file is executed or unpickled.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from phd_jdtc_ros.core.engine import Engine
from phd_jdtc_ros.core.snapshot import Snapshot

from ..common.runtime import WARNING_PERIOD_S

MAGIC = b"phd_jdtc_ros checkpoint 2\n"
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
    snapshot : Snapshot
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
    stored = {name: _text(value) for name, value in texts.items()}
    payload = io.BytesIO()
    np.savez(payload, **stored, **{f"array.{k}": v for k, v in snapshot.arrays.items()})
    body = payload.getvalue()
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            file.write(MAGIC + hashlib.sha256(body).digest() + body)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def read(path: Path, configuration: Mapping[str, Any]) -> Snapshot:
    """Return a stored snapshot.

    Raises
    ------
    CheckpointError
        If the file is missing, damaged, of another format, or of a tracker with other parameters.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise CheckpointError(f"{path}: {error.strerror}") from error
    if not content.startswith(MAGIC):
        raise CheckpointError(f"{path}: not a checkpoint of this version")
    digest, body = content[len(MAGIC) :][:DIGEST_SIZE], content[len(MAGIC) + DIGEST_SIZE :]
    if hashlib.sha256(body).digest() != digest:
        raise CheckpointError(f"{path}: damaged, its checksum does not match")
    try:
        with np.load(io.BytesIO(body), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        stamp_ns, facts, stored = (
            json.loads(arrays.pop(key).tobytes()) for key in (STAMP, FACTS, CONFIGURATION)
        )
    except (KeyError, ValueError, zipfile.BadZipFile) as error:
        raise CheckpointError(f"{path}: not a checkpoint, {error}") from error
    expected = json.loads(json.dumps(dict(configuration)))
    other = sorted(name for name in {*stored, *expected} if stored.get(name) != expected.get(name))
    if other:
        raise CheckpointError(f"{path}: of a tracker with another {', '.join(other)}")
    held = {name.removeprefix("array."): array for name, array in arrays.items()}
    return Snapshot(stamp_ns, held, facts)


class Checkpoints:
    """A tracker's checkpoints: one is read at the start, and new ones are written.

    Parameters
    ----------
    path : Path
    every : int
        Scans between checkpoints; 0 to write on request only.
    max_age_s : float
        Longest time from the checkpoint's last scan to the first scan after a restart, seconds.
    configuration : mapping
        Parameters of the tracker, without those that can change while it runs.
    log : rclpy logger
    """

    def __init__(
        self, path: Path, every: int, max_age_s: float, configuration: Mapping[str, Any], log: Any
    ) -> None:
        self._path, self._every, self._max_age_s = path, every, max_age_s
        self._configuration, self._log = configuration, log
        self._scans = 0
        self._stored: Snapshot | None = None
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
        except (KeyError, TypeError, ValueError) as error:
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
