"""kill -9 and restart, stops by signals, and a second tracker of the same name."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping
from statistics import median

from phd_jdtc_ros.nodes.tracker.peers import NEWCOMER_S

from ..harness import scans
from ..harness.figures import Found, measures
from ..harness.radars import Radars
from ..harness.rig import LIGHT, RELIABLE, Node, Rig

KILLS = 20
MEDIAN_S, MOST_S = 1.5, 4.0
SCAN_PERIOD_S = 0.05

SIGNALS = {"INT": signal.SIGINT, "TERM": signal.SIGTERM}
# Delays of the signal after the first line of the log, seconds.
PHASES = (0.0, 0.01, 0.03, 0.06, 0.1, 0.2, 0.3, 0.5, 0.8, 1.2)
STOP_S = 1.0
NODES: Mapping[str, tuple[object, ...]] = {
    "tracker": (),
    "evaluator": (),
    "sensor_replay": (scans.BAG, "--rate", "1", "--ros-args", "-p", "subscriber_timeout_s:=0.0"),
}


@measures("kill -9 to first estimate", "median 1.5 s, max 4 s")
def measure_kills(kills: int = KILLS) -> Found:
    """Kill and restart a tracker repeatedly, while radars go on sending."""
    took: list[float] = []
    with Rig() as rig:
        node, radars = _start(rig), rig.radars
        radars.connected()
        index = _send_until_answered(radars, 0)
        for _ in range(kills):
            # Answers from before the kill do not count.
            radars.spin(0.1)
            radars.answered.clear()
            killed = time.monotonic()
            node.kill()
            node = _start(rig)
            index = _send_until_answered(radars, index + 1)
            if not radars.answered:
                raise RuntimeError(f"no estimate after a restart:\n{node.text[-2000:]}")
            took.append(radars.filtered[-1][1] - killed)
    text = f"median {median(took):.2f} s, max {max(took):.2f} s of {kills} kills"
    details = {"seconds": took, "load_average": os.getloadavg()[0]}
    return text, median(took) <= MEDIAN_S and max(took) <= MOST_S, details


def _start(rig: Rig) -> Node:
    return rig.start("tracker", "--ros-args", *RELIABLE, *LIGHT)


def _send_until_answered(radars: Radars, index: int) -> int:
    """Send scan after scan at a steady rate until one is answered; return its index."""
    deadline = time.monotonic() + 20.0
    while time.monotonic() < deadline:
        stamp = radars.send(index)
        if radars.wait_for({stamp}, SCAN_PERIOD_S):
            return index
        index += 1
    return index


def stop_goal(phases: tuple[float, ...] = PHASES) -> str:
    """Return the goal in words."""
    whole = len(NODES) * len(SIGNALS) * len(phases)
    return f"{whole} of {whole}: rc 0 within {STOP_S:g} s, no traceback"


@measures("clean stop", stop_goal)
def measure_stops(phases: tuple[float, ...] = PHASES) -> Found:
    """Stop every node by either signal, at several times after its first output."""
    failures, took = [], []
    for name, arguments in NODES.items():
        for word, number in SIGNALS.items():
            for phase in phases:
                with Rig() as rig:
                    node = rig.start(name, *arguments)
                    seconds, fault = _stop(node, number, phase)
                took.append(seconds)
                if fault:
                    failures.append(f"{name} {word} at {phase:g} s: {fault}")
    whole = len(took)
    text = (
        f"{whole - len(failures)} of {whole}; median {median(took):.2f} s, most {max(took):.2f} s"
    )
    return text, not failures, {"failures": failures, "seconds": took}


def _stop(node: Node, number: int, phase: float) -> tuple[float, str]:
    """Stop a node; return the seconds taken and the fault, if any."""
    deadline = time.monotonic() + 30.0
    while not node.text and node.alive and time.monotonic() < deadline:
        time.sleep(0.002)
    time.sleep(phase)
    begin = time.monotonic()
    if node.alive:
        node.process.send_signal(number)
    status = _exit_status(node)
    seconds = time.monotonic() - begin
    if status != 0:
        return seconds, f"rc {status}"
    if "Traceback" in node.text:
        return seconds, "traceback"
    return seconds, "" if seconds <= STOP_S else f"took {seconds:.2f} s"


def _exit_status(node: Node) -> int | None:
    deadline = time.monotonic() + 10.0
    while node.alive and time.monotonic() < deadline:
        time.sleep(0.002)
    return node.process.poll()


@measures(
    "second tracker of the same name", "says so, rc 2; a restart after kill -9 is not held up"
)
def measure_second() -> Found:
    """Start a second tracker beside a running one, and a third after that one has been killed."""
    with Rig() as rig:
        first = rig.tracker(*LIGHT)
        second = _start(rig)
        begin = time.monotonic()
        status = _exit_status(second)
        seconds = time.monotonic() - begin
        message = second.text.strip().splitlines()[-1:] or [""]
        alive = first.alive
        first.kill()
        third, radars = rig.tracking(*LIGHT)
        _send_until_answered(radars, 0)
        # A newcomer gives way for this time, while the graph still lists the killed tracker.
        radars.spin(NEWCOMER_S)
        restarted = third.alive and bool(radars.answered)
    outcome = "goes on beside the first" if status is None else f"rc {status}: {message[0]}"
    text = f"{outcome}; restarted after kill -9: {'tracks' if restarted else 'held up'}"
    reached = status == 2 and alive and restarted
    details = {"status": status, "first_goes_on": alive, "restarted": restarted}
    return text, reached, {**details, "seconds": seconds}
