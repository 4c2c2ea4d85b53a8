"""The health of the bridge: of its input, of each radar and of its output."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters import diagnostics, names
from phd_jdtc_ros.asterix.plot_stream import PlotStream, RadarState

from ..common.health import Rises, first

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
# A radar without messages for this time is silent, seconds.
SILENT_S = 15.0
# Other categories, and radars without settings, are no faults.
EXPECTED = frozenset({"other_category", "unknown_radar", "no_detection"})


def of_input(
    node: str,
    stream: PlotStream,
    lost: int,
    inputs: Sequence[str],
    active_s: float,
    rises: Rises,
    now_s: float,
) -> DiagnosticStatus:
    """Return the status of all received datagrams.

    Parameters
    ----------
    lost : int
        Datagrams for which there was no room.
    active_s : float
        Time for which the bridge has been active, seconds; NaN while it is not.
    """
    counts = +stream.counts
    faults = {reason: count for reason, count in counts.items() if reason not in EXPECTED}
    quiet_s = min(rises.unchanged_s("datagrams", stream.datagrams, now_s), active_s)
    quiet = (
        f"no datagram for {quiet_s:.0f} s on {', '.join(inputs)}; check the address and port that "
        "the sender uses, and interface for a group"
    )
    losing = rises.recent("lost", lost, now_s)
    malformed = rises.recent("faults", sum(faults.values()), now_s)
    condition = first(
        _inactive(active_s),
        (WARN, inputs and quiet_s > SILENT_S, quiet),
        (WARN, losing, f"{lost} datagrams lost: they come too fast"),
        (WARN, malformed, f"malformed: {_enumerate(faults)}"),
        (OK, True, f"{stream.datagrams} datagrams"),
    )
    trailers = sum(stream.blocks.known_trailers().values())
    values = {"datagrams": stream.datagrams, "lost": lost, "trailers": trailers, **counts}
    return diagnostics.status(names.health("input", node), values, *condition, node)


def of_radar(
    name: str,
    number: int,
    state: RadarState,
    active_s: float,
    rises: Rises,
    now_s: float,
) -> DiagnosticStatus:
    """Return the status of a radar; `active_s` is as in `of_input`."""
    offset_s, shift_s = state.clock.offset_s, state.clock.shift_ns * 1e-9
    values = {
        "plots": state.plots,
        "service_messages": state.services,
        "clouds": state.reports,
        "turn_s": state.assembler.turn_s,
        "clock_offset_s": offset_s,
        "clock_shift_s": shift_s,
        **+state.counts,
    }
    messages, late = state.plots + state.services, state.counts["late_plots"]
    quiet_s = min(rises.unchanged_s(f"{name} messages", messages, now_s), active_s)
    quiet = f"silent for {quiet_s:.0f} s" if messages else "no messages yet"
    sources = " and ".join(dict.fromkeys(state.sources.values()))
    second = rises.recent(f"{name} second", state.counts["second_source"], now_s)
    arriving_late = rises.recent(f"{name} late", late, now_s)
    condition = first(
        _inactive(active_s),
        (WARN, quiet_s > SILENT_S, quiet),
        (WARN, second, f"two sources: {sources} is used, {state.other_source} is not"),
        (WARN, shift_s, f"its clock is {-offset_s:+.1f} s off; its times are shifted"),
        (WARN, arriving_late, f"{late} plots came after their cloud was sent"),
        (OK, True, f"{state.plots} plots in {state.reports} clouds"),
    )
    return diagnostics.status(name, values, *condition, f"{number >> 8}/{number & 255}")


def of_output(
    node: str,
    output: str,
    sent: Counter[str],
    dropped: Mapping[str, int],
    clouds: int,
    hint: str,
    active_s: float,
    rises: Rises,
    now_s: float,
) -> DiagnosticStatus:
    """Return the status of the output.

    Parameters
    ----------
    output : str
        Address that the bridge sends to; empty for none.
    dropped : mapping
        Numbers of clouds that are not sent, by reason.
    clouds : int
        Received clouds of estimates.
    hint : str
        Fault of a topic without estimates; empty if they are published.
    """
    counts = {reason: count for reason, count in dropped.items() if reason != "lost"}
    dropping = rises.recent("dropped", sum(counts.values()), now_s)
    quiet_s = min(rises.unchanged_s("estimates", clouds, now_s), active_s)
    quiet = "; ".join(filter(None, (f"no estimates for {quiet_s:.0f} s", hint)))
    condition = first(
        (OK, not output, "nowhere to send tracks"),
        _inactive(active_s),
        (WARN, dropping, _enumerate(counts)),
        (WARN, quiet_s > SILENT_S, quiet),
        (OK, True, f"{sent['tracks']} tracks sent to {output}"),
    )
    values = {**sent, **counts}
    return diagnostics.status(names.health("output", node), values, *condition, node)


def _inactive(active_s: float) -> tuple[bytes, bool, str]:
    return DiagnosticStatus.STALE, math.isnan(active_s), "not active"


def _enumerate(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{reason} {count}" for reason, count in sorted(counts.items()))
