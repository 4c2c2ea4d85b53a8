"""A full disk and a read-only directory: recording must end, and tracking must go on."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from ..harness.figures import Found, NotMeasurableError, measures
from ..harness.rig import LIGHT, Node, Rig

GOAL = "one clear error, tracking goes on"
SCANS = 60
# Number of scans after which the disk must be full.
MOST_SCANS = 600
DISK = "200k"


def _mount(directory: Path, options: str) -> Sequence[str]:
    """Return the prefix of a command that has a small disk of its own at `directory`."""
    if os.geteuid() != 0 or shutil.which("unshare") is None:
        raise NotMeasurableError("a disk of its own needs root and unshare")
    directory.mkdir()
    mount = f'mount -t tmpfs -o {options} tmpfs "{directory}"'
    prefix = ("unshare", "--mount", "sh", "-c", f'{mount} && exec "$@"', "sh")
    done = subprocess.run([*prefix, "true"], capture_output=True, text=True, check=False)
    if done.returncode:
        raise NotMeasurableError(f"cannot mount: {done.stderr.strip()}")
    return prefix


@measures("disk full while recording", GOAL)
def measure_full() -> Found:
    """Record onto a small disk until it is full."""
    with Rig() as rig:
        disk = rig.directory / "disk"
        recorder = _evaluator(rig, _mount(disk, f"size={DISK}"), disk)
        rig.tracking(*LIGHT)
        index = 0
        while "No space left" not in recorder.text and index < MOST_SCANS:
            rig.radars.track(index)
            index += 1
        # The recorder writes with a delay, seconds on a busy machine.
        recorder.said("No space left")
        answered = _track(rig, index)
        alive = recorder.alive
        status = recorder.stop()
        errors = [line for line in recorder.text.splitlines() if "recording" in line]
        text = _text(answered, errors) + f"; the evaluator {'goes on' if alive else 'ended'}"
        clear = len(errors) == 1 and "No space left" in errors[0] and _no_traceback(recorder)
        return text, clear and alive and status == 0 and answered == SCANS, {"said": errors}


@measures("read-only directory", GOAL)
def measure_read_only() -> Found:
    """Record into a directory that cannot be written."""
    with Rig() as rig:
        disk = rig.directory / "disk"
        recorder = _evaluator(rig, _mount(disk, "ro"), disk)
        rig.tracking(*LIGHT)
        answered = _track(rig)
        alive = recorder.alive
        status = recorder.stop()
        errors = [line for line in recorder.text.splitlines() if "cannot be written" in line]
        text = _text(answered, errors) + f"; the evaluator {'goes on' if alive else f'rc {status}'}"
        clear = len(errors) == 1 and "Read-only" in errors[0] and _no_traceback(recorder)
        return text, clear and (alive or status == 2) and answered == SCANS, {"said": errors}


def _evaluator(rig: Rig, prefix: Sequence[str], disk: Path) -> Node:
    node = rig.start("evaluator", "--ros-args", "-p", f"record:={disk / 'bag'}", prefix=prefix)
    # Only then does it record; on a read-only disk it ends instead.
    node.said("waiting for")
    return node


def _track(rig: Rig, first: int = 0) -> int:
    """Let the tracker track; return how many scans were answered."""
    return sum(rig.radars.track(first + index) for index in range(SCANS))


def _text(answered: int, errors: Sequence[str]) -> str:
    return f"{len(errors)} errors logged; {answered} of {SCANS} scans tracked"


def _no_traceback(node: Node) -> bool:
    return "Traceback" not in node.text
