"""More scans than can be processed: losses must be counted, and memory must stay bounded."""

from __future__ import annotations

import time
from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticStatus

from ..harness import scans
from ..harness.figures import Found, measures
from ..harness.radars import Radars
from ..harness.rig import Node, Rig

SCANS = 1624
WARM_UP = 40
FIRST_BURST = 1200
FACTOR = 10
MOST_KIB = 10_000_000 / 1024
SAID_SCANS = 10_000
ADVICE = "turn down"


# A parameter with which steps are slow enough.
SLOW = ("-p", "lag:=60")


@measures(
    "overload in diagnostics",
    "a level above OK that says what to turn down; no radar is called silent",
)
def measure_said(count: int = SAID_SCANS) -> Found:
    """Send scans at ten times the sustainable rate, and read the diagnostics."""
    usual = FACTOR * WARM_UP
    clouds = scans.often(usual + count, FACTOR)
    with Rig() as rig:
        _slow_tracker(rig)
        radars = rig.radars
        period = _keeping_up(radars, clouds[:usual:FACTOR]) / FACTOR
        begin = time.monotonic()
        for index, pair in enumerate(clouds[usual:], 1):
            _publish(radars, pair)
            radars.spin(max(0.0, begin + index * period - time.monotonic()))
        found = [line for at, lines in radars.health if at > begin for line in lines.values()]
    warnings = {line.message for line in found if line.level != DiagnosticStatus.OK}
    advice = sorted(text for text in warnings if ADVICE in text)
    silent = sorted(text for text in warnings if "silent" in text)
    text = f"{advice[0]!r}" if advice else "nothing above OK says what to turn down"
    text += f"; {'silent: ' + silent[0] if silent else 'no radar silent'}"
    return text, bool(advice) and not silent, {"said": sorted(warnings)}


def _slow_tracker(rig: Rig) -> Node:
    """Start a tracker with a user's QoS, best effort and ten deep, but with steps slow enough."""
    tracker = rig.start("tracker", "--ros-args", *SLOW)
    tracker.said("tracking")
    rig.radars.connected()
    return tracker


@measures("loss accounting", "10x overload: exact; memory at most +10 MB")
def measure(count: int = SCANS) -> Found:
    """Send scans at ten times the sustainable rate."""
    usual = FACTOR * WARM_UP
    clouds = scans.often(usual + FIRST_BURST + count, FACTOR)
    with Rig() as rig:
        tracker, radars = _slow_tracker(rig), rig.radars
        period = _keeping_up(radars, clouds[:usual:FACTOR]) / FACTOR
        # Scans with gaps need more memory; the first burst brings it to its usual level.
        _burst(radars, clouds[usual : usual + FIRST_BURST], period)
        first = _received_and_lost(radars)
        before = tracker.status("VmHWM")
        seconds = _burst(radars, clouds[usual + FIRST_BURST :], period)
        growth = tracker.status("VmHWM") - before
        last = _received_and_lost(radars)
    received, lost = (late - early for early, late in zip(first, last, strict=True))
    sent = 2 * count
    factor = count / seconds * period * FACTOR
    text = (
        f"{sent} clouds at {factor:.1f}x: {received} received + {lost} gaps = {received + lost}; "
        f"memory +{growth * 1024 / 1e6:.1f} MB"
    )
    details = {"sent": sent, "received": received, "gaps": lost, "factor": factor}
    details |= {"sustainable_hz": 1.0 / (period * FACTOR), "memory_kib": growth}
    return text, received + lost == sent and lost > 0 and growth <= MOST_KIB, details


def _keeping_up(radars: Radars, clouds: Sequence[tuple[bytes, bytes]]) -> float:
    """Send scans, each when the previous one is answered; return the seconds per scan."""
    half = len(clouds) // 2
    for index, pair in enumerate(clouds):
        if index == half:
            begin = time.monotonic()
        before = len(radars.filtered)
        _publish(radars, pair)
        radars.wait_for_more(before, 5.0)
    return (time.monotonic() - begin) / (len(clouds) - half)


def _burst(radars: Radars, clouds: Sequence[tuple[bytes, bytes]], period: float) -> float:
    """Send scans without waiting, and the last one after a pause; return the seconds taken."""
    begin = time.monotonic()
    for index, pair in enumerate(clouds[:-1], 1):
        _publish(radars, pair)
        # Nothing is received meanwhile, because that would slow the sender down.
        time.sleep(max(0.0, begin + index * period - time.monotonic()))
    seconds = time.monotonic() - begin
    # Losses at the end are detected when one more scan is received.
    radars.spin(2.0)
    _publish(radars, clouds[-1])
    radars.spin(1.0)
    return seconds


def _publish(radars: Radars, pair: tuple[bytes, bytes]) -> None:
    for output, cloud in zip(radars.outputs, pair, strict=True):
        output.publish(cloud)


def _received_and_lost(radars: Radars) -> tuple[int, int]:
    """Return the numbers of both radars' received and lost clouds, from diagnostics."""
    lines = [radars.values(radar) for radar in ("radar_1", "radar_2")]
    return sum(int(line["received"]) for line in lines), sum(int(line["gaps"]) for line in lines)
