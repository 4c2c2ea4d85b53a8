"""The health of the bridge: of its input, of each radar and of its output."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus

from phd_jdtc_ros.asterix.plot_stream import PlotStream, RadarState
from phd_jdtc_ros.quoting import counts_text

from ..common.health import Rises, first, status_of

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
# A radar without messages for this time is silent, seconds.
SILENT_S = 15.0
# Other categories, and radars without settings, are no faults.
EXPECTED = frozenset({"other_category", "unknown_radar", "no_detection"})


class Moment(NamedTuple):
    """Values that the statuses of one report share."""

    node: str  # Full name of the bridge
    rises: Rises  # Increases of all counts since the bridge was made
    active_s: float  # Time for which the bridge has been active; NaN while it is not
    now_s: float

    def recent(self, name: str, count: int) -> int:
        """Return by how much a count has risen recently."""
        return self.rises.recent(name, count, self.now_s)

    def quiet_s(self, name: str, count: int) -> float:
        """Return the time since a count last rose while the bridge was active, seconds."""
        return min(self.rises.unchanged_s(name, count, self.now_s), self.active_s)

    @property
    def inactive(self) -> tuple[bytes, bool, str]:
        """The condition that the bridge is not active."""
        return DiagnosticStatus.STALE, math.isnan(self.active_s), "not active"


def no_datagram(quiet_s: float, inputs: Sequence[str]) -> str:
    """Return the warning about inputs on which nothing has arrived for some time."""
    return (
        f"no datagram for {quiet_s:.0f} s on {', '.join(inputs)}; check the address and port that "
        "the sender uses, and interface for a group"
    )


def of_input(at: Moment, stream: PlotStream, lost: int, inputs: Sequence[str]) -> DiagnosticStatus:
    """Return the status of all received datagrams; for `lost` ones there was no room."""
    counts = +stream.counts
    faults = {reason: count for reason, count in counts.items() if reason not in EXPECTED}
    quiet_s = at.quiet_s("datagrams", stream.datagrams)
    quiet = no_datagram(quiet_s, inputs)
    losing = at.recent("lost", lost)
    malformed = at.recent("faults", sum(faults.values()))
    condition = first(
        at.inactive,
        (WARN, inputs and quiet_s > SILENT_S, quiet),
        (WARN, losing, f"{lost} datagrams lost: they come too fast"),
        (WARN, malformed, f"malformed: {counts_text(faults)}"),
        (OK, True, f"{stream.datagrams} datagrams"),
    )
    trailers = sum(stream.blocks.known_trailers().values())
    values = {"datagrams": stream.datagrams, "lost": lost, "trailers": trailers, **counts}
    return status_of(at.node, "input", condition, values)


def of_radar(at: Moment, number: int, state: RadarState) -> DiagnosticStatus:
    """Return the status of a radar."""
    offset_s, shift_s = state.clock.offset_s, state.clock.shift_ns * 1e-9
    values = {
        "plots": state.plots,
        "service_messages": state.services,
        "clouds": state.reports,
        "revolution_s": state.assembler.revolution_s,
        "clock_offset_s": offset_s,
        "clock_shift_s": shift_s,
        **+state.counts,
    }
    name = state.settings.name
    messages, late = state.plots + state.services, state.counts["late_plots"]
    quiet_s = at.quiet_s(f"{name} messages", messages)
    quiet = f"silent for {quiet_s:.0f} s" if messages else "no messages yet"
    sources = " and ".join(dict.fromkeys(state.sources.values()))
    second = at.recent(f"{name} second", state.counts["second_source"])
    arriving_late = at.recent(f"{name} late", late)
    condition = first(
        at.inactive,
        (WARN, quiet_s > SILENT_S, quiet),
        (WARN, second, f"two sources: {sources} used, {state.other_source} ignored"),
        (WARN, shift_s, f"its clock is {-offset_s:+.1f} s off; its times are shifted"),
        (WARN, arriving_late, f"{late} plots came after their cloud was sent"),
        (OK, True, f"{state.plots} plots in {state.reports} clouds"),
    )
    return status_of(at.node, name, condition, values, f"{number >> 8}/{number & 255}")


def of_output(
    at: Moment, output: str, sent: Counter[str], dropped: Mapping[str, int], clouds: int, hint: str
) -> DiagnosticStatus:
    """Return the status of the output to an address, which is empty for none.

    `dropped` are the numbers of clouds that are not sent, by reason, and `clouds` that of received
    ones. `hint` is the fault of a topic without estimates, empty if they are published.
    """
    counts = {reason: count for reason, count in dropped.items() if reason != "lost"}
    dropping = at.recent("dropped", sum(counts.values()))
    quiet_s = at.quiet_s("estimates", clouds)
    quiet = "; ".join(filter(None, (f"no estimates for {quiet_s:.0f} s", hint)))
    condition = first(
        (OK, not output, "nowhere to send tracks"),
        at.inactive,
        (WARN, dropping, counts_text(counts)),
        (WARN, quiet_s > SILENT_S, quiet),
        (OK, True, f"{sent['tracks']} tracks sent to {output}"),
    )
    return status_of(at.node, "output", condition, {**sent, **counts})
