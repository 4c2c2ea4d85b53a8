"""A rogue peer on the network, in two network namespaces joined by a virtual cable."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from ..harness import scans
from ..harness.figures import Found, NotMeasurableError, measures
from ..harness.isolation import ISOLATED, OPEN
from ..harness.rig import LIGHT, RELIABLE, Node, Rig

ADDRESSES = ("10.77.0.1", "10.77.0.2")
ROGUE_S = 8.0
# Number of clouds of both radars in the reference scenario's bag.
SENT = 160


# Environments of the tracker and the replay. The demo has both the profile and the limited
# discovery range.
TRIALS: Mapping[str, Mapping[str, str]] = {
    "the demo's": {**ISOLATED, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
    "profile alone": {**ISOLATED, "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"},
    "discovery range alone": {**OPEN, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
}
WITHOUT = "discovery range alone"


@measures("rogue on the LAN", "0 data, 0 parameter writes")
def measure(trials: Sequence[str] = tuple(TRIALS), seconds: float = ROGUE_S) -> Found:
    """Let a rogue peer try for `seconds`, with the shipped profile and without it."""
    # Each trial has its own domain, so they can run in parallel.
    with cable() as (ours, theirs), ThreadPoolExecutor() as pool:
        running = {
            name: pool.submit(attempt, ours, theirs, TRIALS[name], seconds) for name in trials
        }
        found = {name: trial.result() for name, trial in running.items()}
    text = "; ".join(
        f"{name}: {counts['data']} data, {counts['parameter_writes']} writes, "
        f"local scans {counts['good']} of {counts['sent']}"
        for name, counts in found.items()
    )
    kept_out = all(
        counts["data"] == counts["parameter_writes"] == 0 and counts["good"] == counts["sent"]
        for name, counts in found.items()
        if name != WITHOUT
    )
    # Without the profile the rogue must succeed, or the trial proves nothing.
    shown = found[WITHOUT]["data"] > 0 and found[WITHOUT]["parameter_writes"] > 0
    return text, kept_out and shown, found


@contextlib.contextmanager
def cable() -> Iterator[tuple[str, str]]:
    """Make two network namespaces joined by a virtual cable; yield their names."""
    if os.geteuid() != 0 or shutil.which("ip") is None:
        raise NotMeasurableError("network namespaces need root and iproute2")
    spaces = f"robust_{os.getpid()}_ours", f"robust_{os.getpid()}_theirs"
    try:
        for space in spaces:
            _ip("netns", "add", space)
            _ip("-n", space, "link", "set", "lo", "up")
        peer = ("peer", "name", "cable", "netns", spaces[1])
        _ip("-n", spaces[0], "link", "add", "cable", "type", "veth", *peer)
        for space, address in zip(spaces, ADDRESSES, strict=True):
            _ip("-n", space, "address", "add", f"{address}/24", "dev", "cable")
            _ip("-n", space, "link", "set", "cable", "up")
        yield spaces
    finally:
        for space in spaces:  # This also deletes the cable
            subprocess.run(["ip", "netns", "delete", space], capture_output=True, check=False)


def _ip(*arguments: str) -> None:
    done = subprocess.run(["ip", *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise NotMeasurableError(f"ip {' '.join(arguments)}: {done.stderr.strip()}")


def attempt(
    ours: str, theirs: str, environment: Mapping[str, str], seconds: float
) -> dict[str, int]:
    """Run a tracker and a replay in one namespace and a rogue in the other; return the counts."""
    inside = ("ip", "netns", "exec", ours)
    with Rig() as rig:
        tracker = rig.start(
            "tracker", "--ros-args", *RELIABLE, *LIGHT, prefix=inside, **environment
        )
        if not tracker.said("tracking"):
            raise RuntimeError(f"the tracker did not start:\n{tracker.text[-2000:]}")
        rogue = _rogue(theirs, rig.domain, seconds)
        replay = rig.start(
            "sensor_replay",
            *(scans.BAG, "--rate", "0", "--ros-args", "-p", "subscriber_timeout_s:=15.0"),
            prefix=inside,
            **environment,
        )
        outcome = json.loads(rogue.communicate(timeout=60.0)[0].splitlines()[-1])
        replay.process.wait(60.0)
        tracker.stop(signal.SIGINT)
        return {**outcome, **_counts(tracker)}


def _rogue(space: str, domain: int, seconds: float) -> subprocess.Popen[str]:
    # An outsider has no profile, and knows the address from observing the network.
    environment = {
        **{k: v for k, v in os.environ.items() if not k.startswith(("FASTDDS_", "FASTRTPS_"))},
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "ROS_STATIC_PEERS": ADDRESSES[0],
        "ROS_DOMAIN_ID": str(domain),
    }
    module = "robustness.operation.rogue"
    return subprocess.Popen(
        ["ip", "netns", "exec", space, sys.executable, "-m", module, str(seconds)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=environment,
        text=True,
        cwd=Path(__file__).parents[2],
    )


def _counts(tracker: Node) -> dict[str, int]:
    """Return the clouds that the tracker took from the replay and from the rogue."""
    received = re.search(r"stopped; (\d+) clouds received", tracker.text)
    rejected = re.search(r"radar_1 frame (\d+)", tracker.text)
    data = int(rejected[1]) if rejected else 0
    total = int(received[1]) if received else 0
    return {"data": data, "good": total - data, "sent": SENT}
