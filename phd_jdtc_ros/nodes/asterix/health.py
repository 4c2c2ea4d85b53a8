# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The health of the bridge: of its input, of each radar and of its output."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters import diagnostics, names
from phd_jdtc_ros.asterix.clocks import StreamClock
from phd_jdtc_ros.asterix.plot_stream import PlotStream, RadarState

from ..common.seen import Seen

# A radar that has sent nothing for so long is silent.
SILENT_S = 15.0


def of_input(
    node: str, stream: PlotStream, lost: int, active: bool, seen: Seen
) -> DiagnosticStatus:
    """Return the status of everything that is received."""
    counts = +stream.counts
    # Other categories, and radars that nobody asked for, are no faults.
    faults = {
        reason: count
        for reason, count in counts.items()
        if reason not in ("other_category", "unknown_radar", "no_detection")
    }
    level, text = DiagnosticStatus.OK, f"{stream.datagrams} datagrams"
    if not active:
        level, text = DiagnosticStatus.STALE, "not active"
    elif seen.rose("lost", lost):
        level, text = DiagnosticStatus.WARN, f"{lost} datagrams lost: they come too fast"
    elif seen.rose("faults", sum(faults.values())):
        listed = ", ".join(f"{reason} {count}" for reason, count in sorted(faults.items()))
        level, text = DiagnosticStatus.WARN, f"malformed: {listed}"
    trailers = sum(stream.blocks.known_trailers().values())
    values = {"datagrams": stream.datagrams, "lost": lost, "trailers": trailers, **counts}
    return diagnostics.status(names.health("input", node), values, level, text, node)


def of_radar(
    name: str, number: int, state: RadarState, clock: StreamClock, seen: Seen
) -> DiagnosticStatus:
    """Return the status of a radar."""
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
    quiet_s = seen.since_s(f"{name} messages", messages)
    level, text = DiagnosticStatus.WARN, ""
    if quiet_s > SILENT_S:
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
    node: str, output: str, sent: Counter[str], dropped: Mapping[str, int], seen: Seen
) -> DiagnosticStatus:
    """Return the status of what is sent."""
    counts = {reason: count for reason, count in dropped.items() if reason != "lost"}
    level, text = DiagnosticStatus.OK, f"{sent['tracks']} tracks sent to {output}"
    if not output:
        text = "nowhere to send tracks"
    elif seen.rose("dropped", sum(counts.values())):
        listed = ", ".join(f"{reason} {count}" for reason, count in sorted(counts.items()))
        level, text = DiagnosticStatus.WARN, listed
    return diagnostics.status(names.health("output", node), {**sent, **counts}, level, text, node)
