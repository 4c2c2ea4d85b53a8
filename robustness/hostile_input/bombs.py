"""Expanding input: YAML, numbers and names must be refused quickly, in a short line."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from msg_adapters.encoding import interfaces, names

from ..harness import scans
from ..harness.domains import Domain
from ..harness.figures import Found, in_own_process, measures
from ..harness.rig import LIGHT, Rig

LIMIT_S, MOST_MB, LONGEST_LINE = 2.0, 256.0, 600
PROCESS_S = 60.0
FRAME_ID = "x" * 2**20
YAML = {
    "aliases": "\n".join(
        [
            "a0: &a0 [x, x, x, x, x, x, x, x, x]",
            *(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 9)),
        ]
    ),
    "itself": "a: &a [*a]",
    "deep lists": "[" * 100_000,
    "deep mappings": "\n".join(f"{' ' * depth}a:" for depth in range(900)),
    "digits": f"lag: {'9' * 5000}",
    "digits of the other base": f"lag: 0x{'f' * 5000}",
    "values": f"lag: [{'1,' * 200_000}]",
    "size": f"lag: {'x' * 2**20}",
}
# The arguments with which each executable reads a YAML file.
WAYS: Mapping[str, tuple[str, ...]] = {
    "tracker": ("--ros-args", "--params-file", "FILE"),
    "evaluator": ("--ros-args", "--params-file", "FILE"),
    "sensor_replay": ("BAG", "--ros-args", "--params-file", "FILE"),
    "track_bag": ("BAG", "--out", "OUT", "--params-file", "FILE"),
    "simulate": ("--out", "OUT", "--scenario", "FILE"),
    "monte_carlo": ("--out", "OUT", "--study", "FILE"),
}
# Command lines with long values.
WORDS: Mapping[str, tuple[str, ...]] = {
    "tracker": ("--ros-args", "-p", f"lag:={'9' * 5000}"),
    "evaluator": ("--ros-args", "-p", f"cutoff:={'9' * 5000}"),
    "sensor_replay": ("BAG", "--rate", "x" * 5000),
    "track_bag": ("BAG", "--out", "OUT", "-p", f"lag:={'9' * 5000}"),
    "simulate": ("--out", "OUT", "--seed", "9" * 5000),
    "monte_carlo": ("--out", "OUT", "--runs", "9" * 5000),
}


@measures(
    "input bombs",
    "rc 2 in a short line within 256 MB and 2 s of CPU more than --help takes; log lines of a 1 MB "
    "frame_id are short",
)
def measure() -> Found:
    """Give every executable all bombs, and a live tracker clouds with a huge frame_id."""
    found = in_own_process(outcome)
    longest = _longest_log_line()
    text = (
        f"{found['runs']} runs: {len(found['wrong'])} wrong, at most {found['most_s']:.1f} s and "
        f"{found['peak_mb']:.0f} MB; the longest log line has {longest} characters"
    )
    good = not found["wrong"] and found["most_s"] <= LIMIT_S and found["peak_mb"] <= MOST_MB
    return text, good and longest <= LONGEST_LINE, {**found, "longest_log_line": longest}


def _longest_log_line() -> int:
    """Return the length of the longest line that a tracker logs of clouds with a huge frame_id."""
    with Rig() as rig:
        tracker, _ = rig.tracking(*LIGHT)
        cloud = interfaces.decode(scans.cloud(0, 0), names.CLOUD)
        cloud.header.frame_id = FRAME_ID
        rig.radars.outputs[0].publish(cloud)
        if not tracker.said("frame_id"):
            raise RuntimeError("the tracker logs nothing about the cloud")
        if not all(rig.radars.track(index) for index in range(1, 5)):
            raise RuntimeError("the scans after the cloud are not tracked")
        return max(map(len, tracker.text.splitlines()))


def _commands(directory: Path) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the name and the command line of each run."""
    for bomb, text in YAML.items():
        path = directory / f"{bomb.replace(' ', '_')}.yaml"
        path.write_text(text)
        for executable, words in WAYS.items():
            given = (str(path) if word == "FILE" else word for word in words)
            yield f"{executable}: {bomb}", (executable, *given)
    for executable, words in WORDS.items():
        yield f"{executable}: a long word", (executable, *words)


def _fault(done: subprocess.CompletedProcess[str]) -> str:
    """Return the fault in the end of a process; empty without one."""
    lines = done.stderr.splitlines() or [""]
    if done.returncode != 2:
        return f"rc {done.returncode}: {lines[-1][:100]}"
    longest = max(map(len, lines))
    return f"a line of {longest} characters" if longest > LONGEST_LINE else ""


def _run(words: Sequence[str], domain: int) -> tuple[subprocess.CompletedProcess[str], float]:
    """Run an executable to its end; return its outcome and its CPU time in seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", "phd_jdtc_ros", *words],
        capture_output=True,
        text=True,
        timeout=PROCESS_S,
        check=False,
        env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return done, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def outcome() -> dict[str, Any]:
    """Return the outcome of all runs."""
    wrong, seconds, domain = {}, [], Domain()
    usual = {name: _run((name, "--help"), domain.number)[1] for name in WAYS}
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        places = {"BAG": str(scans.BAG), "OUT": str(directory / "out")}
        for run, words in _commands(directory):
            done, spent = _run([places.get(word, word) for word in words], domain.number)
            seconds.append(max(spent - usual[words[0]], 0.0))
            if fault := _fault(done):
                wrong[run] = fault
    peak_mb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0
    return {"runs": len(seconds), "wrong": wrong, "most_s": max(seconds), "peak_mb": peak_mb}
