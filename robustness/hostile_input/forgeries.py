"""Forged checkpoints with right checksums. Each must lead to a cold start with a reason.

They run in a separate process, so that the measured memory is that of the restart.
"""

from __future__ import annotations

import hashlib
import json
import os
import resource
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.snapshot import Snapshot
from phd_jdtc_ros.core.types import Estimates
from phd_jdtc_ros.nodes.tracker import checkpoint

from ..harness import scans
from ..harness.figures import Found, in_own_process, measures

SCANS = 6
VALUES: Mapping[str, Any] = {"seed": 0}
# Everything that is learned of a radar's clutter.
LEARNING = {
    "radar_1.clutter_amplitude": "learned",
    "radar_1.clutter_map": True,
    "radar_1.learn": ["clutter"],
}
Change = Callable[[Snapshot], object]
OLDEST, NEXT, STAMPS = "stored.0", "stored.1", "window.stamps_ns"


class _Log:
    """Collects log lines."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def warning(self, text: str, **_: Any) -> None:
        self.lines.append(text)

    error = info = warning


@measures(
    "forged checkpoints",
    "cold start with a reason each, 0 errors, 0 estimates that are not finite, at most 256 MB",
)
def measure(**given: Any) -> Found:
    """Start from every forgery and track on, with some parameters."""
    found = in_own_process(outcomes, {**LEARNING, **given})
    wrong = {name: what for name, what in found["outcomes"].items() if what != "cold"}
    text = f"{len(found['outcomes'])} kinds: {len(wrong)} wrong, {found['memory_mb']:.0f} MB"
    return text, not wrong and found["memory_mb"] <= 256.0, {**found, "wrong": wrong}


def _edit(name: str, new: Callable[[Any], Any]) -> Change:
    """Return a change of an array."""
    return lambda snapshot: snapshot.arrays.update({name: new(snapshot.arrays[name])})


def _put(name: str, value: Any, kind: Any = None) -> Change:
    """Return a change that writes a value into the first entry of an array."""

    def put(array: Any) -> Any:
        found = np.array(array, dtype=kind)
        found.flat[0] = value
        return found

    return _edit(name, put)


NAN, INF = float("nan"), float("inf")
# The first value of each array of the oldest set.
ARRAYS: Mapping[str, tuple[float, ...]] = {
    "origin": (-5, 2**62),
    "weight": (NAN, INF, -1.0, 1e4, 1e300),
    "mean": (NAN, INF, 1e300),
    "covariance": (NAN, INF, -1.0, 1e300),
}


def contents(honest: Snapshot) -> dict[str, Change]:
    """Return changes of the values of a snapshot, by name; `honest` is one."""
    arrays = {
        f"{part} {value}": _put(f"{OLDEST}.{part}", value)
        for part, values in ARRAYS.items()
        for value in values
    }
    return {**arrays, **_around_mixtures(), **_of_mixtures(honest)}


def _around_mixtures() -> dict[str, Change]:
    """Return changes of what is stored beside the mixtures."""
    values = {
        "a scan index as a float": ("filter.scan_index", 1e9),
        "a huge scan index": ("filter.scan_index", 1 << 62),
        "a huge track number": ("numbers.last", 1 << 40),
        "a clutter map of another place": ("clutter_map.radar_1.pose", [5e3, 0.0, 0.0]),
        "a clutter map of no revolutions": ("clutter_map.radar_1.revolutions", NAN),
        "a clutter map with cells of no size": ("clutter_map.radar_1.grid.range_cell", 0.0),
        "a clutter rate that is not finite": ("clutter_rate.radar_1.count", NAN),
        "a clutter rate of no revolutions": ("clutter_rate.radar_1.revolutions", 0.0),
        "no window": ("window.entries", "7"),
    }
    return {
        **{what: _set(name, value) for what, (name, value) in values.items()},
        "stamps backwards": _edit(STAMPS, lambda stamps: stamps[::-1]),
        "a huge stamp": _put(STAMPS, 1 << 62),
        "a stamp as a float": _put(STAMPS, 1.0, "f8"),
        "track numbers that are none": lambda s: s.arrays.pop("numbers.number"),
        "clutter of another radar": _of_another("clutter"),
        "a clutter map of another radar": _of_another("clutter_map"),
        "a clutter rate of another radar": _of_another("clutter_rate"),
        "a clutter map without cells": lambda s: s.arrays.pop("clutter_map.radar_1.cell"),
    }


def _set(name: str, value: Any) -> Change:
    """Return a change that replaces an array."""
    return lambda snapshot: snapshot.arrays.update({name: np.array(value)})


def _of_another(part: str) -> Change:
    """Return a change that assigns the learned clutter to another radar."""

    def change(snapshot: Snapshot) -> None:
        for name in [name for name in snapshot.arrays if name.startswith(f"{part}.radar_1.")]:
            snapshot.arrays[name.replace("radar_1", "mast")] = snapshot.arrays.pop(name)

    return change


def _of_mixtures(honest: Snapshot) -> dict[str, Change]:
    link = f"{NEXT}.link"
    values = {
        f"{name} {value}": _put(name, value)
        for name, array in honest.arrays.items()
        if name.startswith(link) and array.size  # Few pairs of modes have factors
        for value in ((-2, 10**6) if array.dtype.kind == "i" else (NAN, 1e250))
    }
    return {
        "means of other axes": _edit(f"{OLDEST}.mean", _three),
        "means as text": _edit(f"{OLDEST}.mean", _whole),
        "covariances with a negative eigenvalue": _edit(
            f"{OLDEST}.covariance", _against_each_other
        ),
        "covariances that are not symmetric": _edit(f"{OLDEST}.covariance", _asymmetric),
        "survival above one": _put(f"{link}.survival", 1.5),
        "a share above one": _put(f"{link}.share", 3.0),
        **values,
    }


def _three(array: Any) -> Any:
    return array[..., :3]


def _whole(array: Any) -> Any:
    return np.nan_to_num(array).astype("i8")


def _against_each_other(covariance: Any) -> Any:
    """Return covariances in which the correlations of three axes are impossibly negative."""
    matrix = np.array(covariance)
    scale = np.sqrt(np.maximum(np.diagonal(matrix, axis1=-2, axis2=-1)[..., :3], 1.0))
    pattern = np.where(np.eye(3) > 0.0, 1.0, -0.99)
    matrix[..., :3, :3] = pattern * scale[..., :, None] * scale[..., None, :]
    return matrix


def _asymmetric(covariance: Any) -> Any:
    matrix = np.array(covariance)
    matrix[..., 0, 1] *= -0.5
    matrix[..., 0, 1] += 0.1 * np.sqrt(matrix[..., 0, 0] * matrix[..., 1, 1])
    return matrix


def bodies(body: bytes) -> dict[str, bytes]:
    """Return forged bodies of a file, by name; `body` is an honest one."""
    start = checkpoint.LENGTH_SIZE
    end = start + int.from_bytes(body[:start], "little")
    honest, data = json.loads(body[start:end]), body[end:]
    first = next(iter(honest["arrays"]))

    def packed(text: bytes, data: bytes = data) -> bytes:
        return len(text).to_bytes(start, "little") + text + data

    def described(kind: str, shape: Any, data: bytes = data) -> bytes:
        arrays = {**honest["arrays"], first: [kind, shape]}
        return packed(json.dumps({**honest, "arrays": arrays}).encode(), data)

    def other(**parts: Any) -> bytes:
        return packed(json.dumps({**honest, **parts}).encode())

    text = json.dumps(honest).encode()
    return {
        "an array of a huge shape": described("<f8", [10**12, 5]),
        "an array of a shape beyond all integers": described("<f8", [10**30, 0]),
        "an array of a negative shape": described("<f8", [-1, 5]),
        "an array of a shape that is a text": described("<f8", "5"),
        "an array of objects": described("|O", [1]),
        "an array of no type": described("?!", [1]),
        "arrays that are longer than the file": packed(text, data[:-1]),
        "arrays that are shorter than the file": packed(text, data + b"0"),
        "very many arrays": other(arrays={f"{k}": ["<f8", [0]] for k in range(90_000)}),
        "arrays that are a list": other(arrays=[]),
        "deep facts": packed(text.replace(b'"facts": {', b'"facts": {"x": ' + b"[" * 200_000, 1)),
        "a long header": packed(b"[0" + b",0" * 29_999_999 + b"]"),
        "a header that is longer than the file": b"\xff\xff\x1f\x00" + text,
        "facts that are a list": other(facts=[]),
        "a header that is no text": packed(b"\xff" * 99),
        "no header": b"nothing",
        "nothing": b"",
    }


def _forgeries(given: Mapping[str, Any]) -> Iterator[tuple[str, bytes]]:
    """Yield forged files of an engine, by name."""
    engine = new_engine(resolve(given))
    for scan in scans.reference()[:SCANS]:
        engine.step(scan)
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "forged"

        def written(snapshot: Snapshot) -> bytes:
            checkpoint.write(path, snapshot, VALUES)
            return path.read_bytes()

        for name, change in contents(engine.snapshot()).items():
            snapshot = engine.snapshot()
            change(snapshot)
            yield name, written(snapshot)
        start = len(checkpoint.MAGIC) + checkpoint.DIGEST_SIZE
        honest = written(engine.snapshot())[start:]
        for name, body in bodies(honest).items():
            yield name, checkpoint.MAGIC + hashlib.sha256(body).digest() + body


def outcome(path: Path, config: TrackerConfig) -> str:
    """Start from a file and track on; return ``cold``, or the fault."""
    log, engine = _Log(), new_engine(config)
    following = scans.reference()[SCANS : SCANS + 2]
    try:
        found = checkpoint.Checkpoints(path, 0, 60.0, VALUES, log)
        found.resume(engine, following[0].stamp_ns)
        for scan in following:
            step = engine.step(scan)
            for estimates in (*step.filtered, *step.smoothed):
                if not (np.isfinite(estimates.state).all() and _covariances(estimates)):
                    return "not finite"
    except Exception as error:  # Any of them would end the node
        return f"{type(error).__name__}: {error}"[:120]
    if len(log.lines) != 1 or not log.lines[0].startswith("starting cold: "):
        return f"said {log.lines}"[:120]
    return "cold"


def _covariances(found: Estimates) -> bool:
    """Return whether the estimates' covariances are finite and positive semidefinite."""
    finite = np.isfinite(found.covariance).all()
    return bool(finite and (np.linalg.eigvalsh(found.covariance) > -1e-6).all())


def outcomes(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the outcomes and the memory of all starts."""
    with tempfile.TemporaryDirectory() as directory:
        paths = []
        child = os.fork()  # The forgeries are made elsewhere, because that takes memory
        if not child:
            for index, (name, data) in enumerate(_forgeries(given)):
                (Path(directory) / f"{index:03} {name}").write_bytes(data)
            os._exit(0)
        os.waitpid(child, 0)
        paths = sorted(Path(directory).iterdir())
        config = resolve(given)
        new_engine(config).step(scans.reference()[0])
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        found = {path.name[4:]: outcome(path, config) for path in paths}
        after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {"outcomes": found, "memory_mb": (after - before) / 1024.0}
