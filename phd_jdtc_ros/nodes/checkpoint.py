"""A tracker's snapshot as a file: written whole or not at all, and checked before it is believed.

The file is a magic line, the SHA-256 of all that follows, and a numpy archive of arrays; the facts
and what the tracker was configured with are JSON text in two of them. Nothing in it is ever
executed or unpickled.
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

from phd_jdtc_ros.core.snapshot import Snapshot

MAGIC = b"phd_jdtc_ros checkpoint 1\n"
DIGEST_SIZE = hashlib.sha256().digest_size
FACTS, CONFIGURATION = "facts", "configuration"


class CheckpointError(Exception):
    """A checkpoint cannot be used; the message says why."""


def write(path: Path, snapshot: Snapshot, configuration: Mapping[str, Any]) -> None:
    """Store a snapshot; the file before it stays until this one is complete on the disk.

    Parameters
    ----------
    path : Path
        In an existing directory.
    snapshot : Snapshot
    configuration : mapping
        Parameters by name; only a tracker with the same ones may go on from it.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    texts = {FACTS: snapshot.facts, CONFIGURATION: dict(configuration)}
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
        If there is none, it is damaged, of another format, or of a tracker with other parameters.
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
        facts, stored = (json.loads(arrays.pop(key).tobytes()) for key in (FACTS, CONFIGURATION))
    except (KeyError, ValueError, zipfile.BadZipFile) as error:
        raise CheckpointError(f"{path}: not a checkpoint, {error}") from error
    expected = json.loads(json.dumps(dict(configuration)))
    other = sorted(name for name in {*stored, *expected} if stored.get(name) != expected.get(name))
    if other:
        raise CheckpointError(f"{path}: of a tracker with another {', '.join(other)}")
    return Snapshot({name.removeprefix("array."): array for name, array in arrays.items()}, facts)


def latest_stamp_ns(snapshot: Snapshot) -> int | None:
    """Return the stamp of the last scan that a snapshot has seen."""
    stamp_ns = snapshot.facts["filter"]["stamp_ns"]
    return None if stamp_ns is None else int(stamp_ns)


def _text(value: Any) -> Any:
    return np.frombuffer(json.dumps(value).encode(), dtype=np.uint8)
