"""Faults in time: a looped bag, shuffled scans, a radar that becomes silent."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from functools import partial
from itertools import combinations, pairwise, product, takewhile
from operator import eq

from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters.encoding import names
from msg_adapters.outgoing import diagnostics

from ..harness import scans
from ..harness.figures import Found, measures
from ..harness.radars import Radars
from ..harness.rig import LIGHT, Rig, options

GAP_SCANS, SHORT_GAP_SCANS = 600, 10
LOOPS = 3
# Multiple of the bag's rate: about 17 scans per second.
RATE = 100
SHUFFLED = 40
PERIOD_S = 0.25
ALLOWED_S = 2.0 * PERIOD_S + 0.5
# Wrong clocks: GPS time and TAI for UTC, and time zones, seconds; and the number of scans of each.
OFFSETS_S = (18.0, 37.0, 3600.0, -3600.0)
CLOCK_SCANS = 4
NUMBERED = 8  # Scans of a run whose numbers are compared
DAY_NS = 86400 * 1_000_000_000
# More than half of the intervals whose median the tracker uses.
REGULAR = 12


@measures(
    "time faults: bag looped 3 times; +-1 scan shuffled",
    "1 reset per loop, 0 on the shuffle; with late_reports rework no report late",
)
def measure_time_faults(loops: int = LOOPS, duration_s: float = 0.0) -> Found:
    """Loop a bag or its first `duration_s`, then shuffle scans; count the resets."""
    back_jumps, looped = _loop_bag(loops, duration_s)
    shuffled, dropped, _ = _shuffle()
    ordered, late, answered = _shuffle("-p", "late_reports:=rework")
    text = (
        f"{looped} resets at {back_jumps} returns to the bag's start; "
        f"{shuffled} resets in {SHUFFLED} shuffled scans ({dropped} dropped as late), with "
        f"late_reports rework {ordered} ({late} dropped, {answered} answered in order)"
    )
    reached = looped == back_jumps == loops and shuffled == ordered == late == 0
    details = {"jumps_back": back_jumps, "resets": looped, "resets_of_shuffled": shuffled}
    of_ordered = {"resets": ordered, "late": late, "answered": answered}
    return text, reached, {**details, **{f"{k}_of_ordered": n for k, n in of_ordered.items()}}


def _loop_bag(loops: int, duration_s: float) -> tuple[int, int]:
    """Play a bag `loops` times; return the jumps back in the estimates' stamps and the resets."""
    with Rig() as rig:
        _, radars = rig.tracking(*LIGHT)
        played = scans.BAG, "--rate", RATE, "--loop", "--duration", duration_s
        replay = rig.start("sensor_replay", *played)
        # Until the first estimates of one more pass, so that `loops` passes are complete.
        radars.spin_until(lambda: _jumps_back(radars) >= loops, 90.0)
        replay.kill()  # A stop takes a while, in which the next pass may begin.
        radars.spin(0.5)
        return _jumps_back(radars), int(radars.values("step time")["run"])


def _jumps_back(radars: Radars) -> int:
    stamps = [stamp for stamp, _ in radars.filtered]
    return sum(later < earlier for earlier, later in pairwise(stamps))


def _shuffle(*options: str) -> tuple[int, int, int]:
    """Swap scans with their neighbours.

    Return the number of resets, of dropped reports, and of estimates in order before the first that
    is not.
    """
    with Rig() as rig:
        _, radars = rig.tracking(*LIGHT, *options)
        radars.send(0)
        for first in range(1, SHUFFLED, 2):
            pair = {radars.send(first + 1), radars.send(first)}
            # Wait for either of them, so that a busy tracker keeps up.
            radars.wait_for(pair)
        dropped = int(radars.values("radar_1").get("dropped_late", 0))
        run = int(radars.values("step time")["run"])
    received = [stamp for stamp, _ in radars.filtered]
    expected = [scans.stamp_of_scan(index) for index in range(len(received))]
    return run, dropped, sum(takewhile(bool, map(eq, received, expected)))


@measures("numbers in one output", "no number in two runs: loops, a stamp of 0, kill -9 between")
def measure_numbers(loops: int = LOOPS, length: int = NUMBERED) -> Found:
    """Send the same scans again and again, and count the numbers that come back."""
    runs: list[set[int]] = []
    with Rig() as rig:
        path = rig.directory / "tracker.checkpoint"
        given = *LIGHT, *options({"checkpoint.path": path})
        tracker, radars = rig.tracking(*given)
        for _ in range(loops):
            runs.append(_numbers(radars, length))
            radars.send(0, 0)
        for _ in range(loops):
            tracker.kill()
            tracker = rig.tracker(*given)
            radars.connected()
            runs.append(_numbers(radars, length))
    again = [sorted(one & other) for one, other in combinations(runs, 2) if one & other]
    least, used = min(map(len, runs)), len(set().union(*runs))
    text = f"{used} numbers in {len(runs)} runs, at least {least} in each; {len(again)} pairs share"
    return text, not again and least > 0, {"runs": [sorted(run) for run in runs]}


def _numbers(radars: Radars, length: int) -> set[int]:
    """Track the first scans; return the numbers of their estimates."""
    found: set[int] = set()
    for index in range(length):
        radars.answered.clear()
        if radars.track(index) and (own := radars.found[scans.stamp_of_scan(index)]) is not None:
            found |= {*own.track_id.tolist()} - {0}
    return found


@measures(
    "one clock wrong",
    "every scan of the other radar answered, 0 resets; ERROR with the offset in 2 scans + 0.5 s",
)
def measure_clocks(offsets_s: Sequence[float] = OFFSETS_S) -> Found:
    """Let either radar's stamps be wrong for a while, or one of them; count what is lost."""
    with Rig() as rig:
        _, radars = rig.tracking(*LIGHT)
        sent: set[int] = set()
        delays = []
        for wrong, offset_s in product((0, 1), offsets_s):
            sent |= _send(radars, len(sent), wrong, 0.0)
            begin = time.monotonic()
            sent |= _send(radars, len(sent), wrong, offset_s)
            delays.append(_clock_delay(radars, begin, wrong, offset_s))
            sent |= _send(radars, len(sent), wrong, 0.0)
        for wrong, stamp_ns in product((0, 1), (0, scans.START_NS + DAY_NS)):
            radars.outputs[wrong].publish(scans.cloud(0, wrong, stamp_ns))
            sent |= _send(radars, len(sent), wrong, 0.0)
        values = [radars.values(f"radar_{k}") for k in (1, 2)]
        run = int(radars.values("step time")["run"])
        lost = len(sent - radars.answered)
    zeros = sum(int(each.get("dropped_stamp_zero", 0)) for each in values)
    known = [delay for delay in delays if delay is not None]
    text = (
        f"{lost} of {len(sent)} scans not answered, {run} resets; offset named in {len(known)} "
        f"of {len(delays)} cases, after at most {max(known, default=math.nan):.2f} s; {zeros} of 2 "
        "stamps of 0 counted"
    )
    in_time = len(known) == len(delays) and max(known) <= ALLOWED_S
    reached = lost == run == 0 and in_time and zeros == 2
    return text, reached, {"lost": lost, "resets": run, "named_after_s": delays, "zeros": zeros}


def _send(radars: Radars, index: int, wrong: int, offset_s: float) -> set[int]:
    """Publish scans at their rate, with an offset of one radar's stamps; return the right ones.

    The first scan of the right radar alone waits for two more, because both count as live.
    """
    stamps_ns = [scans.stamp_of_scan(each) for each in range(index, index + CLOCK_SCANS)]
    for number, stamp_ns in enumerate(stamps_ns, index):
        for radar, output in enumerate(radars.outputs):
            off_ns = round(offset_s * 1e9) if radar == wrong else 0
            output.publish(scans.cloud(number, radar, stamp_ns + off_ns))
        radars.spin(PERIOD_S)
    radars.wait_for({stamps_ns[-1]})
    return set(stamps_ns)


def _clock_delay(radars: Radars, begin: float, wrong: int, offset_s: float) -> float | None:
    """Return the time until a radar's status was ERROR with its offset; None if it never was."""
    for arrived, lines in radars.health:
        line = lines[names.health(f"radar_{wrong + 1}")]
        if arrived > begin and line.level == DiagnosticStatus.ERROR:
            found_s = float(diagnostics.values_of(line).get("clock_offset_s", math.nan))
            # The stamps go on faster than the time of receipt, so that the offset may be off by an
            # interval.
            exact = abs(found_s - offset_s) <= 1e-9 * scans.interval_ns()
            return arrived - begin if exact else None
    return None


@measures("forward gap", "1 reset above the limit, none below; memory at most +10 MB")
def measure_gap() -> Found:
    """Insert short and long gaps into both radars' stamps; count the resets."""
    with Rig() as rig:
        tracker, radars = rig.tracking()
        whole = all(radars.track(index) for index in range(SHUFFLED))
        index = SHUFFLED + SHORT_GAP_SCANS
        whole &= radars.track(index)
        short = int(radars.values("step time")["run"])
        before = tracker.status("VmHWM")
        begin = time.monotonic()
        for _ in range(5):
            index += GAP_SCANS
            whole &= radars.track(index, timeout_s=30.0)
        seconds = (time.monotonic() - begin) / 5
        growth = tracker.status("VmHWM") - before
        run = int(radars.values("step time")["run"])
    text = (
        f"{short} resets at a gap of {SHORT_GAP_SCANS} scans, {run - short} at 5 of "
        f"{GAP_SCANS}, {seconds:.2f} s for the scan after, "
        f"memory +{growth / 1024:.0f} MiB{'' if whole else ', scans lost'}"
    )
    reached = whole and short == 0 and run == 5 and growth <= 10_000_000 / 1024
    details = {"resets": run - short, "resets_of_short": short, "memory_kib": growth}
    return text, reached, {**details, "seconds": seconds}


@measures("silent radar alarm", "2 scans + 0.5 s")
def measure_silence(repeats: int = 3) -> Found:
    """Stop one radar of two; measure the time until diagnostics report it."""
    with Rig() as rig:
        _, radars = rig.tracking(*LIGHT)
        found, index, going_on = [], 0, True
        for _ in range(repeats):
            _at_rate(radars, index, REGULAR, (0, 1))
            index += REGULAR
            stopped = time.monotonic() - PERIOD_S
            before = len(radars.filtered)
            _at_rate(radars, index, REGULAR, (0,))
            index += REGULAR
            # On a busy machine the status is here later than it was sent.
            radars.spin_until(partial(_is_noticed, radars, stopped), 5.0)
            found.append(_silence_delay(radars, stopped))
            # Two scans wait for the silent radar; all others are answered.
            going_on &= len(radars.filtered) - before >= REGULAR - 3
    delays = [delay for delay in found if delay is not None]
    if len(delays) < len(found):
        return "not noticed", False, {"noticed_after_s": found}
    worst = max(delays)
    text = (
        f"at most {worst:.2f} s in {repeats}, {ALLOWED_S:g} s allowed (scans every {PERIOD_S:g} s);"
        f" tracking {'goes on' if going_on else 'stops'}"
    )
    return text, worst <= ALLOWED_S and going_on, {"noticed_after_s": found}


def _at_rate(radars: Radars, index: int, count: int, sending: tuple[int, ...]) -> None:
    begin = time.monotonic()
    for step in range(count):
        for radar in sending:
            radars.outputs[radar].publish(scans.cloud(index + step, radar))
        # This process receives even if it is late itself.
        radars.spin(max(begin + (step + 1) * PERIOD_S - time.monotonic(), 0.01))


def _is_noticed(radars: Radars, stopped: float) -> bool:
    return _silence_delay(radars, stopped) is not None


def _silence_delay(radars: Radars, stopped: float) -> float | None:
    """Return the time from the second radar's last scan to its first status of silence."""
    for arrived, lines in radars.health:
        line = lines[names.health("radar_2")]
        # Other warnings, of late and dropped scans, do not count.
        if arrived > stopped and line.level != DiagnosticStatus.OK and "silent" in line.message:
            return arrived - stopped
    return None
