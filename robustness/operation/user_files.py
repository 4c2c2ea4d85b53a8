"""A user's files: none may be replaced by a node, and a parameter file must be for the node."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters.encoding import names

from ..harness import scans
from ..harness.figures import Found, measures, such_as
from ..harness.rig import LIGHT, Node, Rig, options, start_limit_s

MINE = "/tracker: {ros__parameters: {lag: 3}}\n"


def _make_link(path: Path) -> None:
    target = path.with_suffix(".target")
    target.write_text(MINE)
    path.symlink_to(target)


# What may be at the path of a node's file, and how it is made.
KINDS: Mapping[str, Callable[[Path], object]] = {
    "a user's file": lambda path: path.write_text(MINE),
    "a pipe": os.mkfifo,
    "a folder": os.mkdir,
    "a link": _make_link,
    # The device is that of /dev/null.
    "a device": lambda path: os.mknod(path, 0o20666, os.makedev(1, 3)),
}
# Only root may make a device.
MADE = tuple(KINDS) if os.geteuid() == 0 else tuple(KINDS)[:-1]
# The parameters that name a file which a node writes again and again.
WRITERS = {"tracker": "checkpoint.path", "evaluator": "report"}
NODES = ("tracker", "evaluator", "sensor_replay", "asterix_bridge", "hand_over")
TOOLS = ("track_bag", "tune")
CLOCK = "/**: {ros__parameters: {use_sim_time: true}}\n"


@measures(
    "files that a node writes",
    "status 2 that names what is there, 0 replaced; in a run an ERROR, and tracking goes on",
)
def measure_written(kinds: Sequence[str] = MADE) -> Found:
    """Put something else at the paths of nodes' files, before their start and in a run."""
    wrong: dict[str, str] = {}
    with Rig() as rig:
        for kind in kinds:
            for name, parameter in WRITERS.items():
                path = rig.directory / f"{name}.file"
                before = _put(kind, path)
                text, status = _ended(rig.start(name, "--ros-args", *options({parameter: path})))
                if _state(path) != before:
                    wrong[f"{name}, {kind}"] = "replaced"
                elif status != 2 or f"{parameter}: {path} given, " not in text:
                    wrong[f"{name}, {kind}"] = f"rc {status}: {text[-100:]}"
        wrong |= _in_a_run(rig, kinds)
    cases = (len(WRITERS) + 1) * len(kinds)
    return f"{cases} cases: {len(wrong)} wrong{such_as(wrong)}", not wrong, {"wrong": wrong}


def _in_a_run(rig: Rig, kinds: Sequence[str]) -> dict[str, str]:
    """Put each kind in the place of a running tracker's checkpoint; return what goes wrong."""
    path, wrong = rig.directory / "tracker.checkpoint", {}
    given = {"checkpoint.path": path}
    _, radars = rig.tracking(*LIGHT, *options(given))
    for number, kind in enumerate(kinds):
        first = 4 * number
        answered = radars.track(first) and radars.spin_until(path.is_file, start_limit_s())
        before = _put(kind, path)
        answered = answered and all(radars.track(first + more) for more in (1, 2))
        status = radars.latest_health()[names.health("outputs")]
        if _state(path) != before:
            wrong[f"in a run, {kind}"] = "replaced"
        elif not answered or status.level != DiagnosticStatus.ERROR:
            wrong[f"in a run, {kind}"] = f"tracked {answered}, status {status.message}"
        _remove(path)
        if not radars.track(first + 3):
            wrong[f"in a run, after {kind}"] = "not tracked"
    return wrong


def _put(kind: str, path: Path) -> Any:
    """Put something at a path, instead of what is there; return its state."""
    while True:
        _remove(path)
        # A tracker may write its checkpoint in between.
        with contextlib.suppress(FileExistsError):
            KINDS[kind](path)
            return _state(path)


def _remove(path: Path) -> None:
    for old in (path, path.with_suffix(".target")):
        if old.is_dir() and not old.is_symlink():
            shutil.rmtree(old)
        else:
            old.unlink(missing_ok=True)


def _state(path: Path) -> Any:
    """Return what would change if something at a path, or what it links to, were written."""
    found = path.lstat()
    content = path.read_text() if path.is_file() else ""
    return found.st_ino, found.st_mode, found.st_rdev, found.st_size, content


@measures(
    "parameter files",
    "status 2 that names the sections and the node; of two files one may be for other nodes",
)
def measure_parameters(nodes: Sequence[str] = NODES, tools: Sequence[str] = TOOLS) -> Found:
    """Give files with a section for another name beside one that sets the clock of all nodes."""
    wrong = {}
    runs = [
        *((name, "north", ("--ros-args", "-r", "__ns:=/north"), f"/{name}") for name in nodes),
        *((name, "", ("--ros-args", "-r", "__node:=other"), f"/{name}") for name in nodes),
        *((name, "", ("--ros-args",), f"/{name}s") for name in nodes),
        *((name, "", (str(scans.BAG),), "/trakcer") for name in tools),
    ]
    with Rig() as rig:
        path, good = rig.directory / "site.yaml", rig.directory / "good.yaml"
        for name, namespace, words, section in runs:
            path.write_text(f"{CLOCK}{section}: {{ros__parameters: {{lag: 3}}}}\n")
            out = ("--out", rig.directory / "out") if name in tools else ()
            text, status = _ended(rig.start(name, *words, *out, "--params-file", path))
            names_both = f"it has /** (only use_sim_time), {section}\n" in text
            if status != 2 or not names_both or (namespace and f"/{namespace}/{name}" not in text):
                wrong[f"{name} {' '.join(words[1:])}"] = f"rc {status}: {text[-200:]}"
        good.write_text("/**/tracker: {ros__parameters: {lag: 4}}\n")
        both = ("-r", "__ns:=/north", "--params-file", path, "--params-file", good)
        tracker = rig.start("tracker", "--ros-args", *both)
        if not tracker.said(f"parameters from {good}\n"):
            wrong["two files"] = tracker.why_not(f"parameters from {good}")
    text = f"{len(runs) + 1} runs: {len(wrong)} wrong{such_as(wrong)}"
    return text, not wrong, {"wrong": wrong}


def _ended(node: Node) -> tuple[str, int | None]:
    """Return what a process says until it ends, and its status; None if it does not end."""
    try:
        status: int | None = node.process.wait(start_limit_s())
    except subprocess.TimeoutExpired:
        node.kill()
        status = None
    return node.text, status
