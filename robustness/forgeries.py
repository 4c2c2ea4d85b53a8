# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Forged checkpoints: right checksums, wrong contents. Each must be a cold start with a reason.

The run is a process of its own (``python -m robustness.forgeries``), so that its memory is that of
the restart alone.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import resource
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from phd_jdtc_ros.core.configuration.build import resolve
from phd_jdtc_ros.core.engines import new_engine
from phd_jdtc_ros.core.snapshot import Snapshot
from phd_jdtc_ros.nodes.tracker import checkpoint

from . import scans
from .figures import Figure, in_own_process, measured_or_why

NAME = "forged checkpoints"
GOAL = "cold start with a reason each, 0 errors, 0 estimates that are not finite, at most 256 MB"
SCANS = 6
VALUES: Mapping[str, Any] = {"seed": 0}
Change = Callable[[Snapshot], object]


class _Log:
    """Keeps what is logged."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def warning(self, text: str, **_: Any) -> None:
        self.lines.append(text)

    error = info = warning


def measure() -> Figure:
    """Start from every forgery and track on."""
    return measured_or_why(NAME, GOAL, _measure)


def _measure() -> tuple[str, bool, Mapping[str, Any]]:
    found = in_own_process("robustness.forgeries")
    wrong = {name: what for name, what in found["outcomes"].items() if what != "cold"}
    text = f"{len(found['outcomes'])} kinds: {len(wrong)} wrong, {found['memory_mb']:.0f} MB"
    return text, not wrong and found["memory_mb"] <= 256.0, {**found, "wrong": wrong}


def _put(name: str, value: Any, kind: Any = None) -> Change:
    """Return a change that writes a value into the first entry of an array."""

    def change(snapshot: Snapshot) -> None:
        array = np.array(snapshot.arrays[name], dtype=kind)
        array.ravel()[0] = value
        snapshot.arrays[name] = array

    return change


def contents() -> dict[str, Change]:
    """Return changes of a snapshot's values, by name."""
    nan, set_ = float("nan"), "stored.0"
    arrays = {
        f"{part} {value}": _put(f"{set_}.{part}", value)
        for part, values in {
            "state": (nan, float("inf"), 1e300),
            "log_snr": (nan, 1e9),
            "mode": (250, -1),
            "origin": (-5, 2**62),
            "parent": (-7,),
            "multiplicity": (0, -1, 10**12),
            "components.data": (nan, -1.0, 1e300),
            "components.indices": (10**6,),
            "components.indptr": (5,),
            "label": (-9,),
        }.items()
        for value in values
    }
    facts: dict[str, Change] = {
        "stamps backwards": lambda s: s.facts["smoother"]["stamps_ns"].reverse(),
        "a huge stamp": lambda s: s.facts["smoother"]["stamps_ns"].__setitem__(-1, 10**30),
        "a stamp as text": lambda s: s.facts["smoother"]["stamps_ns"].__setitem__(0, "x"),
        "a random state of huge numbers": lambda s: s.facts["filter"]["rng"]["state"].update(
            state=10**60
        ),
        "no random state": lambda s: s.facts["filter"].update(rng=None),
        "a scan index as text": lambda s: s.facts["filter"].update(scan_index="1e9"),
        "a huge scan index": lambda s: s.facts["filter"].update(scan_index=10**40),
        "a huge track number": lambda s: s.facts["smoother"]["tracks"].update(count=2**40),
        "track numbers that are none": lambda s: s.facts["smoother"]["tracks"].update(number=[3]),
        "no smoother": lambda s: s.facts.update(smoother=7),
    }
    others: dict[str, Change] = {
        "states of other axes": lambda s: s.arrays.update(
            {f"{set_}.state": np.zeros((len(s.arrays[f"{set_}.state"]), 3))}
        ),
        "states as text": lambda s: s.arrays.update(
            {f"{set_}.state": s.arrays[f"{set_}.state"].astype("i8")}
        ),
        "survival above one": _put("stored.1.link.survival", 1.5),
        "a kernel that is not finite": _put("stored.1.link.ratio.data", nan),
        "a kernel that explodes": _put("stored.1.link.ratio.data", 1e250),
    }
    return {**arrays, **facts, **others}


def archives(body: bytes) -> dict[str, bytes]:
    """Return archives that are no honest ones, by name; `body` is one that is."""
    with zipfile.ZipFile(io.BytesIO(body)) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    first = "array.stored.0.state.npy"

    def packed(changes: Mapping[str, bytes], kind: int = zipfile.ZIP_STORED) -> bytes:
        into = io.BytesIO()
        with zipfile.ZipFile(into, "w", kind, compresslevel=1) as archive:
            for name, data in {**parts, **changes}.items():
                archive.writestr(name, data)
        return into.getvalue()

    def header(shape: str, kind: str = "<f8") -> bytes:
        text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
        return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text

    long = b"[0" + b",0" * 29_999_999 + b"]"
    swelling = header(f"({1 << 29},)", "|u1") + bytes(1 << 29)
    return {
        "an archive that swells": packed({"array.more.npy": swelling}, zipfile.ZIP_DEFLATED),
        "a header of a huge shape": packed({first: header("(1000000000000, 5)")}),
        "a header of a negative shape": packed({first: header("(-1, 5)")}),
        "a header that is no header": packed({first: b"\x93NUMPY\x01\x00\xff\xff("}),
        "an array of objects": packed({first: header("(1,)", "|O") + bytes(8)}),
        "deep facts": packed({"facts.npy": header("(200000,)", "|u1") + b"[" * 200_000}),
        "long facts": packed({"facts.npy": header("(60000001,)", "|u1") + long}),
        "facts that are a list": packed({"facts.npy": header("(2,)", "|u1") + b"[]"}),
        "very many members": packed({f"{k}.npy": b"" for k in range(100_000)}),
        "no archive": b"nothing",
        "nothing": b"",
    }


def _forged() -> Iterator[tuple[str, bytes]]:
    """Yield forged files, by name."""
    engine = new_engine(resolve({}))
    for scan in scans.reference()[:SCANS]:
        engine.step(scan)
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "forged"

        def written(snapshot: Snapshot) -> bytes:
            checkpoint.write(path, snapshot, VALUES)
            return path.read_bytes()

        for name, change in contents().items():
            snapshot = engine.snapshot()
            change(snapshot)
            yield name, written(snapshot)
        start = len(checkpoint.MAGIC) + checkpoint.DIGEST_SIZE
        honest = written(engine.snapshot())[start:]
        for name, body in archives(honest).items():
            yield name, checkpoint.MAGIC + hashlib.sha256(body).digest() + body


def outcome(path: Path) -> str:
    """Start from a file and track on; return ``cold``, or what was wrong."""
    log, engine = _Log(), new_engine(resolve({}))
    following = scans.reference()[SCANS : SCANS + 2]
    try:
        found = checkpoint.Checkpoints(path, 0, 60.0, VALUES, log)
        found.resume(engine, following[0].stamp_ns)
        for scan in following:
            step = engine.step(scan)
            for estimates in (*step.filtered, *step.smoothed):
                if not np.isfinite(estimates.state).all():
                    return "not finite"
    except Exception as error:  # any of them would end the node
        return f"{type(error).__name__}: {error}"[:120]
    if len(log.lines) != 1 or not log.lines[0].startswith("starting cold: "):
        return f"said {log.lines}"[:120]
    return "cold"


def main() -> int:
    """Print the outcomes and the memory of all starts, as JSON."""
    with tempfile.TemporaryDirectory() as directory:
        paths = []
        child = os.fork()  # what makes the forgeries takes memory of its own
        if not child:
            for index, (name, data) in enumerate(_forged()):
                (Path(directory) / f"{index:02} {name}").write_bytes(data)
            os._exit(0)
        os.waitpid(child, 0)
        paths = sorted(Path(directory).iterdir())
        new_engine(resolve({})).step(scans.reference()[0])
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        outcomes = {path.name[3:]: outcome(path) for path in paths}
        after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(json.dumps({"outcomes": outcomes, "memory_mb": (after - before) / 1024.0}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
