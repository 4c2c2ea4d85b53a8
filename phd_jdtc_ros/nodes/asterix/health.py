"""The health of the bridge: of its input, of each radar and of its output."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters import diagnostics, names
from phd_jdtc_ros.asterix.clocks import StreamClock
from phd_jdtc_ros.asterix.plot_stream import PlotStream, RadarState

from ..common.health import Seen

# A radar that has sent nothing for so long is silent.
SILENT_S = 15.0
NOT_ACTIVE = "not active"


def of_input(
    node: str, stream: PlotStream, lost: int, inputs: Sequence[str], active_s: float, seen: Seen
) -> DiagnosticStatus:
    """Return the status of everything that is received.

    Parameters
    ----------
    node : str
        Full name of the bridge.
    lost : int
        Datagrams that there was no room for.
    inputs : sequence of str
        Addresses that are listened to.
    active_s : float
        For how long the bridge has been active, seconds; NaN while it is not.
    """
    counts = +stream.counts
    # Other categories, and radars that nobody asked for, are no faults.
    faults = {
        reason: count
        for reason, count in counts.items()
        if reason not in ("other_category", "unknown_radar", "no_detection")
    }
    level, text = DiagnosticStatus.OK, f"{stream.datagrams} datagrams"
    quiet_s = min(seen.since_s("datagrams", stream.datagrams), active_s)
    if math.isnan(active_s):
        level, text = DiagnosticStatus.STALE, NOT_ACTIVE
    elif inputs and quiet_s > SILENT_S:
        level = DiagnosticStatus.WARN
        text = (
            f"no datagram for {quiet_s:.0f} s on {', '.join(inputs)}; are these the address and "
            "port that is sent to, and interface that of a group's?"
        )
    elif seen.rose("lost", lost):
        level, text = DiagnosticStatus.WARN, f"{lost} datagrams lost: they come too fast"
    elif seen.rose("faults", sum(faults.values())):
        listed = ", ".join(f"{reason} {count}" for reason, count in sorted(faults.items()))
        level, text = DiagnosticStatus.WARN, f"malformed: {listed}"
    trailers = sum(stream.blocks.known_trailers().values())
    values = {"datagrams": stream.datagrams, "lost": lost, "trailers": trailers, **counts}
    return diagnostics.status(names.health("input", node), values, level, text, node)


def of_radar(
    name: str, number: int, state: RadarState, clock: StreamClock, active_s: float, seen: Seen
) -> DiagnosticStatus:
    """Return the status of a radar; `active_s` is that of `of_input`."""
    offset_s = clock.offset_s.get(number, 0.0)
    shift_s = clock.shift_ns.get(number, 0) * 1e-9
    values = {
        "plots": state.plots,
        "service_messages": state.services,
        "clouds": state.reports,
        "turn_s": state.assembler.turn_s,
        "clock_offset_s": offset_s,
        "clock_shift_s": shift_s,
        **+state.counts,
    }
    messages = state.plots + state.services
    quiet_s = min(seen.since_s(f"{name} messages", messages), active_s)
    level, text = DiagnosticStatus.WARN, ""
    if math.isnan(active_s):
        level, text = DiagnosticStatus.STALE, NOT_ACTIVE
    elif quiet_s > SILENT_S:
        text = f"silent for {quiet_s:.0f} s" if messages else "never heard"
    elif seen.rose(f"{name} second", state.counts["second_source"]):
        own = " and ".join(dict.fromkeys(state.sources.values()))
        text = f"two sources: {own} is used, {state.other_source} is not"
    elif shift_s:
        text = f"its clock is {-offset_s:+.1f} s off; its times are shifted"
    elif seen.rose(f"{name} late", state.counts["late_plots"]):
        text = f"{state.counts['late_plots']} plots came after their cloud was sent"
    else:
        level, text = DiagnosticStatus.OK, f"{state.plots} plots in {state.reports} clouds"
    sac_sic = f"{number >> 8}/{number & 255}"
    return diagnostics.status(name, values, level, text, sac_sic)


def of_output(
    node: str,
    output: str,
    sent: Counter[str],
    dropped: Mapping[str, int],
    clouds: int,
    hint: str,
    active_s: float,
    seen: Seen,
) -> DiagnosticStatus:
    """Return the status of what is sent.

    Parameters
    ----------
    node, output : str
        Full name of the bridge, and the address that it sends to; empty for none.
    sent, dropped : Counter, mapping
        By what was sent, and why clouds were left out.
    clouds : int
        Received clouds of estimates.
    hint : str
        What there is instead of estimates, in words; empty if they are published.
    active_s, seen
        Those of `of_input`.
    """
    counts = {reason: count for reason, count in dropped.items() if reason != "lost"}
    level, text = DiagnosticStatus.OK, f"{sent['tracks']} tracks sent to {output}"
    if not output:
        text = "nowhere to send tracks"
    elif math.isnan(active_s):
        level, text = DiagnosticStatus.STALE, NOT_ACTIVE
    elif seen.rose("dropped", sum(counts.values())):
        listed = ", ".join(f"{reason} {count}" for reason, count in sorted(counts.items()))
        level, text = DiagnosticStatus.WARN, listed
    else:
        quiet_s = min(seen.since_s("estimates", clouds), active_s)
        if quiet_s > SILENT_S:
            silence = f"no estimates for {quiet_s:.0f} s"
            level, text = DiagnosticStatus.WARN, "; ".join(filter(None, (silence, hint)))
    return diagnostics.status(names.health("output", node), {**sent, **counts}, level, text, node)
