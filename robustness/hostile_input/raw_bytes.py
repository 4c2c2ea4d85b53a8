"""Mutated bytes on a radar's topic, beside a correct publisher."""

from __future__ import annotations

import random
import time
from collections.abc import Callable

from ..harness import scans
from ..harness.figures import Found, measures
from ..harness.radars import REPLY_S
from ..harness.rig import LIGHT, Rig

SECONDS = 30.0
# Mutated messages between two good scans.
BURST = 100
STAMP = slice(4, 12)
ENCAPSULATION = 4


@measures(
    "raw CDR fuzz beside a good publisher",
    lambda seconds=SECONDS, seed=5: f"{seconds:g} s: 0 exits, 0 good scans lost",
)
def measure(seconds: float = SECONDS, seed: int = 5) -> Found:
    """Publish mutated copies of answered scans between the good scans."""
    rng = random.Random(seed)
    exits, lost, good, bad = 0, [], 0, 0
    with Rig() as rig:
        tracker, radars = rig.tracking(*LIGHT)
        output = radars.outputs[0]
        fuzzer = radars.node.create_publisher(output.msg_type, output.topic_name, 50)
        radars.spin(1.0)
        index = 0
        radars.track(index)
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            for _ in range(BURST):
                # A mutation that is still a valid scan is then a duplicate.
                fuzzer.publish(mutate(scans.cloud(index, 0), rng))
                bad += 1
            index += 1
            good += 1
            answered = radars.track(index, timeout_s=REPLY_S)
            if not tracker.alive:
                exits += 1
                tracker, _ = rig.tracking(*LIGHT)
            elif not answered:
                lost.append(index)
        not_finite = radars.not_finite
        tracebacks = tracker.text.count("Traceback")
    text = f"{exits} exits, {len(lost)} of {good} good scans lost, {bad} mutated messages"
    reached = not exits and not lost and not not_finite and not tracebacks and good > 0
    return text, reached, {"good": good, "bad": bad, "exits": exits, "lost": lost}


def mutate(data: bytes, rng: random.Random) -> bytes:
    """Return a message with some bytes changed, cut off, added or moved, but with its stamp kept.

    A changed stamp could make it a valid scan of another time.
    """
    change: Callable[[bytes, random.Random], bytes] = rng.choice((_flip, _cut, _splice, _resize))
    found = change(data, rng)
    return found[: STAMP.start] + data[STAMP] + found[STAMP.stop :]


def _flip(data: bytes, rng: random.Random) -> bytes:
    found = bytearray(data)
    # The header determines how the rest is read, so it is changed more often.
    reach = 300 if rng.random() < 0.7 else len(found)
    for _ in range(rng.randrange(1, 9)):
        found[rng.randrange(reach)] = rng.randrange(256)
    return bytes(found)


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(STAMP.stop, len(data))]


def _splice(data: bytes, rng: random.Random) -> bytes:
    at, size = rng.randrange(STAMP.stop, len(data)), rng.randrange(1, 200)
    return data[:at] + rng.randbytes(size) + data[at + rng.choice((0, size)) :]


def _resize(data: bytes, rng: random.Random) -> bytes:
    """Put an extreme number where a length or a step may be."""
    at = ENCAPSULATION + 4 * rng.randrange(2, 75)
    number = rng.choice((0, 1, 2**16, 2**24, 2**31 - 1, 2**31, 2**32 - 1))
    return data[:at] + number.to_bytes(4, "little") + data[at + 4 :]
